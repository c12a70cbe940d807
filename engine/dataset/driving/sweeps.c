/* SPDX-License-Identifier: Apache-2.0 */
/* Finds and reads the sweeps lidar/TTT.bin: rows of little-endian float32, three columns of which are the point.
 * Which columns these are depends on the kind of the set (rules.c). */
#include "dataset/driving/checks.h"
#include "dataset/driving/reader.h"

#include "base/bytes.h"
#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t row_bytes(const pags_driving *driving) {
  return 4 * (uint64_t)driving->rules.columns;
}

static pags_result check_size(const pags_driving *driving, const char *path, uint64_t size) {
  if (size % row_bytes(driving) == 0)
    return PAGS_OK;
  const char *format = pags_sweep_format(path);
  return pags_fail(
      PAGS_ERROR_FORMAT,
      "%s: %s%s%llu bytes, expected a multiple of %llu (%d floats a row, as kind %s has; 'lidar_columns' of "
      "dataset.json names others)",
      path, format ? format : "", format ? "; " : "", (unsigned long long)size, (unsigned long long)row_bytes(driving),
      driving->rules.columns, driving->rules.kind);
}

/* Reads the pose of a sweep; *missing: there is none, and the sweep is left out as its photographs are. */
static pags_result read_pose(const pags_driving *driving, int frame, double out[12], bool *missing, pags_tally *lost) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  memcpy(out, identity, sizeof identity);
  *missing = false;
  if (driving->rules.lidar_world)
    return PAGS_OK;
  const char *folder = driving->rules.lidar_frame ? "lidar_pose" : "ego_pose";
  char *path = pags_text_format("%s/%s/%0*d.txt", driving->root, folder, driving->digits, frame);
  pags_result result = path ? pags_text_pose_read(path, out) : pags_out_of_memory("%s", driving->root);
  *missing = path && result != PAGS_OK && pags_text_pose_is_missing(path);
  if (*missing && (driving->rules.lidar_frame || driving->rules.per_frame)) /* else its photographs are, too */
    pags_tally_add(lost, "%s", path);
  free(path);
  return *missing ? PAGS_OK : result;
}

static pags_result add_sweep(pags_driving *driving, const pags_time_step *step, char *path, pags_tally *lost) {
  uint64_t size;
  pags_sweep *sweep = &driving->sweeps[driving->sweep_count];
  if (driving->rules.columns == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s/dataset.json: expected 'lidar_columns', since there is %s", driving->root,
                     path);
  PAGS_TRY(pags_file_size(path, &size));
  PAGS_TRY(check_size(driving, path, size));
  if (size == 0 && driving->empty_sweeps++ == 0)
    driving->first_empty_sweep = step->frame;
  *sweep = (pags_sweep){.frame = step->frame, .test = step->test, .time = step->time};
  bool missing;
  PAGS_TRY(read_pose(driving, step->frame, sweep->world_from_sweep, &missing, lost));
  if (missing)
    return PAGS_OK;
  sweep->path = path;
  driving->sweep_count++;
  return PAGS_OK;
}

pags_result pags_sweeps_find(pags_driving *driving) {
  pags_tally lost = {0};
  driving->sweeps = calloc((size_t)driving->step_count, sizeof *driving->sweeps);
  if (!driving->sweeps)
    return pags_out_of_memory("%s", driving->root);
  for (int64_t i = 0; i < driving->step_count; i++) {
    char *path = pags_text_format("%s/lidar/%0*d.bin", driving->root, driving->digits, driving->steps[i].frame);
    if (!path)
      return pags_out_of_memory("%s", driving->root);
    int64_t before = driving->sweep_count;
    pags_result result = pags_file_exists(path) ? add_sweep(driving, &driving->steps[i], path, &lost) : PAGS_OK;
    if (driving->sweep_count == before)
      free(path);
    PAGS_TRY(result);
  }
  if (lost.count)
    pags_log_message(PAGS_LOG_WARNING, "%s: %lld of %lld sweeps have no pose and are left out; the first pose is %s",
                     driving->root, (long long)lost.count, (long long)driving->step_count, lost.first);
  if (driving->sweep_count > 0)
    driving->provides |= PAGS_PROVIDES_LIDAR;
  if (driving->empty_sweeps > 0)
    pags_log_message(PAGS_LOG_WARNING, "%s/lidar: %lld of %lld sweeps have no points, the first is of frame %d",
                     driving->root, (long long)driving->empty_sweeps, (long long)driving->sweep_count,
                     driving->first_empty_sweep);

  /* The note reads like "LiDAR: 76 sweeps, none for 4 frames: 056 057 058 071". */
  char line[400];
  int length = snprintf(line, sizeof line, "LiDAR: %lld sweeps", (long long)driving->sweep_count);
  int64_t sweep = 0, missing = driving->step_count - driving->sweep_count;
  if (driving->sweep_count == 0)
    return pags_driving_note(driving, "LiDAR: none");
  if (missing > 0)
    length += snprintf(line + length, sizeof line - (size_t)length, ", none for %lld frames:", (long long)missing);
  for (int64_t i = 0; i < driving->step_count && missing > 0; i++) {
    if (sweep < driving->sweep_count && driving->sweeps[sweep].frame == driving->steps[i].frame)
      sweep++;
    else if (length < 300)
      length +=
          snprintf(line + length, sizeof line - (size_t)length, " %0*d", driving->digits, driving->steps[i].frame);
    else {
      snprintf(line + length, sizeof line - (size_t)length, " ...");
      break;
    }
  }
  return pags_driving_note(driving, "%s", line);
}

/* Copies the finite points of the rows to `xyz`; returns their number. */
static int64_t take_points(const pags_rules *rules, const uint8_t *bytes, int64_t rows, float *xyz) {
  int64_t count = 0;
  for (int64_t i = 0; i < rows; i++) {
    const uint8_t *row = bytes + 4 * i * rules->columns;
    float *point = xyz + 3 * count;
    for (int c = 0; c < 3; c++)
      point[c] = pags_load_f32(row + 4 * rules->position[c]);
    count += isfinite(point[0]) && isfinite(point[1]) && isfinite(point[2]);
  }
  return count;
}

pags_result pags_sweep_read(const pags_driving *driving, int64_t index, int64_t *count, float **xyz) {
  assert(index >= 0 && index < driving->sweep_count);
  const char *path = driving->sweeps[index].path;
  uint8_t *bytes;
  size_t size;
  *xyz = NULL;
  *count = 0;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  int64_t rows = (int64_t)(size / row_bytes(driving));
  pags_result result = check_size(driving, path, size); /* the file may have changed since the data set was opened */
  if (result == PAGS_OK)
    *xyz = malloc(((size_t)rows + 1) * 3 * sizeof **xyz);
  if (*xyz)
    *count = take_points(&driving->rules, bytes, rows, *xyz);
  else if (result == PAGS_OK)
    result = pags_out_of_memory("%s", path);
  free(bytes);
  return result;
}
