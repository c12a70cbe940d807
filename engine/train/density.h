/* SPDX-License-Identifier: Apache-2.0 */
/* Density control: what the schedule names for the step just done. */
#ifndef PAGS_TRAIN_DENSITY_H
#define PAGS_TRAIN_DENSITY_H

#include "train/run.h"

/* Clone, split and prune (or MCMC's moves), colour over time, pruning by score, the pull onto LiDAR planes, the reset
 * of opacities, each where the schedule has it due. What looks at all rows pays everything owed first. */
pags_result pags_density_control(pags_trainer *trainer);

#endif
