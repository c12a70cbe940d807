/* SPDX-License-Identifier: Apache-2.0 */
/* Colours of splats from spherical harmonics (sh.h), seen from the camera. */
#include "sh.h"

V_INLINE void shade_rows(bool rolls, const pags_projection *view, const float *data, int64_t stride, const float *sh,
                         int count, const uint32_t *keys, pags_splat *splats) {
  const int coefficients = (view->sh_degree + 1) * (view->sh_degree + 1);
  if (!sh)
    sh = data + 11 * stride;
  for (int first = 0; first < count; first += V_LANES) {
    const int lanes = count - first < V_LANES ? count - first : V_LANES;
    unsigned drawn = 0;
    for (int k = 0; k < lanes; k++)
      drawn |= (unsigned)(keys[first + k] != UINT32_MAX) << k;
    if (!drawn)
      continue;
    vf u, direction[3], inverse_distance, basis[16], rgb[3];
    if (rolls)
      u = scan_time(view->scan, splats + first, drawn);
    sh_direction(view, rolls ? &u : NULL, data + first, stride, direction, &inverse_distance);
    sh_basis(view->sh_degree, direction[0], direction[1], direction[2], basis);
    float colour[3][V_LANES];
    unsigned negative[3];
    for (int c = 0; c < 3; c++) {
      const float *const plane = sh + first + c * stride;
      rgb[c] = v_fma(basis[0], v_load(plane), v_set(0.5f));
      for (int k = 1; k < coefficients; k++)
        rgb[c] = v_fma(basis[k], v_load(plane + 3 * k * stride), rgb[c]);
      negative[c] = m_bits(v_lt(rgb[c], v_zero()));
      v_store(colour[c], v_min(v_max(rgb[c], v_zero()), v_set(PAGS_COLOUR_MAX)));
    }
    for (; drawn; drawn &= drawn - 1) {
      const int k = __builtin_ctz(drawn);
      pags_splat *const out = splats + first + k;
      out->r = colour[0][k], out->g = colour[1][k], out->b = colour[2][k];
      out->clamped = (negative[0] >> k & 1u) | (negative[1] >> k & 1u) << 1 | (negative[2] >> k & 1u) << 2;
    }
  }
}

void KERNEL(shade)(const pags_projection *view, const float *data, int64_t stride, const float *sh, int count,
                   const uint32_t *keys, pags_splat *splats) {
  if (view->scan)
    shade_rows(true, view, data, stride, sh, count, keys, splats);
  else
    shade_rows(false, view, data, stride, sh, count, keys, splats);
}
