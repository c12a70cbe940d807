/* SPDX-License-Identifier: Apache-2.0 */
/* What a training run consists of between two steps: all that a checkpoint holds. */
#ifndef PAGS_TRAIN_STATE_H
#define PAGS_TRAIN_STATE_H

#include "train/exposure.h"
#include "train/model.h"
#include "train/nonfinite.h"
#include "train/sky_fit.h"
#include "train/track_poses.h"

typedef struct pags_train_state {
  pags_schedule schedule;
  int64_t stop;     /* last step to do; beyond schedule.length after --resume --iterations */
  int64_t step;     /* steps done */
  int64_t resets;   /* opacity resets done */
  int64_t cap;      /* the bound on Gaussians that the run keeps: max_gaussians or what max_memory allows; 0: none */
  int64_t clocked;  /* 1: the length was set from a clock, so it need not be the one asked for */
  double loss, mse; /* running means; 0 steps: 0 */
  int64_t model_count;
  pags_train_model *models; /* the background first; then objects in the data set's order */
  pags_track_poses tracks;  /* of all labelled boxes */
  pags_sky_fit sky;         /* size 0: none */
  double sky_share;         /* of the training photographs' pixels */
  int64_t lidar_points;     /* that the background started from */
  pags_exposures exposures; /* count 0: none */
  pags_nonfinite nonfinite; /* what wasn't finite so far */
} pags_train_state;

/* An empty run of `stop` steps with room for `models` models. */
pags_result pags_state_create(pags_train_state *state, const pags_schedule *schedule, int64_t stop, int64_t models);
void pags_state_destroy(pags_train_state *state);

/* Takes over `g` as the next model. `extent`: metres. */
pags_result pags_state_add_model(pags_train_state *state, int64_t object, double extent, pags_gaussians *g);

int64_t pags_state_gaussian_count(const pags_train_state *state);
/* Sets the step of the run and of its models. */
void pags_state_set_step(pags_train_state *state, int64_t step);
/* All models settled (see pags_model_settle). */
void pags_state_settle(pags_train_state *state, pags_tasks *tasks);
/* Parameters of all models current as of the step done; changes no bit of the run. */
void pags_state_flush(pags_train_state *state, pags_tasks *tasks);
/* A schedule of another length, everything settled; models keep their extents. */
pags_result pags_state_retime(pags_train_state *state, const pags_schedule *schedule, int64_t stop);

/* Gives an object's model the bounds of its box, where strays are to be pruned. */
void pags_state_fit_box(pags_train_state *state, int64_t model);

#endif
