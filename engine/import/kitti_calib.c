/* SPDX-License-Identifier: Apache-2.0 */
/* Reads KITTI's calibration files: of the benchmarks (one file per sequence) and of raw recordings (three files per
 * day). */
#include <math.h>
#include <pags/camera.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "import/kitti_files.h"
#include "import/kitti_text.h"

/* A line "key: numbers" to be read; the key has one of two names. */
typedef struct entry {
  const char *name, *other; /* `other` NULL: one name only */
  int count;
  double *out;
  int required;
  int line; /* line number where it was found; 0: not found yet */
} entry;

static entry *find_entry(entry *entries, int count, const char *key) {
  for (int i = 0; i < count; i++)
    if (!strcmp(entries[i].name, key) || (entries[i].other && !strcmp(entries[i].other, key)))
      return &entries[i];
  return NULL;
}

static pags_result read_entry(const pags_lines *lines, char *rest, const char *key, entry *e) {
  if (e->line)
    return pags_lines_fail(lines, "'%s' stands here and in line %d", key, e->line);
  for (int i = 0; i < e->count; i++) {
    const char *word = pags_take_word(&rest);
    if (!word || !pags_word_number(word, &e->out[i]))
      return pags_lines_fail(lines, "expected %d numbers for '%s', found %s%.40s%s as number %d", e->count, key,
                             word ? "'" : "", word ? word : "nothing", word ? "'" : "", i + 1);
  }
  if (pags_take_word(&rest))
    return pags_lines_fail(lines, "expected %d numbers for '%s', found more", e->count, key);
  e->line = lines->line;
  return PAGS_OK;
}

static pags_result read_lines(pags_lines *lines, entry *entries, int count) {
  char *line;
  while ((line = pags_lines_next(lines))) {
    char *key = pags_take_word(&line); /* "P2:"; in the tracking benchmark also "Tr_velo_cam" without the colon */
    if (!key)
      continue;
    const size_t length = strlen(key);
    if (key[length - 1] == ':')
      key[length - 1] = 0;
    entry *e = find_entry(entries, count, key);
    if (e)
      PAGS_TRY(read_entry(lines, line, key, e));
  }
  for (int i = 0; i < count; i++)
    if (entries[i].required && !entries[i].line)
      return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a line '%s:'", lines->path, entries[i].name);
  return PAGS_OK;
}

static pags_result read_entries(const char *path, entry *entries, int count) {
  pags_lines lines;
  PAGS_TRY(pags_lines_open(&lines, path));
  const pags_result result = read_lines(&lines, entries, count);
  pags_lines_close(&lines);
  return result;
}

/* Makes the rotation of a rigid motion exactly orthonormal, which numbers of 7 to 13 digits in the files are not;
 * fails if the rotation is too far from orthonormal. */
static pags_result make_rigid(const char *path, const char *what, double m[12]) {
  pags_camera camera = {.width = 1, .height = 1, .fx = 1, .fy = 1};
  memcpy(camera.world_from_camera, m, sizeof camera.world_from_camera);
  char text[512];
  snprintf(text, sizeof text, "%s: %s", path, what);
  PAGS_TRY(pags_camera_check(&camera, text));
  memcpy(m, camera.world_from_camera, sizeof camera.world_from_camera);
  return PAGS_OK;
}

static void join_rotation(const double r[9], const double t[3], double out[12]) {
  for (int i = 0; i < 3; i++) {
    memcpy(out + 4 * i, r + 3 * i, 3 * sizeof *r);
    out[4 * i + 3] = t ? t[i] : 0;
  }
}

static pags_result join_rectified(const char *path, const double rect[9], const double cam_from_velo[12],
                                  double out[12]) {
  double rectified[12];
  join_rotation(rect, NULL, rectified);
  pags_rigid_multiply(rectified, cam_from_velo, out);
  return make_rigid(path, "R_rect * Tr_velo_to_cam", out);
}

pags_result pags_kitti_calib_read(const char *path, pags_kitti_calib *out) {
  double rect[9], velo[12];
  *out = (pags_kitti_calib){0};
  entry entries[] = {{"P0", NULL, 12, out->projection[0], 1, 0},
                     {"P1", NULL, 12, out->projection[1], 1, 0},
                     {"P2", NULL, 12, out->projection[2], 1, 0},
                     {"P3", NULL, 12, out->projection[3], 1, 0},
                     {"R0_rect", "R_rect", 9, rect, 1, 0},
                     {"Tr_velo_to_cam", "Tr_velo_cam", 12, velo, 1, 0},
                     {"Tr_imu_to_velo", "Tr_imu_velo", 12, out->velo_from_imu, 0, 0}};
  PAGS_TRY(read_entries(path, entries, sizeof entries / sizeof entries[0]));
  out->has_imu = entries[6].line != 0;
  PAGS_TRY(join_rectified(path, rect, velo, out->cam0_from_velo));
  return out->has_imu ? make_rigid(path, "Tr_imu_to_velo", out->velo_from_imu) : PAGS_OK;
}

/* Reads a raw calibration file that consists of a rotation R and a translation T. */
static pags_result read_rigid(const char *folder, const char *name, double out[12]) {
  double r[9], t[3];
  entry entries[] = {{"R", NULL, 9, r, 1, 0}, {"T", NULL, 3, t, 1, 0}};
  char *path = pags_path_join(folder, name);
  if (!path)
    return pags_out_of_memory("%s", folder);
  pags_result result = read_entries(path, entries, 2);
  if (result == PAGS_OK) {
    join_rotation(r, t, out);
    result = make_rigid(path, "R", out);
  }
  free(path);
  return result;
}

pags_result pags_kitti_calib_read_raw(const char *folder, pags_kitti_calib *out) {
  double rect[9], velo[12];
  *out = (pags_kitti_calib){.has_imu = true};
  entry entries[] = {{"P_rect_00", NULL, 12, out->projection[0], 1, 0},
                     {"P_rect_01", NULL, 12, out->projection[1], 1, 0},
                     {"P_rect_02", NULL, 12, out->projection[2], 1, 0},
                     {"P_rect_03", NULL, 12, out->projection[3], 1, 0},
                     {"R_rect_00", NULL, 9, rect, 1, 0},
                     {"S_rect_02", NULL, 2, out->size[2], 0, 0},
                     {"S_rect_03", NULL, 2, out->size[3], 0, 0}};
  char *path = pags_path_join(folder, "calib_cam_to_cam.txt");
  if (!path)
    return pags_out_of_memory("%s", folder);
  pags_result result = read_entries(path, entries, sizeof entries / sizeof entries[0]);
  if (result == PAGS_OK)
    result = read_rigid(folder, "calib_velo_to_cam.txt", velo);
  if (result == PAGS_OK)
    result = join_rectified(path, rect, velo, out->cam0_from_velo);
  if (result == PAGS_OK)
    result = read_rigid(folder, "calib_imu_to_velo.txt", out->velo_from_imu);
  free(path);
  return result;
}

pags_result pags_kitti_camera(const pags_kitti_calib *calib, int index, double intrinsics[4],
                              double cam0_from_camera[12]) {
  const double *p = calib->projection[index];
  const double third[4] = {p[1], p[4], p[8], p[9]};
  for (int i = 0; i < 4; i++)
    if (third[i] != 0)
      return pags_fail(PAGS_ERROR_FORMAT, "P%d is no projection of a rectified camera: expected 0 where it has %g",
                       index, third[i]);
  if (!(p[0] > 0) || !(p[5] > 0) || p[10] != 1)
    return pags_fail(PAGS_ERROR_FORMAT,
                     "P%d is no projection of a rectified camera: focal lengths %g and %g, last row's 1 is %g", index,
                     p[0], p[5], p[10]);
  /* KITTI puts the centre of the first pixel at 0; in our convention the corner of the picture is at 0, half a pixel
   * before. */
  intrinsics[0] = p[0];
  intrinsics[1] = p[5];
  intrinsics[2] = p[2] + 0.5;
  intrinsics[3] = p[6] + 0.5;
  const double t[3] = {(p[3] - p[2] * p[11]) / p[0], (p[7] - p[6] * p[11]) / p[5], p[11]};
  for (int i = 0; i < 12; i++)
    cam0_from_camera[i] = i % 5 == 0;
  for (int i = 0; i < 3; i++)
    cam0_from_camera[4 * i + 3] = -t[i];
  return PAGS_OK;
}
