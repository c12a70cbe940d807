/* SPDX-License-Identifier: Apache-2.0 */
/* Vignette and response curve of each camera of the rig (pags/photometric.h), optimised together with the exposures.
 * The scene keeps its colours: a vignette has mean 1 over the picture, the logarithms of the curves' slopes have mean 0
 * over the cameras, and a rig of one camera has a straight curve. They must pass a holdout test (holdout_test.h). */
#ifndef PAGS_TRAIN_PHOTOMETRY_H
#define PAGS_TRAIN_PHOTOMETRY_H

#include <stdbool.h>

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/photometric.h>

#include "train/adam.h"
#include "train/holdout_test.h"
#include "train/schedule.h"

typedef struct pags_photometry_part {
  double vignette[PAGS_VIGNETTING_RINGS];
  double slopes[PAGS_RESPONSE_PIECES]; /* of the curve's pieces: logarithms, but for a common constant */
  double share[PAGS_VIGNETTING_RINGS]; /* of the picture, that each number of the vignette has */
  pags_adam6 by_vignette, by_slopes;
} pags_photometry_part;

typedef struct pags_photometry {
  pags_holdout_test holdout;
  int64_t count;               /* cameras of the rig, in the order of their numbers; 0: not modelled */
  pags_photometry_part *parts; /* by the camera's number */
} pags_photometry;

/* The gradient of the loss by a camera's vignette and slopes. */
typedef struct pags_photometric_gradient {
  double vignette[PAGS_VIGNETTING_RINGS], slopes[PAGS_RESPONSE_PIECES];
} pags_photometric_gradient;

pags_result pags_photometry_create(pags_photometry *photometry, const pags_dataset *dataset);
/* Frees the parts; the result of the test stays. */
void pags_photometry_destroy(pags_photometry *photometry);

/* The light of a camera, neutral if it has none. */
pags_photometric pags_photometry_of_sensor(const pags_photometry *photometry, int sensor);

/* Writes what the camera makes of the picture to the planes out[c], as large as the picture's. PAGS_CANCELLED. */
pags_result pags_photometry_apply(pags_tasks *tasks, const pags_photometric *light, const pags_camera *camera,
                                  const pags_picture *picture, float *const out[3]);
/* Turns the gradient by these planes into that by the picture's, in place, and sums up that by the light. The same bits
 * for any number of threads. PAGS_CANCELLED, PAGS_ERROR_MEMORY. */
pags_result pags_photometry_back(pags_tasks *tasks, const pags_photometric *light, const pags_camera *camera,
                                 const pags_picture *picture, float *const gradient[3], pags_photometric_gradient *out);

/* One Adam step (Kingma and Ba 2015) of a camera. Returns false, and changes nothing, if the gradient isn't finite. */
bool pags_photometry_update(pags_photometry *photometry, int sensor, const pags_photometric_gradient *gradient,
                            const pags_schedule *schedule, int64_t step);

#endif
