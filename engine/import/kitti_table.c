/* SPDX-License-Identifier: Apache-2.0 */
/* Reads KITTI's files that are rows of numbers: oxts, poses and times; computes poses from oxts. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pags/camera.h>

#include "base/file.h"
#include "base/memory.h"
#include "import/kitti_files.h"
#include "import/kitti_text.h"
#include "maths/maths.h"

void pags_kitti_table_destroy(pags_kitti_table *table) {
  free(table->values);
  *table = (pags_kitti_table){0};
}

/* Makes room for one more row of `width` doubles by doubling the capacity; returns false when out of memory. */
static bool grow(double **values, int64_t rows, int64_t *capacity, int width) {
  if (rows < *capacity)
    return true;
  const int64_t wanted = *capacity ? 2 * *capacity : 64;
  if ((uint64_t)wanted > SIZE_MAX / sizeof(double) / (uint64_t)width)
    return false;
  double *larger = realloc(*values, (size_t)wanted * (size_t)width * sizeof(double));
  if (!larger)
    return false;
  *values = larger;
  *capacity = wanted;
  return true;
}

static pags_result read_row(const pags_lines *lines, char *line, int columns, double *out) {
  for (int i = 0; i < columns; i++) {
    const char *word = pags_take_word(&line);
    if (!word)
      return pags_lines_fail(lines, "expected %d numbers, found %d", columns, i);
    if (!pags_word_number(word, &out[i]))
      return pags_lines_fail(lines, "expected a number in column %d, found '%.40s'", i + 1, word);
  }
  if (pags_take_word(&line))
    return pags_lines_fail(lines, "expected %d numbers, found more", columns);
  return PAGS_OK;
}

static pags_result read_rows(pags_lines *lines, pags_kitti_table *table) {
  int64_t capacity = 0;
  bool ended = false;
  char *line;
  while ((line = pags_lines_next(lines))) {
    if (!line[strspn(line, " \t")]) {
      ended = true;
      continue;
    }
    if (ended)
      return pags_lines_fail(lines, "expected nothing after an empty line");
    if (!grow(&table->values, table->rows, &capacity, table->columns))
      return pags_out_of_memory("%s: its rows", lines->path);
    PAGS_TRY(read_row(lines, line, table->columns, table->values + table->rows * table->columns));
    table->rows++;
  }
  return table->rows ? PAGS_OK : pags_lines_fail(lines, "expected rows of %d numbers, found none", table->columns);
}

pags_result pags_kitti_table_read(const char *path, int columns, pags_kitti_table *out) {
  pags_lines lines;
  *out = (pags_kitti_table){.columns = columns};
  PAGS_TRY(pags_lines_open(&lines, path));
  const pags_result result = read_rows(&lines, out);
  pags_lines_close(&lines);
  if (result != PAGS_OK)
    pags_kitti_table_destroy(out);
  return result;
}

/* ---- oxts ---- */

static const double pi = 3.14159265358979323846;

double pags_kitti_oxts_scale(const double first[PAGS_KITTI_OXTS]) {
  return pags_cos(first[PAGS_OXTS_LAT] * pi / 180);
}

static const double radius = 6378137; /* m; the development kit's earth radius, WGS84's at the equator */

/* Mercator projection with scale s and radius R:
 *     x = s R lon, y = s R ln tan(45 deg + lat / 2), z = alt; R_world_imu = Rz(yaw) Ry(pitch) Rx(roll) */
void pags_kitti_oxts_pose(const double oxts[PAGS_KITTI_OXTS], double scale, double out[12]) {
  const double turn[3] = {oxts[PAGS_OXTS_ROLL], oxts[PAGS_OXTS_PITCH], oxts[PAGS_OXTS_YAW]};
  const double place[3] = {scale * radius * oxts[PAGS_OXTS_LON] * pi / 180,
                           scale * radius * pags_log(pags_tan((90 + oxts[PAGS_OXTS_LAT]) * pi / 360)),
                           oxts[PAGS_OXTS_ALT]};
  pags_rigid_from_angles(turn, place, out);
}

pags_place pags_kitti_place(const double position[3], double scale) {
  return (pags_place){.latitude = 360 / pi * pags_atan(pags_exp(position[1] / (scale * radius))) - 90,
                      .longitude = position[0] / (scale * radius) * 180 / pi,
                      .altitude = position[2],
                      .known = 1};
}

/* ---- Times ---- */

/* Returns the number of days from 1970-01-01 to a date of the Gregorian calendar. Years are counted from March, so
 * that the leap day is the last day of a year. */
static int64_t days_of(int64_t year, int64_t month, int64_t day) {
  const int64_t y = month > 2 ? year : year - 1;
  const int64_t in_year = (153 * (month > 2 ? month - 3 : month + 9) + 2) / 5 + day - 1;
  return 365 * y + y / 4 - y / 100 + y / 400 + in_year - 719468;
}

static bool parse_time(const char *line, double *out) {
  int year, month, day, hour, minute, used = 0;
  double second;
  if (sscanf(line, "%4d-%2d-%2d %2d:%2d:%n", &year, &month, &day, &hour, &minute, &used) != 5 || used == 0)
    return false;
  if (year < 1970 || month < 1 || month > 12 || day < 1 || day > 31 || hour < 0 || hour > 23 || minute < 0 ||
      minute > 59)
    return false;
  if (line[used] < '0' || line[used] > '9' || !pags_word_number(line + used, &second) || second >= 61)
    return false;
  *out = (double)(86400 * days_of(year, month, day) + 3600 * hour + 60 * minute) + second;
  return true;
}

pags_result pags_kitti_times_read(const char *path, int64_t *count, double **seconds) {
  pags_lines lines;
  int64_t capacity = 0;
  pags_result result = PAGS_OK;
  char *line;
  *count = 0;
  *seconds = NULL;
  PAGS_TRY(pags_lines_open(&lines, path));
  int64_t last = 0; /* number of times up to the last one that is known */
  while (result == PAGS_OK && (line = pags_lines_next(&lines))) {
    const bool empty = !line[strspn(line, " \t")];
    if (!grow(seconds, *count, &capacity, 1))
      result = pags_out_of_memory("%s: its times", path);
    else if (empty)
      (*seconds)[(*count)++] = (double)NAN;
    else if (!parse_time(line, &(*seconds)[*count]))
      result = pags_lines_fail(&lines, "expected a time such as 2011-09-26 13:02:25.594360375, found '%.40s'", line);
    else
      last = ++*count;
  }
  *count = last;
  pags_lines_close(&lines);
  if (result != PAGS_OK) {
    free(*seconds);
    *seconds = NULL;
  }
  return result;
}
