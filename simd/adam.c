/* SPDX-License-Identifier: Apache-2.0 */
/* Adam (Kingma & Ba 2015) over one plane of rows, divided into an update for steps with a gradient and a replay that
 * catches up on steps without one later, at one multiply-add per step.
 *
 * Dense Adam at step k, gradient g, rate r, bias corrections 1 - b1^k and 1 - b2^k:
 *     m = b1 m + (1 - b1) g;   v = b2 v + (1 - b2) g^2;   p -= r c_k m / (sqrt v + e_k)
 *     c_k = sqrt(1 - b2^k) / (1 - b1^k),   e_k = eps sqrt(1 - b2^k)
 * which is the usual r (m / (1 - b1^k)) / (sqrt(v / (1 - b2^k)) + eps) with both sides of the quotient times sqrt(1 -
 * b2^k). After a last gradient at step s, with u = m_s / (sqrt v_s + e_s), step s + j without one is
 *     p -= r c_(s+j) q^j u,   q = b1 / sqrt b2,
 * up to a relative error of (1 - b2^(j/2)) eps / sqrt v: under 2e-6 while gradients exceed 1e5 eps = 1e-10. So m and
 * v stay as they were at step s, and each pending step is p -= weight[j] u. Each is rounded separately,
 * so that the bits do not depend on when the replay is done and in how many pieces. */
#include "kernel.h"

/* Returns u = m / (sqrt v + eps), which is 0 where both moments are 0. */
static inline vf adam_direction(const float *m, const float *v, vf eps) {
  return v_div(v_load(m), v_add(v_sqrt(v_load(v)), eps));
}

/* Replays steps without a gradient: p -= weights[j] u for j = 0 .. steps - 1, in this order. Four vectors at a time
 * hide the latency of the chain of subtractions. `rows` is rounded up to 16; the rows beyond hold zeros. */
void KERNEL(adam_replay)(float *p, const float *m, const float *v, int rows, const float *weights, int steps,
                         float eps) {
  const vf e = v_set(eps);
  int i = 0;
  for (; i + 48 < rows; i += 64) {
    const vf u0 = adam_direction(m + i, v + i, e), u1 = adam_direction(m + i + 16, v + i + 16, e);
    const vf u2 = adam_direction(m + i + 32, v + i + 32, e), u3 = adam_direction(m + i + 48, v + i + 48, e);
    vf p0 = v_load(p + i), p1 = v_load(p + i + 16), p2 = v_load(p + i + 32), p3 = v_load(p + i + 48);
    for (int j = 0; j < steps; j++) {
      const vf w = v_set(weights[j]);
      p0 = v_fnma(w, u0, p0);
      p1 = v_fnma(w, u1, p1);
      p2 = v_fnma(w, u2, p2);
      p3 = v_fnma(w, u3, p3);
    }
    v_store(p + i, p0);
    v_store(p + i + 16, p1);
    v_store(p + i + 32, p2);
    v_store(p + i + 48, p3);
  }
  for (; i < rows; i += 16) {
    const vf u = adam_direction(m + i, v + i, e);
    vf x = v_load(p + i);
    for (int j = 0; j < steps; j++)
      x = v_fnma(v_set(weights[j]), u, x);
    v_store(p + i, x);
  }
}

/* One step with a gradient. Moments that are too small to matter are set to zero before they become denormal numbers,
 * which are slow: a first moment of 1e-30 moves p by at most 1e-15 times the rate. */
void KERNEL(adam_update)(float *p, float *m, float *v, const float *gradient, int rows, const pags_adam_step *step) {
  const vf d1 = v_set(step->decay1), d2 = v_set(step->decay2), b1 = v_set(step->blend1), b2 = v_set(step->blend2);
  const vf r = v_set(step->rate), e = v_set(step->eps), small1 = v_set(1e-30f), small2 = v_set(1e-36f);
  for (int i = 0; i < rows; i += 16) {
    const vf g = v_maskz(m_first(rows - i), v_load(gradient + i));
    const vf first = v_fma(b1, g, v_mul(d1, v_load(m + i)));
    const vf second = v_fma(v_mul(b2, g), g, v_mul(d2, v_load(v + i)));
    const vf m1 = v_maskz(v_ge(v_abs(first), small1), first);
    const vf v1 = v_maskz(v_ge(second, small2), second);
    v_store(m + i, m1);
    v_store(v + i, v1);
    v_store(p + i, v_fnma(r, v_div(m1, v_add(v_sqrt(v1), e)), v_load(p + i)));
  }
}

/* Marks the rows that must not be updated (kernels.h): comparisons are false for NaN, so that NaN counts as too
 * large. Runs before the update of the same rows, which then finds them in the cache. */
int KERNEL(adam_check)(const float *p, int64_t p_stride, const float *gradient, int64_t gradient_stride, int planes,
                       int rows, uint16_t *bad) {
  const vf most = v_set(3e38f), steep = v_set(1e18f);
  unsigned any = 0;
  for (int i = 0; i < rows; i += 16) {
    vm good = m_first(rows - i);
    for (int k = 0; k < planes; k++)
      good = m_and(good, m_and(v_lt(v_abs(v_load(p + k * p_stride + i)), most),
                               v_lt(v_abs(v_load(gradient + k * gradient_stride + i)), steep)));
    const unsigned found = m_bits(m_first(rows - i)) & ~m_bits(good);
    bad[i / 16] = (uint16_t)(bad[i / 16] | found);
    any |= found;
  }
  return any != 0;
}

/* Widens [range[0], range[1]] by the values that the rows can reach through replayed steps alone: those between p and
 * p - weight u, since all these steps have the same sign. Rows that are not finite are left out. */
void KERNEL(adam_reach)(const float *p, const float *m, const float *v, int rows, float weight, float eps,
                        float range[2]) {
  const vf w = v_set(weight), e = v_set(eps);
  vf least = v_set(range[0]), most = v_set(range[1]);
  for (int i = 0; i < rows; i += 16) {
    const vf x = v_load(p + i), end = v_fnma(w, adam_direction(m + i, v + i, e), x);
    const vm use = m_first(rows - i);
    least = v_select(use, v_min(v_min(x, end), least), least);
    most = v_select(use, v_max(v_max(x, end), most), most);
  }
  float l[16], h[16];
  v_store(l, least);
  v_store(h, most);
  for (int k = 0; k < 16; k++) {
    range[0] = l[k] < range[0] ? l[k] : range[0];
    range[1] = h[k] > range[1] ? h[k] : range[1];
  }
}
