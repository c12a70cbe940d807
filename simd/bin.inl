/* Which tiles, and which 4x4 blocks of a tile, a Gaussian can change: the exact minimum of its quadratic over the rectangle of pixel
 * centres, sixteen rectangles at once (the idea of exact ellipse-rectangle tests: Radl et al. 2024, Hanson et al. 2025). */

/* Added to the cut-off, in powers of two: the rasteriser's rounding of u^2 + v^2 must never find a pixel that these tests
 * ruled out. u carries an error of about 2^-23 p |d| <= 1e-3 for |d| <= 4096 px, hence u^2 at most 0.01. */
#define PAGS_CUT_SLACK 0.02f

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

/* Calls for each touched tile, row by row. Boxes narrower than a vector are flattened into it. */
static inline uint32_t bin_one(const pags_splat *s, uint32_t splat, int tiles_x, int tiles_y, uint32_t *counts, int64_t *offsets,
                               pags_entry *entries) {
  const float inv = 1.0f / (float)PAGS_TILE;
  const int tx0 = tile_clamp((s->x - s->extent_x) * inv, tiles_x), tx1 = tile_clamp((s->x + s->extent_x) * inv + 1.0f, tiles_x);
  const int ty0 = tile_clamp((s->y - s->extent_y) * inv, tiles_y), ty1 = tile_clamp((s->y + s->extent_y) * inv + 1.0f, tiles_y);
  const int nx = tx1 - tx0, ny = ty1 - ty0;
  if (nx <= 0 || ny <= 0)
    return 0;
  const bool flat = nx < V_LANES;
  const int groups = flat ? (nx * ny + V_LANES - 1) / V_LANES : ny * ((nx + V_LANES - 1) / V_LANES);
  const int groups_per_row = (nx + V_LANES - 1) / V_LANES;
  const vf cut = v_set(cut_off(s)), inv_nx = v_set(1.0f / (float)nx);
  uint32_t rank = 0;
  for (int group = 0; group < groups; group++) {
    vf column, row;
    vm inside;
    if (flat) { /* lane l is tile (l mod nx, l / nx); + 0.5 keeps the product off whole numbers */
      const vf l = v_add(v_iota(), v_set((float)(group * V_LANES)));
      row = v_sub(v_mul(v_add(l, v_set(0.5f)), inv_nx), v_set(0.5f));
      row = i_to_v(v_to_i(row));
      column = v_fnma(row, v_set((float)nx), l);
      inside = m_first(nx * ny - group * V_LANES);
    } else {
      const int start = group % groups_per_row * V_LANES;
      row = v_set((float)(group / groups_per_row));
      column = v_add(v_iota(), v_set((float)start));
      inside = m_first(nx - start);
    }
    const vf x0 = v_sub(v_fma(v_add(column, v_set((float)tx0)), v_set(PAGS_TILE), v_set(0.5f)), v_set(s->x));
    const vf y0 = v_sub(v_fma(v_add(row, v_set((float)ty0)), v_set(PAGS_TILE), v_set(0.5f)), v_set(s->y));
    const vf side = v_set((float)(PAGS_TILE - 1));
    const vm touched = v_ge_and(inside, cut, quadratic_min(s, x0, v_add(x0, side), y0, v_add(y0, side)));
    const vf tile = v_fma(v_add(row, v_set((float)ty0)), v_set((float)tiles_x), v_add(column, v_set((float)tx0)));
    int32_t list[2 * V_LANES];
    const int n = i_compress(list, touched, v_to_i(tile));
    for (int k = 0; k < n; k++) {
      if (counts)
        counts[list[k]]++;
      else
        entries[offsets[list[k]]++] = (pags_entry){splat, rank + (uint32_t)k};
    }
    rank += (uint32_t)n;
  }
  return rank;
}

static void bin_count(pags_splat *splats, const uint32_t *order, int64_t count, int tiles_x, int tiles_y, uint32_t *counts) {
  for (int64_t i = 0; i < count; i++)
    splats[order[i]].tiles = bin_one(splats + order[i], order[i], tiles_x, tiles_y, counts, NULL, NULL);
}

static void bin_fill(const pags_splat *splats, const uint32_t *order, int64_t count, int tiles_x, int tiles_y, int64_t *offsets,
                     pags_entry *entries) {
  for (int64_t i = 0; i < count; i++)
    if (splats[order[i]].tiles)
      bin_one(splats + order[i], order[i], tiles_x, tiles_y, NULL, offsets, entries);
}
