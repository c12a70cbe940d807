/* SPDX-License-Identifier: Apache-2.0 */
/* The layers of SqueezeNet 1.1 (Iandola et al. 2016) for LPIPS, on planes of floats.
 *
 * Every sum is taken in a fixed order: over input channels, then over the window row by row. The inner loops run over
 * pixels, so that the compiler vectorises across pixels without re-ordering a sum. */
#ifndef PAGS_EVAL_SQUEEZENET_H
#define PAGS_EVAL_SQUEEZENET_H

#include <pags/base.h>
#include <pags/tasks.h>

/* A feature map. Row y of channel c begins at pags_map_row(map, c, y), for y in [-1, height]; each plane has a border
 * of one pixel of zeros. */
typedef struct pags_map {
  int channels, width, height;
  int64_t stride, plane; /* number of floats from one row to the next, from one channel to the next */
  float *base;
} pags_map;

static inline float *pags_map_row(const pags_map *map, int channel, int y) {
  return map->base + channel * map->plane + (y + 1) * map->stride + 1;
}

pags_result pags_map_create(pags_map *map, int channels, int width, int height);
void pags_map_destroy(pags_map *map);

/* A convolution with windows of k x k; it does not own its weights. */
typedef struct pags_conv {
  int inputs, outputs;
  const float *weight; /* outputs x inputs x k x k */
  const float *bias;   /* outputs */
} pags_conv;

/* The layers below create `out`. Errors: PAGS_ERROR_MEMORY, PAGS_CANCELLED. */

/* First layer: 3x3 convolution of 3 channels, stride 2, no padding, then ReLU. `in` holds six planes: the even
 * columns of R, G and B, then the odd ones; `width` is that of the picture. */
pags_result pags_layer_first(const pags_map *in, int width, const pags_conv *conv, pags_tasks *tasks, pags_map *out);

/* Fire module: a 1x1 convolution (squeeze) with ReLU, then the concatenated outputs of a 1x1 and a 3x3 convolution
 * (expand, padding 1), each with ReLU. */
typedef struct pags_fire {
  pags_conv squeeze, expand1, expand3;
} pags_fire;
pags_result pags_layer_fire(const pags_map *in, const pags_fire *fire, pags_tasks *tasks, pags_map *out);

/* Max pooling over 3x3 windows, stride 2. At the right and bottom edge, windows may extend beyond the map (PyTorch's
 * ceil_mode). */
pags_result pags_layer_pool(const pags_map *in, pags_tasks *tasks, pags_map *out);

#endif
