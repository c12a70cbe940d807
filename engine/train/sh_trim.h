/* SPDX-License-Identifier: Apache-2.0 */
/* Chooses the SH degrees of the finished scene by their benefit, and removes the terms beyond them.
 *
 * Each Gaussian of the background, and each object as a whole, keeps the SH degree that its view dependence is worth:
 * degrees are chosen so that the scene has the fewest bytes at which the error that is added to the training
 * photographs, bounded from above, lowers their PSNR by at most sh_loss. The mean of the removed terms over the views
 * is added to the constant term. */
#ifndef PAGS_TRAIN_SH_TRIM_H
#define PAGS_TRAIN_SH_TRIM_H

#include "train/run.h"

/* Number of degrees that can be chosen below the highest: 0, 1, 2. */
enum { PAGS_SH_CUTS = 3 };

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

/* Sets changes[l] to the mean square, over the views that may show the row, of the change of its colour (sRGB, summed
 * over the channels) if pags_sh_lower reduces it to degree l; 0 for l from the degree of `g` on. */
void pags_sh_changes(const pags_gaussians *g, const pags_sh_view *views, int64_t view_count, int64_t row,
                     double changes[PAGS_SH_CUTS]);
/* Sets the terms beyond `degree` to 0 and adds their mean over the views that may show the row to the constant term;
 * views count by the solid angle of the row in them. Without such views nothing is added. */
void pags_sh_lower(pags_gaussians *g, const pags_sh_view *views, int64_t view_count, int64_t row, int degree);

/* Collective, at the end of a run with sh_loss and an SH degree above 0: chooses and lowers the degrees of all models
 * but objects with Fourier series on higher terms, and fills state.sh. `weight`: sum of the blending weights (alpha T)
 * of each of this rank's rows over pixels of the training views, model after model. The same bits for any number of
 * threads and ranks. */
pags_result pags_sh_trim(pags_trainer *trainer, const double *weight);

#endif
