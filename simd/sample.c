/* SPDX-License-Identifier: Apache-2.0 */
/* Blends a tile at 4 x 4 sample points only, 4 pixels apart, each in the middle of the 4x4 pixels that it represents.
 * The samples fill one vector, whose state stays in registers. They are blended like pixels (blend.h), with the
 * shorter polynomial for 2^x. */
#include "blend.h"

enum {
  SAMPLES_AHEAD = 16, /* how many splats ahead are prefetched */
  SAMPLES_LOOK = 16   /* splats between tests whether all samples have stopped */
};

V_INLINE void sample_tile(const pags_raster_in *in, const pags_raster_out *out, float *marked, raster_how how) {
  static const float middle_x[V_LANES] = {2, 6, 10, 14, 2, 6, 10, 14, 2, 6, 10, 14, 2, 6, 10, 14};
  static const float middle_y[V_LANES] = {2, 2, 2, 2, 6, 6, 6, 6, 10, 10, 10, 10, 14, 14, 14, 14};
  raster_state state;
  memset(&state, 0, sizeof state);
  state.px = v_add(v_load(middle_x), v_set((float)in->x0));
  state.py = v_add(v_load(middle_y), v_set((float)in->y0));
  state.t = v_set(1.0f);
  state.id = i_set(-1);
  const int64_t last = in->count - 1;
  if (last >= 0) {
    raster_pair pair = {in->splats + in->entries[0].splat, &state},
                next = {in->splats + in->entries[last > 0].splat, &state};
    raster_pipeline pipe = raster_prime(pair, next, how.degree);
    for (int64_t i = 0; i <= last; i++) {
      __builtin_prefetch(in->splats + in->entries[i + SAMPLES_AHEAD < last ? i + SAMPLES_AHEAD : last].splat);
      next.splat = in->splats + in->entries[i + 2 < last ? i + 2 : last].splat;
      raster_step(&pipe, next, how);
      if (i % SAMPLES_LOOK == SAMPLES_LOOK - 1 && raster_stopped(&state, how))
        break;
    }
  }
  v_store_4x4(marked, out->stride, state.marked);
  raster_write(out, &state, 0, how);
}

void KERNEL(sample)(const pags_raster_in *in, const uint8_t *marks, int64_t mark_count, const pags_raster_out *out,
                    float *marked) {
  raster_how how = {.degree = 3, .bounded = true, .eps = in->eps, .marks = marks, .mark_count = mark_count};
  if (!out->depth) {
    sample_tile(in, out, marked, how);
    return;
  }
  how.sum = how.extra = true;
  sample_tile(in, out, marked, how);
}
