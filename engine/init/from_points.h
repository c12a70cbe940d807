/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the initial Gaussians of a training run from coloured points. */
#ifndef PAGS_INIT_FROM_POINTS_H
#define PAGS_INIT_FROM_POINTS_H

#include <pags/dataset.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>
#include <pags/train.h>

/* The scene's extent: 1.1 times the largest distance of a camera from the cameras' mean position, metres (Kerbl et al.
 * 2023), without those that are far from all others (dataset/far_cameras.c), but at least a quarter of the median
 * distance of the points from there: cameras that stand closely together (on a tripod, or before a far wall) say
 * nothing of the size of what they see. Without points, 1 if all cameras stand in one place. `views` are the indices of
 * the training views in the data set; xyz holds 3 floats per point, relative to the data set's origin.
 * PAGS_ERROR_MEMORY. */
pags_result pags_init_extent(const pags_dataset *dataset, const int64_t *views, int64_t count, int64_t points,
                             const float *xyz, double *extent);

/* Makes one isotropic Gaussian per point, in Morton order. Its sigma is the root mean square
 * distance of the three nearest neighbours, at most 0.1 times `extent`; it has the point's colour and the
 * opacity init_opacity. Points that are not finite are left out; of more than `most` points every (points / most)th
 * is taken. `out` receives these rows of them: [rows[0], rows[1]); NULL: all. */
pags_result pags_init_gaussians(const pags_train_config *config, int64_t points, const float *xyz, const uint8_t *rgb,
                                int64_t most, double extent, const int64_t *rows, pags_tasks *tasks,
                                pags_gaussians *out);
/* How many Gaussians that makes of the points. */
int64_t pags_init_count(int64_t points, const float *xyz, int64_t most);

/* Distances of points to their three nearest neighbours, from which initial Gaussians get their scales: out[i] = mean
 * of the squared distances (metres^2) from point i to the 3 other points nearest to it; to all other points if there
 * are fewer; 0 if there is no other. A duplicate of a point counts as a neighbour at distance 0; it is up to the caller
 * to bound the result from below. `xyz` holds 3 finite floats a point. The result has the same bits for any number of
 * threads. Errors: PAGS_ERROR_LIMIT beyond 2^31 - 1 points, PAGS_ERROR_MEMORY, PAGS_CANCELLED. */
pags_result pags_knn_mean_squared(const float *xyz, int64_t count, pags_tasks *tasks, float *out);

#endif
