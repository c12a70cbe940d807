/* SPDX-License-Identifier: Apache-2.0 */
/* Renders a view for training: composes the parts that exist at its time, applies the pending Adam steps of the
 * clusters in view, renders. */
#ifndef PAGS_TRAIN_VIEW_RENDER_H
#define PAGS_TRAIN_VIEW_RENDER_H

#include "train/driving_losses.h"
#include "train/gradient_store.h"
#include "train/state.h"

struct pags_trainer;

enum { PAGS_RENDER_PLANES = 11 };

/* The floats of a cluster's gradients by all planes, Fourier terms included. */
static inline int64_t pags_row_floats(const pags_train_config *config) {
  const int degree = config->color.sh_degree, terms = PAGS_FOURIER_PLANES * pags_sh_coefficients(degree);
  return (int64_t)(pags_plane_count(degree) + terms) * config->picture.cluster_size;
}

/* Buffers that a model needs to be drawn and trained; they grow with its number of clusters. */
typedef struct pags_model_room {
  double (*pose)[6]; /* per cluster: its share of the gradient by the model's pose */
  int64_t pose_room; /* clusters that fit in `pose` */
  float *sh;         /* with colour over time: the SH coefficients at the view's time, as in pags_part */
  int64_t sh_stride;
  float *factor; /* factors of opacity, for photographs with dropout */
  int64_t factor_room;
  double basis[5];          /* the Fourier basis at the view's time */
  pags_gradient_store held; /* gradients of the object opacity term until the other terms' arrive, by photograph */
  pags_gradient_store sum;  /* with several photographs a step: the sum of their gradients, by step */
} pags_model_room;

/* The model, and the labelled pose, that a part of the view was made from. */
typedef struct pags_drawn_model {
  int64_t model;
  int64_t keyframe; /* index of the track's keyframe at the view's time step; -1: none, or the background */
} pags_drawn_model;

/* LiDAR depth samples of a view. */
typedef struct pags_view_samples {
  int64_t count;
  pags_lidar_depth_sample *samples;
  bool loaded;
} pags_view_samples;

/* Frames and buffers for rendering in training, besides the run's state; kept from step to step. */
typedef struct pags_view_render {
  pags_frame *frame, *object_frame;
  pags_part *parts;        /* the view's parts: the background, then the moving objects that exist at its time */
  pags_drawn_model *drawn; /* one per part */
  int part_count;
  int64_t photograph;               /* number in the run of the one that training sees now */
  pags_model_room *models;          /* one per model */
  float *plane[PAGS_RENDER_PLANES]; /* gradients by R, G, B, T, sum(w z); zeros; ones; pixels that the mask leaves; R,
                                       G, B as the camera shows them (photometry.h) */
  float *rows;                      /* per worker: gradients of a cluster, pags_row_floats */
  uint8_t *emphasis;                /* 1 where the training view is critical, else 0; as long as a plane */
  int64_t plane_floats;             /* floats allocated per plane */
  pags_view_samples *depth;         /* one per view of the data set */
} pags_view_render;

/* The argument of the frame's callbacks. */
typedef struct pags_render_context {
  struct pags_trainer *trainer;
  int64_t step;
  int first_part; /* index of the first of the trainer's parts that the frame was given */
} pags_render_context;

pags_result pags_view_render_create(struct pags_trainer *trainer);
void pags_view_render_destroy(struct pags_trainer *trainer);

/* Sets the parts to those that exist at a view's time, with the current poses. */
void pags_view_render_compose(struct pags_trainer *trainer, int64_t view);
/* Returns the camera that a view of the data set is drawn with, its size divided by `factor`. */
pags_camera pags_view_render_camera(const struct pags_trainer *trainer, int64_t view, double factor);
/* Returns the frame's options for a view at `step`. */
pags_frame_options pags_view_render_options(const struct pags_trainer *trainer, int64_t step);
/* For photographs with dropout: gives each part an array of opacity factors, one per Gaussian, which
 * pags_view_render_touch fills at random (0 for a Gaussian that is left out). */
pags_result pags_view_render_reserve_factors(struct pags_trainer *trainer);
/* Callback of the frame before it reads a cluster: applies pending Adam steps, evaluates the colour at the view's
 * time, draws dropout. `user` is a pags_render_context. */
void pags_view_render_touch(void *user, int part, int64_t cluster, int worker);
/* Makes room for what drawing the composed parts needs of their models, and begins their Adam steps. */
pags_result pags_view_render_prepare(struct pags_trainer *trainer, int64_t step);
/* Renders the composed parts; applies the pending Adam steps of the clusters in view. */
pags_result pags_view_render_draw(struct pags_trainer *trainer, int64_t step, const pags_camera *camera,
                                  const pags_frame_options *options, pags_picture *picture);

#endif
