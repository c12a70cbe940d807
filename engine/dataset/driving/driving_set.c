/* SPDX-License-Identifier: Apache-2.0 */
/* Release, lookup and notes of a driving set (driving_set.h). */
#include "dataset/driving/driving_set.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/text.h"

void pags_driving_destroy(pags_driving *driving) {
  if (!driving)
    return;
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    free(driving->sensors[i].name);
    pags_image_destroy(&driving->sensors[i].ego);
  }
  for (int64_t i = 0; i < driving->object_count; i++)
    pags_object_destroy(&driving->objects[i]);
  for (int64_t i = 0; i < driving->sweep_count; i++)
    free((char *)(uintptr_t)driving->sweeps[i].path);
  for (int64_t i = 0; i < driving->note_count; i++)
    free(driving->notes[i]);
  free(driving->sensors);
  free(driving->steps);
  free(driving->objects);
  free(driving->sweeps);
  free(driving->notes);
  free(driving->critical.list);
  free(driving->critical.objects);
  free(driving->root);
  free(driving);
}

int64_t pags_driving_step(const pags_driving *driving, int64_t frame) {
  int64_t low = 0, high = driving->step_count;
  while (low < high) {
    int64_t middle = low + (high - low) / 2;
    if (driving->steps[middle].frame < frame)
      low = middle + 1;
    else
      high = middle;
  }
  return low < driving->step_count && driving->steps[low].frame == frame ? low : -1;
}

bool pags_driving_has_boxes(const pags_driving *driving, int frame) {
  for (int64_t i = 0; i < driving->object_count; i++)
    if (pags_object_keyframe(&driving->objects[i], frame))
      return true;
  return false;
}

pags_sensor *pags_driving_sensor(const pags_driving *driving, int number) {
  for (int64_t i = 0; i < driving->sensor_count; i++)
    if (driving->sensors[i].number == number)
      return &driving->sensors[i];
  return NULL;
}

pags_result pags_driving_note(pags_driving *driving, const char *format, ...) {
  char line[512];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  PAGS_CHECK_MEMORY(
      pags_grow(&driving->notes, driving->note_count + 1, &driving->note_capacity, sizeof *driving->notes), "%s",
      driving->root);
  driving->notes[driving->note_count] = pags_text_copy(line);
  PAGS_CHECK_MEMORY(driving->notes[driving->note_count], "%s", driving->root);
  driving->note_count++;
  return PAGS_OK;
}
