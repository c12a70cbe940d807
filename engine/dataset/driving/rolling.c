/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the rolling shutters of a driving set's cameras. dataset.json says in which direction a camera reads its
 * picture, timestamps.json when the first line's exposure begins, when the last one's ends, and how long a line is
 * exposed:
 *     {"rolling_shutter": {"0": "top_to_bottom", ...}, "read_out": {"0": seconds}}
 *     {"trigger": {"0": [seconds]}, "readout": {"0": [seconds]}, "shutter": {"0": [seconds]}}
 * From the middle of the first line's exposure to that of the last one's it takes readout - trigger - shutter, or
 * read_out, which holds where dataset.json has it. The camera's velocity is the mean over the time steps around the
 * photograph's. */
#include "dataset/driving/reader.h"

#include "base/json.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double longest = 0.5; /* seconds of a read-out; more is another unit or no time of one */

typedef struct rolling {
  const pags_json *description, *times;
  pags_driving *driving;
  pags_parsed_dataset *parsed;
} rolling;

/* What dataset.json or timestamps.json say of a camera, by the key of that; NULL: nothing. */
static const pags_json_value *of_camera(const pags_json *json, const char *key, const char *camera) {
  const pags_json_value *all = json ? pags_json_member(pags_json_root(json), key) : NULL;
  return all ? pags_json_member(all, camera) : NULL;
}

/* A camera's list of numbers in timestamps.json, read along the frames. */
typedef struct time_list {
  const pags_json_value *item; /* of `frame`; NULL: not found */
  int frame;
} time_list;

static time_list times_of(const rolling *r, const char *what, const char *camera) {
  const pags_json_value *list = of_camera(r->times, what, camera);
  return (time_list){list && list->type == PAGS_JSON_ARRAY ? list->first : NULL, 0};
}

/* The number at a frame, which isn't before the last one asked for; NaN where none exists. */
static double time_at(time_list *t, int frame) {
  for (; t->item && t->frame < frame; t->frame++)
    t->item = t->item->next;
  return t->item && t->item->type == PAGS_JSON_NUMBER ? t->item->number : (double)NAN;
}

static double moment_of(const pags_parsed_view *view) {
  return isnan(view->shutter_time) ? view->time : view->shutter_time;
}

/* The camera's velocity in the view at `step` of sensor number `sensor`, from its poses in the steps before and after.
 * Returns false if it has none. */
static bool find_velocity(const rolling *r, int64_t step, int64_t sensor, double velocity[6]) {
  const int64_t width = r->driving->sensor_count;
  const pags_parsed_view *const views = r->parsed->views + sensor, *const now = views + step * width, *first = now,
                                *last = now;
  if (step > 0 && !views[(step - 1) * width].missing)
    first = views + (step - 1) * width;
  if (step + 1 < r->driving->step_count && !views[(step + 1) * width].missing)
    last = views + (step + 1) * width;
  const double seconds = moment_of(last) - moment_of(first);
  if (!(seconds > 0))
    return false;
  pags_rigid_velocity(first->world_from_camera, now->world_from_camera, last->world_from_camera, seconds, velocity);
  return true;
}

/* Sets the shutters of a camera's views; *count: how many, *seconds: the sum of their read-outs. */
static pags_result read_camera(const rolling *r, const pags_json_value *item, int64_t sensor, int64_t *count,
                               double *seconds) {
  const char *direction;
  PAGS_TRY(pags_json_as_string(r->description, item, "the direction of a rolling shutter", &direction));
  const pags_json_value *stated = of_camera(r->description, "read_out", item->key);
  time_list begun = times_of(r, "trigger", item->key), ended = times_of(r, "readout", item->key),
            exposed = times_of(r, "shutter", item->key);
  for (int64_t step = 0; step < r->driving->step_count; step++) {
    pags_parsed_view *const view = &r->parsed->views[step * r->driving->sensor_count + sensor];
    const double line = time_at(&exposed, view->frame);
    double read_out = time_at(&ended, view->frame) - time_at(&begun, view->frame) - (isnan(line) ? 0 : line);
    if (stated && stated->type == PAGS_JSON_NUMBER)
      read_out = stated->number;
    pags_shutter shutter = {0};
    if (!pags_shutter_set(&shutter, direction, read_out))
      return pags_json_fail(r->description, item,
                            "camera %s: expected a rolling shutter top_to_bottom, bottom_to_top, left_to_right, "
                            "right_to_left or none, found '%s'",
                            item->key, direction);
    if (view->missing || !(read_out > 0 && read_out <= longest) || strcmp(direction, "none") == 0 ||
        !find_velocity(r, step, sensor, shutter.velocity))
      continue;
    view->shutter = shutter;
    ++*count;
    *seconds += read_out;
  }
  return PAGS_OK;
}

static pags_result read_all(const rolling *r) {
  const pags_json_value *cameras = pags_json_member(pags_json_root(r->description), "rolling_shutter");
  if (!cameras)
    return PAGS_OK;
  PAGS_TRY(pags_json_as_object(r->description, cameras, "the rolling shutters of the cameras"));
  for (const pags_json_value *item = cameras->first; item; item = item->next) {
    int64_t sensor = -1, count = 0;
    double seconds = 0;
    for (int64_t i = 0; i < r->driving->sensor_count; i++)
      sensor = strtol(item->key, NULL, 10) == r->driving->sensors[i].number ? i : sensor;
    if (sensor < 0 || item->type == PAGS_JSON_NULL)
      continue;
    PAGS_TRY(read_camera(r, item, sensor, &count, &seconds));
    if (count > 0)
      PAGS_TRY(pags_driving_note(r->driving, "rolling shutter: camera %s is read %s in %.1f ms, %lld of %lld views",
                                 item->key, item->text, 1e3 * seconds / (double)count, (long long)count,
                                 (long long)r->driving->step_count));
    else if (strcmp(item->text, "none") != 0)
      PAGS_TRY(pags_driving_note(r->driving,
                                 "rolling shutter: camera %s is read %s, but neither timestamps.json nor read_out has "
                                 "its duration; drawn as read at once",
                                 item->key, item->text));
  }
  return PAGS_OK;
}

pags_result pags_rolling_read(pags_driving *driving, pags_parsed_dataset *parsed) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *description = NULL;
  PAGS_AUTO(pags_json_destroy_auto) pags_json *times = NULL;
  PAGS_TRY(pags_json_parse_in_folder(driving->root, "dataset.json", &description));
  if (!description)
    return PAGS_OK;
  if (pags_json_member(pags_json_root(description), "rolling_shutter"))
    PAGS_TRY(pags_json_parse_in_folder(driving->root, "timestamps.json", &times));
  return read_all(&(rolling){description, times, driving, parsed});
}
