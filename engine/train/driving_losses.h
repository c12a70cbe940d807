/* SPDX-License-Identifier: Apache-2.0 */
/* Loss terms of driving scenes. Each adds its gradient to planes that exist already and returns its weighted value;
 * each is a pure function of planes of `stride` floats a row, the same bits for any number of threads. Weights and
 * sources: facts of Street Gaussians. */
#ifndef PAGS_TRAIN_DRIVING_LOSSES_H
#define PAGS_TRAIN_DRIVING_LOSSES_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/tasks.h>

#include "train/lidar_depth.h"

/* Values of a step's loss terms beside the photometric loss, weighted. */
typedef struct pags_driving_losses {
  double sky, depth, objects;
} pags_driving_losses;

/* Sky opacity: weight times the mean over counted pixels of the binary cross-entropy of alpha = 1 - T against 0 where
 * the label says sky and 1 elsewhere, alpha clamped to [1e-6, 1 - 1e-6] (zero gradient outside).
 * `transmittance_gradient`: added to. */
pags_result pags_driving_loss_sky(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                  double weight, float *transmittance_gradient, double *value);

/* LiDAR depth: weight times the mean of |depth_sum / alpha - sample| over the samples with the smallest `share` of
 * errors among those whose pixel has alpha > 0.05. `shrink`: of the picture. Gradients by depth_sum and T are added. */
pags_result pags_driving_loss_depth(const pags_picture *picture, const pags_photo *photo,
                                    const pags_lidar_depth_sample *samples, int64_t count, int shrink, double weight,
                                    double share, float *depth_gradient, float *transmittance_gradient, double *value);

/* Opacity of objects, from a picture of the moving objects alone: weight times the mean over counted pixels of the
 * binary entropy of alpha where a moving object's box is (PAGS_LABEL_VEHICLE | _PEDESTRIAN | _CYCLIST), and of -log(1 -
 * alpha) elsewhere. */
pags_result pags_driving_loss_objects(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                      double weight, float *transmittance_gradient, double *value);

#endif
