/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the times of the time steps and of the exposures from timestamps.json:
 *     {"frames": [seconds of each time step], "cameras": {"0": [seconds of each exposure], ...}}
 * Both lists are indexed by the frame numbers of the file names. */
#include "dataset/driving/reader.h"

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"

#include <math.h>
#include <stdlib.h>

static const double usual_fps = 10;

static pags_result read_exposures(const pags_json *json, const pags_json_value *list, const pags_driving *driving,
                                  int64_t sensor, pags_parsed_dataset *parsed) {
  int64_t frame = 0;
  for (const pags_json_value *item = list->first; item; item = item->next, frame++) {
    int64_t step = pags_driving_step(driving, frame);
    if (step < 0 || item->type == PAGS_JSON_NULL)
      continue;
    double *time = &parsed->views[step * driving->sensor_count + sensor].shutter_time;
    PAGS_TRY(pags_json_as_number(json, item, "the time of an exposure", time));
  }
  return PAGS_OK;
}

static pags_result read_file(const pags_json *json, pags_driving *driving, pags_parsed_dataset *parsed) {
  const pags_json_value *root = pags_json_root(json), *frames, *cameras;
  PAGS_TRY(pags_json_as_object(json, root, "the times of a data set"));
  PAGS_TRY(pags_json_array(json, root, "frames", &frames));

  /* Times of the steps, which must ascend. */
  int64_t frame = 0;
  for (const pags_json_value *item = frames->first; item; item = item->next, frame++) {
    int64_t step = pags_driving_step(driving, frame);
    if (step < 0)
      continue;
    PAGS_TRY(pags_json_as_number(json, item, "the time of a frame", &driving->steps[step].time));
    if (step > 0 && !(driving->steps[step].time > driving->steps[step - 1].time))
      return pags_json_fail(json, item, "frame %lld: expected a later time than frame %d's", (long long)frame,
                            driving->steps[step - 1].frame);
  }
  int last = driving->steps[driving->step_count - 1].frame;
  if (frame <= last)
    return pags_json_fail(json, frames, "'frames' has %lld times, expected one for each frame up to %d",
                          (long long)frame, last);

  if (!pags_json_member(root, "cameras"))
    return PAGS_OK;
  PAGS_TRY(pags_json_object(json, root, "cameras", &cameras));

  /* Exposure times of each camera of the set; other keys are ignored. */
  for (const pags_json_value *list = cameras->first; list; list = list->next) {
    char *end;
    long number = strtol(list->key, &end, 10);
    for (int64_t i = 0; i < driving->sensor_count; i++) {
      if (*end || end == list->key || driving->sensors[i].number != number)
        continue;
      if (list->type != PAGS_JSON_ARRAY)
        return pags_json_fail(json, list, "expected an array with the exposure times of camera %ld", number);
      PAGS_TRY(read_exposures(json, list, driving, i, parsed));
    }
  }
  return PAGS_OK;
}

pags_result pags_times_read(pags_driving *driving, pags_parsed_dataset *parsed) {
  char *path = pags_path_join(driving->root, "timestamps.json");
  if (!path)
    return pags_out_of_memory("%s", driving->root);
  pags_json *json = NULL;
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < parsed->count; i++)
    parsed->views[i].shutter_time = (double)NAN;
  if (!pags_file_exists(path)) {
    driving->fps = driving->rules.fps > 0 ? driving->rules.fps : usual_fps;
    for (int64_t i = 0; i < driving->step_count; i++)
      driving->steps[i].time = driving->steps[i].frame / driving->fps;
    result = pags_driving_note(driving, "times: no timestamps.json, frame t is at t / %g s", driving->fps);
  } else {
    result = pags_json_parse_file(path, &json);
    if (result == PAGS_OK)
      result = read_file(json, driving, parsed);
    if (result == PAGS_OK) {
      /* Without fps in dataset.json, the mean rate over the used frames is taken. */
      const pags_time_step *first = &driving->steps[0], *last = &driving->steps[driving->step_count - 1];
      driving->fps = driving->rules.fps;
      if (driving->fps == 0)
        driving->fps = last > first ? (last->frame - first->frame) / (last->time - first->time) : usual_fps;
    }
  }
  for (int64_t i = 0; i < parsed->count && result == PAGS_OK; i++)
    parsed->views[i].time = driving->steps[i / driving->sensor_count].time;
  pags_json_destroy(json);
  free(path);
  return result;
}
