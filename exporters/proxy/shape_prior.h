/* SPDX-License-Identifier: Apache-2.0 */
/* What no camera saw of an object: its mirror image, the form that well-seen objects of its size have, or its box. */
#ifndef PAGS_PROXY_SHAPE_PRIOR_H
#define PAGS_PROXY_SHAPE_PRIOR_H

#include <pags/object.h>

#include "exporters/proxy/lidar_fit.h"
#include "exporters/proxy/tsdf.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Signed distances about a vehicle on a lattice that is stretched with its box. */
typedef struct pags_shape_prior {
  int64_t object;  /* of the scene; whose form it is */
  double size[3];  /* of its box, metres */
  float *distance; /* metres, negative inside; NULL: nothing is known */
  float *known;    /* 0..1 a point */
} pags_shape_prior;

void pags_shape_prior_destroy(pags_shape_prior *prior); /* frees and zeroes */

/* From what the views say, fused about the box's middle: what was seen, or its mirror image. */
pags_result pags_shape_prior_take(const pags_tsdf *grid, const double size[3], int64_t object, pags_shape_prior *out);

/* The mean of others' forms for an object of this size, the nearer their sizes are and the better LiDAR's points on
 * it (`cloud`, may be NULL) fit them the more. `distance` stays NULL where none has about its size. */
pags_result pags_shape_prior_blend(const pags_shape_prior *priors, int64_t count, const double size[3], int64_t object,
                                   const pags_lidar_fit *cloud, pags_shape_prior *out);

/* Gives what no view saw a distance; weights stay 0 there. `form` (may be NULL) also steadies what was seen hardly, and
 * in the end LiDAR's points are held to (`cloud`, may be NULL). The grid is even about the object's middle. */
pags_result pags_shape_prior_complete(pags_tsdf *grid, const double size[3], int vehicle, const pags_shape_prior *prior,
                                      const pags_lidar_fit *cloud);

#ifdef __cplusplus
}
#endif
#endif
