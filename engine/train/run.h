/* SPDX-License-Identifier: Apache-2.0 */
/* The data of a training run in progress, shared by the training loop, its steps, the estimate and the opening of a
 * run. */
#ifndef PAGS_TRAIN_RUN_H
#define PAGS_TRAIN_RUN_H

#include <math.h>

#include "base/clock.h"
#include "base/memory.h"
#include "init/lidar_planes.h"
#include "train/driving_losses.h"
#include "train/exact_sum.h"
#include "train/output.h"
#include "train/photometric_loss.h"
#include "train/shared_views.h"
#include "train/sky_parts.h"
#include "train/state.h"
#include "train/view_render.h"

/* The time that a stage of training takes, in ms: by the wall's clock, and of the processor on the thread that trains,
 * which doesn't count while it waits for other ranks. */
typedef struct pags_stage_time {
  double wall, processor;
} pags_stage_time;

static inline pags_stage_time pags_stage_now(void) {
  return (pags_stage_time){pags_clock_ms(), (double)pags_port_thread_clock_ns() * 1e-6};
}

/* Adds the time since *since to *sum, and sets *since to the present. */
static inline void pags_stage_lap(pags_stage_time *since, pags_stage_time *sum) {
  const pags_stage_time now = pags_stage_now();
  sum->wall += now.wall - since->wall;
  sum->processor += now.processor - since->processor;
  *since = now;
}

/* What the photographs of a step leave until its end, in their order. */
typedef struct pags_step_rest {
  int64_t count; /* photographs drawn */
  struct pags_photograph_rest {
    int64_t view;
    double by_exposure[6];
    pags_exact_sum by_world; /* by a motion of everything that the camera sees (camera_poses.h) */
    pags_photometric_gradient by_light;
  } *photographs; /* [batch] */
  int64_t pose_count;
  struct pags_pose_rest {
    int64_t object, keyframe;
    double by_pose[6]; /* dLoss/d(rotation, translation) of the object at that keyframe */
  } *poses;            /* [batch * models] */
} pags_step_rest;

/* Held-out views as they were measured last (held_out.c). */
enum { PAGS_HELD_OUT_VIEWS = 8 };
typedef struct pags_held_out {
  int count; /* 0: not measured yet */
  pags_train_score scores[PAGS_HELD_OUT_VIEWS];
  double psnr;  /* their mean, dB; NaN: none counts */
  int64_t step; /* steps done then */
} pags_held_out;

typedef struct pags_trainer {
  const pags_train_options *options;
  const pags_dataset *dataset;
  pags_tasks *tasks;
  pags_train_state state;
  pags_output output;
  uint64_t fingerprint; /* hash of the views, see pags_views_list */
  int64_t view_count;
  int64_t *views;      /* the training views, as indices of the data set's views */
  int64_t *order;      /* permutations of the training views for the current pass and the next: 2 x view_count */
  int64_t order_epoch; /* the current pass; -1: no permutation yet */
  pags_photo_cache *cache;
  pags_view_render render;
  pags_step_rest rest;
  pags_held_out held_out;
  pags_described *described;      /* of pags_train_moment_compose, until its release; else NULL */
  double watched_ms;              /* time spent in callbacks */
  int ranks;                      /* that draw photographs, this one included */
  pags_sharing sharing;           /* of the models; zeroed with one rank */
  pags_sky_parts sky_parts;       /* the sky's gradient of this rank's view */
  pags_shared_views shared;       /* the other ranks; zeroed with one rank */
  int64_t shared_nonfinite;       /* state.nonfinite.count at the begin of the step */
  struct pags_step_view *round;   /* [ranks]: the views of a round */
  pags_lidar_planes lidar_planes; /* of the data set; empty without lidar_pull and lidar_lay */
  int64_t done[PAGS_DECISIONS];   /* steps of this process that trained a part that a run decides about */
  bool counted;                   /* a pixel of a photograph has counted */
  bool measuring;                 /* a timing probe; gradients are computed but nothing is updated */
  pags_train_traffic traffic;     /* with several ranks: of the views that this one has drawn */
  struct {
    pags_stage_time wait, forward, loss, backward, density; /* summed over the steps of this process */
    pags_stage_time tests[PAGS_DECISIONS];                  /* holdout tests of parts that a run decides about */
    pags_stage_time of[PAGS_DECISIONS];                     /* of parts that a run decides about, contained in these */
  } ms;
} pags_trainer;

/* What all ranks learn of a view that one of them has drawn. */
typedef struct pags_view_result {
  pags_photometric_loss loss;
  pags_photometric_gradient by_light; /* of the loss, by the camera's light */
  pags_driving_losses terms;
  bool objects_drawn; /* the object opacity term was evaluated */
} pags_view_result;

/* One of a step's views: its photograph, picture and losses. */
typedef struct pags_step_view {
  int64_t number; /* of the photograph in the run, from 1 */
  int64_t view;   /* index of the data set's view */
  int level;
  pags_camera camera; /* the view's camera at the resolution level */
  pags_photo photo;   /* this and the picture: only at the rank that draws the view */
  pags_picture picture;
  pags_view_result result;
} pags_step_view;

#endif
