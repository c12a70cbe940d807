/* SPDX-License-Identifier: Apache-2.0 */
/* Pruning scores of a (splat, tile) pair: the visible weight of the splat, the part of it on critical pixels, and the
 * sensitivity of the picture to the splat (the score of Speedy-Splat, Hanson et al. 2025).
 *
 * Pairs are walked front to back as in the backward pass (raster_backward.c), with w = alpha T:
 *   seen     = sum of w n              n: weight of the pixel
 *   critical = sum of w n m            m: how critical the pixel is, 0..1
 *   squared  = sum of n (dL/dG)^2      G: value of the projected Gaussian at the pixel, alpha = o G; L: the sum of the
 *                                      pixel's channels
 * dL/dG = o dL/dalpha. The derivative of the cap on alpha (0.99) is taken as 1, as in Speedy-Splat (and INRIA's
 * backward), since otherwise an opaque splat would have no score where it covers most.
 *
 * With overlap `seen` and `critical` are sums of alpha instead, as if every splat were alone in the picture. */
#include "blend.h"

typedef struct score_tile {
  drawn_tile drawn;
  vf counted[PAGS_TILE_BLOCKS], critical[PAGS_TILE_BLOCKS];
} score_tile;

V_INLINE void score_load(score_tile *tile, const pags_raster_score *in) {
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    const int64_t at = block_at(in->tile.stride, b);
    const vm inside = begin_block(&tile->drawn, &in->tile, b);
    vf behind = v_zero();
    for (int c = 0; c < 3; c++)
      behind = v_add(behind, v_load_4x4(in->tile.rgb[c] + at, in->tile.stride));
    tile->counted[b] = v_maskz(inside, v_load_4x4(in->counted + at, in->tile.stride));
    tile->critical[b] = v_mul(tile->counted[b], v_maskz(inside, v_load_4x4(in->critical + at, in->tile.stride)));
    tile->drawn.behind[b] = v_maskz(inside, behind);
  }
}

V_INLINE void score_step(score_tile *tile, const pags_splat *s, int b, bool overlap, vf sum[3]) {
  vf u, v;
  const vf exponent = raster_exponent(s, tile->drawn.px[b], tile->drawn.py[b], &u, &v);
  const vf alpha = raster_alpha(s, exponent, 5);
  const vf t = tile->drawn.t[b], next = v_fnma(t, alpha, t);
  const vm goes_on = v_ge(next, v_set(PAGS_T_STOP)), blends = m_and(goes_on, v_gt(alpha, v_zero()));
  const vf w = v_maskz(goes_on, v_mul(alpha, t));
  const vf shine = v_set(s->r + s->g + s->b);
  const vf behind = v_fnma(w, shine, tile->drawn.behind[b]);
  tile->drawn.t[b] = v_maskz(goes_on, next);
  tile->drawn.behind[b] = v_maskz(goes_on, behind);

  const vf seen = overlap ? alpha : w;
  const vf by_alpha = v_maskz(blends, v_sub(v_mul(t, shine), v_div(behind, v_sub(v_set(1.0f), alpha))));
  sum[0] = v_fma(seen, tile->counted[b], sum[0]);
  sum[1] = v_fma(seen, tile->critical[b], sum[1]);
  sum[2] = v_fma(v_mul(by_alpha, by_alpha), tile->counted[b], sum[2]);
}

V_INLINE void score_all(const pags_raster_score *in, bool overlap) {
  const block_corners corners = corners_of(in->tile.x0, in->tile.y0);
  score_tile tile;
  score_load(&tile, in);
  for (int64_t i = 0; i < in->tile.count; i++) {
    if (i + 4 < in->tile.count)
      __builtin_prefetch(in->tile.splats + in->tile.entries[i + 4].splat);
    const pags_splat *const s = in->tile.splats + in->tile.entries[i].splat;
    float *const slot = slot_of(&in->tile, i, PAGS_SCORE_SUMS);
    uint16_t blocks = in->tile.block_masks[i];
    if (overlap) /* a splat counts also where it is hidden by others */
      blocks = block_mask(s, &corners);
    vf sum[3] = {v_zero(), v_zero(), v_zero()};
    for (unsigned left = blocks; left; left &= left - 1)
      score_step(&tile, s, __builtin_ctz(left), overlap, sum);
    const vf opacity = v_exp2(v_set(s->log2_opacity), 5);
    slot[PAGS_SCORE_SEEN] = v_sum(sum[0]);
    slot[PAGS_SCORE_CRITICAL] = v_sum(sum[1]);
    slot[PAGS_SCORE_SQUARED] = v_sum(v_mul(sum[2], v_mul(opacity, opacity)));
  }
}

void KERNEL(raster_score)(const pags_raster_score *in) {
  if (in->overlap)
    score_all(in, true);
  else
    score_all(in, false);
}
