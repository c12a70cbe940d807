/* SPDX-License-Identifier: Apache-2.0 */
/* The bound on bytes that --target-size sets: scene.json, PLYs and sky, of which training decides the rows of the PLYs.
 */
#ifndef PAGS_TRAIN_SIZE_LIMIT_H
#define PAGS_TRAIN_SIZE_LIMIT_H

#include "train/state.h"

/* Bytes that a row of the model will take in the finished scene. */
int pags_size_limit_row(const pags_train_state *state, int64_t model);

/* Bytes that all rows may take together; below 0 where the rest alone is too much. What scene.json may still grow by is
 * set aside. */
pags_result pags_size_limit_rows(const pags_dataset *dataset, const pags_train_state *state, int64_t *bytes);

/* How many more Gaussians fit, of the kind that takes most; 0 when too many are there already. INT32_MAX where nothing
 * bounds growth: no target, or a prune by score still to come, which sees to it. */
pags_result pags_size_limit_room(const pags_dataset *dataset, const pags_train_state *state, int64_t *gaussians);

/* Before the first step, where no prune by score is to come: thins the background evenly, so that the start fits. */
pags_result pags_size_limit_start(const pags_dataset *dataset, pags_train_state *state, pags_tasks *tasks);

#endif
