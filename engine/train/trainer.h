/* SPDX-License-Identifier: Apache-2.0 */
/* A run at work: what the loop, its estimate and its opening share. */
#ifndef PAGS_TRAIN_TRAINER_H
#define PAGS_TRAIN_TRAINER_H

#include "init/lidar_planes.h"
#include "train/output.h"
#include "train/photometric_loss.h"
#include "train/state.h"
#include "train/step.h"

/* Views announced to the photo cache ahead of use. */
enum { PAGS_TRAIN_AHEAD = 32 };

typedef struct pags_trainer {
  const pags_train_options *options;
  const pags_dataset *dataset;
  pags_tasks *tasks;
  pags_train_state state;
  pags_output output;
  uint64_t fingerprint; /* of the views */
  int64_t view_count;
  int64_t *views;      /* training views: indices of the data set's */
  int64_t *order;      /* of the pass under way and the next: 2 x view_count */
  int64_t order_epoch; /* -1: none yet */
  pags_photo_cache *cache;
  pags_pass pass;
  pags_lidar_planes facets; /* of the data set; none without lidar_pull */
  int measuring;            /* 1: gradients are thrown away */
  struct {
    double wait, forward, loss, backward, density; /* ms, summed over the steps of this process */
  } ms;
} pags_trainer;

/* One view's way through the frame. */
typedef struct pags_step_view {
  int64_t view; /* of the data set */
  int level;
  pags_camera camera; /* shrunk */
  pags_photo photo;
  pags_picture picture;
  pags_photometric_loss loss;
  pags_terms terms;
} pags_step_view;

/* Renders, compares and goes back, with the SH degree of `step`; times are added to trainer->ms. */
pags_result pags_trainer_pass(pags_trainer *trainer, int64_t step, pags_step_view *v);

/* The photograph of training view `index` as training sees it at the step done, for what looks at all of them in turn:
 * those that follow are decoded meanwhile. At any other level than `*level` each would have to be decoded anew, and
 * again for the next step. */
pags_result pags_trainer_photo(pags_trainer *trainer, int64_t index, int *level, pags_photo *photo);

/* What a run takes: s = step_seconds * steps + scoring_seconds. */
typedef struct pags_estimate {
  double step_seconds;    /* mean over the schedule */
  double scoring_seconds; /* of the passes for scores, as many as the schedule prunes and one at its end */
  uint64_t bytes;
} pags_estimate;

/* From a few passes at each level that change no bit of the run. Makes no assumption about the machine; about growth it
 * assumes what estimate.c says. */
pags_result pags_trainer_estimate(pags_trainer *trainer, pags_estimate *out);

/* How a run begins (open_run.c): the training views and their fingerprint, then the state. A resumed run goes on with
 * the checkpoint's configuration, and what `config` asks for must agree with it. */
pags_result pags_trainer_list_views(pags_trainer *trainer);
pags_result pags_trainer_start(pags_trainer *trainer, const pags_train_config *config);
pags_result pags_trainer_resume(pags_trainer *trainer, const pags_train_config *config);

/* Gives an object's model the bounds of its box, where strays are to be pruned. */
void pags_trainer_fit_box(pags_train_state *state, int64_t model);

#endif
