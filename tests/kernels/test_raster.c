/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the blending kernel for a tile. Compares each ISA with the scalar kernel and all with a direct loop over
 * pixels and splats. A pixel depends only on the splats that reach it. */
#include "check.h"
#include "splats.h"

#include <math.h>
#include <string.h>

enum { STRIDE = 19, PLANE = 15 * STRIDE + 16 };

static const int counts[] = {0, 1, 2, 7, 8, 9, 15, 16, 17, 31, 32, 33, 63, 64, 65, 255, 256, 257, 600};

typedef struct scene {
  pags_splat *splats;
  pags_entry *entries;
  int64_t count;
  int x0, y0, width, height;
  const float *hard; /* a plane of depth limits by pixel, or NULL */
  float eps;         /* transmittance at which pixels stop and become opaque; 0: they don't stop */
} scene;

/* Output of one call, in buffers that end exactly where the kernel may write. */
typedef struct picture {
  float *rgb[3], *transmittance, *depth, *depth_sum;
  int32_t *id;
  uint16_t *masks;
  int64_t pairs[3];
} picture;

static const float background[3] = {0.25f, 0.5f, 0.125f};

/* A tile of splats whose list visits them in random order. With a border the tile extends beyond the picture. */
static scene make_scene(int64_t count, const splat_mix *mix, bool border) {
  scene s = {.splats = CHECK_NEW(pags_splat, count), .entries = CHECK_NEW(pags_entry, count), .count = count};
  s.x0 = 32, s.y0 = 48, s.width = border ? 32 + 1 + check_below(15) : 100,
  s.height = border ? 48 + 1 + check_below(15) : 70;
  for (int64_t i = 0; i < count; i++) {
    s.splats[i] = splat_random(mix);
    s.entries[i] = (pags_entry){.splat = (uint32_t)(count - 1 - i), .rank = check_u32()};
  }
  for (int64_t i = count - 1; i > 0; i--) {
    const int j = check_below((int)i + 1);
    const pags_entry e = s.entries[i];
    s.entries[i] = s.entries[j], s.entries[j] = e;
  }
  check_freeze(s.splats);
  check_freeze(s.entries);
  return s;
}

enum { SUM_ALONE = 2 }; /* values of `channels`: 0 none, 1 all extra channels, 2 only the depth sum */

static picture blend(const pags_kernels *k, const scene *s, int degree, int channels, bool counted) {
  picture p = {.masks = CHECK_NEW(uint16_t, s->count), .pairs = {0, 0, 0}};
  for (int c = 0; c < 3; c++)
    p.rgb[c] = CHECK_NEW(float, PLANE);
  p.transmittance = CHECK_NEW(float, PLANE);
  pags_raster_out out = {.rgb = {p.rgb[0], p.rgb[1], p.rgb[2]}, .transmittance = p.transmittance, .stride = STRIDE};
  memcpy(out.background, background, sizeof background);
  if (channels)
    out.depth_sum = p.depth_sum = CHECK_NEW(float, PLANE);
  if (channels == 1) {
    out.depth = p.depth = CHECK_NEW(float, PLANE);
    out.id = p.id = CHECK_NEW(int32_t, PLANE);
  }
  const pags_raster_in in = {.splats = s->splats,
                             .entries = s->entries,
                             .count = s->count,
                             .x0 = s->x0,
                             .y0 = s->y0,
                             .width = s->width,
                             .height = s->height,
                             .exp_degree = degree,
                             .block_masks = p.masks,
                             .pairs = counted ? p.pairs : NULL,
                             .hard = s->hard,
                             .eps = s->eps};
  k->raster(&in, &out);
  return p;
}

static bool inside(const scene *s, int i) {
  return i % STRIDE < 16 && s->x0 + i % STRIDE < s->width && s->y0 + i / STRIDE < s->height;
}

/* Sets unused pixels outside of the picture to zero; checks that gaps between rows weren't written. */
static void crop(const scene *s, float *plane) {
  static const unsigned char untouched[4] = {0xA5, 0xA5, 0xA5, 0xA5};
  for (int i = 0; plane && i < PLANE; i++) {
    if (i % STRIDE >= 16)
      CHECK(memcmp(plane + i, untouched, sizeof untouched) == 0);
    else if (!inside(s, i))
      plane[i] = 0.0f;
  }
}

static void crop_all(const scene *s, const picture *p) {
  for (int c = 0; c < 3; c++)
    crop(s, p->rgb[c]);
  crop(s, p->transmittance);
  crop(s, p->depth);
  crop(s, p->depth_sum);
  crop(s, (float *)(void *)p->id);
}

static int64_t differ_by(int64_t a, int64_t b) {
  return a < b ? b - a : a - b;
}

static void compare(const picture *got, const picture *want, int64_t count) {
  /* Rounding may add or remove a splat of weight at most 0.0099 at the early stop, and of 1/255 at the cut-off. */
  const double flips = 0.004, size = 0.012;
  for (int c = 0; c < 3; c++)
    CHECK_FLOATS("rgb", got->rgb[c], want->rgb[c], PLANE, .absolute = 3e-6, .flips = flips, .flip_size = size);
  CHECK_FLOATS("transmittance", got->transmittance, want->transmittance, PLANE, .absolute = 3e-6, .flips = flips,
               .flip_size = size);
  int64_t mask_flips = 0;
  for (int64_t i = 0; i < count; i++)
    mask_flips += __builtin_popcount((unsigned)got->masks[i] ^ (unsigned)want->masks[i]);
  CHECK(mask_flips <= (CHECK_EXACT ? 0 : 2 + count * PAGS_TILE_BLOCKS / 100));
  CHECK(got->pairs[1] <= got->pairs[2] && got->pairs[2] <= got->pairs[0]);
  for (int j = 0; j < 3; j++)
    CHECK(differ_by(got->pairs[j], want->pairs[j]) <= (CHECK_EXACT ? 0 : 64 + want->pairs[j] / 100));
  if (!want->depth)
    return;
  CHECK_FLOATS("depth", got->depth, want->depth, PLANE, .absolute = 2e-5, .flips = flips, .flip_size = 4.0);
  CHECK_FLOATS("depth_sum", got->depth_sum, want->depth_sum, PLANE, .absolute = 1e-5, .flips = flips,
               .flip_size = 4 * size);
  int id_flips = 0;
  for (int i = 0; i < PLANE; i++)
    id_flips += got->id[i] != want->id[i];
  CHECK(id_flips <= (CHECK_EXACT ? 0 : 2));
}

static void test_scalar(const pags_kernels *k) {
  const splat_mix *const mixes[] = {&splats_translucent, &splats_opaque, &splats_awkward};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int choice = 0; choice < 8; choice++) {
      const scene s = make_scene(counts[n], mixes[check_below(3)], check_below(2));
      const int degree = choice & 1 ? 3 : 5;
      const picture got = blend(k, &s, degree, choice & 2, choice & 4);
      const picture want = blend(&pags_kernels_scalar, &s, degree, choice & 2, choice & 4);
      crop_all(&s, &got);
      crop_all(&s, &want);
      compare(&got, &want, s.count);
      check_release();
    }
}

/* ---- Against a direct loop ---- */

typedef struct pixel {
  double rgb[3], t, depth_sum, weight, best, marked;
  int32_t id;
} pixel;

enum { MARKS = 200 }; /* number of ids that can be marked */

/* Blends one pixel in double, except for the exponent, which decides the cut-off. `blended` is counted like the
 * kernel's `pairs`. `marks`: a flag for each of MARKS ids, or NULL. */
static pixel blend_pixel(const scene *s, float px, float py, bool fused, const uint8_t *marks, int64_t *blended) {
  pixel out = {.t = 1.0, .id = -1};
  for (int64_t i = 0; i < s->count && out.t > (double)s->eps; i++) {
    const pags_splat *const g = s->splats + s->entries[i].splat;
    const float exponent = splat_exponent(g, px, py, fused);
    if (!(exponent >= g->cut))
      continue;
    const double alpha = fmin((double)PAGS_ALPHA_MAX, exp2((double)exponent) - (double)g->floor), w = alpha * out.t;
    if (out.t - w < (double)PAGS_T_STOP)
      break;
    const float colour[3] = {g->r, g->g, g->b};
    for (int c = 0; c < 3; c++)
      out.rgb[c] += w * (double)colour[c];
    out.depth_sum += w * (double)g->z;
    out.weight += w;
    if (marks && g->id >= 0 && g->id < MARKS && marks[g->id])
      out.marked += w;
    if (w > out.best)
      out.best = w, out.id = g->id;
    out.t -= w;
    ++*blended;
  }
  if (out.t <= (double)s->eps) {
    for (int c = 0; c < 3; c++)
      out.rgb[c] /= 1.0 - out.t;
    out.t = 0.0;
  }
  return out;
}

static picture blend_plainly(const scene *s, bool fused) {
  picture p = {.depth = CHECK_NEW(float, PLANE), .depth_sum = CHECK_NEW(float, PLANE), .id = CHECK_NEW(int32_t, PLANE)};
  for (int c = 0; c < 3; c++)
    p.rgb[c] = CHECK_NEW(float, PLANE);
  p.transmittance = CHECK_NEW(float, PLANE);
  for (int i = 0; i < PLANE; i++) {
    const float px = (float)(s->x0 + i % STRIDE) + 0.5f, py = (float)(s->y0 + i / STRIDE) + 0.5f;
    if (!inside(s, i))
      continue;
    const pixel v = blend_pixel(s, px, py, fused, NULL, &p.pairs[1]);
    for (int c = 0; c < 3; c++)
      p.rgb[c][i] = (float)(v.rgb[c] + v.t * (double)background[c]);
    p.transmittance[i] = (float)v.t;
    p.depth[i] = v.weight > 0.0 ? (float)(v.depth_sum / v.weight) : 0.0f;
    p.depth_sum[i] = (float)v.depth_sum;
    p.id[i] = v.id;
  }
  crop_all(s, &p);
  return p;
}

/* Compares with the direct loop; returns the number of pixels that stop because at most s->eps would come through. */
static int check_plainly(const pags_kernels *k, const scene *s, int degree) {
  /* If only one of the two computations stops at eps = 1/255, the difference is at most 1/255. */
  const double close = degree >= 5 ? 4e-6 : 1.5e-4, flips = 0.004, size = 0.012;
  const picture got = blend(k, s, degree, true, true), want = blend_plainly(s, splat_fused(k));
  crop_all(s, &got);
  for (int c = 0; c < 3; c++)
    CHECK_NEAR("rgb", got.rgb[c], want.rgb[c], PLANE, .absolute = close, .flips = flips, .flip_size = size);
  CHECK_NEAR("transmittance", got.transmittance, want.transmittance, PLANE, .absolute = close, .flips = flips,
             .flip_size = size);
  CHECK_NEAR("depth", got.depth, want.depth, PLANE, .absolute = 4 * close, .flips = flips, .flip_size = 4.0);
  CHECK_NEAR("depth_sum", got.depth_sum, want.depth_sum, PLANE, .absolute = 4 * close, .flips = flips,
             .flip_size = 4 * size);
  int id_flips = 0, closed = 0;
  for (int i = 0; i < PLANE; i++) {
    id_flips += got.id[i] != want.id[i];
    closed += inside(s, i) && got.transmittance[i] == 0.0f;
  }
  CHECK(id_flips <= 2);
  CHECK(differ_by(got.pairs[1], want.pairs[1]) <= (s->eps > 0.0f ? 64 : 3));
  CHECK(got.pairs[0] >= got.pairs[1] && got.pairs[0] <= s->count * PAGS_TILE_PIXELS);
  return closed;
}

static void test_plainly(const pags_kernels *k) {
  const splat_mix *const mixes[] = {&splats_translucent, &splats_opaque, &splats_awkward};
  int closed = 0;
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int choice = 0; choice < 12; choice++) {
      scene s = make_scene(counts[n], mixes[choice / 4], check_below(2));
      s.eps = choice & 1 ? 1.0f / 255.0f : 0.0f;
      const int opaque = check_plainly(k, &s, choice & 2 ? 3 : 5);
      CHECK(s.eps > 0.0f || opaque == 0);
      closed += opaque;
      check_release();
    }
  CHECK(closed > 1000);
}

/* ---- Variable rate: one sample for each 4x4 pixels ---- */

enum { SAMPLES = 16, SAMPLE_STRIDE = 5, SAMPLE_PLANE = 3 * SAMPLE_STRIDE + 4 };

typedef struct samples {
  float *rgb[3], *transmittance, *marked, *depth, *depth_sum;
  int32_t *id;
} samples;

static samples make_samples(bool extra) {
  samples p = {.transmittance = CHECK_NEW(float, SAMPLE_PLANE), .marked = CHECK_NEW(float, SAMPLE_PLANE)};
  for (int c = 0; c < 3; c++)
    p.rgb[c] = CHECK_NEW(float, SAMPLE_PLANE);
  if (extra) {
    p.depth = CHECK_NEW(float, SAMPLE_PLANE);
    p.depth_sum = CHECK_NEW(float, SAMPLE_PLANE);
    p.id = CHECK_NEW(int32_t, SAMPLE_PLANE);
  }
  return p;
}

static samples take_samples(const pags_kernels *k, const scene *s, const uint8_t *marks, float eps, bool extra) {
  const samples p = make_samples(extra);
  pags_raster_out out = {.rgb = {p.rgb[0], p.rgb[1], p.rgb[2]},
                         .transmittance = p.transmittance,
                         .depth = p.depth,
                         .depth_sum = p.depth_sum,
                         .id = p.id,
                         .stride = SAMPLE_STRIDE};
  memcpy(out.background, background, sizeof background);
  const pags_raster_in in = {
      .splats = s->splats, .entries = s->entries, .count = s->count, .x0 = s->x0, .y0 = s->y0, .eps = eps};
  k->sample(&in, marks, MARKS, &out, p.marked);
  return p;
}

static samples sample_plainly(const scene *s, const uint8_t *marks, bool fused) {
  const samples p = make_samples(true);
  int64_t unused = 0;
  for (int i = 0; i < SAMPLES; i++) {
    const int at = i / 4 * SAMPLE_STRIDE + i % 4;
    const float px = (float)(s->x0 + 4 * (i % 4) + 2), py = (float)(s->y0 + 4 * (i / 4) + 2);
    const pixel v = blend_pixel(s, px, py, fused, marks, &unused);
    for (int c = 0; c < 3; c++)
      p.rgb[c][at] = (float)(v.rgb[c] + v.t * (double)background[c]);
    p.transmittance[at] = (float)v.t;
    p.depth[at] = v.weight > 0.0 ? (float)(v.depth_sum / v.weight) : 0.0f;
    p.id[at] = v.id;
    p.marked[at] = (float)v.marked;
  }
  return p;
}

/* Checks the sampling kernel; returns how many samples stopped earlier with an error bound. */
static int check_samples(const pags_kernels *k, const scene *s, const uint8_t *marks, bool extra) {
  const double close = 1.5e-4, flips = 0.004, size = 0.012;
  const samples got = take_samples(k, s, marks, 0.0f, extra), want = sample_plainly(s, marks, splat_fused(k));
  for (int c = 0; c < 3; c++)
    CHECK_NEAR("rgb", got.rgb[c], want.rgb[c], SAMPLE_PLANE, .absolute = close, .flips = flips, .flip_size = size);
  CHECK_NEAR("transmittance", got.transmittance, want.transmittance, SAMPLE_PLANE, .absolute = close, .flips = flips,
             .flip_size = size);
  CHECK_NEAR("marked", got.marked, want.marked, SAMPLE_PLANE, .absolute = close, .flips = flips, .flip_size = size);
  if (extra) {
    CHECK_NEAR("depth", got.depth, want.depth, SAMPLE_PLANE, .absolute = 4 * close, .flips = flips, .flip_size = 4.0);
    int id_flips = 0;
    for (int i = 0; i < SAMPLES; i++)
      id_flips += got.id[i / 4 * SAMPLE_STRIDE + i % 4] != want.id[i / 4 * SAMPLE_STRIDE + i % 4];
    CHECK(id_flips <= 1);
  }
  const samples scalar = take_samples(&pags_kernels_scalar, s, marks, 0.0f, extra);
  CHECK_FLOATS("rgb", got.rgb[0], scalar.rgb[0], SAMPLE_PLANE, .absolute = 3e-6, .flips = flips, .flip_size = size);
  CHECK_FLOATS("marked", got.marked, scalar.marked, SAMPLE_PLANE, .absolute = 3e-6, .flips = flips, .flip_size = size);
  const float eps = 0.05f; /* bound on the weight of the excluded splats */
  const samples bounded = take_samples(k, s, marks, eps, extra);
  int sooner = 0;
  for (int i = 0; i < SAMPLES; i++) {
    const int at = i / 4 * SAMPLE_STRIDE + i % 4;
    const float less = got.transmittance[at] - bounded.transmittance[at];
    CHECK(less == 0.0f || (less <= eps && bounded.transmittance[at] == 0.0f));
    sooner += less > 0.0f;
  }
  return sooner;
}

static void test_samples(const pags_kernels *k) {
  const splat_mix *const mixes[] = {&splats_translucent, &splats_opaque, &splats_awkward};
  int sooner = 0;
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int choice = 0; choice < 6; choice++) {
      uint8_t *const marks = CHECK_NEW(uint8_t, MARKS);
      for (int i = 0; i < MARKS; i++)
        marks[i] = (uint8_t)check_below(2);
      scene s = make_scene(counts[n], mixes[choice / 2], false);
      pags_splat *const splats = CHECK_NEW(pags_splat, s.count);
      for (int64_t i = 0; i < s.count; i++) { /* ids within and beyond the table of marks */
        splats[i] = s.splats[i];
        splats[i].id = check_below(MARKS + 20) - 5;
      }
      s.splats = splats;
      sooner += check_samples(k, &s, marks, choice % 2);
      check_release();
    }
  CHECK(sooner > 100);
}

/* ---- Variations that must not change a bit ---- */

static void check_same_picture(const picture *a, const picture *b, const scene *s) {
  crop_all(s, a);
  crop_all(s, b);
  for (int c = 0; c < 3; c++)
    CHECK_SAME("rgb", a->rgb[c], b->rgb[c], PLANE);
  CHECK_SAME("transmittance", a->transmittance, b->transmittance, PLANE);
  if (a->depth && b->depth) {
    CHECK_SAME("depth", a->depth, b->depth, PLANE);
    CHECK(memcmp(a->id, b->id, PLANE * sizeof *a->id) == 0);
  }
  if (a->depth_sum && b->depth_sum)
    CHECK_SAME("depth_sum", a->depth_sum, b->depth_sum, PLANE);
}

/* Extra channels and the counting of pairs don't change the picture. */
static void test_variants(const pags_kernels *k) {
  for (int round = 0; round < 12; round++) {
    const scene s = make_scene(300, round % 2 ? &splats_opaque : &splats_awkward, round & 2);
    const int degree = round & 4 ? 3 : 5;
    const picture all = blend(k, &s, degree, true, true);
    for (int choice = 0; choice < 6; choice++) {
      const picture other = blend(k, &s, degree, choice % 3, choice / 3);
      check_same_picture(&all, &other, &s);
      CHECK(memcmp(all.masks, other.masks, (size_t)s.count * sizeof *all.masks) == 0);
    }
    check_release();
  }
}

/* Inserted splats that reach no pixel move the others to other places and chunks of the list, and don't change the
 * picture. */
static void test_strangers(const pags_kernels *k) {
  for (int round = 0; round < 12; round++) {
    const scene s = make_scene(150 + check_below(200), round % 2 ? &splats_opaque : &splats_translucent, round & 2);
    scene longer = {.splats = CHECK_NEW(pags_splat, s.count + 1),
                    .entries = CHECK_NEW(pags_entry, 4 * s.count),
                    .x0 = s.x0,
                    .y0 = s.y0,
                    .width = s.width,
                    .height = s.height};
    memcpy(longer.splats, s.splats, (size_t)s.count * sizeof *s.splats);
    longer.splats[s.count] = splat_make(500.0, 500.0, 2.0, 0.0, 2.0, 0.5);
    for (int64_t i = 0; i < s.count; i++) {
      for (int strangers = check_below(4); strangers > 0; strangers--)
        longer.entries[longer.count++] = (pags_entry){.splat = (uint32_t)s.count};
      longer.entries[longer.count++] = s.entries[i];
    }
    const picture a = blend(k, &s, 5, true, false), b = blend(k, &longer, 5, true, false);
    check_same_picture(&a, &b, &s);
    for (int64_t i = 0; i < longer.count; i++)
      CHECK(longer.entries[i].splat != s.count || b.masks[i] == 0);
    check_release();
  }
}

/* One of two sides for each pixel, alternating from pixel to pixel and from block to block. */
static int side_of(int i) {
  return (i % STRIDE + i % STRIDE / 4 + i / STRIDE / 4) % 2;
}

/* With a depth limit for each pixel, a pixel has the bits of a list that holds only the splats within its limit. */
static void test_hard(const pags_kernels *k) {
  for (int round = 0; round < 8; round++) {
    scene s = make_scene(200, round % 2 ? &splats_opaque : &splats_awkward, round & 2);
    const int degree = round & 4 ? 3 : 5;
    const float limit[2] = {s.splats[0].z, s.splats[1].z};
    picture nearer[2];
    for (int side = 0; side < 2; side++) {
      scene kept = s;
      kept.entries = CHECK_NEW(pags_entry, s.count);
      kept.count = 0;
      for (int64_t i = 0; i < s.count; i++)
        if (s.splats[s.entries[i].splat].z <= limit[side])
          kept.entries[kept.count++] = s.entries[i];
      CHECK(kept.count > 0);
      nearer[side] = blend(k, &kept, degree, true, false);
    }
    float *const hard = CHECK_NEW(float, PLANE);
    for (int i = 0; i < PLANE; i++)
      hard[i] = limit[side_of(i)];
    s.hard = hard;
    const picture got = blend(k, &s, degree, true, false), plain = blend(k, &s, degree, false, false);
    check_same_picture(&got, &plain, &s);
    for (int i = 0; i < PLANE; i++) {
      const picture *const want = nearer + side_of(i);
      if (!inside(&s, i))
        continue;
      for (int c = 0; c < 3; c++)
        CHECK_SAME("rgb", got.rgb[c] + i, want->rgb[c] + i, 1);
      CHECK_SAME("transmittance", got.transmittance + i, want->transmittance + i, 1);
      CHECK_SAME("depth", got.depth + i, want->depth + i, 1);
      CHECK(got.id[i] == want->id[i]);
    }
    check_release();
  }
}

/* A pixel has the bits of its own list, which holds only the splats above the cut-off at that pixel. */
static void test_own_list(const pags_kernels *k) {
  for (int round = 0; round < 4; round++) {
    const scene s = make_scene(400, round % 2 ? &splats_opaque : &splats_awkward, false);
    const picture whole = blend(k, &s, 5, true, false);
    for (int i = 0; i < 16; i++) {
      const int x = check_below(16), y = check_below(16), at = y * STRIDE + x;
      scene own = s;
      own.entries = CHECK_NEW(pags_entry, s.count);
      own.count = 0;
      for (int64_t j = 0; j < s.count; j++)
        if (splat_exponent(s.splats + s.entries[j].splat, (float)(s.x0 + x) + 0.5f, (float)(s.y0 + y) + 0.5f,
                           splat_fused(k)) >= s.splats[s.entries[j].splat].cut)
          own.entries[own.count++] = s.entries[j];
      const picture p = blend(k, &own, 5, true, false);
      for (int c = 0; c < 3; c++)
        CHECK_SAME("rgb", p.rgb[c] + at, whole.rgb[c] + at, 1);
      CHECK_SAME("transmittance", p.transmittance + at, whole.transmittance + at, 1);
      CHECK_SAME("depth", p.depth + at, whole.depth + at, 1);
      CHECK(p.id[at] == whole.id[at]);
    }
    check_release();
  }
}

/* A list blended in pieces, each resuming where the previous one ended, gives the bits of the whole list. Entries
 * after the tile is saturated change nothing. Returns whether the tile was saturated before the end. */
static bool blend_in_pieces(const pags_kernels *k, const scene *s, int degree, const picture *whole) {
  picture p = {0};
  for (int c = 0; c < 3; c++)
    p.rgb[c] = CHECK_NEW(float, PLANE);
  p.transmittance = CHECK_NEW(float, PLANE), p.depth = CHECK_NEW(float, PLANE), p.depth_sum = CHECK_NEW(float, PLANE);
  p.id = CHECK_NEW(int32_t, PLANE);
  pags_raster_out out = {.rgb = {p.rgb[0], p.rgb[1], p.rgb[2]},
                         .transmittance = p.transmittance,
                         .depth = p.depth,
                         .depth_sum = p.depth_sum,
                         .best = CHECK_NEW(float, PLANE),
                         .id = p.id,
                         .stride = STRIDE};
  memcpy(out.background, background, sizeof background);
  bool full = false;
  for (int64_t at = 0, next; !full && (at == 0 || at < s->count); at = next) {
    next = at + 1 + check_below(1 + (int)s->count / 3);
    next = next < s->count ? next : s->count;
    const pags_raster_in in = {.splats = s->splats,
                               .entries = s->entries + at,
                               .count = next - at,
                               .x0 = s->x0,
                               .y0 = s->y0,
                               .width = s->width,
                               .height = s->height,
                               .exp_degree = degree,
                               .resume = at > 0,
                               .unfinished = next < s->count,
                               .eps = s->eps};
    full = k->raster(&in, &out) == 0 && next < s->count;
    if (next == s->count)
      break;
  }
  crop_all(s, &p);
  check_same_picture(&p, whole, s);
  return full;
}

static void test_resume(const pags_kernels *k) {
  int full = 0;
  for (int run = 0; run < 60; run++) {
    const splat_mix *const mixes[] = {&splats_translucent, &splats_opaque, &splats_awkward};
    scene s = make_scene(1 + check_below(600), mixes[run % 3], run % 2);
    s.eps = run % 5 < 2 ? 1.0f / 255.0f : 0.0f;
    const int degree = run % 4 < 2 ? 5 : 3;
    const picture whole = blend(k, &s, degree, true, false);
    picture cropped = whole;
    crop_all(&s, &cropped);
    full += blend_in_pieces(k, &s, degree, &cropped);
    check_release();
  }
  CHECK(full > 3);
}

/* The block masks contain every block that a splat changed, and are zero after the entry where all blocks had
 * stopped. */
static void test_masks(const pags_kernels *k) {
  static const splat_mix wall = {39, 55, 41, 57, 40, 60, 1, 0.6f, 0.9f, false};
  const scene s = make_scene(600, &wall, false);
  const picture p = blend(k, &s, 5, false, false);
  int64_t after = s.count;
  while (after > 0 && p.masks[after - 1] == 0)
    after--;
  /* Transmittance falls below the stop after 11 splats of alpha 0.6; the stop is tested every 8 splats. */
  CHECK(after > 4 && after < 64);
  scene head = s;
  head.count = after;
  const picture q = blend(k, &head, 5, false, false);
  check_same_picture(&p, &q, &s);
}

static void test_bench(const pags_kernels *k) {
  static const splat_mix usual = {24, 40, 56, 72, 1.0f, 10, 4, 0.02f, 0.5f, false};
  const scene s = make_scene(256, &usual, false);
  for (int degree = 3; degree <= 5; degree += 2) {
    const picture p = blend(k, &s, degree, false, true);
    pags_raster_out out = {.rgb = {p.rgb[0], p.rgb[1], p.rgb[2]}, .transmittance = p.transmittance, .stride = STRIDE};
    const pags_raster_in in = {.splats = s.splats,
                               .entries = s.entries,
                               .count = s.count,
                               .x0 = s.x0,
                               .y0 = s.y0,
                               .width = s.width,
                               .height = s.height,
                               .exp_degree = degree,
                               .block_masks = p.masks};
    CHECK(p.pairs[0] > 0);
    CHECK_BENCH(degree == 3 ? "raster, degree 3" : "raster, degree 5", p.pairs[0], "lane") k->raster(&in, &out);
    float kept = 0.0f;
    CHECK_BENCH(degree == 3 ? "roofline, degree 3" : "roofline, degree 5", 16 * 1000, "lane")
    kept += k->roofline(s.splats, 1000, degree);
    CHECK(isfinite(kept));
  }
}

static void test_roofline(const pags_kernels *k) {
  const pags_splat s = splat_make(2.0, 2.0, 9.0, 1.0, 9.0, 0.01);
  for (int degree = 3; degree <= 5; degree += 2) {
    const float got = k->roofline(&s, 100, degree), want = pags_kernels_scalar.roofline(&s, 100, degree);
    CHECK_FLOATS("roofline", &got, &want, 1, .relative = 1e-5);
  }
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"raster scalar", test_scalar},       {"raster plainly", test_plainly}, {"raster variants", test_variants},
      {"raster strangers", test_strangers}, {"raster hard", test_hard},       {"raster own list", test_own_list},
      {"raster masks", test_masks},         {"raster resume", test_resume},   {"raster bench", test_bench},
      {"raster samples", test_samples},     {"roofline", test_roofline},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
