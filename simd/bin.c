/* SPDX-License-Identifier: Apache-2.0 */
/* The lists of splats per tile: which tiles each splat touches (tiles.h), their number, and the lists. */
#include "tiles.h"

void KERNEL(tile_boxes)(pags_splat *splats, const uint32_t *keys, int count, int tiles_x, int tiles_y,
                        pags_tile_box *boxes) {
  int32_t rows[256 + 1]; /* indices of the splats that are drawn */
  int drawn = 0;
  for (int k = 0; k < count; k++) {
    rows[drawn] = k;
    drawn += keys[k] != UINT32_MAX;
  }
  for (int first = 0; first < drawn; first += V_LANES) {
    const int n = drawn - first < V_LANES ? drawn - first : V_LANES;
    vf fields[SPLAT_FIELDS];
    float extent_x[V_LANES] = {0}, extent_y[V_LANES] = {0};
    for (int k = 0; k < n; k++) {
      fields[k] = load_splat(splats + rows[first + k]);
      extent_x[k] = boxes[rows[first + k]].extent[0];
      extent_y[k] = boxes[rows[first + k]].extent[1];
    }
    for (int k = n; k < SPLAT_FIELDS; k++)
      fields[k] = v_zero();
    v_transpose(fields);
    const boxes_found found =
        find_boxes(fields, v_load(extent_x), v_load(extent_y), rows + first, n, tiles_x, tiles_y, boxes);
    int32_t tiles[V_LANES];
    i_store(tiles, found.tiles);
    for (int k = 0; k < n; k++)
      splats[rows[first + k]].tiles = (uint32_t)tiles[k];
    large_boxes(found.large, rows + first, splats, boxes);
  }
}

/* ---- Lists ---- */

/* Pairs are made for BIN_SPLATS splats at a time: first the tiles of each splat are written down without a branch, then
 * one loop goes through all of these pairs. The end of a loop whose length varies is a mispredicted branch, which costs
 * as much as several pairs. */
enum { BIN_SPLATS = 16, BIN_PAIRS = 1024 };

typedef struct bin_batch {
  uint32_t splat[BIN_SPLATS], key[BIN_SPLATS], rank[BIN_SPLATS]; /* rank: of the next entry */
  float z[BIN_SPLATS];
  uint8_t some[BIN_SPLATS]; /* 1: the splat has a pair */
  int pairs;
  int32_t pair[BIN_PAIRS + V_LANES]; /* BIN_SPLATS * tile + splat of the batch */
} bin_batch;

/* What is done with a pair: constant in each function made from it. */
typedef struct bin_how {
  bool fill, limited, ranks;
} bin_how;

V_INLINE void bin_pairs(const pags_bin *in, bin_batch *b, uint32_t *counts, int64_t *offsets, pags_entry *entries,
                        bin_how how, int64_t *hidden) {
  for (int i = 0; i < b->pairs; i++) {
    const unsigned pair = (unsigned)b->pair[i], k = pair % BIN_SPLATS;
    const int64_t tile = pair / BIN_SPLATS;
    if (how.limited && b->z[k] > in->limits[tile]) {
      ++*hidden;
      continue;
    }
    if (!how.fill) {
      counts[tile]++;
      b->some[k] = 1;
    } else if (how.ranks) {
      entries[offsets[tile]++] = (pags_entry){.splat = b->splat[k], .rank = b->rank[k]++};
    } else {
      entries[offsets[tile]++] = (pags_entry){.splat = b->splat[k], .key = b->key[k]};
    }
  }
  b->pairs = 0;
}

/* l / n in lane l, for n = 0 (unused) to FEW_TILES. */
enum { FEW_TILES = 8 };
static const int32_t bin_rows[FEW_TILES + 1][V_LANES] __attribute__((aligned(64))) = {
    {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}, {0, 1, 2, 3, 4, 5, 6, 7, 0, 0, 0, 0, 0, 0, 0, 0},
    {0, 0, 1, 1, 2, 2, 3, 3, 0, 0, 0, 0, 0, 0, 0, 0}, {0, 0, 0, 1, 1, 1, 2, 2, 0, 0, 0, 0, 0, 0, 0, 0},
    {0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0}, {0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0},
    {0, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0}, {0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0},
    {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0},
};

/* Writes down the tiles of a larger box, a row of sixteen at a time; goes through the pairs whenever there is no room
 * for more. */
V_INLINE void bin_many(const pags_bin *in, bin_batch *b, int k, uint32_t *counts, int64_t *offsets, pags_entry *entries,
                       bin_how how, int64_t *hidden) {
  const pags_tile_box *const box = in->boxes + b->splat[k];
  const bool masked = box->nx * box->ny <= 64;
  for (int y = 0; y < box->ny; y++)
    for (int x = 0; x < box->nx; x += V_LANES) {
      const int left = box->nx - x < V_LANES ? box->nx - x : V_LANES;
      const unsigned bits =
          masked ? (unsigned)(box->touched >> (y * box->nx + x)) & ((1u << left) - 1)
                 : box_touched(in->splats + b->splat[k], box, left, v_add(v_iota(), v_set((float)x)), v_set((float)y));
      const int first = (box->y0 + y) * in->tiles_x + box->x0 + x;
      if (b->pairs > BIN_PAIRS - V_LANES)
        bin_pairs(in, b, counts, offsets, entries, how, hidden);
      b->pairs += i_compress(b->pair + b->pairs, m_from_bits(bits),
                             i_add(i_shl(i_add(i_set(first), v_to_i(v_iota())), 4), i_set(k)));
    }
}

/* Counts or writes the pairs of all splats, in the order of `drawn`, which is about that of memory. Returns, if they
 * are counted, the number of splats that have a pair. */
V_INLINE int64_t bin_all(const pags_bin *in, uint32_t *counts, int64_t *offsets, pags_entry *entries, bin_how how) {
  int64_t binned = 0, hidden = 0;
  bin_batch b;
  b.pairs = 0;
  for (int64_t first = 0; first < in->count; first += BIN_SPLATS) {
    const int n = in->count - first < BIN_SPLATS ? (int)(in->count - first) : BIN_SPLATS;
    for (int k = 0; k < n; k++) {
      const uint32_t splat = b.splat[k] = in->drawn[first + k];
      const pags_tile_box *const box = in->boxes + splat;
      b.some[k] = 0;
      b.rank[k] = 0;
      if (how.fill && !how.ranks)
        b.key[k] = in->keys[splat];
      if (how.limited) {
        const uint32_t bits = in->keys[splat] & INT32_MAX; /* the paper's order sets the sign */
        memcpy(b.z + k, &bits, sizeof bits);
      }
      if (b.pairs > BIN_PAIRS - V_LANES)
        bin_pairs(in, &b, counts, offsets, entries, how, &hidden);
      if (box->nx * box->ny <= FEW_TILES) { /* tile l is in row l / nx */
        const vi row = i_load(bin_rows[box->nx]);
        const vi tile = i_add(i_mul(row, i_set(in->tiles_x - box->nx)), i_set(box->y0 * in->tiles_x + box->x0));
        const vi pair = i_add(i_shl(i_add(tile, v_to_i(v_iota())), 4), i_set(k));
        b.pairs += i_compress8(b.pair + b.pairs, (unsigned)box->touched, pair);
      } else {
        bin_many(in, &b, k, counts, offsets, entries, how, &hidden);
      }
    }
    bin_pairs(in, &b, counts, offsets, entries, how, &hidden);
    if (!how.fill)
      for (int k = 0; k < n; k++)
        binned += b.some[k];
  }
  if (in->hidden && !how.fill)
    *in->hidden = hidden;
  return binned;
}

int64_t KERNEL(bin_count)(const pags_bin *in, uint32_t *counts) {
  return in->limits ? bin_all(in, counts, NULL, NULL, (bin_how){.limited = true})
                    : bin_all(in, counts, NULL, NULL, (bin_how){0});
}

void KERNEL(bin_fill)(const pags_bin *in, int64_t *offsets, pags_entry *entries) {
  if (in->limits)
    bin_all(in, NULL, offsets, entries, (bin_how){.fill = true, .limited = true});
  else if (in->keys)
    bin_all(in, NULL, offsets, entries, (bin_how){.fill = true});
  else
    bin_all(in, NULL, offsets, entries, (bin_how){.fill = true, .ranks = true});
}
