/* SPDX-License-Identifier: Apache-2.0 */
/* The weights w = alpha T of a tile's splats at its pixels: for the passes that sum other quantities
 * than colour. Blending as in blend.h, front to back, gives the weights of the picture to the bit. */
#include "blend.h"

V_INLINE void weights_all(const pags_raster_weights *in, int degree) {
  vf px[PAGS_TILE_BLOCKS], py[PAGS_TILE_BLOCKS], t[PAGS_TILE_BLOCKS];
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    px[b] = block_x(b, in->x0);
    py[b] = block_y(b, in->y0);
    t[b] = in->first ? v_select(block_inside(px[b], py[b], in->width, in->height), v_set(1.0f), v_set(-1.0f))
                     : v_load(in->transmittance + b * V_LANES);
  }
  for (int64_t i = 0; i < in->count; i++) {
    if (i + 4 < in->count)
      __builtin_prefetch(in->splats + in->entries[i + 4].splat);
    const pags_splat *const s = in->splats + in->entries[i].splat;
    unsigned blended = 0;
    for (unsigned left = in->block_masks[i]; left; left &= left - 1) {
      const int b = __builtin_ctz(left);
      vf u, v;
      const vf alpha = raster_alpha(s, raster_exponent(s, px[b], py[b], &u, &v), degree);
      const vf next = v_fnma(t[b], alpha, t[b]);
      const vm goes_on = v_ge(next, v_set(PAGS_T_STOP));
      const vf w = v_maskz(goes_on, v_mul(alpha, t[b]));
      t[b] = v_select(goes_on, next, v_minus_abs(t[b]));
      v_store(in->weights + (i * PAGS_TILE_BLOCKS + b) * V_LANES, w);
      blended |= (unsigned)(m_bits(v_gt(w, v_zero())) != 0) << b;
    }
    in->blended[i] = (uint16_t)blended;
  }
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++)
    v_store(in->transmittance + b * V_LANES, t[b]);
}

void KERNEL(raster_weights)(const pags_raster_weights *in) {
  if (in->exp_degree >= 5)
    weights_all(in, 5);
  else
    weights_all(in, 3);
}
