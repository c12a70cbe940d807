/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/scene_html/pack.h"

#include <math.h>
#include "base/memory.h"
#include "exporters/format/object_gaussians.h"

enum { PARTS = 8 }; /* samples from one label to the next: chords are within a millimetre of the curve */

/* Rounded to a part of one, so that the text is short. */
static double rounded(double value, double parts) {
  return round(value * parts) / parts;
}

/* Writes the samples of one presence, `times` ascending. */
static void put_samples(pags_json_writer *json, const pags_scene *scene, const pags_object *object, const double *times,
                        int64_t count, bool poses) {
  pags_json_begin_array(json, NULL);
  for (int64_t i = 0; i < count; i++) {
    double pose[12], row[7];
    if (!pags_object_pose(object, times[i], pose))
      continue;
    if (!poses) {
      pags_json_put_number(json, NULL, rounded(times[i] - scene->time_begin, 1e6));
      continue;
    }
    const double r[9] = {pose[0], pose[1], pose[2], pose[4], pose[5], pose[6], pose[8], pose[9], pose[10]};
    double q[4];
    pags_quaternion_from_rotation(r, q);
    for (int k = 0; k < 3; k++)
      row[k] = rounded(pose[4 * k + 3] - scene->origin[k], 1e4);
    for (int k = 0; k < 4; k++)
      row[3 + k] = rounded(q[k], 1e6);
    pags_json_put_numbers(json, NULL, row, 7);
  }
  pags_json_end_array(json);
}

pags_result pags_web_track_put(pags_json_writer *json, const pags_scene *scene, int64_t object) {
  const pags_object *o = &scene->objects[object].record;
  const double ends[2] = {o->keyframes[0].time - scene->time_begin,
                          o->keyframes[o->keyframe_count - 1].time - scene->time_begin};
  PAGS_AUTO(pags_presence_destroy) pags_presence presence = {0};
  PAGS_TRY(pags_presence_find(scene, object, &presence));
  PAGS_AUTOFREE double *times = malloc(((size_t)o->keyframe_count * PARTS + 4) * sizeof *times);
  PAGS_CHECK_MEMORY(times, "a track");
  pags_json_put_numbers(json, "span", ends, 2);
  for (int poses = 0; poses < 2; poses++) {
    pags_json_begin_array(json, poses ? "poses" : "times");
    for (int64_t s = 0; s < presence.count; s++) {
      const double *span = presence.spans[s], inside = fmin(1e-6, 0.25 * (span[1] - span[0]));
      int64_t count = 0;
      times[count++] = span[0] + inside; /* the ends themselves may fall outside by rounding */
      for (int64_t k = 0; k < o->keyframe_count; k++) {
        const double next = k + 1 < o->keyframe_count ? o->keyframes[k + 1].time : o->keyframes[k].time;
        for (int part = 0; part < (k + 1 < o->keyframe_count ? PARTS : 1); part++) {
          const double time = o->keyframes[k].time + (next - o->keyframes[k].time) * part / PARTS;
          if (time > span[0] + inside && time < span[1] - inside)
            times[count++] = time;
        }
      }
      times[count++] = span[1] - inside;
      put_samples(json, scene, o, times, count, poses != 0);
    }
    pags_json_end_array(json);
  }
  return PAGS_OK;
}
