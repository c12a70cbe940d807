/* SPDX-License-Identifier: Apache-2.0 */
/* The PSNR of some held-out views during a run: drawn as training draws, at full size, which changes no bit of the
 * run. */
#ifndef PAGS_TRAIN_HELD_OUT_H
#define PAGS_TRAIN_HELD_OUT_H

#include "train/run.h"

/* A view to measure. */
typedef struct pags_measured_view {
  int64_t view;          /* of the data set */
  pags_scene_view shown; /* by which camera it is drawn, which may be another than the data set's, and how exposed */
  double psnr;           /* dB, the result; NaN if no pixel counts */
} pags_measured_view;

/* Collective: measures the views, which are the same at all ranks. Errors of photographs. */
pags_result pags_held_out_views(pags_trainer *trainer, pags_measured_view *views, int count);

/* Collective: measures a sample of the held-out views, at most PAGS_HELD_OUT_VIEWS spread evenly over
 * the data set: trainer->held_out. Does nothing where none is held out. Errors of photographs. */
pags_result pags_held_out_measure(pags_trainer *trainer);

#endif
