/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the tiles, and the 4x4 blocks of a tile, that a Gaussian can change, and writes the lists of splats per tile.
 * A tile or block is tested by the exact minimum of the Gaussian's quadratic form over the rectangle of its pixel
 * centres, sixteen rectangles at once (exact ellipse-rectangle tests: Radl et al. 2024, Hanson et al. 2025). */

typedef struct quadratic {
  vf p, h, w, slope; /* as in pags_splat */
} quadratic;

static inline quadratic quadratic_of(const pags_splat *s) {
  return (quadratic){v_set(s->p), v_set(s->h), v_set(s->w), v_set(s->slope)};
}

/* Returns the smallest u^2 + v^2 over the rectangle [x0, x1] x [y0, y1], coordinates relative to the mean. A convex
 * quadratic with its minimum at the origin has its minimum over a rectangle on an edge that faces the origin, or at
 * the origin if that lies inside. */
static inline vf quadratic_min(quadratic q, vf x0, vf x1, vf y0, vf y1) {
  const vf zero = v_zero();
  const vf x = v_clamp(zero, x0, x1), y = v_clamp(zero, y0, y1); /* nearest to the origin */
  const vf on_x = v_clamp(v_mul(q.slope, x), y0, y1);            /* best y on the edge at x */
  const vf on_y = v_clamp(v_mul(q.h, y), x0, x1);                /* best x on the edge at y */
  const vf u1 = v_mul(q.p, v_fnma(q.h, on_x, x)), v1 = v_mul(q.w, on_x);
  const vf u2 = v_mul(q.p, v_fnma(q.h, y, on_y)), v2 = v_mul(q.w, y);
  return v_min(v_fma(u1, u1, v_mul(v1, v1)), v_fma(u2, u2, v_mul(v2, v2)));
}

/* Returns the value of u^2 + v^2 above which the splat isn't blended, with PAGS_CUT_SLACK added. */
static inline float cut_off(const pags_splat *s) {
  return s->log2_opacity + (PAGS_CUT_SLACK - s->cut);
}

/* Returns, for each of `lanes`, whether the Gaussian touches the tile at (column, row) of the picture. Mean, cut-off
 * and quadratic may differ from lane to lane. */
static inline vm tile_touched(vm lanes, quadratic q, vf cut, vf mean_x, vf mean_y, vf column, vf row) {
  const vf tile = v_set((float)PAGS_TILE), half = v_set(0.5f), side = v_set((float)(PAGS_TILE - 1));
  const vf x0 = v_sub(v_fma(column, tile, half), mean_x), y0 = v_sub(v_fma(row, tile, half), mean_y);
  return v_ge_and(lanes, cut, quadratic_min(q, x0, v_add(x0, side), y0, v_add(y0, side)));
}

/* Returns a mask whose bit k < `lanes` is set if the splat touches the tile that lane k of (column, row), relative to
 * the box, holds. */
static inline unsigned box_touched(const pags_splat *s, const pags_tile_box *box, int lanes, vf column, vf row) {
  return m_bits(tile_touched(m_first(lanes), quadratic_of(s), v_set(cut_off(s)), v_set(s->x), v_set(s->y),
                             v_add(column, v_set((float)box->x0)), v_add(row, v_set((float)box->y0))));
}

/* Returns the mask of touched tiles, row by row, of a box of at most 64 tiles. */
static inline uint64_t small_box_touched(const pags_splat *s, const pags_tile_box *box) {
  const int tiles = box->nx * box->ny;
  const vf nx = v_set((float)box->nx), inv_nx = v_set(1.0f / (float)box->nx), half = v_set(0.5f);
  uint64_t touched = 0;
  /* Lane l holds tile (l mod nx, l / nx). The row is computed from l + 0.5, so that rounding errors of the quotient
   * cannot cross a whole number. */
  for (int first = 0; first < tiles; first += V_LANES) {
    const vf l = v_add(v_iota(), v_set((float)first));
    const vf row = i_to_v(v_to_i(v_sub(v_mul(v_add(l, half), inv_nx), half)));
    touched |= (uint64_t)box_touched(s, box, tiles - first, v_fnma(row, nx, l), row) << first;
  }
  return touched;
}

/* ---- Boxes: sixteen splats at once ---- */

/* In this section each lane holds one splat, and the tiles of the boxes are tested in turn. Boxes of more than
 * LANE_TILES tiles are done one by one instead, with their tiles in the lanes. */
enum { LANE_TILES = 9 };

typedef struct box_lanes {
  float x[V_LANES], y[V_LANES], p[V_LANES], h[V_LANES], w[V_LANES], slope[V_LANES], cut[V_LANES];
  float extent_x[V_LANES], extent_y[V_LANES];
} box_lanes;

static inline void box_lanes_put(box_lanes *l, int k, const pags_splat *s, const pags_tile_box *box) {
  l->x[k] = s->x, l->y[k] = s->y;
  l->p[k] = s->p, l->h[k] = s->h, l->w[k] = s->w, l->slope[k] = s->slope;
  l->cut[k] = cut_off(s);
  l->extent_x[k] = box->extent[0], l->extent_y[k] = box->extent[1];
}

/* Returns t clamped to [0, tiles] and rounded down. */
static inline vf tile_floor(vf t, int tiles) {
  const vf cut = v_clamp(t, v_zero(), v_set((float)tiles)), nearest = i_to_v(v_to_i(cut));
  return v_sub(nearest, v_maskz(v_gt(nearest, cut), v_set(1.0f)));
}

/* Returns, in each lane, the mask of touched tiles of that splat's box: bit k for tile k, row by row, if the box has
 * 2 to LANE_TILES tiles. 1 for a box of one tile, which is not tested; 0 for larger boxes, which are tested
 * elsewhere. */
static inline vi few_touched(const box_lanes *l, vf x0, vf y0, vf nx, vf tiles) {
  const quadratic q = {v_load(l->p), v_load(l->h), v_load(l->w), v_load(l->slope)};
  const vf x = v_load(l->x), y = v_load(l->y), cut = v_load(l->cut), one = v_set(1.0f);
  const vm few = v_le(tiles, v_set((float)LANE_TILES));
  vi touched = i_select(v_le(tiles, one), i_set(1), i_set(0));
  vf column = v_zero(), row = v_zero();
  for (int k = 0; k < LANE_TILES; k++) {
    const vm there = m_and(few, v_gt(tiles, v_set((float)(k > 0 ? k : 1))));
    if (m_bits(there) == 0)
      break;
    const vm is = tile_touched(there, q, cut, x, y, v_add(column, x0), v_add(row, y0));
    touched = i_select(is, i_or(touched, i_set(1 << k)), touched);
    column = v_add(column, one);
    const vm next_row = v_ge(column, nx);
    column = v_select(next_row, v_zero(), column);
    row = v_add(row, v_maskz(next_row, one));
  }
  return touched;
}

/* Counts the touched tiles of a box of more than 64 tiles. */
static inline uint32_t large_box_tiles(const pags_splat *s, const pags_tile_box *box) {
  uint32_t tiles = 0;
  for (int y = 0; y < box->ny; y++)
    for (int x = 0; x < box->nx; x += V_LANES)
      tiles += (uint32_t)__builtin_popcount(
          box_touched(s, box, box->nx - x, v_add(v_iota(), v_set((float)x)), v_set((float)y)));
  return tiles;
}

/* Computes the boxes, touched tiles and tile counts of up to sixteen splats. */
static inline void box_lanes_finish(const box_lanes *l, const uint16_t *members, int count, int tiles_x, int tiles_y,
                                    pags_splat *splats, pags_tile_box *boxes) {
  const vf inv = v_set(1.0f / (float)PAGS_TILE), one = v_set(1.0f);
  const vf x = v_load(l->x), y = v_load(l->y), extent_x = v_load(l->extent_x), extent_y = v_load(l->extent_y);
  const vf x0 = tile_floor(v_mul(v_sub(x, extent_x), inv), tiles_x),
           x1 = tile_floor(v_fma(v_add(x, extent_x), inv, one), tiles_x);
  const vf y0 = tile_floor(v_mul(v_sub(y, extent_y), inv), tiles_y),
           y1 = tile_floor(v_fma(v_add(y, extent_y), inv, one), tiles_y);
  const vf nx = v_sub(x1, x0), ny = v_sub(y1, y0), tiles = v_mul(nx, ny);
  int32_t column[V_LANES], row[V_LANES], across[V_LANES], down[V_LANES], touched[V_LANES];
  i_store(column, v_to_i(x0));
  i_store(row, v_to_i(y0));
  i_store(across, v_to_i(nx));
  i_store(down, v_to_i(ny));
  i_store(touched, few_touched(l, x0, y0, nx, tiles));
  for (int k = 0; k < count; k++) {
    pags_splat *const s = splats + members[k];
    pags_tile_box *const box = boxes + members[k];
    *box = (pags_tile_box){
        {(uint64_t)touched[k]}, (uint16_t)column[k], (uint16_t)row[k], (uint16_t)across[k], (uint16_t)down[k]};
    const int64_t area = (int64_t)across[k] * down[k];
    if (area <= 0)
      *box = (pags_tile_box){{0}, 0, 0, 0, 0};
    else if (area > LANE_TILES && area <= 64)
      box->touched = small_box_touched(s, box);
    s->tiles = area > 64 ? large_box_tiles(s, box) : (uint32_t)__builtin_popcountll(box->touched);
  }
}

static void tile_boxes(pags_splat *splats, const uint32_t *keys, int count, int tiles_x, int tiles_y,
                       pags_tile_box *boxes) {
  uint16_t members[256 + 1]; /* indices of the splats that are drawn */
  int drawn = 0;
  for (int k = 0; k < count; k++) {
    members[drawn] = (uint16_t)k;
    drawn += keys[k] != UINT32_MAX;
  }
  box_lanes lanes;
  memset(&lanes, 0, sizeof lanes);
  for (int first = 0; first < drawn; first += V_LANES) {
    const int n = drawn - first < V_LANES ? drawn - first : V_LANES;
    for (int k = 0; k < n; k++)
      box_lanes_put(&lanes, k, splats + members[first + k], boxes + members[first + k]);
    box_lanes_finish(&lanes, members + first, n, tiles_x, tiles_y, splats, boxes);
  }
}

/* ---- Lists ---- */

/* The destination of (splat, tile) pairs, which are counted (counts) or written (offsets, entries). */
typedef struct bin_sink {
  int tiles_x;
  uint32_t splat, rank;
  uint32_t *counts;
  int64_t *offsets;
  pags_entry *entries;
  const float *limits; /* per tile, largest z that is drawn; NULL: no limit */
  float z;
  int64_t hidden; /* pairs left out because z exceeds the limit */
} bin_sink;

V_INLINE void bin_tile(bin_sink *sink, int64_t tile, bool fill) {
  if (sink->limits && sink->z > sink->limits[tile]) {
    sink->hidden++;
    return;
  }
  if (fill)
    sink->entries[sink->offsets[tile]++] = (pags_entry){sink->splat, sink->rank};
  else
    sink->counts[tile]++;
  sink->rank++;
}

/* Handles a box of at most 64 tiles. One loop over all touched tiles rather than one per row: the end of a loop whose
 * length varies is a mispredicted branch, which costs as much as several pairs. Tile k is in row k / nx, computed
 * from k + 0.5 so that rounding errors cannot cross a whole number. */
V_INLINE void bin_small(bin_sink *sink, const pags_tile_box *box, bool fill) {
  const int64_t first = (int64_t)box->y0 * sink->tiles_x + box->x0;
  const float inv_nx = 1.0f / (float)box->nx;
  for (uint64_t touched = box->touched; touched; touched &= touched - 1) {
    const int k = __builtin_ctzll(touched), row = (int)(((float)k + 0.5f) * inv_nx);
    bin_tile(sink, first + k + row * (sink->tiles_x - box->nx), fill);
  }
}

V_INLINE void bin_large(bin_sink *sink, const pags_splat *s, const pags_tile_box *box, bool fill) {
  for (int y = 0; y < box->ny; y++)
    for (int x = 0; x < box->nx; x += V_LANES) {
      unsigned bits = box_touched(s, box, box->nx - x, v_add(v_iota(), v_set((float)x)), v_set((float)y));
      for (; bits; bits &= bits - 1)
        bin_tile(sink, (int64_t)(box->y0 + y) * sink->tiles_x + box->x0 + x + __builtin_ctz(bits), fill);
    }
}

/* Counts or writes the pairs of all splats, in the order of `drawn`, which is about that of memory. Returns the
 * number of splats that have a pair. */
V_INLINE int64_t bin_all(const pags_bin *in, bin_sink sink, bool fill, bool limited) {
  int64_t binned = 0;
  for (int64_t i = 0; i < in->count; i++) {
    const uint32_t splat = in->drawn[i];
    const pags_tile_box *const box = in->boxes + splat;
    sink.splat = splat;
    sink.rank = 0;
    if (limited)
      sink.z = in->splats[splat].z;
    else
      sink.limits = NULL;
    if (box->nx * box->ny <= 64)
      bin_small(&sink, box, fill);
    else
      bin_large(&sink, in->splats + splat, box, fill);
    binned += sink.rank > 0;
  }
  if (in->hidden && !fill)
    *in->hidden = sink.hidden;
  return binned;
}

static int64_t bin_count(const pags_bin *in, uint32_t *counts) {
  const bin_sink sink = {.tiles_x = in->tiles_x, .counts = counts, .limits = in->limits};
  return in->limits ? bin_all(in, sink, false, true) : bin_all(in, sink, false, false);
}

static void bin_fill(const pags_bin *in, int64_t *offsets, pags_entry *entries) {
  const bin_sink sink = {.tiles_x = in->tiles_x, .offsets = offsets, .entries = entries, .limits = in->limits};
  if (in->limits)
    bin_all(in, sink, true, true);
  else
    bin_all(in, sink, true, false);
}
