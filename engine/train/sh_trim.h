/* SPDX-License-Identifier: Apache-2.0 */
/* Trims spherical harmonics that no training view needs, to make the finished scene smaller.
 *
 * Each Gaussian keeps the lowest SH degree at which its colour changes by at most `error`, in every direction from
 * which a training view can see it. The common part of the removed terms over these directions (the middle of their
 * range, channel by channel) is added to the constant term. A pixel is a sum of colours whose weights add up to at
 * most 1, so no pixel of a training view changes by more than `error`. */
#ifndef PAGS_TRAIN_SH_TRIM_H
#define PAGS_TRAIN_SH_TRIM_H

#include "train/run.h"

/* A view in the frame of reference of a model's Gaussians. */
typedef struct pags_sh_view {
  float r[9], t[3]; /* camera_from_model: rotation, translation */
  float eye[3];     /* the camera's centre in the model's frame */
  float fx, fy, cx, cy, width, height;
  bool bends;             /* has a lens: everything may show */
  float reach_x, reach_y; /* largest extent on the screen, px per (sigma / depth) */
  float near_plane, low;  /* metres; px that the low-pass filter adds to the extent */
} pags_sh_view;

/* Builds the view of a model from a camera. `origin` is the origin of the model's positions in the world, subtracted
 * from the camera's position. */
pags_sh_view pags_sh_view_make(const pags_camera *camera, const double world_from_model[12], const double origin[3],
                               double near_plane, double low_pass);

/* Trims rows [first, last): sets the terms beyond the degree that a row keeps to 0. A Gaussian that no view sees
 * keeps its constant term only. */
void pags_sh_trim_rows(pags_gaussians *g, const pags_sh_view *views, int64_t view_count, double error, int64_t first,
                       int64_t last);

/* Trims all models at the end of a run with the error that sh_error of the configuration gives; does nothing if it is
 * 0. */
pags_result pags_sh_trim(pags_trainer *trainer);

#endif
