/* SPDX-License-Identifier: Apache-2.0 */
/* A run at work: what the loop, its steps, its estimate and its opening share. */
#ifndef PAGS_TRAIN_RUN_H
#define PAGS_TRAIN_RUN_H

#include "init/lidar_planes.h"
#include "train/driving_losses.h"
#include "train/output.h"
#include "train/photometric_loss.h"
#include "train/state.h"
#include "train/view_render.h"

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
  pags_view_render render;
  pags_lidar_planes lidar_planes; /* of the data set; none without lidar_pull */
  int measuring;                  /* 1: gradients are thrown away */
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
  pags_driving_losses terms;
} pags_step_view;

#endif
