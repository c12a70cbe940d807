/* SPDX-License-Identifier: Apache-2.0 */
/* Decides whether a labelled track moves. */
#include "scene/object.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "base/vec3.h"

/* ---- Jitter ---- */

/* Fewest labels by which jitter is distinguished from motion; stretches of a track whose mean places are compared. */
enum { LEAST_LABELS = 6, STRETCHES = 6 };

/* Mean places of equal stretches of the track, relative to the first label. */
static void mean_places(const pags_object *object, double places[STRETCHES][3]) {
  double first[3];
  pags_pose_position(object->keyframes[0].world_from_object, first);
  for (int s = 0; s < STRETCHES; s++) {
    const int64_t begin = s * object->keyframe_count / STRETCHES, end = (s + 1) * object->keyframe_count / STRETCHES;
    memset(places[s], 0, sizeof places[s]);
    for (int64_t i = begin; i < end; i++)
      for (int k = 0; k < 3; k++)
        places[s][k] += (object->keyframes[i].world_from_object[4 * k + 3] - first[k]) / (double)(end - begin);
  }
}

/* The labels of a static object differ by errors. Two tests distinguish these from motion. J. von Neumann's ratio
 * (1941), the mean square of the steps between labels divided by the variance of the labels, is 2 for independent
 * errors (0.4 off in 12 labels) and below 0.3 for any object that travels during six labels or more. Errors of a
 * tracker are correlated: the mean places of six stretches of the track then wander within a car's length, and the path
 * along them is longer than twice the farthest distance; a travelling vehicle doesn't turn back that often. */
static bool lies_about_one_place(const pags_object *object) {
  if (object->keyframe_count < LEAST_LABELS)
    return false;
  double mean[3] = {0}, steps = 0, spread = 0, places[STRETCHES][3], at[3], before[3], first[3];
  pags_pose_position(object->keyframes[0].world_from_object, first);
  mean_places(object, places);
  for (int64_t i = 0; i < object->keyframe_count; i++)
    for (int k = 0; k < 3; k++)
      mean[k] += (object->keyframes[i].world_from_object[4 * k + 3] - first[k]) / (double)object->keyframe_count;
  pags_add_scaled3(1, first, mean);
  for (int64_t i = 0; i < object->keyframe_count; i++) {
    pags_pose_position(object->keyframes[i].world_from_object, at);
    spread += pags_distance_squared3(at, mean);
    steps += i ? pags_distance_squared3(at, before) : 0;
    memcpy(before, at, sizeof before);
  }
  if (steps > spread)
    return true;
  double way = 0, farthest = 0;
  for (int s = 0; s < STRETCHES; s++) {
    way += s ? pags_distance3(places[s], places[s - 1]) : 0;
    for (int t = 0; t < s; t++)
      farthest = fmax(farthest, pags_distance3(places[s], places[t]));
  }
  return object->category == PAGS_CATEGORY_VEHICLE && farthest < 2 && way > 2 * farthest;
}

/* ---- Motion ---- */

/* Whether the object moves along a straight line faster than any label drifts, on a track that may be short: by more
 * than `least` metres at more than `speed` m/s. The distances to a straight line of constant speed must be small
 * compared with `travel`. */
static bool goes_straight(const pags_object *object, double travel, double least, double speed) {
  const pags_keyframe *first = &object->keyframes[0], *last = &object->keyframes[object->keyframe_count - 1];
  const double duration = last->time - first->time;
  if (!(duration > 0) || travel < least || travel < speed * duration)
    return false;
  double square = 0;
  for (int64_t i = 0; i < object->keyframe_count; i++) {
    const double share = (object->keyframes[i].time - first->time) / duration;
    for (int axis = 3; axis < 12; axis += 4) {
      const double from = first->world_from_object[axis], to = last->world_from_object[axis];
      const double d = object->keyframes[i].world_from_object[axis] - from - share * (to - from);
      square += d * d;
    }
  }
  return sqrt(square / (double)object->keyframe_count) < 0.15 * travel;
}

/* Whether the distance between the first and the last label, *travel, or the spread of the labels is that of a moving
 * object. */
static bool goes_far(const pags_object *object, double *travel) {
  const double *first = object->keyframes[0].world_from_object;
  const double *last = object->keyframes[object->keyframe_count - 1].world_from_object;
  double between = 0, largest = 0, count = (double)object->keyframe_count;
  for (int axis = 3; axis < 12; axis += 4) {
    double mean = 0, square = 0;
    for (int64_t i = 0; i < object->keyframe_count; i++)
      mean += (object->keyframes[i].world_from_object[axis] - first[axis]) / count;
    for (int64_t i = 0; i < object->keyframe_count; i++) {
      double d = object->keyframes[i].world_from_object[axis] - first[axis] - mean;
      square += d * d / count;
    }
    between += (last[axis] - first[axis]) * (last[axis] - first[axis]);
    largest = fmax(largest, square);
  }
  *travel = sqrt(between);
  return *travel > 2 || sqrt(largest) > 0.5;
}

bool pags_object_jitters(const pags_object *object) {
  double travel;
  return goes_far(object, &travel) && lies_about_one_place(object);
}

/* The rule of Street Gaussians (Yan et al. 2024): an object moves if its first and last labelled position are more
 * than 2 m apart, or if the standard deviation of its positions along x, y or z exceeds 0.5 m. In a short clip nobody
 * walks that far: pedestrians and cyclists also move if they go straight on for 0.8 m at 0.5 m/s, vehicles for 1.2 m at
 * 1 m/s. At least three labels are needed for that. Labels that jitter by more than half a metre don't make a parked
 * car move. */
void pags_object_classify_motion(pags_object *object) {
  assert(object->keyframe_count > 0);
  double travel;
  const bool person = object->category == PAGS_CATEGORY_PEDESTRIAN || object->category == PAGS_CATEGORY_CYCLIST;
  object->moving = goes_far(object, &travel) && !lies_about_one_place(object);
  if (object->category != PAGS_CATEGORY_OTHER && object->keyframe_count > 2)
    object->moving = object->moving || goes_straight(object, travel, person ? 0.8 : 1.2, person ? 0.5 : 1.0);
}
