/* SPDX-License-Identifier: Apache-2.0 */
/* Exposure of each training photograph: photograph = gain * picture + offset, per channel, in display-referred sRGB.
 * An exposure is the sum of a camera's part, which every photograph of that camera updates, and a small part of the
 * photograph's own, which gets no more than some tens of updates in a run: the cameras of one rig differ far more
 * than the photographs of one camera do. After every step, the means over all training photographs are set back to
 * where they were, gain 1 and offset 0, so that the scene keeps its colours.
 *
 * They must pass a holdout test (holdout_test.h), unless the configuration asks for them. */
#ifndef PAGS_TRAIN_EXPOSURE_H
#define PAGS_TRAIN_EXPOSURE_H

#include <stdbool.h>

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/tasks.h>

#include "train/adam.h"
#include "train/holdout_test.h"
#include "train/schedule.h"

typedef struct pags_exposure {
  double value[6]; /* gains of R, G, B, then offsets */
  pags_adam6 moments;
} pags_exposure;

typedef struct pags_exposures {
  pags_holdout_test holdout;
  int64_t count;        /* views of the data set; 0: exposure isn't modelled */
  int64_t sensors;      /* cameras of the rig, indexed by camera number + 1 (number -1: unknown) */
  pags_exposure *items; /* parts of the `count` views, from 1 and 0 (held-out views stay there), then those of the
                           cameras, from 0 and 0 */
  double mean[6];       /* what the mean over the training photographs is held at: 1 and 0, in a block of a recording
                           that of the whole recording's scene (shared_parts.c) */
} pags_exposures;

pags_result pags_exposures_create(pags_exposures *exposures, const pags_dataset *dataset);
/* Frees the exposures; the result of the test stays. */
void pags_exposures_destroy(pags_exposures *exposures);

/* Writes the exposure of a training view to `value`: gains, then offsets. */
void pags_exposures_value(const pags_exposures *exposures, const pags_dataset *dataset, int64_t view, double value[6]);

/* Whether the photographs of a static set were taken in the order of their names, as far as exposures show it: those of
 * training views differ less from the middle of their neighbours' than from the mean of all. */
bool pags_exposures_follow_names(const pags_exposures *exposures, const pags_dataset *dataset);
/* Writes the exposure of a held-out view of such a set, between those of the training views before and after it.
 * Held-out views of other static sets have the mean exposure, gain 1 and offset 0; in driving sets pags_scene_exposure
 * interpolates in time. */
void pags_exposures_between(const pags_exposures *exposures, const pags_dataset *dataset, int64_t view,
                            double value[6]);

/* One Adam step for one view's part and its camera's part, after which the means over the training views are set back
 * to `mean`. Returns false if the gradient isn't finite; then no part takes a step. */
bool pags_exposures_update(pags_exposures *exposures, const pags_dataset *dataset, int64_t view,
                           const double gradient[6], const pags_schedule *schedule, int64_t step);

#endif
