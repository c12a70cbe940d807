/* SPDX-License-Identifier: Apache-2.0 */
/* One set of Gaussians in training: the background, or a moving object in its box's frame. Rows move together through
 * parameters, moments and statistics. */
#ifndef PAGS_TRAIN_MODEL_H
#define PAGS_TRAIN_MODEL_H

#include <pags/frame.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

#include "train/adam.h"
#include "train/schedule.h"

/* Statistics since the last densify, per row; zero beyond the rows in use. */
typedef struct pags_density {
  int64_t capacity;
  float *gradient; /* sum of |dL/d mean2D|, NDC, over the views it was drawn in */
  int32_t *seen;   /* how many */
  float *squared;  /* since the last prune: sum of squared derivatives of the loss by the projected Gaussian's value;
                      NULL unless the  configuration takes S_grad from training */
} pags_density;

typedef struct pags_train_model {
  int64_t object;         /* of the data set; -1: the background */
  pags_schedule schedule; /* the run's, with this model's extent */
  int64_t step;           /* steps done */
  int64_t cap;            /* bound on this model's Gaussians at the next densify; 0: none */
  double half_size[3];    /* of an object's box, metres: what strays outside is pruned; 0: unbounded */
  double fourier_gain;    /* dB that colour over time promised when it was decided; NaN: not decided */
  pags_gaussians gaussians;
  pags_adam adam;
  pags_density density;
  pags_clusters clusters; /* derived: not in the checkpoint */
} pags_train_model;

/* Takes over `g` (zeroed) as the start of a run of `stop` steps; on failure everything is freed. */
pags_result pags_model_create(pags_train_model *model, const pags_schedule *schedule, int64_t stop, pags_gaussians *g);
void pags_model_destroy(pags_train_model *model);

/* Parameters and moments of all rows current as of the step done, for decisions that look at all of them. */
void pags_model_settle(pags_train_model *model, pags_tasks *tasks);

/* Row i becomes the old row source[i] (all planes, moments, statistics); rows from `fresh` on start with moments of
 * zero. Capacity grows as needed. The clusters no longer fit: sort follows. */
pags_result pags_model_gather(pags_train_model *model, const int64_t *source, int64_t count, int64_t fresh,
                              pags_tasks *tasks);
/* Morton order, clusters and bounds anew. The model must be settled. */
pags_result pags_model_sort(pags_train_model *model, pags_tasks *tasks);
/* All parameters of the row are numbers. */
int pags_model_is_finite_row(const pags_gaussians *gaussians, int64_t row);
/* For the finished scene: takes out rows that aren't finite; the model can't be trained any more. Returns how many
 * there were, -1 without memory. */
int64_t pags_model_drop_spoiled(pags_train_model *model);
/* Statistics back to zero. */
void pags_model_clear_density(pags_train_model *model);
/* Gives the colour terms over time (zeros) with their moments. */
pags_result pags_model_add_fourier(pags_train_model *model);

#endif
