/* SPDX-License-Identifier: Apache-2.0 */
/* Parts that the blocks of a recording share (docs/blocks.md): the training of a block takes the sky of a scene of the
 * whole recording, which stays fixed, and its exposures, which are optimised with a fixed mean. Otherwise each block
 * would choose its own sky and brightness, which photograph = gain * picture + offset leaves open. */
#ifndef PAGS_TRAIN_SHARED_PARTS_H
#define PAGS_TRAIN_SHARED_PARTS_H

#include "train/state.h"

/* Fixes the sky and the mean exposure of a run to those of the scene that the data set names. `begin`: sky and
 * exposures start from that scene; otherwise they are those of a checkpoint. Does nothing if the data set names no
 * scene. PAGS_ERROR_FORMAT if the scene lacks a photograph of the data set. */
pags_result pags_shared_parts_load(const pags_dataset *dataset, bool begin, pags_train_state *state);

#endif
