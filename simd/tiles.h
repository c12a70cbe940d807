/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the tiles, and the 4x4 blocks of a tile, that a Gaussian can change, and writes the lists of splats per tile.
 * A tile or block is tested by the exact minimum of the Gaussian's quadratic form over the rectangle of its pixel
 * centres, sixteen rectangles at once (exact ellipse-rectangle tests: Radl et al. 2024, Hanson et al. 2025). */
#ifndef PAGS_SIMD_TILES_H
#define PAGS_SIMD_TILES_H

#include "kernel.h"

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

/* ---- Boxes: sixteen splats at once ---- */

/* In this section each lane holds one splat, and the tiles of the boxes are tested in turn. Boxes of more than
 * LANE_TILES tiles are done one by one instead, with their tiles in the lanes. */
enum { LANE_TILES = 9 };

/* Sixteen splats as vectors: the members of pags_splat in their order, one vector each. */
enum { SPLAT_FIELDS = sizeof(pags_splat) / sizeof(float) };
_Static_assert((int)SPLAT_FIELDS == (int)V_LANES && sizeof(pags_tile_box) == 4 * sizeof(float),
               "a splat fills a vector, a box a quarter of one");
#define SPLAT_AT(member) (offsetof(pags_splat, member) / sizeof(float))

/* As vectors, since gcc copies structs in smaller pieces, which loads of whole ones would wait for. */
V_INLINE vf load_splat(const pags_splat *s) {
  return v_load((const float *)(const void *)s);
}
V_INLINE void store_splat(pags_splat *s, vf fields) {
  v_store((float *)(void *)s, fields);
}

/* Returns t clamped to [0, tiles] and rounded down. */
static inline vf tile_floor(vf t, int tiles) {
  const vf cut = v_clamp(t, v_zero(), v_set((float)tiles)), nearest = i_to_v(v_to_i(cut));
  return v_sub(nearest, v_maskz(v_gt(nearest, cut), v_set(1.0f)));
}

/* Result of find_boxes for sixteen splats: the number of tiles that each touches, and a bit for each splat whose box
 * has more than LANE_TILES tiles, which large_boxes tests. */
typedef struct boxes_found {
  vi tiles;
  unsigned large;
} boxes_found;

/* Finds, in each lane, the mask of touched tiles of that splat's box: bit k for tile k, row by row, if the box has 2 to
 * LANE_TILES tiles; 1 for a box of one tile, which is not tested; 0 for other boxes. *tiles: the number of bits. */
V_INLINE vi few_touched(const vf *fields, vf x0, vf y0, vf nx, vf area, vi *tiles) {
  const quadratic q = {fields[SPLAT_AT(p)], fields[SPLAT_AT(h)], fields[SPLAT_AT(w)], fields[SPLAT_AT(slope)]};
  const vf cut = v_add(fields[SPLAT_AT(log2_opacity)], v_sub(v_set(PAGS_CUT_SLACK), fields[SPLAT_AT(cut)]));
  const vf one = v_set(1.0f);
  const vm few = v_le(area, v_set((float)LANE_TILES));
  vi touched = i_select(m_and(v_gt(area, v_zero()), v_le(area, one)), i_set(1), i_set(0));
  *tiles = touched;
  vf column = v_zero(), row = v_zero();
  for (int k = 0; k < LANE_TILES; k++) {
    const vm there = m_and(few, v_gt(area, v_set((float)(k > 0 ? k : 1))));
    if (m_bits(there) == 0)
      break;
    const vm is =
        tile_touched(there, q, cut, fields[SPLAT_AT(x)], fields[SPLAT_AT(y)], v_add(column, x0), v_add(row, y0));
    touched = i_select(is, i_or(touched, i_set(1 << k)), touched);
    *tiles = i_select(is, i_add(*tiles, i_set(1)), *tiles);
    column = v_add(column, one);
    const vm next_row = v_ge(column, nx);
    column = v_select(next_row, v_zero(), column);
    row = v_add(row, v_maskz(next_row, one));
  }
  return touched;
}

/* Finds the boxes of up to sixteen splats, which are members rows[0], rows[1], ... of `boxes`, from half their size.
 * Lanes from `count` on must hold zeros. */
V_INLINE boxes_found find_boxes(const vf *fields, vf extent_x, vf extent_y, const int32_t *rows, int count, int tiles_x,
                                int tiles_y, pags_tile_box *boxes) {
  const vf inv = v_set(1.0f / (float)PAGS_TILE), one = v_set(1.0f), x = fields[SPLAT_AT(x)], y = fields[SPLAT_AT(y)];
  const vf x0 = tile_floor(v_mul(v_sub(x, extent_x), inv), tiles_x),
           x1 = tile_floor(v_fma(v_add(x, extent_x), inv, one), tiles_x);
  const vf y0 = tile_floor(v_mul(v_sub(y, extent_y), inv), tiles_y),
           y1 = tile_floor(v_fma(v_add(y, extent_y), inv, one), tiles_y);
  const vf nx = v_sub(x1, x0), ny = v_sub(y1, y0), area = v_mul(nx, ny);
  const vm some = v_gt(area, v_zero());
  boxes_found found = {.large = m_bits(m_and(m_first(count), v_gt(area, v_set((float)LANE_TILES))))};
  const vi touched = few_touched(fields, x0, y0, nx, area, &found.tiles);

  /* The four words of a pags_tile_box in each lane, then one box in each quarter of a vector. */
  vf words[4] = {v_from_bits(touched), v_zero(), v_maskz(some, v_from_bits(i_or(v_to_i(x0), i_shl(v_to_i(y0), 16)))),
                 v_maskz(some, v_from_bits(i_or(v_to_i(nx), i_shl(v_to_i(ny), 16))))};
  v_transpose4(words);
  float quarters[4][V_LANES];
  for (int k = 0; k < 4; k++)
    v_store(quarters[k], words[k]);
  for (int k = 0; k < count; k++)
    memcpy(boxes + rows[k], quarters[k & 3] + 4 * (k >> 2), sizeof *boxes);
  return found;
}

/* Finds the touched tiles of the larger boxes, and their number. */
static inline void large_boxes(unsigned large, const int32_t *rows, pags_splat *splats, pags_tile_box *boxes) {
  for (; large; large &= large - 1) {
    pags_splat *const s = splats + rows[__builtin_ctz(large)];
    pags_tile_box *const box = boxes + rows[__builtin_ctz(large)];
    const int tiles = box->nx * box->ny;
    s->tiles = 0;
    if (tiles > 64) {
      for (int y = 0; y < box->ny; y++)
        for (int x = 0; x < box->nx; x += V_LANES)
          s->tiles += (uint32_t)__builtin_popcount(
              box_touched(s, box, box->nx - x, v_add(v_iota(), v_set((float)x)), v_set((float)y)));
      continue;
    }
    /* Lane l holds tile (l mod nx, l / nx). The row is computed from l + 0.5, so that rounding errors of the quotient
     * cannot cross a whole number. */
    const vf nx = v_set((float)box->nx), inv_nx = v_set(1.0f / (float)box->nx), half = v_set(0.5f);
    box->touched = 0;
    for (int first = 0; first < tiles; first += V_LANES) {
      const vf l = v_add(v_iota(), v_set((float)first));
      const vf row = i_to_v(v_to_i(v_sub(v_mul(v_add(l, half), inv_nx), half)));
      box->touched |= (uint64_t)box_touched(s, box, tiles - first, v_fnma(row, nx, l), row) << first;
    }
    s->tiles = (uint32_t)__builtin_popcountll(box->touched);
  }
}

#endif
