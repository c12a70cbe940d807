/* SPDX-License-Identifier: Apache-2.0 */
/* Tests binning, which computes splats' tile boxes and tiles' splat lists. The lists are well formed and the same on
 * every ISA. They hold every tile and 4x4 block with a pixel that the splat reaches, and few others. The test computes
 * the reached pixels one by one with the rasteriser's float operations, fused and not. */
#include "check.h"
#include "splats.h"

#include <math.h>
#include <string.h>

typedef struct bins {
  int tiles_x, tiles_y;
  int64_t count, splat_count, total;
  pags_splat *splats;
  uint32_t *keys; /* UINT32_MAX: not drawn */
  uint32_t *order, *counts;
  pags_tile_box *boxes;
  int64_t *start; /* beginning of each tile's list, and the end of the last */
  pags_entry *entries;
} bins;

/* Makes `splat_count` splats of which two of three are drawn, in random order. */
static bins make_bins(int64_t splat_count, int tiles_x, int tiles_y) {
  bins b = {.tiles_x = tiles_x, .tiles_y = tiles_y, .splat_count = splat_count, .count = splat_count - splat_count / 3};
  uint32_t all[4096];
  for (int64_t i = 0; i < splat_count; i++) {
    const int j = check_below((int)i + 1);
    all[i] = all[j];
    all[j] = (uint32_t)i;
  }
  b.order = CHECK_NEW(uint32_t, b.count);
  memcpy(b.order, all, (size_t)b.count * sizeof *all);
  check_freeze(b.order);
  b.keys = CHECK_NEW(uint32_t, splat_count);
  for (int64_t i = 0; i < splat_count; i++)
    b.keys[i] = UINT32_MAX;
  for (int64_t i = 0; i < b.count; i++)
    b.keys[b.order[i]] = 1;
  check_freeze(b.keys);
  b.splats = CHECK_NEW(pags_splat, splat_count);
  return b;
}

/* Computes the tile boxes; those of splats that aren't drawn must not be written. */
static void find_boxes(const pags_kernels *k, bins *b) {
  b->boxes = CHECK_NEW(pags_tile_box, b->splat_count);
  memset(b->boxes, 0xA5, (size_t)b->splat_count * sizeof *b->boxes);
  for (int64_t i = 0; i < b->splat_count; i++)
    if (b->keys[i] != UINT32_MAX)
      splat_extent(b->splats + i, b->boxes[i].extent);
  for (int64_t first = 0; first < b->splat_count; first += 256) {
    const int count = b->splat_count - first < 256 ? (int)(b->splat_count - first) : 256;
    k->tile_boxes(b->splats + first, b->keys + first, count, b->tiles_x, b->tiles_y, b->boxes + first);
  }
  pags_tile_box untouched;
  memset(&untouched, 0xA5, sizeof untouched);
  for (int64_t i = 0; i < b->splat_count; i++)
    CHECK(b->keys[i] != UINT32_MAX || memcmp(b->boxes + i, &untouched, sizeof untouched) == 0);
  check_freeze(b->boxes);
  check_freeze(b->splats);
}

static bins bin(const pags_kernels *k, const bins *in) {
  bins b = *in;
  const int64_t tiles = (int64_t)b.tiles_x * b.tiles_y;
  b.splats = CHECK_NEW(pags_splat, b.splat_count);
  memcpy(b.splats, in->splats, (size_t)b.splat_count * sizeof *b.splats);
  b.counts = CHECK_NEW(uint32_t, tiles);
  memset(b.counts, 0, (size_t)tiles * sizeof *b.counts);
  find_boxes(k, &b);
  const pags_bin list = {
      .splats = b.splats, .boxes = b.boxes, .drawn = b.order, .count = b.count, .tiles_x = b.tiles_x};
  k->bin_count(&list, b.counts);
  b.start = CHECK_NEW(int64_t, tiles + 1);
  b.start[0] = 0;
  for (int64_t t = 0; t < tiles; t++)
    b.start[t + 1] = b.start[t] + b.counts[t];
  b.total = b.start[tiles];
  b.entries = CHECK_NEW(pags_entry, b.total);
  int64_t *const offsets = CHECK_NEW(int64_t, tiles);
  memcpy(offsets, b.start, (size_t)tiles * sizeof *offsets);
  k->bin_fill(&list, offsets, b.entries);
  for (int64_t t = 0; t < tiles; t++)
    CHECK(offsets[t] == b.start[t + 1]);
  return b;
}

/* Checks that each tile's list is in the order of `order`, that a splat's entries have the ranks 0, 1, ... in the
 * order of tiles, and that `.tiles` is their number, set only for splats in `order`. */
static void check_lists(const bins *b, const bins *before) {
  int64_t *const position = CHECK_NEW(int64_t, b->splat_count);
  uint32_t *const next_rank = CHECK_NEW(uint32_t, b->splat_count);
  memset(next_rank, 0, (size_t)b->splat_count * sizeof *next_rank);
  for (int64_t i = 0; i < b->splat_count; i++)
    position[i] = -1;
  for (int64_t i = 0; i < b->count; i++)
    position[b->order[i]] = i;
  for (int64_t t = 0; t < (int64_t)b->tiles_x * b->tiles_y; t++) {
    int64_t last = -1;
    for (int64_t i = b->start[t]; i < b->start[t + 1]; i++) {
      const pags_entry e = b->entries[i];
      CHECK(e.rank == next_rank[e.splat]++);
      CHECK(position[e.splat] > last);
      last = position[e.splat];
    }
  }
  for (int64_t i = 0; i < b->splat_count; i++) {
    pags_splat want = before->splats[i];
    if (position[i] >= 0)
      want.tiles = next_rank[i];
    CHECK(memcmp(&want, b->splats + i, sizeof want) == 0);
  }
}

static void compare(const bins *got, const bins *want) {
  const int64_t tiles = (int64_t)got->tiles_x * got->tiles_y;
  /* Each table is compared with the pixels, as two tables may decide differently at a splat's rim. */
  if (!CHECK_EXACT) {
    const int64_t apart = got->total < want->total ? want->total - got->total : got->total - want->total;
    CHECK(apart <= 2 + want->total / 500);
    return;
  }
  CHECK(memcmp(got->counts, want->counts, (size_t)tiles * sizeof *got->counts) == 0);
  CHECK(memcmp(got->boxes, want->boxes, (size_t)got->splat_count * sizeof *got->boxes) == 0);
  CHECK(got->total == want->total &&
        memcmp(got->entries, want->entries, (size_t)got->total * sizeof *got->entries) == 0);
}

/* ---- Which pixels a splat reaches ---- */

/* Returns whether the splat's alpha reaches its cut at the pixel in fused or unfused arithmetic. The two exponents
 * never differ by as much as 1. */
static bool reaches(const pags_splat *s, float px, float py) {
  const float exponent = splat_exponent(s, px, py, false);
  return exponent >= s->cut || (exponent >= s->cut - 1.0f && splat_exponent(s, px, py, true) >= s->cut);
}

/* Returns the mask of the 4x4 blocks with a pixel that the splat reaches, in the tile at (x0, y0) px; 0 for tiles
 * far from the splat's box. */
static unsigned blocks_reached(const pags_splat *s, int x0, int y0) {
  unsigned blocks = 0;
  const float half = 0.5f * PAGS_TILE, margin = half + 16.0f;
  float extent[2];
  splat_extent(s, extent);
  if (fabsf((float)x0 + half - s->x) > extent[0] + margin || fabsf((float)y0 + half - s->y) > extent[1] + margin)
    return 0;
  for (int y = 0; y < PAGS_TILE; y++)
    for (int x = 0; x < PAGS_TILE; x++)
      blocks |= (unsigned)reaches(s, (float)(x0 + x) + 0.5f, (float)(y0 + y) + 0.5f) << (y / 4 * 4 + x / 4);
  return blocks;
}

/* Returns the mask of the 4x4 blocks that the rasteriser evaluates for this splat in this tile. */
static unsigned blocks_listed(const pags_kernels *k, const pags_splat *s, int x0, int y0) {
  float planes[4][PAGS_TILE_PIXELS];
  uint16_t mask;
  const pags_entry entry = {.splat = 0};
  const pags_raster_in in = {.splats = s,
                             .entries = &entry,
                             .count = 1,
                             .x0 = x0,
                             .y0 = y0,
                             .width = 1 << 20,
                             .height = 1 << 20,
                             .exp_degree = 5,
                             .block_masks = &mask};
  const pags_raster_out out = {
      .rgb = {planes[0], planes[1], planes[2]}, .transmittance = planes[3], .stride = PAGS_TILE};
  k->raster(&in, &out);
  return mask;
}

typedef struct waste {
  int64_t tiles, empty_tiles, blocks, empty_blocks;
} waste;

static void check_against_pixels(const pags_kernels *k, const bins *b, waste *w) {
  bool *const listed = CHECK_NEW(bool, b->splat_count);
  for (int64_t t = 0; t < (int64_t)b->tiles_x * b->tiles_y; t++) {
    const int x0 = (int)(t % b->tiles_x) * PAGS_TILE, y0 = (int)(t / b->tiles_x) * PAGS_TILE;
    memset(listed, 0, (size_t)b->splat_count);
    for (int64_t i = b->start[t]; i < b->start[t + 1]; i++)
      listed[b->entries[i].splat] = true;
    for (int64_t i = 0; i < b->count; i++) {
      const pags_splat *const s = b->splats + b->order[i];
      const unsigned reached = blocks_reached(s, x0, y0);
      if (reached && !listed[b->order[i]])
        CHECK_FAIL("splat %u at (%g, %g) reaches pixels of tile %lld, which does not list it", b->order[i],
                   (double)s->x, (double)s->y, (long long)t);
      if (!listed[b->order[i]])
        continue;
      const unsigned blocks = blocks_listed(k, s, x0, y0);
      if (reached & ~blocks)
        CHECK_FAIL("splat %u at (%g, %g): blocks %04x of tile %lld are reached, %04x looked at", b->order[i],
                   (double)s->x, (double)s->y, reached, (long long)t, blocks);
      w->tiles++, w->empty_tiles += !reached;
      w->blocks += __builtin_popcount(blocks), w->empty_blocks += __builtin_popcount(blocks & ~reached);
    }
  }
}

static void check_mix(const pags_kernels *k, const splat_mix *mix, int64_t count, double tile_share,
                      double block_share) {
  waste w = {0, 0, 0, 0};
  bins in = make_bins(count, 9, 7);
  for (int64_t i = 0; i < count; i++)
    in.splats[i] = splat_random(mix);
  const bins got = bin(k, &in), want = bin(&pags_kernels_scalar, &in);
  check_lists(&got, &in);
  compare(&got, &want);
  check_against_pixels(k, &got, &w);
  const double empty_tiles = (double)w.empty_tiles / (double)w.tiles,
               empty_blocks = (double)w.empty_blocks / (double)w.blocks;
  check_note("%lld tiles listed, %.2f %% without a pixel; %lld blocks, %.2f %% without", (long long)w.tiles,
             100.0 * empty_tiles, (long long)w.blocks, 100.0 * empty_blocks);
  CHECK(empty_tiles <= tile_share && empty_blocks <= block_share);
}

/* Small splats have the largest share of needless pairs: a rim between two rows of pixel centres counts as touching. */
static void test_small(const pags_kernels *k) {
  check_mix(k, &(splat_mix){-10, -10, 154, 122, 0.1f, 3, 4, 0.004f, 1.0f, false}, 400, 0.03, 0.015);
}
static void test_large(const pags_kernels *k) {
  check_mix(k, &(splat_mix){-100, -100, 244, 212, 3, 60, 20, 0.004f, 1.0f, false}, 200, 0.03, 0.015);
}
static void test_awkward(const pags_kernels *k) {
  check_mix(k, &(splat_mix){-10, -10, 154, 122, 0.3f, 10, 10, 0.004f, 1.0f, true}, 200, 0.03, 0.015);
}
static void test_needles(const pags_kernels *k) {
  check_mix(k, &(splat_mix){-10, -10, 154, 122, 0.01f, 0.2f, 1e4f, 0.004f, 1.0f, false}, 200, 0.03, 0.015);
}

/* Tile boxes of every shape (n x 1, 1 x n, 2 x n / 2, ...) around two limits: 9 tiles, up to which sixteen splats are
 * tested at once, and 64 tiles, up to which a bit mask of touched tiles is used. */
static void test_shapes(const pags_kernels *k) {
  for (int tall = 0; tall < 2; tall++)
    for (int across = 1; across <= 9; across += across < 3 ? 1 : 3) {
      bins in = make_bins(210, tall ? 9 : 70, tall ? 70 : 9);
      for (int i = 0; i < 210; i++) {
        const double half[2] = {8.0 * (i % 70 + 1) - 2.0, 8.0 * across - 2.0}, k2 = 2.0 * log(254.0);
        const double a = half[tall] * half[tall] / k2, c = half[!tall] * half[!tall] / k2;
        const double b = (i / 70 - 1) * 0.9 * sqrt(a * c);
        in.splats[i] = splat_make(in.tiles_x * 8.0 + (double)check_uniform(-8, 8),
                                  in.tiles_y * 8.0 + (double)check_uniform(-8, 8), a, b, c, 254.0 / 255.0);
      }
      const bins got = bin(k, &in), want = bin(&pags_kernels_scalar, &in);
      check_lists(&got, &in);
      compare(&got, &want);
      if (across == 6) {
        waste w = {0, 0, 0, 0};
        check_against_pixels(k, &got, &w);
      }
      check_release();
    }
}

/* With depth limits per tile, pairs of a larger z are left out and counted. With keys, entries have these in place of
 * ranks. */
static void test_limits(const pags_kernels *k) {
  const splat_mix mix = {-10, -10, 154, 122, 0.3f, 40, 10, 0.004f, 1.0f, true};
  bins in = make_bins(400, 9, 7);
  for (int i = 0; i < 400; i++)
    in.splats[i] = splat_random(&mix);
  const bins all = bin(k, &in);
  float limits[9 * 7];
  for (int t = 0; t < 9 * 7; t++)
    limits[t] = t % 4 == 0 ? -1.0f : t % 4 == 1 ? INFINITY : in.splats[check_below(400)].z;
  uint32_t counts[9 * 7] = {0};
  int64_t hidden = -1, offsets[9 * 7], binned = 0;
  uint32_t *const keys = CHECK_NEW(uint32_t, all.splat_count);
  for (int64_t i = 0; i < all.splat_count; i++) {
    memcpy(keys + i, &all.splats[i].z, sizeof *keys);
    keys[i] |= (uint32_t)(i % 2) << 31; /* the sign isn't part of the depth */
  }
  const pags_bin list = {.splats = all.splats,
                         .boxes = all.boxes,
                         .keys = keys,
                         .drawn = all.order,
                         .count = all.count,
                         .tiles_x = all.tiles_x,
                         .limits = limits,
                         .hidden = &hidden};
  const int64_t said = k->bin_count(&list, counts);
  pags_entry *const entries = CHECK_NEW(pags_entry, all.total);
  memcpy(offsets, all.start, sizeof offsets);
  k->bin_fill(&list, offsets, entries);
  bool *const seen = CHECK_NEW(bool, all.splat_count);
  memset(seen, 0, (size_t)all.splat_count);
  int64_t left = 0;
  for (int t = 0; t < 9 * 7; t++) {
    int64_t place = all.start[t];
    for (int64_t i = all.start[t]; i < all.start[t + 1]; i++) {
      const uint32_t splat = all.entries[i].splat;
      if (all.splats[splat].z > limits[t]) {
        left++;
        continue;
      }
      CHECK(entries[place].splat == splat && entries[place].key == keys[splat]);
      place++;
      binned += !seen[splat];
      seen[splat] = true;
    }
    CHECK(offsets[t] == place && counts[t] == place - all.start[t]);
  }
  CHECK(left > 0 && hidden == left && said == binned);

  const pags_bin unlimited = {.splats = all.splats,
                              .boxes = all.boxes,
                              .keys = keys,
                              .drawn = all.order,
                              .count = all.count,
                              .tiles_x = all.tiles_x};
  memcpy(offsets, all.start, sizeof offsets);
  k->bin_fill(&unlimited, offsets, entries);
  for (int64_t i = 0; i < all.total; i++)
    CHECK(entries[i].splat == all.entries[i].splat && entries[i].key == keys[entries[i].splat]);
}

static void test_counts(const pags_kernels *k) {
  static const int counts[] = {0, 1, 2, 7, 8, 9, 15, 16, 17, 63, 64, 255, 256};
  const splat_mix mix = {-10, -10, 58, 42, 0.3f, 10, 10, 0.004f, 1.0f, true};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    bins in = make_bins(counts[n], 3, 2);
    for (int i = 0; i < counts[n]; i++)
      in.splats[i] = splat_random(&mix);
    const bins got = bin(k, &in), want = bin(&pags_kernels_scalar, &in);
    check_lists(&got, &in);
    compare(&got, &want);
    check_release();
  }
}

static void test_bench(const pags_kernels *k) {
  const splat_mix mix = {0, 0, 640, 480, 0.5f, 12, 4, 0.02f, 1.0f, false};
  bins in = make_bins(4096, 40, 30);
  for (int i = 0; i < 4096; i++)
    in.splats[i] = splat_random(&mix);
  const bins b = bin(k, &in);
  int64_t *const offsets = CHECK_NEW(int64_t, 40 * 30);
  pags_tile_box *const boxes = CHECK_NEW(pags_tile_box, b.splat_count);
  const pags_bin list = {
      .splats = b.splats, .boxes = b.boxes, .drawn = b.order, .count = b.count, .tiles_x = b.tiles_x};
  CHECK(b.total > b.count);
  float *const extents = CHECK_NEW(float, 4096 * 2);
  for (int i = 0; i < 4096; i++)
    splat_extent(in.splats + i, extents + 2 * i);
  CHECK_BENCH("tile_boxes", b.count, "splat")
  for (int first = 0; first < 4096; first += 256) {
    for (int i = first; i < first + 256; i++)
      boxes[i].extent[0] = extents[2 * i], boxes[i].extent[1] = extents[2 * i + 1];
    k->tile_boxes(in.splats + first, in.keys + first, 256, b.tiles_x, b.tiles_y, boxes + first);
  }
  CHECK_BENCH("bin_count", b.count, "splat")
  k->bin_count(&list, b.counts);
  CHECK_BENCH("bin_fill, ranks", b.total, "pair") {
    memcpy(offsets, b.start, 40 * 30 * sizeof *offsets);
    k->bin_fill(&list, offsets, b.entries);
  }
  pags_bin keyed = list;
  keyed.keys = b.keys;
  CHECK_BENCH("bin_fill, keys", b.total, "pair") {
    memcpy(offsets, b.start, 40 * 30 * sizeof *offsets);
    k->bin_fill(&keyed, offsets, b.entries);
  }
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"bin small", test_small},     {"bin large", test_large},   {"bin awkward", test_awkward},
      {"bin needles", test_needles}, {"bin shapes", test_shapes}, {"bin limits", test_limits},
      {"bin counts", test_counts},   {"bin bench", test_bench},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
