/* SPDX-License-Identifier: Apache-2.0 */
/* Loss terms of driving scenes: sky opacity, LiDAR depth, opacity of moving objects, with the forms and weights of
 * Street Gaussians (Yan et al. 2024). Each function adds its gradient to existing planes and returns its weighted
 * value. Each is a pure function of planes of `stride` floats a row and gives the same bits for any number of
 * threads. */
#ifndef PAGS_TRAIN_DRIVING_LOSSES_H
#define PAGS_TRAIN_DRIVING_LOSSES_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/tasks.h>

/* ---- LiDAR points as sparse depth samples of a view, for the loss and for evaluation: lidar_depth.c ---- */

typedef struct pags_lidar_depth_sample {
  float x, y;  /* px at the full size of the view's camera (divide by the shrink factor of a smaller picture) */
  float depth; /* camera z, metres */
} pags_lidar_depth_sample;

/* Lists the LiDAR points of the view's own time step that its camera sees, at most `most` of them, chosen evenly. The
 * points are projected; those hidden behind nearer ones are left out by a z-buffer of coarse cells, since the LiDAR
 * sits elsewhere than the camera. The list is empty if the time step has no sweep. Works for held-out views, too:
 * evaluation uses them, training must not. `samples` is freed by the caller. */
pags_result pags_lidar_depth_samples(const pags_dataset *dataset, int64_t view, int64_t most, int64_t *count,
                                     pags_lidar_depth_sample **samples);

/* ---- The loss terms ---- */

/* Weighted values of a step's loss terms, the photometric loss excluded. */
typedef struct pags_driving_losses {
  double sky, depth, objects;
} pags_driving_losses;

/* Sky opacity: weight times the mean over counted pixels of the binary cross-entropy of alpha = 1 - T (T:
 * transmittance), whose target is 0 where the label says sky and 1 elsewhere. alpha is clamped to [1e-6, 1 - 1e-6],
 * with zero gradient outside. The gradient is added to `transmittance_gradient`. */
pags_result pags_driving_loss_sky(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                  double weight, float *transmittance_gradient, double *value);

/* LiDAR depth: weight times the mean of |depth_sum / alpha - sample|, in metres, over the `share` (0..1) of samples
 * with the smallest errors, among samples whose pixel has alpha > 0.05. `shrink`: the factor by which the picture is
 * smaller than the camera's full size, a power of two. The gradients by depth_sum and by the transmittance are added
 * to the planes. */
pags_result pags_driving_loss_depth(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                    const pags_lidar_depth_sample *samples, int64_t count, int shrink, double weight,
                                    double share, float *depth_gradient, float *transmittance_gradient, double *value);

/* Opacity of objects, from a picture of the moving objects alone: weight times the mean over counted pixels of the
 * binary entropy of alpha inside of moving objects' boxes (PAGS_LABEL_VEHICLE | _PEDESTRIAN | _CYCLIST), and of
 * -log(1 - alpha) elsewhere. */
pags_result pags_driving_loss_objects(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                      double weight, float *transmittance_gradient, double *value);

#endif
