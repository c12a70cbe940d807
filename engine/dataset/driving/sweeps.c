/* SPDX-License-Identifier: Apache-2.0 */
/* Finds and reads the sweeps lidar/TTT.bin: rows of little-endian float32, three columns of which are the point.
 * Which columns these are depends on the kind of the set (rules.c). */
#include "dataset/driving/check/checks.h"
#include "dataset/driving/reader.h"

#include "base/bytes.h"
#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "base/vec3.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *pags_sweep_format(const char *path) {
  static const struct {
    const char *magic, *name;
  } known[] = {{"\x93NUMPY", "a .npy file of numpy (write its array with tofile)"},
               {"ply\n", "a PLY file"},
               {"ply\r", "a PLY file"},
               {"# .PCD", "a PCD file"},
               {"VERSION", "a PCD file"},
               {"LASF", "a LAS file"},
               {"PK\x03\x04", "a zip archive (.npz)"},
               {"version https://git-lfs", "a pointer of Git LFS (fetch the file itself with 'git lfs pull')"}};
  char head[32];
  const size_t got = pags_file_head(path, head, sizeof head);
  for (size_t i = 0; i < sizeof known / sizeof *known; i++)
    if (got >= strlen(known[i].magic) && memcmp(head, known[i].magic, strlen(known[i].magic)) == 0)
      return known[i].name;
  return NULL;
}

static uint64_t row_bytes(const pags_driving *driving) {
  return 4 * (uint64_t)driving->rules.columns;
}

static pags_result check_size(const pags_driving *driving, const char *path, uint64_t size) {
  if (size % row_bytes(driving) == 0)
    return PAGS_OK;
  const char *format = pags_sweep_format(path);
  return pags_fail(PAGS_ERROR_FORMAT,
                   "%s: %s%s%llu bytes, expected a multiple of %llu (%d floats a row, as kind %s has; 'lidar_columns' "
                   "of dataset.json names others)",
                   path, format ? format : "", format ? "; " : "", (unsigned long long)size,
                   (unsigned long long)row_bytes(driving), driving->rules.columns, driving->rules.kind);
}

/* Reads the pose of a sweep; *missing: none exists, and the sweep is left out as its photographs are. */
static pags_result read_pose(const pags_driving *driving, int frame, double out[12], bool *missing, pags_tally *lost) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  memcpy(out, identity, sizeof identity);
  *missing = false;
  if (driving->rules.lidar_world)
    return PAGS_OK;
  const char *folder = driving->rules.lidar_frame ? "lidar_pose" : "ego_pose";
  PAGS_AUTOFREE char *path = pags_text_format("%s/%s/%0*d.txt", driving->root, folder, driving->digits, frame);
  PAGS_CHECK_MEMORY(path, "%s", driving->root);
  const pags_result result = pags_text_pose_read(path, out);
  *missing = result != PAGS_OK && pags_text_pose_is_missing(path);
  if (*missing && (driving->rules.lidar_frame || driving->rules.per_frame)) /* else its photographs are, too */
    pags_tally_add(lost, "%s", path);
  return *missing ? PAGS_OK : result;
}

/* Adds the sweep of a time step, if it has one. */
static pags_result add_sweep(pags_driving *driving, const pags_time_step *step, pags_tally *lost) {
  PAGS_AUTOFREE char *path = pags_text_format("%s/lidar/%0*d.bin", driving->root, driving->digits, step->frame);
  PAGS_CHECK_MEMORY(path, "%s", driving->root);
  if (!pags_file_exists(path))
    return PAGS_OK;
  uint64_t size;
  pags_sweep *sweep = &driving->sweeps[driving->sweep_count];
  if (driving->rules.columns == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s/dataset.json: expected 'lidar_columns', since there is %s", driving->root,
                     path);
  PAGS_TRY(pags_file_size(path, &size));
  PAGS_TRY(check_size(driving, path, size));
  *sweep = (pags_sweep){.frame = step->frame, .test = step->test, .time = step->time};
  bool missing;
  PAGS_TRY(read_pose(driving, step->frame, sweep->world_from_sweep, &missing, lost));
  if (missing)
    return PAGS_OK;
  sweep->path = pags_take(&path);
  driving->sweep_count++;
  return PAGS_OK;
}

pags_result pags_sweeps_find(pags_driving *driving) {
  pags_tally lost = {0};
  driving->sweeps = calloc((size_t)driving->step_count, sizeof *driving->sweeps);
  PAGS_CHECK_MEMORY(driving->sweeps, "%s", driving->root);
  for (int64_t i = 0; i < driving->step_count; i++)
    PAGS_TRY(add_sweep(driving, &driving->steps[i], &lost));
  if (lost.count)
    PAGS_WARN("%s: %lld of %lld sweeps have no pose and are left out; the first pose is %s", driving->root,
              (long long)lost.count, (long long)driving->step_count, lost.first);
  if (driving->sweep_count > 0)
    driving->provides |= PAGS_PROVIDES_LIDAR;

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

/* ---- Points ---- */

enum { SAMPLED = 512, REPEATED = 8, MOST_PLACES = 4 };

static int by_bytes(const void *a, const void *b) {
  return memcmp(a, b, 3 * sizeof(float));
}

static void load_point(const pags_rules *rules, const uint8_t *row, float point[3]) {
  for (int c = 0; c < 3; c++)
    point[c] = pags_load_f32(row + 4 * rules->position[c]);
}

/* Finds places where many rows lie: beams without a return are rows of zeros, which a converter may have moved to the
 * scanner's place in the car or in the world. At most SAMPLED rows are looked at; REPEATED are at the same place to the
 * last bit: no surface gives more than a few returns of equal coordinates. Returns the number of such places. */
static int find_places(const pags_rules *rules, const uint8_t *bytes, int64_t rows, float places[MOST_PLACES][3]) {
  float sampled[SAMPLED][3];
  const int count = rows < SAMPLED ? (int)rows : SAMPLED;
  int found = 0;
  for (int i = 0; i < count; i++)
    load_point(rules, bytes + 4 * (i * rows / count) * rules->columns, sampled[i]);
  pags_sort(sampled, count, sizeof *sampled, by_bytes);
  for (int begin = 0, end; begin < count && found < MOST_PLACES; begin = end) {
    for (end = begin + 1; end < count && by_bytes(sampled[begin], sampled[end]) == 0;)
      end++;
    if (end - begin >= REPEATED)
      memcpy(places[found++], sampled[begin], sizeof *sampled);
  }
  return found;
}

/* Copies the points of the rows to `xyz` and counts the invalid rows; returns the number of points. `centre`: the
 * car's place in the frame of the sweep. */
static int64_t take_points(const pags_rules *rules, const uint8_t *bytes, const double centre[3], float *xyz,
                           pags_sweep_rows *rows) {
  float places[MOST_PLACES][3];
  const int place_count = find_places(rules, bytes, rows->all, places);
  int64_t count = 0;
  for (int64_t i = 0; i < rows->all; i++) {
    float *p = xyz + 3 * count;
    load_point(rules, bytes + 4 * i * rules->columns, p);
    if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2])) {
      rows->not_finite++;
      continue;
    }
    bool none = fabsf(p[0]) < 1e-3f && fabsf(p[1]) < 1e-3f && fabsf(p[2]) < 1e-3f; /* at the scanner */
    for (int k = 0; k < place_count; k++)
      none = none || memcmp(p, places[k], sizeof places[k]) == 0;
    double at[3];
    pags_widen3(p, at);
    const bool far = pags_distance_squared3(at, centre) > (double)PAGS_FARTHEST * PAGS_FARTHEST;
    rows->no_return += none;
    rows->far += far && !none;
    count += !none && !far;
  }
  return count;
}

pags_result pags_sweep_read(const pags_driving *driving, int64_t index, int64_t *count, float **xyz,
                            pags_sweep_rows *rows) {
  assert(index >= 0 && index < driving->sweep_count);
  const pags_sweep *sweep = &driving->sweeps[index];
  const pags_time_step *step = &driving->steps[pags_driving_step(driving, sweep->frame)];
  const double zero[3] = {0}, *centre = driving->rules.lidar_world && isfinite(step->eye[0]) ? step->eye : zero;
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  *xyz = NULL;
  *count = 0;
  PAGS_TRY(pags_file_read(sweep->path, &bytes, &size));
  PAGS_TRY(check_size(driving, sweep->path, size)); /* it may have changed since the data set was opened */
  pags_sweep_rows counted = {.all = (int64_t)(size / row_bytes(driving))};
  *xyz = malloc(((size_t)counted.all + 1) * 3 * sizeof **xyz);
  PAGS_CHECK_MEMORY(*xyz, "%s", sweep->path);
  *count = take_points(&driving->rules, bytes, centre, *xyz, &counted);
  if (rows)
    *rows = counted;
  return PAGS_OK;
}
