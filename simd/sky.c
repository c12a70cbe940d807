/* SPDX-License-Identifier: Apache-2.0 */
/* The cube map behind the Gaussians (pags/sky.h): finds the texels behind each pixel, and adds their colour times
 * the transmittance that the Gaussians leave.
 *
 * A cell is the square between four texel centres, named by its top left texel. A pixel's colour is interpolated
 * bilinearly between the four corners of the cell that its direction meets, at the position (along, down) in [0, 1]
 * within the cell. Directions less than half a texel from the border of a face are clamped to the edge of the
 * outermost cell. A map of one texel a side has one cell per face, all of whose corners are that texel. */
#include "kernel.h"

typedef struct sky_cells16 {
  vi row, column; /* of the top left texel; rows count on from face to face */
  vf along, down;
} sky_cells16;

V_INLINE vf sky_negated(vf x) {
  return v_sub(v_zero(), x);
}

/* Converts a position on a face along one axis, -1..1, to the first texel of the cell (returned) and the position
 * 0..1 in the cell (*rest). NaN, which a direction of length 0 gives, becomes the last texel. */
V_INLINE vi sky_axis(vf position, int size, vf *rest) {
  const float half = 0.5f * (float)size;
  const vf last = v_set((float)(size - 1)), last_cell = v_set(size > 1 ? (float)(size - 2) : 0.0f);
  const vf u = v_max(v_min(v_fma(position, v_set(half), v_set(half - 0.5f)), last), v_zero());
  /* A whole u may be rounded to the cell on its left: *rest is 1 then, which is the same point. */
  const vi first = v_to_i(v_min(v_sub(u, v_set(0.5f)), last_cell));
  *rest = v_sub(u, i_to_v(first));
  return first;
}

V_INLINE sky_cells16 sky_cells_of(const pags_sky_rays *rays, int x0, int y) {
  const vf px = v_sub(v_add(v_iota(), v_set((float)x0 + 0.5f)), v_set(rays->cx)),
           py = v_set((float)y + 0.5f - rays->cy);
  vf d[3], a[3];
  vm minus[3];
  for (int k = 0; k < 3; k++) {
    d[k] = v_fma(px, v_set(rays->across[k]), v_fma(py, v_set(rays->downwards[k]), v_set(rays->forward[k])));
    a[k] = v_abs(d[k]);
    minus[k] = v_lt(d[k], v_zero());
  }
  const vm on_x = v_ge_and(v_ge(a[0], a[1]), a[0], a[2]), on_y = v_ge(a[1], a[2]); /* in this order */
  const vf major = v_select(on_x, a[0], v_select(on_y, a[1], a[2]));
  const vf up = sky_negated(d[1]), aside = sky_negated(d[2]);
  const vf s = v_select(on_x, v_select(minus[0], d[2], aside),
                        v_select(on_y, d[0], v_select(minus[2], sky_negated(d[0]), d[0])));
  const vf t = v_select(on_x, up, v_select(on_y, v_select(minus[1], aside, d[2]), up));
  const vi face =
      i_select(on_x, i_select(minus[0], i_set(1), i_set(0)),
               i_select(on_y, i_select(minus[1], i_set(3), i_set(2)), i_select(minus[2], i_set(5), i_set(4))));
  const vf inverse = v_div(v_set(1.0f), major);
  sky_cells16 c;
  c.column = sky_axis(v_mul(s, inverse), rays->size, &c.along);
  c.row = i_add(i_mul(face, i_set(rays->size)), sky_axis(v_mul(t, inverse), rays->size, &c.down));
  return c;
}

/* Computes the bilinear weights of a cell's four corners, times t. */
V_INLINE void sky_weights(vf along, vf down, vf t, vf weight[4]) {
  const vf lower = v_mul(t, down), upper = v_sub(t, lower);
  weight[0] = v_fnma(upper, along, upper), weight[1] = v_mul(upper, along);
  weight[2] = v_fnma(lower, along, lower), weight[3] = v_mul(lower, along);
}

void KERNEL(sky_cells)(const pags_sky_rays *rays, int x0, int y0, int step, int32_t *row, int32_t *column,
                       float *const weight[4]) {
  for (int y = 0; y * step < PAGS_TILE; y++) {
    const sky_cells16 c = sky_cells_of(rays, x0, y0 + y * step);
    vf of_row[4];
    sky_weights(c.along, c.down, v_set(1.0f), of_row);
    i_store(row + y * PAGS_TILE, c.row);
    i_store(column + y * PAGS_TILE, c.column);
    for (int k = 0; k < 4; k++)
      v_store(weight[k] + y * PAGS_TILE, of_row[k]);
  }
}

void KERNEL(sky_find)(const pags_sky_rays *rays, const float *texels, int x0, int y0, pags_sky_tile *tile) {
  for (int y = 0; y < PAGS_TILE; y++) {
    const sky_cells16 cells = sky_cells_of(rays, x0, y0 + y);
    int32_t *const texel = tile->texel + y * PAGS_TILE;
    i_store(texel, i_add(i_mul(cells.row, i_set(rays->size)), cells.column));
    v_store(tile->along + y * PAGS_TILE, cells.along);
    v_store(tile->down + y * PAGS_TILE, cells.down);
    /* Prefetches the texels of sixteen pixels: the map has tens of megabytes, and without prefetching, two thirds of
     * the blending time is spent waiting for it. Every fifth pixel suffices to reach each cache line, as long as
     * neighbouring pixels are at most one texel apart. */
    for (int k = 0; k < V_LANES; k += 5) {
      const float *const at = texels + 3 * (int64_t)texel[k];
      __builtin_prefetch(at, 0, 2);
      __builtin_prefetch(at + 3 * (rays->size > 1 ? rays->size : 0), 0, 2);
    }
  }
}

V_INLINE vf sky_load(const float *const at[4], int64_t on) {
  return v_load_fours(at[0] + on, at[1] + on, at[2] + on, at[3] + on);
}

/* Adds the sky to a tile. Four pixels at a time: each group of four lanes loads red, green, blue and the float after
 * them at once, since gathering lane by lane takes five times as long. Loads read one float beyond a texel's three. The
 * last texel of the map is read from the copy `ending`, since no float follows it. */
void KERNEL(sky_blend)(const pags_sky_rays *rays, const float *texels, const pags_sky_tile *tile, int64_t stride,
                       const float *transmittance, float *const rgb[3]) {
  const int64_t right = rays->size > 1 ? 3 : 0, below = right * rays->size,
                last = 18 * (int64_t)rays->size * rays->size - 3;
  float all[20] = {0.0f}, ending[4] = {texels[last], texels[last + 1], texels[last + 2]};
  const int32_t ending_texel = (int32_t)((last - right - below) / 3);
  if (rays->size == 1) /* all of a cell's corners are one texel, the last's as well */
    texels = memcpy(all, texels, 18 * sizeof *all);
  for (int y = 0; y < PAGS_TILE; y++) {
    const int row = y * PAGS_TILE;
    vf weight[4], colour[4], sky[3];
    const vf t = v_load(transmittance + y * stride);
    if (m_bits(v_gt(t, v_zero())) == 0) /* nothing of the sky is seen */
      continue;
    sky_weights(v_load(tile->along + row), v_load(tile->down + row), t, weight);
    for (int k = 0; k < 4; k++) {
      const float *corner[4], *opposite[4]; /* the top left and the bottom right ones of four pixels' cells */
      for (int i = 0; i < 4; i++) {
        const int32_t texel = tile->texel[row + 4 * k + i];
        corner[i] = texels + 3 * (int64_t)texel;
        opposite[i] = texel == ending_texel ? ending : corner[i] + right + below;
      }
      colour[k] = v_mul(sky_load(corner, 0), v_spread(weight[0], k));
      colour[k] = v_fma(sky_load(corner, right), v_spread(weight[1], k), colour[k]);
      colour[k] = v_fma(sky_load(corner, below), v_spread(weight[2], k), colour[k]);
      colour[k] = v_fma(sky_load(opposite, 0), v_spread(weight[3], k), colour[k]);
    }
    v_columns3(colour, &sky[0], &sky[1], &sky[2]);
    for (int c = 0; c < 3; c++)
      v_store(rgb[c] + y * stride, v_add(v_load(rgb[c] + y * stride), sky[c]));
  }
}

/* Adam (Kingma & Ba 2015). Products and sums are rounded one by one, by which all ISAs give the same bits. */
void KERNEL(sky_adam)(const pags_sky_step *step, int floats, float *colour, float *first, float *second) {
  const vf d1 = v_set(step->decay1), d2 = v_set(step->decay2), eps = v_set(step->eps);
  const vf b1 = v_set(1.0f - step->decay1), b2 = v_set(1.0f - step->decay2);
  for (int i = 0; i < floats; i += 16) {
    const vf rate = v_load(step->rate + i), m = v_load(first + i), v = v_load(second + i), c = v_load(colour + i);
    const vm seen = v_lt(v_zero(), rate);
    const vf g = v_maskz(seen, v_load(step->gradient + i));
    const vf m1 = v_select(seen, v_add(v_mul(d1, m), v_mul(b1, g)), m);
    const vf v1 = v_select(seen, v_add(v_mul(d2, v), v_mul(v_mul(b2, g), g)), v);
    const vf root = v_add(v_sqrt(v_mul(v1, v_load(step->correction + i))), eps);
    v_store(first + i, m1);
    v_store(second + i, v1);
    v_store(colour + i, v_sub(c, v_div(v_mul(rate, m1), root)));
  }
}
