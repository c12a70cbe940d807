/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the times of the time steps and of the exposures from timestamps.json:
 *     {"frames": [seconds of each time step], "cameras": {"0": [seconds of each exposure], ...}}
 * Both lists are indexed by the frame numbers of the file names. Street Gaussians' converter writes them otherwise:
 *     {"FRAME": {"000000": seconds, ...}, "FRONT": {"000000": seconds, ...}, ...}
 * Times that by their distance are milli-, micro- or nanoseconds are turned into seconds, with a warning. */
#include "dataset/driving/reader.h"

#include "base/json.h"
#include "base/log.h"
#include "base/text.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double usual_fps = 10;

/* Seconds between time steps that are plausible for a recording: a unit is looked for if the gap between them is larger
 * than `longest`, and taken if they then are between `least` and `most`, so that one unit at most fits. */
static const double longest = 20, least = 0.02, most = 2;

typedef struct times {
  const pags_json *json;
  pags_driving *driving;
  pags_parsed_dataset *parsed;
} times;

/* ---- Reading ---- */

/* Returns the index of a frame's time step by its number, or by its place in a list if it has no key; -1: not used. */
static int64_t step_of(const pags_driving *driving, const pags_json_value *item, int64_t place) {
  char *end;
  if (!item->key)
    return pags_driving_step(driving, place);
  const long long frame = strtoll(item->key, &end, 10);
  return *end || end == item->key || frame < 0 ? -1 : pags_driving_step(driving, frame);
}

static pags_result read_exposures(const times *t, const pags_json_value *list, int64_t sensor) {
  int64_t frame = 0;
  for (const pags_json_value *item = list->first; item; item = item->next, frame++) {
    const int64_t step = step_of(t->driving, item, frame), view = step * t->driving->sensor_count + sensor;
    if (step >= 0 && item->type != PAGS_JSON_NULL)
      PAGS_TRY(pags_json_as_number(t->json, item, "the time of an exposure", &t->parsed->views[view].shutter_time));
  }
  return PAGS_OK;
}

/* Reads the times of the steps from an array or, by their numbers, from an object; they must be there and ascend. */
static pags_result read_steps(const times *t, const pags_json_value *list) {
  pags_driving *driving = t->driving;
  const int last = driving->steps[driving->step_count - 1].frame;
  int64_t frame = 0;
  for (int64_t i = 0; i < driving->step_count; i++)
    driving->steps[i].time = (double)NAN;
  for (const pags_json_value *item = list->first; item; item = item->next, frame++) {
    const int64_t step = step_of(driving, item, frame);
    if (step < 0)
      continue;
    PAGS_TRY(pags_json_as_number(t->json, item, "the time of a frame", &driving->steps[step].time));
    if (step > 0 && driving->steps[step].time <= driving->steps[step - 1].time)
      return pags_json_fail(t->json, item, "frame %d: expected a later time than frame %d's",
                            driving->steps[step].frame, driving->steps[step - 1].frame);
  }
  for (int64_t i = 0; i < driving->step_count; i++)
    if (isnan(driving->steps[i].time))
      return pags_json_fail(t->json, list,
                            "'%s' has %lld times, expected one for each frame up to %d; frame %d has none", list->key,
                            (long long)frame, last, driving->steps[i].frame);
  return PAGS_OK;
}

/* Returns the index of the camera that a key of the file names: its number, or its name in Street Gaussians' files; -1
 * if the set has no such camera. */
static int64_t sensor_of(const pags_driving *driving, const char *key, bool named) {
  static const char *const names[] = {"FRONT", "FRONT_LEFT", "FRONT_RIGHT", "SIDE_LEFT", "SIDE_RIGHT"};
  char *end;
  long number = strtol(key, &end, 10);
  if (*end || end == key)
    number = -1;
  if (named && pags_text_find(key, names, 5) >= 0)
    number = pags_text_find(key, names, 5);
  for (int64_t i = 0; i < driving->sensor_count; i++)
    if (number >= 0 && driving->sensors[i].number == number)
      return i;
  return -1;
}

static pags_result read_file(const times *t) {
  const pags_json_value *root = pags_json_root(t->json), *frames, *cameras = root;
  PAGS_TRY(pags_json_as_object(t->json, root, "the times of a data set"));
  const bool named = pags_json_member(root, "FRAME") && !pags_json_member(root, "frames");
  if (named)
    PAGS_TRY(pags_json_object(t->json, root, "FRAME", &frames));
  else
    PAGS_TRY(pags_json_array(t->json, root, "frames", &frames));
  PAGS_TRY(read_steps(t, frames));
  if (!named && !pags_json_member(root, "cameras"))
    return PAGS_OK;
  if (!named)
    PAGS_TRY(pags_json_object(t->json, root, "cameras", &cameras));

  /* Exposure times of each camera of the set; other keys are ignored. */
  for (const pags_json_value *list = cameras->first; list; list = list->next) {
    const int64_t sensor = sensor_of(t->driving, list->key, named);
    if (sensor < 0)
      continue;
    if (list->type != (named ? PAGS_JSON_OBJECT : PAGS_JSON_ARRAY))
      return pags_json_fail(t->json, list, "expected the exposure times of camera %d as %s",
                            t->driving->sensors[sensor].number, named ? "an object" : "an array");
    PAGS_TRY(read_exposures(t, list, sensor));
  }
  return PAGS_OK;
}

/* ---- Units ---- */

static const struct {
  double seconds, since_1970; /* of 1; the least time that is one since 1970, in seconds */
  const char *name;
} units[] = {{1e-3, 1e11, "milliseconds"}, {1e-6, 1e14, "microseconds"}, {1e-9, 1e17, "nanoseconds"}};
enum { UNITS = sizeof units / sizeof *units };

/* Mean time from one frame number to the next; NaN for a single time step. */
static double spacing_of(const pags_driving *driving) {
  const pags_time_step *first = &driving->steps[0], *last = &driving->steps[driving->step_count - 1];
  return last > first ? (last->time - first->time) / (last->frame - first->frame) : (double)NAN;
}

/* Turns times of another unit into seconds, and warns of that and of times that no unit explains. Returns the name of
 * the unit, NULL for seconds. */
static const char *find_unit(const pags_driving *driving, const char *path) {
  const double spacing = spacing_of(driving);
  int unit = -1;
  for (int i = 0; i < UNITS; i++) {
    const double apart = spacing * units[i].seconds;
    if (isnan(spacing) ? driving->steps[0].time >= units[i].since_1970
                       : spacing > longest && apart >= least && apart <= most)
      unit = i;
  }
  if (unit >= 0) {
    for (int64_t i = 0; i < driving->step_count; i++)
      driving->steps[i].time *= units[unit].seconds;
    PAGS_WARN("%s: times are taken as %s, since the interval of frames is %g; expected seconds", path, units[unit].name,
              isnan(spacing) ? driving->steps[0].time / units[unit].seconds : spacing);
  } else if (spacing > longest || spacing < 1e-3) {
    PAGS_WARN("%s: the interval of frames is %g s: the times may not be seconds", path, spacing);
  }
  return unit >= 0 ? units[unit].name : NULL;
}

/* Does the same for the exposures, which must be near their time steps. `told`: the unit that was told already. */
static void find_exposure_unit(const times *t, const char *path, const char *told) {
  const pags_driving *driving = t->driving;
  int64_t off = 0, count = 0;
  double seconds = 1, first_off = 0;
  const char *name = NULL;
  for (int64_t i = 0; i < t->parsed->count; i++) {
    double *time = &t->parsed->views[i].shutter_time;
    const double step = driving->steps[i / driving->sensor_count].time;
    if (isnan(*time))
      continue;
    for (int u = 0; u < UNITS && count == 0 && fabs(*time - step) > longest; u++)
      if (fabs(*time * units[u].seconds - step) < longest) {
        seconds = units[u].seconds;
        name = units[u].name;
      }
    *time *= seconds;
    count++;
    if (fabs(*time - step) > longest && off++ == 0)
      first_off = *time - step;
  }
  if (name && name != told)
    PAGS_WARN("%s: times of exposures are taken as %s; expected seconds", path, name);
  if (off > 0)
    PAGS_WARN(
        "%s: %lld of %lld exposures are far from the time of their frame, the first by %g s: 'cameras' may be wrong",
        path, (long long)off, (long long)count, first_off);
}

/* ---- All times ---- */

static pags_result read_times(const times *t, const char *path) {
  pags_driving *driving = t->driving;
  PAGS_TRY(read_file(t));
  find_exposure_unit(t, path, find_unit(driving, path));

  /* Without fps in dataset.json, the mean rate over the used frames is taken. */
  const double spacing = spacing_of(driving), stated = driving->rules.fps;
  driving->fps = stated > 0 ? stated : isnan(spacing) ? usual_fps : 1 / spacing;
  if (stated > 0 && fabs(spacing * stated - 1) > 0.5)
    PAGS_WARN(
        "%s: the interval of frames is %g s, %g per second, but dataset.json has fps %g; one of them may be wrong",
        path, spacing, 1 / spacing, stated);
  for (int64_t i = 1; i < driving->step_count; i++)
    if (!(driving->steps[i].time > driving->steps[i - 1].time)) /* equal in seconds, if not in the file's unit */
      return pags_fail(PAGS_ERROR_FORMAT, "%s: frame %d: expected a later time than frame %d's", path,
                       driving->steps[i].frame, driving->steps[i - 1].frame);
  return PAGS_OK;
}

pags_result pags_times_read(pags_driving *driving, pags_parsed_dataset *parsed) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_in_folder(driving->root, "timestamps.json", &json));
  for (int64_t i = 0; i < parsed->count; i++)
    parsed->views[i].shutter_time = (double)NAN;
  if (json) {
    PAGS_TRY(read_times(&(times){json, driving, parsed}, pags_json_path(json)));
  } else {
    driving->fps = driving->rules.fps > 0 ? driving->rules.fps : usual_fps;
    for (int64_t i = 0; i < driving->step_count; i++)
      driving->steps[i].time = driving->steps[i].frame / driving->fps;
    PAGS_TRY(pags_driving_note(driving, "times: no timestamps.json, frame t is at t / %g s", driving->fps));
  }
  for (int64_t i = 0; i < parsed->count; i++)
    parsed->views[i].time = driving->steps[i / driving->sensor_count].time;
  return PAGS_OK;
}
