/* SPDX-License-Identifier: Apache-2.0 */
/* The sky in training: its resolution, its first colour, and Adam over the texels that training views can see. */
#ifndef PAGS_TRAIN_SKY_FIT_H
#define PAGS_TRAIN_SKY_FIT_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/sky.h>

#include "train/schedule.h"

typedef struct pags_sky_fit {
  pags_sky sky;          /* size 0: the scene has none */
  float *first, *second; /* Adam's moments, laid out as the texels; they move only when a gradient arrives */
  uint16_t *visits; /* per texel: gradients so far, which is what the moments' bias is corrected by; stays at 65535 */
  float (*correction)[2];   /* of the moments, by visits; made at the first step. Derived */
  float beta1, beta2, rate; /* of the step under way */
} pags_sky_fit;

/* Decides by the labels of the training photographs, seen at an eighth of their size: below a thousandth of all pixels
 * there is no sky (size 0). Else texels as large as one to two pixels of the sharpest camera, 64 to 1024 a side, of the
 * mean colour of what is labelled sky. `share` receives that share of pixels. */
pags_result pags_sky_fit_create(pags_sky_fit *fit, const pags_dataset *dataset, pags_photo_cache *photos,
                                double *share);
/* Memory that a sky of `size` takes in training, and that of the data set's where it has one. */
uint64_t pags_sky_fit_bytes(int size);
uint64_t pags_sky_fit_most_bytes(const pags_dataset *dataset);
/* Zero moments for a sky of `size`, as loaded from a checkpoint. */
pags_result pags_sky_fit_prepare(pags_sky_fit *fit, int size);
void pags_sky_fit_destroy(pags_sky_fit *fit);

/* Has the sky take one Adam step while a frame goes back, by pixels that show at least a 255th of it: by Adam's measure
 * the rest would move what lies behind walls as fast as what is seen. PAGS_ERROR_MEMORY. */
pags_result pags_sky_fit_receive(pags_sky_fit *fit, const pags_schedule *schedule, int64_t step,
                                 pags_picture_gradient *gradient);

#endif
