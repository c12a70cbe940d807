/* SPDX-License-Identifier: Apache-2.0 */
/* Tracks of the labelled objects and their optimisation in training: each keyframe (labelled pose) has an increment in
 * the frame of the object's box (pags_keyframe). */
#ifndef PAGS_TRAIN_TRACK_POSES_H
#define PAGS_TRAIN_TRACK_POSES_H

#include <stdbool.h>

#include <pags/dataset.h>
#include <pags/object.h>

#include "train/adam.h"
#include "train/schedule.h"

typedef struct pags_track_poses {
  int64_t count;
  pags_object *objects; /* copies of the data set's; their keyframes hold the increments */
  pags_adam6 **moments; /* per object: Adam's moments, one per keyframe */
} pags_track_poses;

/* Copies the data set's objects; increments are zero. Must be destroyed on failure, too. */
pags_result pags_track_poses_create(pags_track_poses *tracks, const pags_dataset *dataset);
void pags_track_poses_destroy(pags_track_poses *tracks);

/* Returns the index of an object's keyframe at exactly this time step; -1: none. */
int64_t pags_track_poses_keyframe(const pags_object *object, int frame);

/* Sets the first increments of moving objects, which remove the jitter of their labels (track_smooth.c). */
pags_result pags_tracks_smooth(pags_track_poses *tracks);

/* One Adam step (Kingma and Ba 2015) of one keyframe, from dL/d(rotation, translation) by the perturbation xi of the
 * pose world_from_model * exp(xi), as pags_pose_gradient gives it. Increments are small, so exp(increment) exp(xi) is
 * taken to be the increment plus xi, with xi's translation turned by the increment's rotation. Returns 0, and changes
 * nothing, if the gradient isn't finite. */
bool pags_track_poses_update(pags_track_poses *tracks, int64_t object, int64_t keyframe, const double gradient[6],
                             const pags_schedule *schedule, int64_t step);

#endif
