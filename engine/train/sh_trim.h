/* SPDX-License-Identifier: Apache-2.0 */
/* Spherical harmonics only where they show.
 *
 * For each Gaussian, the lowest degree is kept at which its colour, from every direction that a training view can see
 * it from, changes by at most `error`. What the removed terms have in common there (the middle of their range, channel
 * by channel) goes to the constant term. A pixel is a sum of colours with weights of at most 1 in all, so no pixel of a
 * training view changes by more than `error`. */
#ifndef PAGS_TRAIN_SH_TRIM_H
#define PAGS_TRAIN_SH_TRIM_H

#include "train/run.h"

/* A view as the Gaussians of one frame of reference have it. */
typedef struct pags_sh_view {
  float r[9], t[3]; /* camera_from_model */
  float eye[3];     /* the camera in the model's frame */
  float fx, fy, cx, cy, width, height;
  float reach_x, reach_y; /* px of extent per (sigma / depth), at most */
  float near_plane, low;  /* metres; px */
} pags_sh_view;

/* `origin`: of the model's positions, subtracted where it stands still in the world. */
pags_sh_view pags_sh_view_make(const pags_camera *camera, const double world_from_model[12], const double origin[3],
                               double near_plane, double low_pass);

/* Rows [first, last): terms beyond the degree that a row keeps become 0. What no view sees keeps its constant term
 * only. */
void pags_sh_trim_rows(pags_gaussians *g, const pags_sh_view *views, int64_t view_count, double error, int64_t first,
                       int64_t last);

/* All models of a run at its end, by the configuration's sh_error; nothing where that is 0. */
pags_result pags_sh_trim(pags_trainer *trainer);

#endif
