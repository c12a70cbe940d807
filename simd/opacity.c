/* SPDX-License-Identifier: Apache-2.0 */
/* Cross-entropy and entropy of a row of pixels' transmittance T, and their slopes (engine/train/driving_losses.h):
 *
 *   empty    -log T            d/dT = -1 / T
 *   full     -log(1 - T)       d/dT = 1 / (1 - T)
 *   unsure   -T log T - (1 - T) log(1 - T)     d/dT = log((1 - T) / T)
 *
 * Arguments of the first two logarithms and the third's T are clamped to [1e-6, 1 - 1e-6], outside of which the slope
 * is zero. */
#include "kernel.h"

V_INLINE vf opacity_log(vf x) {
  return v_mul(v_log2(x), v_set(0.693147181f));
}

/* Returns x clamped to [1e-6, 1 - 1e-6]; *within: whether x was inside of that interval. */
V_INLINE vf opacity_argument(vf x, vm *within) {
  const vf least = v_set(1e-6f), most = v_set(1.0f - 1e-6f);
  *within = v_ge_and(v_ge(x, least), most, x);
  return v_clamp(x, least, most);
}

/* If `unsure`, `chosen` pixels have the entropy (unsure) and the others the loss of empty pixels; otherwise `chosen`
 * pixels have that of empty and the others that of full ones. */
V_INLINE double opacity_all(const pags_opacity_row *in, bool unsure) {
  const vf zero = v_zero(), one = v_set(1.0f);
  vf sum = zero;
  for (int i = 0; i < in->width; i += V_LANES) {
    vm use = m_first(in->width - i);
    if (in->mask)
      use = m_and(use, v_gt(v_load_u8(in->mask + i), v_zero()));
    const vi labels = v_to_i(v_load_u8(in->labels + i));
    const vf chosen = i_to_v(i_and(labels, i_set(in->chosen))), unknown = i_to_v(i_and(labels, i_set(in->unknown)));
    use = m_and(use, v_gt(v_set(0.5f), unknown));
    const vm first = v_gt(chosen, zero);
    const vf t = v_load(in->transmittance + i);
    vf value, slope; /* by T */
    vm within;
    if (unsure) {
      const vf x = opacity_argument(t, &within), y = v_sub(one, x), log_x = opacity_log(x), log_y = opacity_log(y);
      slope = v_select(first, v_sub(log_y, log_x), v_div(v_set(-1.0f), x));
      value = v_sub(zero, v_select(first, v_fma(x, log_x, v_mul(y, log_y)), log_x));
    } else {
      const vf x = opacity_argument(v_select(first, t, v_sub(one, t)), &within);
      slope = v_div(v_select(first, v_set(-1.0f), one), x);
      value = v_sub(zero, opacity_log(x));
    }
    slope = v_maskz(within, slope);
    sum = v_add(sum, v_maskz(use, value));
    v_store(in->gradient + i, v_fma(v_maskz(use, slope), v_set(in->scale), v_load(in->gradient + i)));
  }
  return (double)v_sum(sum);
}

double KERNEL(opacity_row)(const pags_opacity_row *in) {
  return in->unsure ? opacity_all(in, true) : opacity_all(in, false);
}
