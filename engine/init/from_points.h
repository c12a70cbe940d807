/* SPDX-License-Identifier: Apache-2.0 */
/* The first Gaussians. */
#ifndef PAGS_INIT_FROM_POINTS_H
#define PAGS_INIT_FROM_POINTS_H

#include <pags/dataset.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>
#include <pags/train.h>

/* 1.1 times the largest distance of a training camera from their mean, metres; 1 for cameras that all stand in one
 * place. `views` are indices of the data set's. */
double pags_init_extent(const pags_dataset *dataset, const int64_t *views, int64_t count);

/* One Gaussian per point, in Morton order: isotropic, sigma from the three nearest neighbours, the point's colour,
 * opacity init_opacity. Of more than `most` points every (points / most)th is taken; points that are not finite are
 * left out. */
pags_result pags_init_gaussians(const pags_train_config *config, int64_t points, const float *xyz, const uint8_t *rgb,
                                int64_t most, double extent, pags_tasks *tasks, pags_gaussians *out);

#endif
