/* SPDX-License-Identifier: Apache-2.0 */
/* The PSNR of some held-out views during a run: drawn as training draws, at full size, which changes no bit of the
 * run. */
#ifndef PAGS_TRAIN_HELD_OUT_H
#define PAGS_TRAIN_HELD_OUT_H

#include "train/run.h"

/* Draws a view by `camera`, which may be another than the data set's, exposes it as `exposed` says, and measures its
 * PSNR in dB; NaN if no pixel counts or none differs. */
pags_result pags_held_out_view(pags_trainer *trainer, int64_t view, const pags_camera *camera,
                               const pags_scene_view *exposed, double *psnr);

/* Measures the held-out views that stand for all of them, at most PAGS_HELD_OUT_VIEWS spread evenly over the data
 * set: trainer->held_out. Does nothing where none is held out. Errors of photographs. */
pags_result pags_held_out_measure(pags_trainer *trainer);

#endif
