/* SPDX-License-Identifier: Apache-2.0 */
/* Optimises the poses of labelled objects in training: an increment per keyframe, by Adam. */
#include "train/track_poses.h"

#include <math.h>

#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"
#include "maths/maths.h"

/* The learning rates at the schedule's end as a share of the first. They fall log-linearly, as those of Gaussians'
 * positions do, but only to a tenth (Street Gaussians ends at a fifth to a hundredth). */
static const double final_share = 0.1;
static const double reference_visits = 100.0; /* visits of each photograph in a run that need no correction of the
                                                 rates: about 30 000 steps over 300 photographs */

pags_result pags_track_poses_create(pags_track_poses *tracks, const pags_dataset *dataset) {
  const int64_t count = pags_dataset_object_count(dataset);
  const size_t room = (size_t)(count > 0 ? count : 1);
  *tracks = (pags_track_poses){.objects = calloc(room, sizeof *tracks->objects),
                               .moments = calloc(room, sizeof *tracks->moments)};
  PAGS_CHECK_MEMORY(tracks->objects && tracks->moments, "%lld tracks", (long long)count);
  for (int64_t i = 0; i < count; i++) {
    const pags_object *const from = pags_dataset_object(dataset, i);
    const size_t keyframes = (size_t)(from->keyframe_count > 0 ? from->keyframe_count : 1);
    pags_object *const to = &tracks->objects[i];
    *to = *from;
    to->id = pags_text_copy(from->id);
    to->class_name = pags_text_copy(from->class_name);
    to->keyframes = malloc(keyframes * sizeof *to->keyframes);
    tracks->moments[i] = calloc(keyframes, sizeof *tracks->moments[i]);
    tracks->count = i + 1;
    PAGS_CHECK_MEMORY(to->id && to->class_name && to->keyframes && tracks->moments[i], "a track of %lld keyframes",
                      (long long)from->keyframe_count);
    memcpy(to->keyframes, from->keyframes, (size_t)from->keyframe_count * sizeof *to->keyframes);
  }
  return PAGS_OK;
}

void pags_track_poses_destroy(pags_track_poses *tracks) {
  for (int64_t i = 0; i < tracks->count; i++) {
    pags_object_destroy(&tracks->objects[i]);
    free(tracks->moments[i]);
  }
  free(tracks->objects);
  free(tracks->moments);
  *tracks = (pags_track_poses){0};
}

int64_t pags_track_poses_keyframe(const pags_object *object, int frame) {
  for (int64_t k = 0; k < object->keyframe_count; k++)
    if (object->keyframes[k].frame == frame)
      return k;
  return -1;
}

/* Keeps the mean of a track's increments: the step `gone` that one keyframe was moved by is divided by the number of
 * keyframes that photographs have moved and added back to each of them. No photograph shows where in its box an
 * object lies, since moving all poses one way and the Gaussians the other way changes no picture; the mean of the
 * labels is the best estimate. */
static void hold_mean(pags_track_poses *tracks, int64_t object, const double gone[6]) {
  const pags_adam6 *m = tracks->moments[object];
  pags_object *o = &tracks->objects[object];
  double moved = 0.0;
  for (int64_t k = 0; k < o->keyframe_count; k++)
    moved += m[k].count > 0;
  for (int64_t k = 0; k < o->keyframe_count; k++)
    for (int i = 0; i < 3 && m[k].count > 0; i++) {
      o->keyframes[k].rotation[i] += gone[i] / moved;
      o->keyframes[k].translation[i] += gone[3 + i] / moved;
    }
}

bool pags_track_poses_update(pags_track_poses *tracks, int64_t object, int64_t keyframe, const double gradient[6],
                             const pags_schedule *schedule, int64_t step) {
  const pags_train_config *c = &schedule->config;
  pags_keyframe *k = &tracks->objects[object].keyframes[keyframe];
  double turn[12], zero[3] = {0.0, 0.0, 0.0}, g[6], direction[6];
  pags_increment_matrix(k->rotation, zero, turn);
  pags_copy3(gradient, g);
  pags_rotate3(turn, gradient + 3, g + 3);
  /* A keyframe takes one step per visit of one of its photographs, so a run that is short or has many photographs must
   * take longer steps to move a pose as far. */
  const double visits = (double)(schedule->length * schedule->batch) / (double)schedule->views;
  const double hurry = fmin(fmax(reference_visits / visits, 0.25), 4.0);
  const double fall = pags_pow(final_share, fmin((double)step / (double)schedule->length, 1.0)) * hurry;
  if (!pags_adam6_step(&tracks->moments[object][keyframe], g, c, direction))
    return false;
  for (int i = 0; i < 3; i++) {
    direction[i] *= fall * c->objects.track_rotation_rate;
    direction[3 + i] *= fall * c->objects.track_translation_rate;
    k->rotation[i] -= direction[i];
    k->translation[i] -= direction[3 + i];
  }
  hold_mean(tracks, object, direction);
  return true;
}
