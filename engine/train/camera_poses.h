/* SPDX-License-Identifier: Apache-2.0 */
/* Corrections of the recorded poses of cameras, found in training. A photograph's correction in a driving set has three
 * parts: that of its time step, which moves the whole rig; that of its camera, which is the same in all time steps; and
 * the camera's delay, by which it moves along the drive. No photograph there is corrected by itself: its own error
 * would be fitted, too. Objects stay where they are at the frame's time: a delay doesn't move them. In a capture, whose
 * cameras know nothing of each other, each photograph is a time step of its own, and those that aren't trained on stay
 * as they are.
 *
 * They must pass a holdout test (holdout_test.h). */
#ifndef PAGS_TRAIN_CAMERA_POSES_H
#define PAGS_TRAIN_CAMERA_POSES_H

#include <stdbool.h>

#include <pags/dataset.h>
#include <pags/frame.h>

#include "train/adam.h"
#include "train/holdout_test.h"
#include "train/schedule.h"

typedef struct pags_camera_part {
  double value[6]; /* rotation vector, radians, then translation, metres */
  pags_adam6 moments;
} pags_camera_part;

typedef struct pags_camera_poses {
  pags_holdout_test holdout;
  int64_t count; /* views of the data set; 0: poses are as recorded */
  bool alone;    /* a capture: each view is a time step, and they have one camera, which isn't corrected */
  int64_t steps, sensors;
  pags_camera_part *items; /* those of the `steps` time steps: in world axes, about the middle of the rig's cameras;
                              then those of the `sensors` cameras: in the camera's frame, applied first; then their
                              delays: value[0], seconds */
  int32_t *step_of, *sensor_of; /* per view: its items, the second counted from `steps` */
  double (*speeds)[6];          /* per view: of the recorded camera, in its own frame: radians and metres a second */
  double (*places)[3];          /* per time step: the middle of its cameras, relative to the data set's origin */
  double (*turns)[9];           /* per camera: its rotation to the world's axes in its first photograph */
} pags_camera_poses;

/* Starts with corrections of zero and a holdout test. */
pags_result pags_camera_poses_create(pags_camera_poses *poses, const pags_dataset *dataset);
/* Frees the corrections: the poses are as recorded again. The result of the test stays. */
void pags_camera_poses_destroy(pags_camera_poses *poses);

/* Returns a view's camera with its correction. A time step that no photograph has corrected yet, as those that are held
 * out, gets what lies between its neighbours in time; in a capture nothing. */
pags_camera pags_camera_poses_view(const pags_camera_poses *poses, const pags_dataset *dataset, int64_t view);

/* What a view's corrected camera does after the recorded pose, in that camera's frame: a rotation vector, then a
 * translation. */
void pags_camera_poses_correction(const pags_view *view, const pags_camera *corrected, double out[6]);

/* Number of items. */
int64_t pags_camera_poses_items(const pags_camera_poses *poses);

/* The gradient by a motion (rotation, translation) of a camera in its own frame, from that by a motion of everything in
 * the world about `origin`. */
void pags_camera_gradient(const double world_from_camera[12], const double origin[3], const double by_world[6],
                          double out[6]);

/* The loss's gradients by the parts of a view's time step and of its camera, and by the delay, from that by a motion
 * (rotation, translation) of everything in the world about the data set's origin. Exact where the correction is zero.
 */
void pags_camera_poses_gradient(const pags_camera_poses *poses, const pags_dataset *dataset, int64_t view,
                                const double by_world[6], double by_step[6], double by_sensor[6], double *by_delay);

/* One Adam step (Kingma and Ba 2015) of the parts of a view, from the gradient `by_world`. The mean of the corrections
 * of all time steps, of all cameras in the world's axes, and of all delays is held at zero, since moving all cameras
 * and the world alike changes no picture. Returns false, and changes nothing, if the gradient isn't finite. */
bool pags_camera_poses_update(pags_camera_poses *poses, const pags_dataset *dataset, int64_t view,
                              const double by_world[6], const pags_schedule *schedule, int64_t step);

/* ---- A single pose: fit_pose.c ---- */

/* The pose of a camera, fitted to the left half of its photograph, the scene held, and judged on the right half: how
 * much of a picture's error is the pose's. */
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
