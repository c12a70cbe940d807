/* SPDX-License-Identifier: Apache-2.0 */
/* The depth-only pre-pass of a tile. */
#include "blend.h"

#define RASTER_COVERS 0.5f /* the alpha from which a splat counts as an occluder in the depth pre-pass */

void KERNEL(raster_depth)(const pags_raster_in *in, float *depth, int64_t stride, float farthest[PAGS_TILE_BLOCKS]) {
  const block_corners corners = corners_of(in->x0, in->y0);
  vf nearest[PAGS_TILE_BLOCKS];
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++)
    nearest[b] = v_set(INFINITY);
  for (int64_t i = 0; i < in->count; i++) {
    const pags_splat *const s = in->splats + in->entries[i].splat;
    const vf least = v_log2(v_set(RASTER_COVERS + s->floor));
    for (unsigned left = block_mask(s, &corners); left; left &= left - 1) {
      const int b = __builtin_ctz(left);
      vf u, v;
      const vm covers = v_ge(raster_exponent(s, block_x(b, in->x0), block_y(b, in->y0), &u, &v), least);
      nearest[b] = v_select(covers, v_min(v_set(s->z), nearest[b]), nearest[b]);
    }
  }
  for (int b = 0; b < PAGS_TILE_BLOCKS; b++) {
    v_store_4x4(depth + block_at(stride, b), stride, nearest[b]);
    float lane[V_LANES];
    v_store(lane, v_select(block_inside(block_x(b, in->x0), block_y(b, in->y0), in->width, in->height), nearest[b],
                           v_zero()));
    farthest[b] = 0.0f;
    for (int k = 0; k < V_LANES; k++)
      farthest[b] = lane[k] > farthest[b] ? lane[k] : farthest[b];
  }
}
