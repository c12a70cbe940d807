/* SPDX-License-Identifier: Apache-2.0 */
/* The layers SqueezeNet 1.1 is made of (Iandola et al. 2016), on planes of floats.
 *
 * Every sum runs in a fixed order: input channels, then the window row by row. Pixels are the inner loop, so that the
 * compiler vectorises across them without re-ordering a sum. */
#ifndef PAGS_EVAL_SQUEEZENET_H
#define PAGS_EVAL_SQUEEZENET_H

#include <pags/base.h>
#include <pags/tasks.h>

/* Feature map: row y of channel c begins at pags_map_row(map, c, y), for y in [-1, height]; one pixel of zeros lies
 * around each plane. */
typedef struct pags_map {
  int channels, width, height;
  int64_t stride, plane; /* floats from row to row, from channel to channel */
  float *base;
} pags_map;

static inline float *pags_map_row(const pags_map *map, int channel, int y) {
  return map->base + channel * map->plane + (y + 1) * map->stride + 1;
}

pags_result pags_map_create(pags_map *map, int channels, int width, int height);
void pags_map_destroy(pags_map *map);

typedef struct pags_conv {
  int inputs, outputs;
  const float *weight; /* outputs x inputs x k x k */
  const float *bias;   /* outputs */
} pags_conv;

/* The layers below create `out`. Errors: PAGS_ERROR_MEMORY, PAGS_CANCELLED. */

/* 3x3, stride 2, no padding, 3 channels in, ReLU. `in` holds six planes: the even columns of R, G, B, then the odd
 * ones; `width` is that of the picture. */
pags_result pags_layer_first(const pags_map *in, int width, const pags_conv *conv, pags_tasks *tasks, pags_map *out);

/* Squeeze 1x1 and ReLU, then the concatenation of expand 1x1 and expand 3x3 (padding 1), each with ReLU. */
typedef struct pags_fire {
  pags_conv squeeze, expand1, expand3;
} pags_fire;
pags_result pags_layer_fire(const pags_map *in, const pags_fire *fire, pags_tasks *tasks, pags_map *out);

/* Maximum of 3x3, stride 2; a window may hang over the right and bottom edge. */
pags_result pags_layer_pool(const pags_map *in, pags_tasks *tasks, pags_map *out);

#endif
