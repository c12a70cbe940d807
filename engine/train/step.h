/* SPDX-License-Identifier: Apache-2.0 */
/* One view's way through the frame and back: compose -> render -> losses -> backward -> updates. */
#ifndef PAGS_TRAIN_STEP_H
#define PAGS_TRAIN_STEP_H

#include "train/lidar_depth.h"
#include "train/photometric_loss.h"
#include "train/state.h"

/* What passes work with besides the state; grown when needed, the same from step to step. */
typedef struct pags_pass {
  pags_frame *frame, *object_frame;
  pags_part *parts;    /* of the view: the background first, then what moves and is there */
  int64_t *part_model; /* index of each part's model */
  int64_t *part_knot;  /* of its track at the view's time step; -1: the background, or a time step without a label */
  int part_count;
  double (**pose)[6]; /* per model: the pose gradient of each of its clusters */
  int64_t *pose_room; /* clusters that fit */
  float **dc;         /* per model with colour over time: 3 planes, the colour now */
  int64_t *dc_stride;
  float **factor; /* per model: factors of opacity, for steps with dropout */
  int64_t *factor_room;
  double (*basis)[5]; /* per model: Fourier basis now */
  float **held; /* per model: gradients by the object opacity term, waiting for the others: planes as the frame's */
  int32_t **held_step;  /* per cluster: the step they belong to */
  int64_t *held_room;   /* floats; clusters = floats / (planes * cluster size) */
  float *plane[7];      /* gradient R G B, T, sum(w z); zeros; ones */
  uint8_t *emphasis;    /* 1 where the training view shows something critical; as long as a plane */
  int64_t plane_floats; /* room in each */
  struct {
    int64_t count;
    pags_lidar_depth_sample *samples;
    int loaded;
  } *depth; /* per view of the data set */
} pags_pass;

/* Values of a step's loss terms beside the photometric loss, weighted. */
typedef struct pags_terms {
  double sky, depth, objects;
} pags_terms;

struct pags_trainer;
pags_result pags_pass_create(struct pags_trainer *trainer);
void pags_pass_destroy(struct pags_trainer *trainer);

/* The parts that exist at a view's time, as trained so far. */
void pags_pass_compose(struct pags_trainer *trainer, int64_t view);
/* The frame's options for a view at `step`. */
pags_frame_options pags_pass_options(const struct pags_trainer *trainer, int64_t step);
/* Renders the composed parts; owed updates of what is in view are paid. */
pags_result pags_pass_render(struct pags_trainer *trainer, int64_t step, const pags_camera *camera,
                             const pags_frame_options *options, pags_picture *picture);

#endif
