/* SPDX-License-Identifier: Apache-2.0 */
/* What the training of a block takes from a scene of the whole recording (docs/blocks.md): its sky, which stays as it
 * is, and its exposures, which go on being trained but keep their mean. Without that each block would choose its own
 * brightness, since photograph = gain * picture + offset leaves it open, and its own sky. */
#ifndef PAGS_TRAIN_WHOLE_H
#define PAGS_TRAIN_WHOLE_H

#include "train/state.h"

/* Fixes the sky and the mean exposure of a run to those of the scene that the data set names; with `begin` its sky and
 * exposures begin there, else they are those of a checkpoint. Does nothing for a data set that names none.
 * PAGS_ERROR_FORMAT if that scene lacks a photograph of the data set. */
pags_result pags_whole_take(const pags_dataset *dataset, bool begin, pags_train_state *state);

#endif
