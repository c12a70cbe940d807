/* SPDX-License-Identifier: Apache-2.0 */
/* Fits the pose of a camera to the left half of its photograph, the scene held, and judges it on the right half: how
 * much of a picture's error is the pose's. */
#ifndef PAGS_TRAIN_FIT_POSE_H
#define PAGS_TRAIN_FIT_POSE_H

#include <pags/dataset.h>
#include <pags/frame.h>

typedef struct pags_fitted_pose {
  pags_camera camera;   /* with the fitted pose */
  double given, fitted; /* PSNR of the right half, dB, as given and as fitted; NaN if no pixel counts */
} pags_fitted_pose;

/* Draws `parts` through `camera` some forty times, with keep_for_backward and therefore without a light; gain and
 * offset of `options` are applied. `photo` has the camera's size; where a half of it has no pixel that counts, the pose
 * stays as given. `touch` and `user` are as of pags_frame_render. The same bits for any number of threads. Errors of
 * drawing, PAGS_ERROR_MEMORY. */
pags_result pags_fit_pose(pags_frame *frame, const pags_part *parts, int part_count, const pags_camera *camera,
                          const pags_frame_options *options, pags_touch_fn *touch, void *user, const pags_photo *photo,
                          pags_fitted_pose *out);

#endif
