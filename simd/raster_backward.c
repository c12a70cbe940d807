/* SPDX-License-Identifier: Apache-2.0 */
/* The gradient of blending, computed front to back like the forward pass.
 *
 * Let behind_i be the contribution of all splats after i and of the background to dL/dC . C. It is found by
 * subtracting each splat's own part from the total, which the picture of the forward pass gives:
 *   dL/dcolour_i = w_i dL/dC                       w_i = alpha_i T_i
 *   dL/dalpha_i  = T_i (colour_i . dL/dC) - behind_i / (1 - alpha_i)
 * No division recovers T (it is blended again, to the same bits), no per-pixel index is stored, and pixels stop where
 * they stopped. A stopped pixel has T = 0 and behind = 0 here, which makes all its terms vanish.
 *
 * The exponent's gradient s = dL/dalpha (alpha + floor) (ln 2 is applied later) is summed in moments of the whitened
 * offsets u, v, which stay within 3.4 for every shape, where moments of dx, dy of a long needle would swamp float. At
 * the 0.99 cap the true derivative is 0: nothing flows to shape and opacity there (as in gsplat; INRIA lets it
 * through).
 *
 * On demand the squared derivatives of the pixels' colour by each splat, the score of score.c, are summed along the
 * way.
 *
 * Splats are the outer loop, so the twelve sums live in registers and are folded once per (splat, tile). */
#include "blend.h"

typedef struct backward_score { /* of the squared derivatives */
  vf behind[PAGS_TILE_BLOCKS];  /* as that of drawn_tile, of the sum of the channels in place of dL/dC . C */
  vf counted[PAGS_TILE_BLOCKS]; /* weights of the pixels */
} backward_score;

V_INLINE void backward_load_score(backward_score *score, const drawn_tile *tile, const pags_raster_back *in) {
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    const int64_t at = block_at(in->tile.stride, b);
    const vm inside = v_gt(tile->t[b], v_zero());
    vf behind = v_zero();
    for (int c = 0; c < 3; c++)
      behind = v_add(behind, v_load_4x4(in->tile.rgb[c] + at, in->tile.stride));
    score->behind[b] = v_maskz(inside, behind);
    score->counted[b] = v_maskz(inside, v_load_4x4(in->counted + at, in->tile.stride));
  }
}

V_INLINE void backward_load(drawn_tile *tile, const pags_raster_back *in, bool depth) {
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    const int64_t at = block_at(in->tile.stride, b);
    const vm inside = begin_block(tile, &in->tile, b);
    vf behind = v_zero();
    for (int c = 0; c < 3; c++) {
      tile->g[c][b] = v_maskz(inside, v_load_4x4(in->rgb_gradient[c] + at, in->tile.stride));
      behind = v_fma(tile->g[c][b], v_load_4x4(in->tile.rgb[c] + at, in->tile.stride), behind);
    }
    if (in->transmittance_gradient)
      behind = v_fma(v_load_4x4(in->transmittance_gradient + at, in->tile.stride),
                     v_load_4x4(in->transmittance + at, in->tile.stride), behind);
    if (depth) {
      tile->g[3][b] = v_maskz(inside, v_load_4x4(in->depth_gradient + at, in->tile.stride));
      behind = v_fma(tile->g[3][b], v_load_4x4(in->depth_sum + at, in->tile.stride), behind);
    }
    tile->behind[b] = v_maskz(inside, behind);
  }
}

typedef struct backward_cover { /* the part of one splat over one block that doesn't depend on the splats in front */
  vf u, v, alpha;
} backward_cover;

V_INLINE backward_cover backward_alpha(const drawn_tile *tile, const pags_splat *s, int b) {
  backward_cover c;
  const vf exponent = raster_exponent(s, tile->px[b], tile->py[b], &c.u, &c.v);
  c.alpha = raster_alpha(s, exponent, 5);
  return c;
}

/* `score`: NULL: not wanted. */
V_INLINE void backward_step(drawn_tile *tile, const pags_splat *s, const backward_cover *cover, int b, bool depth,
                            backward_score *score, vf *sum) {
  const vf u = cover->u, v = cover->v, alpha = cover->alpha;
  const vf t = tile->t[b], next = v_fnma(t, alpha, t);
  const vm goes_on = v_ge(next, v_set(PAGS_T_STOP));
  const vf w = v_maskz(goes_on, v_mul(alpha, t));
  vf shine = v_mul(tile->g[2][b], v_set(s->b)); /* colour . dL/dC */
  shine = v_fma(tile->g[1][b], v_set(s->g), shine);
  shine = v_fma(tile->g[0][b], v_set(s->r), shine);
  if (depth)
    shine = v_fma(tile->g[3][b], v_set(s->z), shine);
  const vf behind = v_fnma(w, shine, tile->behind[b]);
  tile->t[b] = v_maskz(goes_on, next);
  tile->behind[b] = v_maskz(goes_on, behind);

  const vf dalpha = v_sub(v_mul(t, shine), v_div(behind, v_sub(v_set(1.0f), alpha)));
  const vm shaped = m_and(v_gt(alpha, v_zero()), v_lt(alpha, v_set(PAGS_ALPHA_MAX)));
  const vf ds = v_maskz(m_and(goes_on, shaped), v_mul(v_add(alpha, v_set(s->floor)), dalpha));
  const vf su = v_mul(ds, u), sv = v_mul(ds, v);
  sum[PAGS_SLOT_S] = v_add(sum[PAGS_SLOT_S], ds);
  sum[PAGS_SLOT_SU] = v_add(sum[PAGS_SLOT_SU], su);
  sum[PAGS_SLOT_SV] = v_add(sum[PAGS_SLOT_SV], sv);
  sum[PAGS_SLOT_SUU] = v_fma(su, u, sum[PAGS_SLOT_SUU]);
  sum[PAGS_SLOT_SUV] = v_fma(su, v, sum[PAGS_SLOT_SUV]);
  sum[PAGS_SLOT_SVV] = v_fma(sv, v, sum[PAGS_SLOT_SVV]);
  sum[PAGS_SLOT_R] = v_fma(w, tile->g[0][b], sum[PAGS_SLOT_R]);
  sum[PAGS_SLOT_G] = v_fma(w, tile->g[1][b], sum[PAGS_SLOT_G]);
  sum[PAGS_SLOT_B] = v_fma(w, tile->g[2][b], sum[PAGS_SLOT_B]);
  if (depth)
    sum[PAGS_SLOT_Z] = v_fma(w, tile->g[3][b], sum[PAGS_SLOT_Z]);
  if (score) { /* where alpha is capped, its derivative counts as 1 here (score.c) */
    const vf light = v_set(s->r + s->g + s->b), rest = v_fnma(w, light, score->behind[b]);
    const vf by_alpha = v_sub(v_mul(t, light), v_div(rest, v_sub(v_set(1.0f), alpha)));
    const vf counted = v_maskz(m_and(goes_on, v_gt(alpha, v_zero())), score->counted[b]);
    score->behind[b] = v_maskz(goes_on, rest);
    sum[PAGS_SLOT_SQUARED] = v_fma(v_mul(by_alpha, by_alpha), counted, sum[PAGS_SLOT_SQUARED]);
  }
}

enum { BACKWARD_SOON = 8, BACKWARD_LATER = 16 }; /* how many splats ahead is prefetched */

V_INLINE void backward_all(const pags_raster_back *in, bool depth, bool scored) {
  drawn_tile tile;
  backward_score of_tile, *const score = scored ? &of_tile : NULL;
  const int64_t count = in->tile.count + in->next_count;
  backward_load(&tile, in, depth);
  if (scored)
    backward_load_score(score, &tile, in);
  for (int64_t i = 0; i < in->tile.count; i++) {
    /* Prefetches, for a splat BACKWARD_LATER entries ahead, the index of its first slot; for one BACKWARD_SOON entries
     * ahead, the slot itself and the splat. They are scattered in memory. */
    if (i + BACKWARD_LATER < count)
      __builtin_prefetch(in->tile.slot_start + in->tile.entries[i + BACKWARD_LATER].splat);
    if (i + BACKWARD_SOON < count) {
      __builtin_prefetch(in->tile.splats + in->tile.entries[i + BACKWARD_SOON].splat);
      __builtin_prefetch(slot_of(&in->tile, i + BACKWARD_SOON, PAGS_SLOT_FLOATS), 1);
    }
    /* Prefetches rows of the next tile's planes, two per splat. They are a picture's width apart, too far for the
     * hardware prefetcher; prefetched all at once, they would exceed what the processor can have in flight. */
    const int64_t first = i / PAGS_TILE * 2, row = i % PAGS_TILE * in->tile.stride;
    for (int64_t k = first; k < first + 2 && k < PAGS_BACK_PLANES; k++)
      if (in->next[k])
        __builtin_prefetch(in->next[k] + row);

    const pags_splat *const s = in->tile.splats + in->tile.entries[i].splat;
    float *const slot = slot_of(&in->tile, i, PAGS_SLOT_FLOATS);
    unsigned blocks = in->tile.block_masks[i];
    if (!blocks) {
      v_store12(slot, v_zero());
      continue;
    }
    vf sum[PAGS_SLOT_FLOATS];
    for (int k = 0; k < PAGS_SLOT_FLOATS; k++)
      sum[k] = v_zero();
    /* The alpha of the next block is computed before the gradient of this one, so that both overlap: see
     * raster_pipeline. */
    int b = __builtin_ctz(blocks);
    backward_cover cover = backward_alpha(&tile, s, b);
    for (blocks &= blocks - 1; blocks; blocks &= blocks - 1) {
      const int next = __builtin_ctz(blocks);
      const backward_cover next_cover = backward_alpha(&tile, s, next);
      backward_step(&tile, s, &cover, b, depth, score, sum);
      cover = next_cover;
      b = next;
    }
    backward_step(&tile, s, &cover, b, depth, score, sum);
    if (scored) {
      const vf opacity = v_exp2(v_set(s->log2_opacity), 5);
      sum[PAGS_SLOT_SQUARED] = v_mul(sum[PAGS_SLOT_SQUARED], v_mul(opacity, opacity));
    }
    v_store12(slot, v_sum12(sum));
  }
}

void KERNEL(raster_backward)(const pags_raster_back *in) {
  if (in->counted && in->depth_gradient)
    backward_all(in, true, true);
  else if (in->counted)
    backward_all(in, false, true);
  else if (in->depth_gradient)
    backward_all(in, true, false);
  else
    backward_all(in, false, false);
}
