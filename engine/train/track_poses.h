/* SPDX-License-Identifier: Apache-2.0 */
/* Poses of labelled boxes and their optimisation: an increment per knot, in the box's frame (pags_knot). */
#ifndef PAGS_TRAIN_TRACK_POSES_H
#define PAGS_TRAIN_TRACK_POSES_H

#include <pags/dataset.h>
#include <pags/object.h>

#include "train/adam6.h"
#include "train/schedule.h"

typedef struct pags_track_poses {
  int64_t count;
  pags_object *objects; /* copies: knots hold the increments */
  pags_adam6 **moments; /* per object: one per knot */
} pags_track_poses;

/* Copies of the data set's objects, increments zero. */
pags_result pags_track_poses_create(pags_track_poses *tracks, const pags_dataset *dataset);
void pags_track_poses_destroy(pags_track_poses *tracks);

/* Knot of an object at exactly this time step; -1: none. */
int64_t pags_track_poses_knot(const pags_object *object, int frame);

/* Increments to begin with: they take the jitter out of the labels of what moves (track_smooth.c). */
pags_result pags_tracks_smooth(pags_track_poses *tracks);

/* One Adam step (Kingma and Ba) of one knot from dL/d(rotation, translation) of the perturbation world_from_model *
 * exp(xi): the gradient of pags_pose_gradient. Increments are small, so that exp(increment) exp(xi) is the increment
 * plus xi, its translation turned by the increment. */
int pags_track_poses_update(pags_track_poses *tracks, int64_t object, int64_t knot, const double gradient[6],
                            const pags_schedule *schedule, int64_t step);

#endif
