/* SPDX-License-Identifier: Apache-2.0 */
/* How far each point's neighbours are: the size that first Gaussians get. */
#ifndef PAGS_INIT_KNN_H
#define PAGS_INIT_KNN_H

#include <pags/base.h>
#include <pags/tasks.h>

/* out[i] = mean of the squared distances (float, metres^2) from point i to its 3 nearest others, to all others where
 * there are fewer, 0 where there is none. A copy of a point counts as a neighbour at distance 0: clamping is the
 * caller's. `xyz` holds 3 finite floats a point. The same bits for any number of threads. Errors: PAGS_ERROR_LIMIT
 * beyond 2^31 - 1 points, PAGS_ERROR_MEMORY, PAGS_CANCELLED. */
pags_result pags_knn_mean_squared(const float *xyz, int64_t count, pags_tasks *tasks, float *out);

#endif
