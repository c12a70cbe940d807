/* SPDX-License-Identifier: Apache-2.0 */
/* The layers of SqueezeNet 1.1 (Iandola et al. 2016, arXiv:1602.07360) and AlexNet (Krizhevsky 2014, arXiv:1404.5997)
 * for LPIPS, on planes of floats.
 *
 * Every sum is taken in a fixed order: over input channels, then over the window row by row. The inner loops run over
 * pixels, so that the compiler vectorises across pixels without re-ordering a sum. */
#ifndef PAGS_EVAL_LAYERS_H
#define PAGS_EVAL_LAYERS_H

#include <stdbool.h>

#include <pags/base.h>
#include <pags/tasks.h>

/* Zeros on each side of a plane, in pixels: the largest padding of a convolution. */
enum { PAGS_MAP_BORDER = 2 };

/* A feature map. Column x of channel c lies in plane c + channels * (x % phases), at x / phases: a convolution of step
 * s reads a map of s phases, so that neighbouring outputs read neighbouring floats. Row y of a plane begins at
 * pags_map_row(map, plane, y). */
typedef struct pags_map {
  int channels, width, height, phases;
  int64_t stride, plane; /* number of floats from one row to the next, from one plane to the next */
  float *base;
} pags_map;

static inline float *pags_map_row(const pags_map *map, int plane, int y) {
  return map->base + plane * map->plane + (y + PAGS_MAP_BORDER) * map->stride + PAGS_MAP_BORDER;
}

/* Creates a map of zeros. Errors: PAGS_ERROR_MEMORY. */
pags_result pags_map_create(pags_map *map, int channels, int width, int height, int phases);
void pags_map_destroy(pags_map *map);

/* A convolution with windows of size x size; it does not own its weights. */
typedef struct pags_conv {
  int inputs, outputs;
  int size, step, padding; /* padding at most PAGS_MAP_BORDER */
  const float *weight;     /* outputs x inputs x size x size */
  const float *bias;       /* outputs */
} pags_conv;

/* The layers below create `out`, with one phase. Errors: PAGS_ERROR_MEMORY, PAGS_CANCELLED. */

/* A convolution, then ReLU. `in` has `step` phases. */
pags_result pags_layer_conv(const pags_map *in, const pags_conv *conv, pags_tasks *tasks, pags_map *out);

/* SqueezeNet's fire module: a 1x1 convolution (squeeze) with ReLU, then the concatenated outputs of a 1x1 and a 3x3
 * convolution (expand, padding 1), each with ReLU. */
typedef struct pags_fire {
  pags_conv squeeze, expand1, expand3;
} pags_fire;
pags_result pags_layer_fire(const pags_map *in, const pags_fire *fire, pags_tasks *tasks, pags_map *out);

/* Max pooling over 3x3 windows, stride 2. `partial`: at the right and bottom edge, windows may extend beyond the map
 * (PyTorch's ceil_mode). */
pags_result pags_layer_pool(const pags_map *in, bool partial, pags_tasks *tasks, pags_map *out);

#endif
