/* SPDX-License-Identifier: Apache-2.0 */
/* Measures the peak rate of blending. */
#include "blend.h"

/* Measures the peak rate of blending: the steps of the rasteriser with all data in registers. The pixel centres move
 * by 1e-6 each step, so that the compiler cannot move any part of a step out of the loop. */
V_INLINE float roofline_steps(const pags_splat *splats, int64_t steps, int degree) {
  const pags_splat s = *splats;
  raster_state state;
  const raster_pair pair = {&s, &state};
  state.px = block_x(0, 0);
  state.py = block_y(0, 0);
  state.t = v_set(1.0f);
  state.r = state.g = state.b = v_zero();
  const vf hair = v_set(1e-6f);
  raster_pipeline pipe = raster_prime(pair, pair, degree);
  for (int64_t i = 0; i < steps; i++) {
    raster_step(&pipe, pair, (raster_how){.degree = degree});
    state.px = v_add(state.px, hair);
    state.py = v_add(state.py, hair);
  }
  return v_sum(state.r) + v_sum(state.g) + v_sum(state.b) + v_sum(state.t);
}
float KERNEL(roofline)(const pags_splat *splats, int64_t steps, int exp_degree) {
  return exp_degree >= 5 ? roofline_steps(splats, steps, 5) : roofline_steps(splats, steps, 3);
}
