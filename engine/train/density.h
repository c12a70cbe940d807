/* SPDX-License-Identifier: Apache-2.0 */
/* Density control after a training step: runs whatever the schedule names for that step. */
#ifndef PAGS_TRAIN_DENSITY_H
#define PAGS_TRAIN_DENSITY_H

#include "train/run.h"

/* Runs, each where the schedule has it due after the step just done: clone, split and prune (or MCMC's moves), the
 * choice of objects with colour over time, pruning by score, the pull of the background onto LiDAR planes, the reset
 * of opacities. Whatever looks at all Gaussians first applies all pending Adam steps. */
pags_result pags_density_control(pags_trainer *trainer);

#endif
