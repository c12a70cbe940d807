/* SPDX-License-Identifier: Apache-2.0 */
/* Mean squared distances of points to their three nearest neighbours, from which initial Gaussians get their
 * scales. */
#ifndef PAGS_INIT_KNN_H
#define PAGS_INIT_KNN_H

#include <pags/base.h>
#include <pags/tasks.h>

/* out[i] = mean of the squared distances (metres^2) from point i to the 3 other points nearest to it; to all other
 * points if there are fewer; 0 if there is no other. A duplicate of a point counts as a neighbour at distance 0; it
 * is up to the caller to bound the result from below. `xyz` holds 3 finite floats a point. The result has the same
 * bits for any number of threads. Errors: PAGS_ERROR_LIMIT beyond 2^31 - 1 points, PAGS_ERROR_MEMORY,
 * PAGS_CANCELLED. */
pags_result pags_knn_mean_squared(const float *xyz, int64_t count, pags_tasks *tasks, float *out);

#endif
