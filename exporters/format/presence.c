/* SPDX-License-Identifier: Apache-2.0 */
/* Finds when an object is there, by the rule of pags_object_pose: at its labels, between those at most 1.5 median
 * spacings apart, and half a spacing beyond. Builds without proxies have this file, too: pages of HTML use it. */
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "exporters/format/object_gaussians.h"

void pags_presence_destroy(pags_presence *presence) {
  free(presence->spans);
  *presence = (pags_presence){0};
}

pags_result pags_presence_find(const pags_scene *scene, int64_t object, pags_presence *out) {
  static const double same_time = 1e-6; /* seconds */
  const pags_object *o = &scene->objects[object].record;
  *out = (pags_presence){.always = true};
  if (scene->objects[object].model < 0 && !o->moving)
    return PAGS_OK;
  PAGS_AUTOFREE double *spacings = malloc((size_t)o->keyframe_count * sizeof *spacings);
  out->spans = malloc((size_t)o->keyframe_count * sizeof *out->spans);
  PAGS_CHECK_MEMORY(spacings && out->spans, "a track");
  for (int64_t i = 0; i + 1 < o->keyframe_count; i++)
    spacings[i] = o->keyframes[i + 1].time - o->keyframes[i].time;
  pags_sort_doubles(spacings, o->keyframe_count - 1);
  const double usual = o->keyframe_count > 1 ? spacings[(o->keyframe_count - 1) / 2] : o->time_step;
  for (int64_t i = 0; i < o->keyframe_count; i++) {
    const double begins = o->keyframes[i].time - 0.5 * usual, ends = o->keyframes[i].time + 0.5 * usual;
    if (out->count && o->keyframes[i].time - o->keyframes[i - 1].time <= 1.5 * usual + same_time)
      out->spans[out->count - 1][1] = ends;
    else
      memcpy(out->spans[out->count++], (double[2]){begins, ends}, sizeof *out->spans);
  }
  out->always = out->count == 1 && out->spans[0][0] <= scene->time_begin + same_time &&
                out->spans[0][1] >= scene->time_end - same_time;
  return PAGS_OK;
}

pags_result pags_presence_tell(const pags_scene *scene) {
  int64_t count = 0, first = 0;
  for (int64_t i = 0; i < scene->object_count; i++) {
    PAGS_AUTO(pags_presence_destroy) pags_presence presence = {0};
    PAGS_TRY(pags_presence_find(scene, i, &presence));
    first = !presence.always && !count ? i : first;
    count += !presence.always;
  }
  if (count)
    pags_log_message(PAGS_LOG_INFO,
                     "%lld of %lld objects come late or leave, the first is %s: in glTF they stand still before and "
                     "after their tracks (extras: time_begin, time_end)",
                     (long long)count, (long long)scene->object_count, scene->objects[first].record.id);
  return PAGS_OK;
}
