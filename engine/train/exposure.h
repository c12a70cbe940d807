/* SPDX-License-Identifier: Apache-2.0 */
/* Exposure of each training photograph: photograph = gain * picture + offset, per channel, in display-referred sRGB. It
 * is the sum of a part of the camera's, which every photograph of that camera moves, and a small one of the
 * photograph's own, which has no more than some tens of visits in a run: cameras of one rig differ far more than the
 * photographs of a camera do. The means over all training photographs are held at 1 and 0 after every step, so that the
 * scene keeps its colours. */
#ifndef PAGS_TRAIN_EXPOSURE_H
#define PAGS_TRAIN_EXPOSURE_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/tasks.h>

#include "train/adam6.h"
#include "train/schedule.h"

typedef struct pags_exposure {
  double value[6]; /* gains, then offsets */
  pags_adam6 moments;
} pags_exposure;

typedef struct pags_exposures {
  int64_t count;        /* views of the data set; 0: not modelled */
  int64_t sensors;      /* cameras of the rig, by number + 1 (number -1: unknown) */
  pags_exposure *items; /* by view, those held out stay at 1 and 0; after them by camera, from 0 and 0 */
} pags_exposures;

pags_result pags_exposures_create(pags_exposures *exposures, const pags_dataset *dataset);
void pags_exposures_destroy(pags_exposures *exposures);

/* Of a training view: gains, then offsets. Of those held out nothing is known but by their neighbours:
 * pags_scene_exposure. */
void pags_exposures_value(const pags_exposures *exposures, const pags_dataset *dataset, int64_t view, double value[6]);

/* Adam for one view and its camera, then the means over the training views put back. Returns 0 where the gradient
 * isn't finite, which moves nothing. */
int pags_exposures_update(pags_exposures *exposures, const pags_dataset *dataset, int64_t view,
                          const double gradient[6], const pags_schedule *schedule, int64_t step);

#endif
