/* SPDX-License-Identifier: Apache-2.0 */
/* Completes what no camera saw of an object: by its mirror image, by a shape prior (the mean shape of well-seen
 * vehicles of about its size), or by its labelled box. */
#ifndef PAGS_PROXY_SHAPE_PRIOR_H
#define PAGS_PROXY_SHAPE_PRIOR_H

#include <pags/object.h>

#include "exporters/proxy/lidar.h"
#include "exporters/proxy/tsdf.h"

/* The shape of a vehicle: signed distances on a lattice that is scaled with its box. */
typedef struct pags_shape_prior {
  int64_t object;  /* index in the scene of the object whose shape it is */
  double size[3];  /* size of its box, metres */
  float *distance; /* metres, negative inside; NULL: nothing is known */
  float *known;    /* confidence of each lattice point's distance, 0..1 */
} pags_shape_prior;

void pags_shape_prior_destroy(pags_shape_prior *prior); /* frees and zeroes */

/* Takes the shape of one vehicle from its fused TSDF, which is centred at the box's middle: at each lattice point the
 * seen distance, or, if the point was not seen, that of its mirror image. */
pags_result pags_shape_prior_take(const pags_tsdf *grid, const double size[3], int64_t object, pags_shape_prior *out);

/* Blends the shapes of other vehicles into the prior of an object of this size: their mean, weighted by how near
 * their sizes are and how well the LiDAR points on the object (`cloud`, may be NULL) fit them. `distance` stays NULL
 * if no vehicle is of about this size. */
pags_result pags_shape_prior_blend(const pags_shape_prior *priors, int64_t count, const double size[3], int64_t object,
                                   const pags_lidar_fit *cloud, pags_shape_prior *out);

/* Gives every grid point that no view saw a distance; the weight stays 0 there. `prior` (may be NULL) is also
 * averaged into points that were hardly seen. In the end the surface is pulled to the LiDAR points (`cloud`, may be
 * NULL). The grid must be symmetric about the object's middle. */
pags_result pags_shape_prior_complete(pags_tsdf *grid, const double size[3], bool vehicle,
                                      const pags_shape_prior *prior, const pags_lidar_fit *cloud);

#endif
