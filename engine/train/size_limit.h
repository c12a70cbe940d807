/* SPDX-License-Identifier: Apache-2.0 */
/* The size limit that --target-size sets on the bytes of scene.json, PLYs and sky. Training keeps it by limiting the
 * number of Gaussians, the rows of the PLYs. */
#ifndef PAGS_TRAIN_SIZE_LIMIT_H
#define PAGS_TRAIN_SIZE_LIMIT_H

#include "train/state.h"

/* Returns the bytes that a Gaussian of the model will take in the finished scene's PLY. */
int pags_size_limit_row(const pags_train_state *state, int64_t model);

/* Computes the bytes that all Gaussians together may take; below 0 if the rest of the scene alone is too large. Bytes
 * by which scene.json may still grow are set aside. */
pags_result pags_size_limit_rows(const pags_dataset *dataset, const pags_train_state *state, int64_t *bytes);

/* Computes how many more Gaussians fit, each counted as one of the largest kind; 0 if there are too many already;
 * INT32_MAX if growth isn't limited: no target size, or a prune by score still to come, which applies it. */
pags_result pags_size_limit_room(const pags_dataset *dataset, const pags_train_state *state, int64_t *gaussians);

/* Collective. Call before the first step: if no prune by score is to come, thins the background evenly so that the
 * start fits the target size. */
pags_result pags_size_limit_start(const pags_dataset *dataset, pags_train_state *state, pags_tasks *tasks);

#endif
