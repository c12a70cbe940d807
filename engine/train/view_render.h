/* SPDX-License-Identifier: Apache-2.0 */
/* How training draws a view: compose the parts, pay what is owed to the clusters in view, render. */
#ifndef PAGS_TRAIN_VIEW_RENDER_H
#define PAGS_TRAIN_VIEW_RENDER_H

#include "train/lidar_depth.h"
#include "train/state.h"

struct pags_trainer;

enum { PAGS_RENDER_PLANES = 7 };

/* What a model needs to be drawn and learned from; grown with its clusters. */
typedef struct pags_model_room {
  double (*pose)[6]; /* the pose gradient of each of its clusters */
  int64_t pose_room; /* clusters that fit */
  float *dc;         /* with colour over time: 3 planes, the colour now */
  int64_t dc_stride;
  float *factor; /* factors of opacity, for steps with dropout */
  int64_t factor_room;
  double basis[5];    /* Fourier basis now */
  float *held;        /* gradients by the object opacity term, waiting for the others: planes as the frame's */
  int32_t *held_step; /* per cluster: the step they belong to */
  int64_t held_room;  /* floats; clusters = floats / (planes * cluster size) */
} pags_model_room;

/* The model that a part of the view was made from. */
typedef struct pags_drawn_model {
  int64_t model;
  int64_t knot; /* index of the pose in its track at the view's time step; -1: the background, or a time step without a
                   label */
} pags_drawn_model;

/* What training draws with besides the state; the same from step to step. */
typedef struct pags_view_render {
  pags_frame *frame, *object_frame;
  pags_part *parts;        /* of the view: the background first, then what moves and is there */
  pags_drawn_model *drawn; /* by part */
  int part_count;
  pags_model_room *models;          /* by model */
  float *plane[PAGS_RENDER_PLANES]; /* gradient R G B, T, sum(w z); zeros; ones */
  uint8_t *emphasis;                /* 1 where the training view shows something critical; as long as a plane */
  int64_t plane_floats;             /* room in each */
  struct {
    int64_t count;
    pags_lidar_depth_sample *samples;
    bool loaded;
  } *depth; /* by view of the data set */
} pags_view_render;

/* What the frame's callbacks are given. */
typedef struct pags_render_context {
  struct pags_trainer *trainer;
  int64_t step;
  int first_part; /* of the trainer's parts that the frame was given */
} pags_render_context;

pags_result pags_view_render_create(struct pags_trainer *trainer);
void pags_view_render_destroy(struct pags_trainer *trainer);

/* The parts that exist at a view's time, as trained so far. */
void pags_view_render_compose(struct pags_trainer *trainer, int64_t view);
/* The frame's options for a view at `step`. */
pags_frame_options pags_view_render_options(const struct pags_trainer *trainer, int64_t step);
/* In steps with dropout: gives each part an array of opacity factors, one a Gaussian, which pags_view_render_touch
 * fills at random (0 for a Gaussian that the step leaves out). */
pags_result pags_view_render_reserve_factors(struct pags_trainer *trainer, int64_t step);
/* Before a cluster is read: owed updates, colour now, dropout. `user` is a pags_render_context. */
void pags_view_render_touch(void *user, int part, int64_t cluster, int worker);
/* Renders the composed parts; owed updates of what is in view are paid. */
pags_result pags_view_render_draw(struct pags_trainer *trainer, int64_t step, const pags_camera *camera,
                                  const pags_frame_options *options, pags_picture *picture);

#endif
