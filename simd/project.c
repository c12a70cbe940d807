/* SPDX-License-Identifier: Apache-2.0 */
/* Projects the rows of a cluster to splats: tests which are drawn, then packs those and finds their tiles. The maths is
 * in projection.h. */
#include "projection.h"
#include "tiles.h"

/* Computes the range [first, end) of 4-pixel blocks along one axis that have a pixel centre within `extent` of the
 * mean:
 *     first = floor((m - e + 1/2) / 4),  end = floor((m + e - 1/2) / 4) + 1
 * floor(x) being computed as round(x - 1/2). e is slightly larger than `extent`, to cover earlier rounding errors. */
static inline void project_blocks(vm drawn, vf mean, vf extent, float size, int32_t *first, int32_t *end) {
  const vf e = v_fma(extent, v_set(1.00001f), v_fma(v_abs(mean), v_set(1e-6f), v_set(1e-3f)));
  const vf zero = v_zero(), blocks = v_set(ceilf(size * 0.25f)), quarter = v_set(0.25f), half = v_set(0.5f);
  const vf lo = v_mul(v_add(v_sub(mean, e), half), quarter), hi = v_mul(v_sub(v_add(mean, e), half), quarter);
  i_store(first, v_to_i(v_clamp(v_maskz(drawn, v_sub(lo, half)), zero, blocks)));
  i_store(end, v_to_i(v_clamp(v_maskz(drawn, v_add(hi, half)), zero, blocks)));
}

/* The drawn rows of a call, compacted: members of their splats, half the sizes of their boxes, and their numbers. */
enum { PACKED_ROWS = 256 + V_LANES };
typedef struct packed_splats {
  float x[PACKED_ROWS], y[PACKED_ROWS], p[PACKED_ROWS], h[PACKED_ROWS], w[PACKED_ROWS], log2_opacity[PACKED_ROWS];
  float z[PACKED_ROWS], slope[PACKED_ROWS], cut[PACKED_ROWS], floor[PACKED_ROWS];
  float extent_x[PACKED_ROWS], extent_y[PACKED_ROWS];
  int32_t rows[PACKED_ROWS];
  int count;
  pags_project_counts counts;
} packed_splats;

/* Projects the sixteen rows from `first` on and appends those that are drawn to `out`. */
V_INLINE void project_rows(bool rolls, bool bends, const pags_projection *view, const float *data, int64_t stride,
                           const float *factor, int first, int count, uint32_t *keys, pags_reach *reaches,
                           packed_splats *out) {
  projected s;
  scanned scan;
  project_all(&s, rolls ? &scan : NULL, bends, view, data + first, stride);
  if (factor)
    s.opacity = v_mul(s.opacity, v_load(factor + first));
  /* Antialiasing lowers the opacity of what is smaller than a pixel, and the cut of the part with it, but not below
   * 1/255: otherwise what is far away would vanish. */
  vf least = v_set(view->alpha.least), cut = v_set(view->alpha.cut), floor = v_set(view->alpha.floor);
  if (view->antialiased && view->alpha.floor != 0.0f) {
    const vf scale = v_max(s.compensation, v_set(PAGS_ALPHA_MIN / view->alpha.least));
    least = v_mul(least, scale);
    cut = v_add(cut, v_log2(scale));
    floor = v_mul(floor, scale);
  }
  const vf raw = v_log2(v_max(s.opacity, v_set(1e-30f)));
  const vf l = v_add(factor ? raw : v_min(raw, v_zero()), v_set(view->alpha.lift));
  /* Half size of the box in which it is blended (the opacity-aware bound of StopThePop, not 3 sigma). */
  const vf reach = v_mul(v_sub(l, cut), v_set(1.0f / PAGS_HALF_LOG2E));
  const vf extent_x = v_sqrt(v_max(v_mul(reach, s.a), v_zero()));
  const vf extent_y = v_sqrt(v_max(v_mul(reach, s.c), v_zero()));
  /* Comparisons are false for NaN, so a row with any non-finite value that matters drops out here. */
  const vf huge = v_set(1e18f);
  vm drawn = m_and(v_gt(s.depth, v_set(view->near_plane)), v_ge(s.opacity, least));
  if (bends) {
    const vm seen = v_le(s.seen.angle, v_set(view->lens->farthest));
    const vm apart = m_and(v_gt(s.depth, v_set(view->near_plane)), v_lt(s.depth, huge));
    out->counts.beyond += __builtin_popcount(m_bits(m_and(m_andnot(apart, seen), m_first(count - first))));
    drawn = m_and(drawn, seen);
  }
  for (int k = 0; k < view->clip_count; k++) {
    const float *const p = view->clips[k];
    const vf x = rolls ? scan.c0[0] : s.x, y = rolls ? scan.c0[1] : s.y, z = rolls ? scan.c0[2] : s.z;
    const vf inside = v_add(v_dot3(v_set(p[0]), v_set(p[1]), v_set(p[2]), x, y, z), v_set(p[3]));
    drawn = m_and(drawn, v_ge(inside, v_zero()));
  }
  drawn = m_and(drawn, m_and(v_lt(s.a, huge), v_lt(s.c, huge)));
  drawn = m_and(drawn, m_and(v_gt(s.d, v_zero()), v_lt(s.d, v_set(1e36f))));
  drawn = m_and(drawn, m_and(v_gt(v_add(s.mx, extent_x), v_zero()), v_lt(v_sub(s.mx, extent_x), v_set(view->width))));
  drawn = m_and(drawn, m_and(v_gt(v_add(s.my, extent_y), v_zero()), v_lt(v_sub(s.my, extent_y), v_set(view->height))));
  drawn = m_and(drawn, m_and(v_lt(s.depth, huge), m_and(v_lt(v_abs(s.mx), huge), v_lt(v_abs(s.my), huge))));
  drawn = m_and(drawn, m_first(count - first));

  const int lanes = count - first < V_LANES ? count - first : V_LANES;
  int32_t key[V_LANES];
  i_store(key, i_select(drawn, v_bits(s.depth), i_set(-1)));
  memcpy(keys + first, key, (size_t)lanes * sizeof *keys);
  if (m_bits(drawn) == 0)
    return;
  if (reaches) { /* outside of which u^2 + v^2 exceeds the cut-off of the rasteriser's test of blocks (tiles.h) */
    const vf wide = v_mul(v_add(l, v_sub(v_set(PAGS_CUT_SLACK), cut)), v_set(1.0f / PAGS_HALF_LOG2E));
    int32_t x0[V_LANES], x1[V_LANES], y0[V_LANES], y1[V_LANES];
    project_blocks(drawn, s.mx, v_sqrt(v_max(v_mul(wide, s.a), v_zero())), view->width, x0, x1);
    project_blocks(drawn, s.my, v_sqrt(v_max(v_mul(wide, s.c), v_zero())), view->height, y0, y1);
    for (int k = 0; k < lanes; k++)
      reaches[first + k] = (pags_reach){(uint16_t)x0[k], (uint16_t)x1[k], (uint16_t)y0[k], (uint16_t)y1[k]};
  }

  const vf inv_c = v_div(v_set(1.0f), s.c);
  const v_packing packing = v_packing_of(drawn);
  const int at = out->count;
  v_pack(out->x + at, packing, s.mx);
  v_pack(out->y + at, packing, s.my);
  v_pack(out->p + at, packing, v_sqrt(v_div(v_mul(v_set(PAGS_HALF_LOG2E), s.c), s.d)));
  v_pack(out->h + at, packing, v_mul(s.b, inv_c));
  v_pack(out->w + at, packing, v_sqrt(v_mul(v_set(PAGS_HALF_LOG2E), inv_c)));
  v_pack(out->log2_opacity + at, packing, l);
  v_pack(out->z + at, packing, s.depth);
  v_pack(out->slope + at, packing, v_div(s.b, s.a));
  v_pack(out->cut + at, packing, cut);
  v_pack(out->floor + at, packing, floor);
  v_pack(out->extent_x + at, packing, extent_x);
  v_pack(out->extent_y + at, packing, extent_y);
  out->count += i_compress(out->rows + out->count, drawn, i_add(v_to_i(v_iota()), i_set(first)));
  if (rolls)
    out->counts.held += __builtin_popcount(m_bits(drawn) & ~m_bits(scan.found));
}

/* Whether the shutter rolls and a lens bends rays are constants, so that a pinhole has code of its own. */
V_INLINE void pack_rows(bool rolls, bool bends, const pags_projection *view, const float *data, int64_t stride,
                        const float *factor, int count, uint32_t *keys, pags_reach *reaches, packed_splats *packed) {
  packed->count = 0;
  packed->counts = (pags_project_counts){0, 0};
  for (int first = 0; first < count; first += V_LANES)
    project_rows(rolls, bends, view, data, stride, factor, first, count, keys, reaches, packed);
}

pags_project_counts KERNEL(project)(const pags_projection *view, const float *data, int64_t stride, const float *factor,
                                    int count, pags_splat *splats, uint32_t *keys, bool tiles, pags_tile_box *boxes,
                                    pags_reach *reaches) {
  packed_splats packed;
  if (view->lens && view->scan)
    pack_rows(true, true, view, data, stride, factor, count, keys, reaches, &packed);
  else if (view->lens)
    pack_rows(false, true, view, data, stride, factor, count, keys, reaches, &packed);
  else if (view->scan)
    pack_rows(true, false, view, data, stride, factor, count, keys, reaches, &packed);
  else
    pack_rows(false, false, view, data, stride, factor, count, keys, reaches, &packed);

  const int tiles_x = ((int)view->width + PAGS_TILE - 1) / PAGS_TILE,
            tiles_y = ((int)view->height + PAGS_TILE - 1) / PAGS_TILE;
  for (int first = 0; first < packed.count; first += V_LANES) {
    const int n = packed.count - first < V_LANES ? packed.count - first : V_LANES;
    const int32_t *const rows = packed.rows + first;
    const vm there = m_first(n);
#define PACKED(member) v_maskz(there, v_load(packed.member + first))
    const vf none = v_zero();
    vf fields[] = {PACKED(x),     PACKED(y), PACKED(p), PACKED(h), PACKED(w),     PACKED(log2_opacity),
                   none,          none,      none,      PACKED(z), PACKED(slope), PACKED(cut),
                   PACKED(floor), none,      none,      none};
    boxes_found found = {.large = 0};
    if (tiles) {
      found = find_boxes(fields, PACKED(extent_x), PACKED(extent_y), rows, n, tiles_x, tiles_y, boxes);
      fields[SPLAT_AT(tiles)] = v_from_bits(found.tiles);
    } else {
      for (int k = 0; k < n; k++)
        boxes[rows[k]].extent[0] = packed.extent_x[first + k], boxes[rows[k]].extent[1] = packed.extent_y[first + k];
    }
#undef PACKED
    v_transpose(fields);
    for (int k = 0; k < n; k++)
      store_splat(splats + rows[k], fields[k]);
    large_boxes(found.large, rows, splats, boxes);
  }
  return packed.counts;
}
