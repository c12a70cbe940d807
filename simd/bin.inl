/* Which tiles, and which 4x4 blocks of a tile, a Gaussian can change: the exact minimum of its quadratic over the rectangle of pixel
 * centres, sixteen rectangles at once (the idea of exact ellipse-rectangle tests: Radl et al. 2024, Hanson et al. 2025). */

/* Smallest u^2 + v^2 over [x0, x1] x [y0, y1], all relative to the mean. A convex quadratic with its minimum at the origin
 * has its minimum over a rectangle on an edge that faces the origin, or at the origin. */
static inline vf quadratic_min(const pags_splat *s, vf x0, vf x1, vf y0, vf y1) {
  const vf zero = v_zero(), p = v_set(s->p), h = v_set(s->h), w = v_set(s->w);
  const vf x = v_clamp(zero, x0, x1), y = v_clamp(zero, y0, y1); /* nearest to the origin */
  const vf on_x = v_clamp(v_mul(v_set(s->slope), x), y0, y1);    /* best y on the edge at x */
  const vf on_y = v_clamp(v_mul(h, y), x0, x1);                  /* best x on the edge at y */
  const vf u1 = v_mul(p, v_fnma(h, on_x, x)), v1 = v_mul(w, on_x);
  const vf u2 = v_mul(p, v_fnma(h, y, on_y)), v2 = v_mul(w, y);
  return v_min(v_fma(u1, u1, v_mul(v1, v1)), v_fma(u2, u2, v_mul(v2, v2)));
}

static inline float cut_off(const pags_splat *s) { return s->log2_opacity + (PAGS_LOG2_255 + PAGS_CUT_SLACK); }

static inline int tile_clamp(float t, int tiles) { return t < 0.0f ? 0 : t > (float)tiles ? tiles : (int)t; }

typedef struct tile_box { /* the tiles that the splat's bounding box meets, numbered row by row from 0 */
  int x0, y0, nx, ny;
} tile_box;

static inline tile_box tile_box_of(const pags_splat *s, int tiles_x, int tiles_y) {
  const float inv = 1.0f / (float)PAGS_TILE;
  const int x0 = tile_clamp((s->x - s->extent_x) * inv, tiles_x), x1 = tile_clamp((s->x + s->extent_x) * inv + 1.0f, tiles_x);
  const int y0 = tile_clamp((s->y - s->extent_y) * inv, tiles_y), y1 = tile_clamp((s->y + s->extent_y) * inv + 1.0f, tiles_y);
  return (tile_box){x0, y0, x1 - x0, y1 - y0};
}

/* Bit k < lanes: the tile at (column, row) of the box in lane k is touched. */
static inline unsigned box_touched(const pags_splat *s, tile_box box, int lanes, vf column, vf row) {
  const vf tile = v_set((float)PAGS_TILE), half = v_set(0.5f), side = v_set((float)(PAGS_TILE - 1));
  const vf x0 = v_sub(v_fma(v_add(column, v_set((float)box.x0)), tile, half), v_set(s->x));
  const vf y0 = v_sub(v_fma(v_add(row, v_set((float)box.y0)), tile, half), v_set(s->y));
  return m_bits(v_ge_and(m_first(lanes), v_set(cut_off(s)), quadratic_min(s, x0, v_add(x0, side), y0, v_add(y0, side))));
}

/* All of a box of at most 64 tiles. */
static inline uint64_t small_box_touched(const pags_splat *s, tile_box box) {
  const int tiles = box.nx * box.ny;
  if (tiles == 1)
    return 1;
  const vf nx = v_set((float)box.nx), inv_nx = v_set(1.0f / (float)box.nx), half = v_set(0.5f);
  uint64_t touched = 0;
  for (int first = 0; first < tiles; first += V_LANES) { /* lane l is tile (l mod nx, l / nx); + 0.5 keeps l / nx off whole numbers */
    const vf l = v_add(v_iota(), v_set((float)first));
    const vf row = i_to_v(v_to_i(v_sub(v_mul(v_add(l, half), inv_nx), half)));
    touched |= (uint64_t)box_touched(s, box, tiles - first, v_fnma(row, nx, l), row) << first;
  }
  return touched;
}

/* Where pairs are counted or written. */
typedef struct bin_sink {
  int tiles_x;
  uint32_t splat, rank;
  uint32_t *counts;
  int64_t *offsets;
  pags_entry *entries;
  const float *limits; /* per tile; NULL: none */
  float z;
  int64_t hidden;
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

V_INLINE void bin_small(bin_sink *sink, tile_box box, uint64_t touched, bool fill) {
  int64_t row_tile = (int64_t)box.y0 * sink->tiles_x + box.x0;
  const uint64_t row_bits = box.nx < 64 ? (UINT64_C(1) << box.nx) - 1 : ~UINT64_C(0);
  for (int y = 0; y < box.ny; y++, row_tile += sink->tiles_x) {
    for (uint64_t bits = touched & row_bits; bits; bits &= bits - 1)
      bin_tile(sink, row_tile + __builtin_ctzll(bits), fill);
    touched = box.nx < 64 ? touched >> box.nx : 0;
  }
}

V_INLINE void bin_large(bin_sink *sink, const pags_splat *s, tile_box box, bool fill) {
  for (int y = 0; y < box.ny; y++)
    for (int x = 0; x < box.nx; x += V_LANES) {
      const vf column = v_add(v_iota(), v_set((float)x));
      unsigned bits = box_touched(s, box, box.nx - x, column, v_set((float)y));
      for (; bits; bits &= bits - 1)
        bin_tile(sink, (int64_t)(box.y0 + y) * sink->tiles_x + box.x0 + x + __builtin_ctz(bits), fill);
    }
}

enum { BIN_AHEAD = 12 }; /* splats are met in depth order, which is no order in memory */

V_INLINE int64_t bin_count_with(pags_splat *splats, const uint32_t *order, int64_t count, int tiles_x, int tiles_y,
                                const float *limits, uint64_t *touched, uint32_t *counts, int64_t *hidden) {
  int64_t binned = 0, left_out = 0;
  for (int64_t i = 0; i < count; i++) {
    pags_splat *const s = splats + order[i];
    if (i + BIN_AHEAD < count)
      __builtin_prefetch(splats + order[i + BIN_AHEAD], 1);
    const tile_box box = tile_box_of(s, tiles_x, tiles_y);
    bin_sink sink = {.tiles_x = tiles_x, .counts = counts, .limits = limits, .z = s->z};
    touched[i] = 0;
    if (box.nx > 0 && box.ny > 0 && (int64_t)box.nx * box.ny <= 64)
      bin_small(&sink, box, touched[i] = small_box_touched(s, box), false);
    else if (box.nx > 0 && box.ny > 0)
      bin_large(&sink, s, box, false);
    s->tiles = sink.rank;
    binned += sink.rank > 0;
    left_out += sink.hidden;
  }
  if (hidden)
    *hidden = left_out;
  return binned;
}

static int64_t bin_count(pags_splat *splats, const uint32_t *order, int64_t count, int tiles_x, int tiles_y, const float *limits,
                         uint64_t *touched, uint32_t *counts, int64_t *hidden) {
  if (limits)
    return bin_count_with(splats, order, count, tiles_x, tiles_y, limits, touched, counts, hidden);
  return bin_count_with(splats, order, count, tiles_x, tiles_y, NULL, touched, counts, hidden);
}

V_INLINE void bin_fill_with(const pags_splat *splats, const uint32_t *order, int64_t count, int tiles_x, int tiles_y,
                            const float *limits, const uint64_t *touched, int64_t *offsets, pags_entry *entries) {
  for (int64_t i = 0; i < count; i++) {
    const pags_splat *const s = splats + order[i];
    if (i + BIN_AHEAD < count)
      __builtin_prefetch(splats + order[i + BIN_AHEAD]);
    if (s->tiles == 0)
      continue;
    const tile_box box = tile_box_of(s, tiles_x, tiles_y);
    bin_sink sink = {.tiles_x = tiles_x, .splat = order[i], .offsets = offsets, .entries = entries, .limits = limits, .z = s->z};
    if ((int64_t)box.nx * box.ny <= 64)
      bin_small(&sink, box, touched[i], true);
    else
      bin_large(&sink, s, box, true);
  }
}

static void bin_fill(const pags_splat *splats, const uint32_t *order, int64_t count, int tiles_x, int tiles_y, const float *limits,
                     const uint64_t *touched, int64_t *offsets, pags_entry *entries) {
  if (limits)
    bin_fill_with(splats, order, count, tiles_x, tiles_y, limits, touched, offsets, entries);
  else
    bin_fill_with(splats, order, count, tiles_x, tiles_y, NULL, touched, offsets, entries);
}
