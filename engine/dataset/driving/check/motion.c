/* SPDX-License-Identifier: Apache-2.0 */
/* Looks for leaps among the poses of a driving set's cameras, and for boxes that are out of sight. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "dataset/driving/check/checks.h"
#include "dataset/driving/motion.h"

#include <pags/camera.h>

typedef struct track {
  int64_t *steps; /* time step of each pose */
  double *times;
  double (*poses)[12];
} track;

static void track_destroy(track *t) {
  free(t->steps);
  free(t->times);
  free(t->poses);
}

/* Copies the poses of a camera at the time steps where it has one; returns their number. `any`: cameras are fixed to
 * the car, so that at a step without a photograph of this one another camera's pose states where it is. */
static int64_t take_poses(const pags_driving *driving, const pags_parsed_dataset *parsed, int64_t sensor, bool any,
                          track *out) {
  int64_t count = 0;
  for (int64_t step = 0; step < driving->step_count; step++) {
    const pags_parsed_view *views = &parsed->views[step * driving->sensor_count];
    int64_t other = sensor;
    for (int64_t i = 0; i < driving->sensor_count && any && views[other].missing; i++)
      other = i;
    if (views[other].missing)
      continue;
    double *pose = out->poses[count];
    memcpy(pose, views[other].world_from_camera, sizeof *out->poses);
    if (other != sensor) {
      double back[12];
      pags_rigid_inverse(driving->sensors[other].ego_from_camera, back);
      pags_rigid_multiply(pose, back, pose);
      pags_rigid_multiply(pose, driving->sensors[sensor].ego_from_camera, pose);
    }
    out->steps[count] = step;
    out->times[count++] = driving->steps[step].time;
  }
  return count;
}

/* With constant extrinsics and poses, all cameras have the car's motion, so that one is looked at. */
pags_result pags_driving_check_motion(pags_driving *driving, const pags_parsed_dataset *parsed) {
  const bool each = driving->rules.per_frame || driving->exposure_poses;
  const char *folder = driving->rules.per_frame ? "extrinsics" : "ego_pose";
  const size_t steps = (size_t)driving->step_count;
  pags_tally found = {0}, repeated = {0};
  int64_t all = 0;
  PAGS_AUTO(track_destroy)
  track t = {malloc(steps * sizeof *t.steps), malloc(steps * sizeof *t.times), malloc(steps * sizeof *t.poses)};
  PAGS_CHECK_MEMORY(t.steps && t.times && t.poses, "%s", driving->root);
  for (int64_t sensor = 0; sensor < (each ? driving->sensor_count : 1); sensor++) {
    const int64_t count = take_poses(driving, parsed, sensor, !each, &t);
    const pags_leaps leaps = pags_find_leaps((const double(*)[12])t.poses, t.times, count);
    char camera[24] = "";
    if (each)
      snprintf(camera, sizeof camera, " of camera %d", driving->sensors[sensor].number);
    all += count > 0 ? count - 1 : 0;
    if (leaps.count) {
      pags_tally_add(&found, "from frame %0*d to %0*d%s, %.2f m and %.1f degrees off in %.2f s", driving->digits,
                     driving->steps[t.steps[leaps.first]].frame, driving->digits,
                     driving->steps[t.steps[leaps.first + 1]].frame, camera, leaps.metres, leaps.degrees,
                     leaps.seconds);
      found.count += leaps.count - 1;
    }
    if (leaps.repeats) {
      pags_tally_add(&repeated, "%0*d%s", driving->digits, driving->steps[t.steps[leaps.first_repeat + 1]].frame,
                     camera);
      repeated.count += leaps.repeats - 1;
    }
  }
  driving->poses_leap = found.count > 0;
  if (found.count)
    PAGS_WARN(
        "%s/%s: %lld of %lld steps between poses leap as no car does, so poses or times may be wrong; the first is %s",
        driving->root, folder, (long long)found.count, (long long)all, found.first);
  if (repeated.count)
    PAGS_WARN(
        "%s/%s: %lld of %lld poses repeat the one before though the car drives on; the first is of frame %s; expected "
        "a pose of its own for each time step",
        driving->root, folder, (long long)repeated.count, (long long)all, repeated.first);
  return PAGS_OK;
}

enum { FARTHEST = 500 }; /* m; no label of a LiDAR or a photograph lies beyond */

void pags_driving_check_places(const pags_driving *driving) {
  pags_tally far = {0};
  int64_t all = 0;
  for (int64_t i = 0; i < driving->object_count; i++) {
    const pags_object *object = &driving->objects[i];
    for (int64_t k = 0; k < object->keyframe_count; k++, all++) {
      const double *eye = driving->steps[pags_driving_step(driving, object->keyframes[k].frame)].eye;
      double place[3];
      pags_pose_position(object->keyframes[k].world_from_object, place);
      const double square = pags_distance_squared3(place, eye);
      if (square > (double)FARTHEST * FARTHEST)
        pags_tally_add(&far, "%s '%s' in frame %d, at %.0f m", object->class_name, object->id,
                       object->keyframes[k].frame, sqrt(square));
    }
  }
  if (far.count)
    PAGS_WARN(
        "%s/instances/instances_info.json: %lld of %lld boxes lie more than %d m from the cameras, so obj_to_world may "
        "be in other axes than those of the world; the first is %s",
        driving->root, (long long)far.count, (long long)all, FARTHEST, far.first);
}
