/* SPDX-License-Identifier: Apache-2.0 */
/* A camera's vignette and response curve (pags/photometric.h) over a row of pixels, and its gradient. With the squared
 * distance q and the value x,
 *
 *   u = b x,  b = base + v_0 q + v_1 max(q - 1/3, 0) + v_2 max(q - 2/3, 0), at least 0.01
 *   f(u) = u + sum r_i max(min(u, 1) - i/6, 0)
 *
 * both piecewise linear, written as changes of slope. With w_j the rise of the curve's piece j and c_j =
 * min(max(6 u - j, 0), 1), the gradient by the logarithm of its slope is w_j (c_j - f) where 0 < u < 1, and that by a
 * number of the vignette is f' x times its share in b: a hat around q = k/3, the last ones straight on beyond 1. */
#include "kernel.h"

typedef struct light_pixels {
  vf q, bright;
} light_pixels;

V_INLINE vf light_positive(vf x) {
  return v_max(x, v_zero());
}

V_INLINE light_pixels light_find(const pags_light_row *in, int i) {
  light_pixels p;
  const vf x = v_sub(v_add(v_iota(), v_set((float)i + 0.5f)), v_set(in->cx));
  p.q = v_mul(v_fma(x, x, v_set(in->y_squared)), v_set(in->per_corner));
  vf b = v_fma(v_set(in->vignette[1]), p.q, v_set(in->vignette[0]));
  b = v_fma(v_set(in->vignette[2]), light_positive(v_sub(p.q, v_set(1.0f / 3.0f))), b);
  b = v_fma(v_set(in->vignette[3]), light_positive(v_sub(p.q, v_set(2.0f / 3.0f))), b);
  p.bright = v_max(b, v_set(0.01f));
  return p;
}

V_INLINE vf light_curve(const pags_light_row *in, vf u) {
  const vf within = v_min(u, v_set(1.0f));
  vf f = u;
  for (int k = 0; k < PAGS_LIGHT_BENDS; k++)
    f = v_fma(v_set(in->bends[k]), light_positive(v_sub(within, v_set((float)k / PAGS_LIGHT_BENDS))), f);
  return f;
}

void KERNEL(light_row)(const pags_light_row *in) {
  for (int i = 0; i < in->width; i += V_LANES) {
    const light_pixels p = light_find(in, i);
    for (int c = 0; c < 3; c++)
      v_store(in->planes[c] + i, light_curve(in, v_mul(p.bright, v_load(in->rgb[c] + i))));
  }
}

void KERNEL(light_back)(const pags_light_row *in, double by_vignette[4], double by_rises[PAGS_LIGHT_BENDS]) {
  const vf zero = v_zero(), one = v_set(1.0f), two = v_set(2.0f);
  vf hats[4] = {zero, zero, zero, zero}, rises[PAGS_LIGHT_BENDS], all = zero;
  for (int k = 0; k < PAGS_LIGHT_BENDS; k++)
    rises[k] = zero;
  for (int i = 0; i < in->width; i += V_LANES) {
    const vm use = m_first(in->width - i);
    const light_pixels p = light_find(in, i);
    vf by_bright = zero;
    for (int c = 0; c < 3; c++) {
      const vf value = v_maskz(use, v_load(in->rgb[c] + i)), by_y = v_maskz(use, v_load(in->planes[c] + i));
      const vf u = v_mul(p.bright, value), six = v_mul(u, v_set((float)PAGS_LIGHT_BENDS));
      const vm inside = m_and(v_gt(u, zero), v_lt(u, one));
      const vf curved = v_maskz(inside, by_y);
      vf slope = one;
      for (int k = 0; k < PAGS_LIGHT_BENDS; k++) {
        const vf past = v_sub(six, v_set((float)k));
        slope = v_add(slope, v_maskz(v_ge(past, zero), v_set(in->bends[k])));
        rises[k] = v_fma(curved, v_clamp(past, zero, one), rises[k]);
      }
      all = v_fma(curved, v_maskz(inside, light_curve(in, u)), all);
      const vf by_u = v_mul(by_y, v_select(inside, slope, one));
      by_bright = v_fma(by_u, value, by_bright);
      v_store(in->planes[c] + i, v_mul(by_u, p.bright));
    }
    const vf at = v_mul(v_set(3.0f), p.q);
    const vf hat[4] = {light_positive(v_sub(one, at)), light_positive(v_sub(one, v_abs(v_sub(at, one)))),
                       v_min(light_positive(v_sub(at, one)), v_sub(v_set(3.0f), at)), light_positive(v_sub(at, two))};
    for (int k = 0; k < 4; k++)
      hats[k] = v_fma(by_bright, v_maskz(use, hat[k]), hats[k]);
  }
  for (int k = 0; k < 4; k++)
    by_vignette[k] = (double)v_sum(hats[k]);
  const double less = (double)v_sum(all);
  for (int k = 0; k < PAGS_LIGHT_BENDS; k++)
    by_rises[k] = (double)v_sum(rises[k]) - less;
}
