/* SPDX-License-Identifier: Apache-2.0 */
/* Fits the sky, a cube map, in training: chooses its resolution and first colour, and runs Adam over the texels that
 * training views see. */
#ifndef PAGS_TRAIN_SKY_FIT_H
#define PAGS_TRAIN_SKY_FIT_H

#include <stdbool.h>

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/sky.h>

#include "train/gradient_store.h"
#include "train/schedule.h"

struct pags_kernels;

typedef struct pags_sky_fit {
  const struct pags_kernels *kernels;
  pags_sky sky; /* size 0: the scene has no sky */
  bool fixed;   /* it is another scene's and stays as it is (shared_parts.c) */
  /* Each rank has all texels; of every ranks-th block of them, from block number `rank` on, it has the following as
   * well, and updates them. */
  int rank, ranks;
  float *first, *second; /* Adam's moments, as the texels; a texel's change only with a gradient */
  uint16_t *visits; /* per texel: number of gradients to date, at most 65535, for the bias correction of the moments */
  pags_gradient_store sum;  /* of the step's photographs, where it has several: per block of texels */
  float (*correction)[2];   /* bias corrections by number of visits, made at the first step; not in the checkpoint */
  int64_t step;             /* the current one */
  float beta1, beta2, rate; /* of it */
} pags_sky_fit;

/* Decides from the labels of the training photographs, sampled at an eighth of their size, whether the scene has a
 * sky: if less than a thousandth of all pixels is sky, it has none (size 0). Otherwise creates a cube map whose
 * texels are as large as one to two pixels of the sharpest camera, 64 to 1024 texels a side, filled with the mean
 * colour of the pixels labelled sky. `share` receives the sky's share of pixels. */
pags_result pags_sky_fit_create(pags_sky_fit *fit, const pags_dataset *dataset, pags_photo_cache *photos,
                                double *share);
/* Returns the size that the data set's sky has if there is one. */
int pags_sky_fit_size(const pags_dataset *dataset);
/* Returns the bytes that a sky of `size` takes in training; pags_sky_fit_most_bytes those of the data set's sky if it
 * has one. */
uint64_t pags_sky_fit_bytes(int size);
uint64_t pags_sky_fit_most_bytes(const pags_dataset *dataset);
/* Allocates a sky of `size` with zero moments, as for loading a checkpoint. Must be destroyed on failure, too.
 * PAGS_ERROR_MEMORY, PAGS_ERROR_UNSUPPORTED when PAGS_CPU asks for kernels that can't run here. */
pags_result pags_sky_fit_prepare(pags_sky_fit *fit, int size);
void pags_sky_fit_destroy(pags_sky_fit *fit);
/* Keeps only the rank's part of a sky that it has in whole. PAGS_ERROR_MEMORY. */
pags_result pags_sky_fit_share(pags_sky_fit *fit, int rank, int ranks);
/* Blocks of texels of the whole sky, and those that a rank updates. */
int64_t pags_sky_fit_blocks(const pags_sky_fit *fit);
int64_t pags_sky_fit_own_blocks(const pags_sky_fit *fit, int rank);

/* Prepares the sky's part of a photograph's backward pass through `gradient`: its Adam step, or with several
 * photographs a step the sum of their gradients, which pags_sky_fit_finish uses. Only pixels in which the
 * sky has a weight of at least 1/255 count: Adam normalises gradients, so the rest would move texels behind walls as
 * fast as visible ones. PAGS_ERROR_MEMORY. */
pags_result pags_sky_fit_receive(pags_sky_fit *fit, const pags_schedule *schedule, int64_t step,
                                 pags_picture_gradient *gradient);
/* With several photographs a step: the sky's Adam step, by the mean of their gradients. PAGS_CANCELLED. */
pags_result pags_sky_fit_finish(pags_sky_fit *fit, const pags_schedule *schedule, int64_t step, pags_tasks *tasks);

#endif
