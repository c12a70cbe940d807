/* SPDX-License-Identifier: Apache-2.0 */
/* Results of a step that all ranks share: losses of photographs drawn by others, gradients of poses of objects owned by
 * others, of camera poses and photometric calibration, and skipped updates. Tracks, exposures, cameras and
 * the sky are the same at every rank, which updates them from the same numbers. */
#ifndef PAGS_TRAIN_SHARED_STEP_H
#define PAGS_TRAIN_SHARED_STEP_H

#include "train/run.h"

/* Collective: fills losses, terms and the gradient by the light of all views of a round, of which rank r has drawn view
 * r. */
pags_result pags_shared_step_results(pags_trainer *trainer, pags_step_view *views, int count);
/* Collective, at the end of a step, after the Gaussians' updates: brings together trainer->rest and state.nonfinite. */
pags_result pags_shared_step_rest(pags_trainer *trainer);
/* Collective: brings together state.nonfinite since it was trainer->shared_nonfinite. */
pags_result pags_shared_step_nonfinite(pags_trainer *trainer);

#endif
