/* SPDX-License-Identifier: Apache-2.0 */
/* A model in training: the Gaussians of the background, or of one moving object in the frame of its box, with their
 * optimiser moments, densify statistics and clusters. A Gaussian has the same row in all of these arrays; whatever
 * moves or removes rows does so in all of them. */
#ifndef PAGS_TRAIN_MODEL_H
#define PAGS_TRAIN_MODEL_H

#include <stdbool.h>

#include <pags/frame.h>
#include <pags/gaussians.h>
#include <pags/tasks.h>

#include "cluster/transport.h"
#include "train/adam.h"
#include "train/schedule.h"

/* Densify statistics since the last densify, per row; zero beyond the rows in use. */
typedef struct pags_density {
  int64_t capacity;
  float *gradient; /* sum of |dL/d mean2D|, NDC, over the views in which the Gaussian was drawn */
  int32_t *seen;   /* number of those views */
  float *squared;  /* since the last prune: sum of squared derivatives of the picture by the projected Gaussian's value;
                      NULL unless the configuration takes S_grad from training */
} pags_density;

/* How the models of a run are shared out to ranks (cluster/shares.h). */
typedef struct pags_sharing {
  pags_transport *transport;
  int64_t models;
  int64_t *rows, *begin; /* [models]; [models][ranks + 1], as pags_shares_cut has them */
} pags_sharing;

typedef struct pags_train_model {
  int64_t object;         /* object number in the data set; -1: the background */
  pags_schedule schedule; /* the run's schedule, with this model's extent */
  int64_t step;           /* number of steps done */
  int64_t cap;            /* limit on this model's Gaussians at the next densify; 0: none */
  double half_size[3];    /* of an object's box, metres; Gaussians may be within 1.5 times the box; 0: no limit */
  double fourier_gain;    /* PSNR gain in dB that colour over time promised when it was decided; NaN: not decided */
  pags_gaussians gaussians;
  /* With several ranks, `gaussians` and all else by row or cluster are this rank's rows [first_row, first_row +
   * gaussians.count) of `total`, first_row being a multiple of the cluster size. With one rank they are all. */
  int64_t first_row, total;
  pags_sharing *sharing; /* of the run, which owns it; NULL with one rank */
  int64_t index;         /* of the model in it */
  pags_adam adam;
  pags_density density;
  pags_clusters clusters; /* derived from the rest; not in the checkpoint */
} pags_train_model;

/* Creates a model from the Gaussians `g`, which it takes over (`g` is zeroed), for a run of `stop` steps; on failure
 * everything is freed. A model without pending Adam steps (pags_adam_settle) is called settled: all of its rows are
 * current as of the last step done, as decisions that look at all rows need. */
pags_result pags_model_create(pags_train_model *model, const pags_schedule *schedule, int64_t stop, pags_gaussians *g);
void pags_model_destroy(pags_train_model *model);

/* Reorders the rows: new row i is the old row source[i] (all planes, moments, statistics), of `count` rows; rows from
 * `fresh` on start with moments of zero. Capacity grows as needed. The clusters no longer match the rows: call
 * pags_model_sort afterwards. */
pags_result pags_model_gather(pags_train_model *model, const int64_t *source, int64_t count, int64_t fresh,
                              pags_tasks *tasks);
/* Collective, at the end of a run: brings the Gaussians of all ranks to rank 0. Moments and statistics are given up, so
 * that the model can't be trained any more; other ranks have nothing of it then. */
pags_result pags_model_collect(pags_train_model *model);
/* Copies rows, with moments and statistics, to rows `at` and following of another model that has as many columns; their
 * clusters' steps and bounds are the caller's. */
void pags_model_copy_rows(pags_train_model *from, int64_t first, int64_t count, pags_train_model *to, int64_t at);
/* A row that becomes a copy of another; `from` and `to` are known, and read, only at their own ranks. */
typedef struct pags_row_move {
  int from_rank, to_rank;
  int64_t from, to;
} pags_row_move;
/* Makes the row `to` of each move a copy of the row `from` in all planes and statistics; the moments of both become
 * zero. No row may be copied from and to. Collective: all ranks have the same list. */
pags_result pags_model_relocate(pags_train_model *model, const pags_row_move *moves, int64_t count);
/* Sorts the rows in Morton order and rebuilds the clusters and their bounds. The model must be settled. With several
 * ranks (collective) the rows go to the ranks that the order gives them to; numbers[row] is the row's place among those
 * of all ranks, which decides between equal codes. `numbers` may be NULL with one rank. */
pags_result pags_model_sort(pags_train_model *model, const uint32_t *numbers, pags_tasks *tasks);
/* The other ranks of the model's run; NULL: none. */
static inline pags_transport *pags_model_transport(const pags_train_model *model) {
  return model->sharing ? model->sharing->transport : NULL;
}
/* One Adam step on a cluster's Gaussians, as pags_adam_update; notes updates that are left out. */
void pags_model_update(pags_train_model *model, pags_nonfinite *nonfinite, int64_t cluster, const float *gradient,
                       int64_t stride, int planes);
/* Returns whether all parameters of the row are finite. */
bool pags_model_is_finite_row(const pags_gaussians *gaussians, int64_t row);
/* Removes the rows with parameters that aren't finite, for the finished scene; the model can't be trained any more.
 * Adds the number of rows removed to *dropped. */
pags_result pags_model_drop_spoiled(pags_train_model *model, int64_t *dropped);
/* Sets the densify statistics `gradient` and `seen` to zero. */
void pags_model_clear_density(pags_train_model *model);
/* Adds the Fourier terms of colour over time up to an SH degree, all zero, and their moments. */
pags_result pags_model_add_fourier(pags_train_model *model, int degree);

#endif
