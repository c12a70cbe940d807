/* SPDX-License-Identifier: Apache-2.0 */
/* Reads KITTI's text files (kitti_files.h): tables of numbers, times, labels, and the calibrations of the benchmarks
 * (one file per sequence) and of raw recordings (three files per day). Numbers are parsed strictly. */
#include "import/kitti_files.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <strings.h>

#include <pags/camera.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"
#include "maths/maths.h"

/* ---- Lines and words ---- */

typedef struct lines {
  const char *path;
  char *text; /* the whole file; the newline of each line taken is replaced by a zero byte */
  char *at, *end;
  int line; /* number of the last line taken, from 1 */
} lines;

static void close_lines(lines *l) {
  free(l->text);
}

/* Reads a text file; fails if it contains a zero byte. */
static pags_result open_lines(const char *path, lines *out) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size = 0;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  const uint8_t *zero = memchr(bytes, 0, size);
  if (zero)
    return pags_fail_at(path, "expected text, found a zero byte at byte %lld", (long long)(zero - bytes));
  char *text = pags_take(&bytes);
  const bool marked = size >= 3 && !memcmp(text, "\xef\xbb\xbf", 3); /* a byte order mark, as some editors write it */
  *out = (lines){.path = path, .text = text, .at = text + (marked ? 3 : 0), .end = text + size};
  return PAGS_OK;
}

/* Returns the next line without its line end; NULL at the end of the file. */
static char *next_line(lines *l) {
  if (l->at >= l->end || l->line == INT_MAX)
    return NULL;
  char *line = l->at;
  char *newline = memchr(line, '\n', (size_t)(l->end - line));
  char *stop = newline ? newline : l->end;
  l->at = newline ? newline + 1 : l->end;
  l->line++;
  if (stop > line && stop[-1] == '\r')
    stop--;
  *stop = 0; /* at the end of the file, this is the extra zero byte of pags_file_read */
  return line;
}

static bool is_blank(const char *line) {
  return !line[strspn(line, " \t")];
}

/* Fails with the message "path:line: " followed by the formatted text. */
static pags_result fail(const lines *l, const char *format, ...) PAGS_PRINTF(2, 3);
static pags_result fail(const lines *l, const char *format, ...) {
  char text[512];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: %s", l->path, l->line, text);
}

/* Takes the next word, ended by blanks or commas, from *text and moves *text behind it; NULL at the end. */
static char *take_word(char **text) {
  char *word = *text + strspn(*text, " \t,");
  if (!*word)
    return NULL;
  char *stop = word + strcspn(word, " \t,");
  *text = *stop ? stop + 1 : stop;
  *stop = 0;
  return word;
}

bool pags_word_number(const char *word, double *out) {
  char *end = NULL;
  *out = pags_text_to_double(word, &end);
  return end != word && !*end && isfinite(*out);
}

bool pags_word_integer(const char *word, int64_t lo, int64_t hi, int64_t *out) {
  char *end = NULL;
  errno = 0;
  *out = strtoll(word, &end, 10);
  return end != word && !*end && errno == 0 && *out >= lo && *out <= hi;
}

/* ---- Tables ---- */

void pags_kitti_table_destroy(pags_kitti_table *table) {
  free(table->values);
  *table = (pags_kitti_table){0};
}

pags_result pags_kitti_table_read(const char *path, int columns, pags_kitti_table *out) {
  PAGS_AUTO(pags_kitti_table_destroy) pags_kitti_table table = {.columns = columns};
  PAGS_AUTO(close_lines) lines l = {0};
  int64_t capacity = 0;
  bool ended = false;
  char *line;
  *out = (pags_kitti_table){0};
  PAGS_TRY(open_lines(path, &l));
  while ((line = next_line(&l))) {
    const bool blank = is_blank(line);
    if (ended && !blank)
      return fail(&l, "expected nothing after an empty line");
    ended = blank;
    if (blank)
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&table.values, table.rows + 1, &capacity, (size_t)columns * sizeof *table.values),
                      "%s: its rows", path);
    double *row = table.values + table.rows++ * columns;
    for (int i = 0; i < columns; i++) {
      const char *word = take_word(&line);
      if (!word)
        return fail(&l, "expected %d numbers, found %d", columns, i);
      if (!pags_word_number(word, &row[i]))
        return fail(&l, "expected a number in column %d, found '%.40s'", i + 1, word);
    }
    if (take_word(&line))
      return fail(&l, "expected %d numbers, found more", columns);
  }
  if (!table.rows)
    return fail(&l, "expected rows of %d numbers, found none", columns);
  *out = table;
  table.values = NULL;
  return PAGS_OK;
}

/* ---- oxts ---- */

static const double pi = 3.14159265358979323846;
static const double radius = 6378137; /* m; the development kit's earth radius, WGS84's at the equator */

double pags_kitti_oxts_scale(const double first[PAGS_KITTI_OXTS]) {
  return pags_cos(first[PAGS_OXTS_LAT] * pi / 180);
}

/* Mercator projection with scale s and radius R:
 *     x = s R lon, y = s R ln tan(45 deg + lat / 2), z = alt; R_world_imu = Rz(yaw) Ry(pitch) Rx(roll) */
void pags_kitti_oxts_pose(const double oxts[PAGS_KITTI_OXTS], double scale, double out[12]) {
  const double place[3] = {scale * radius * oxts[PAGS_OXTS_LON] * pi / 180,
                           scale * radius * pags_log(pags_tan((90 + oxts[PAGS_OXTS_LAT]) * pi / 360)),
                           oxts[PAGS_OXTS_ALT]};
  pags_rigid_from_angles(oxts + PAGS_OXTS_ROLL, place, out);
}

pags_place pags_kitti_place(const double position[3], double scale) {
  return (pags_place){.latitude = 360 / pi * pags_atan(pags_exp(position[1] / (scale * radius))) - 90,
                      .longitude = position[0] / (scale * radius) * 180 / pi,
                      .altitude = position[2],
                      .known = 1};
}

/* ---- Times ---- */

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
  /* Days since 1970-01-01 in the Gregorian calendar. Years are counted from March, so that the leap day is the last day
   * of a year. */
  const int64_t y = month > 2 ? year : year - 1;
  const int64_t in_year = (153 * (month > 2 ? month - 3 : month + 9) + 2) / 5 + day - 1;
  const int64_t days = 365 * y + y / 4 - y / 100 + y / 400 + in_year - 719468;
  *out = (double)(86400 * days + 3600 * hour + 60 * minute) + second;
  return true;
}

pags_result pags_kitti_times_read(const char *path, int64_t *count, double **seconds) {
  PAGS_AUTO(close_lines) lines l = {0};
  PAGS_AUTOFREE double *times = NULL;
  int64_t capacity = 0, read = 0;
  char *line;
  *count = 0; /* number of times up to the last one that is known */
  *seconds = NULL;
  PAGS_TRY(open_lines(path, &l));
  while ((line = next_line(&l))) {
    PAGS_CHECK_MEMORY(pags_grow(&times, read + 1, &capacity, sizeof *times), "%s: its times", path);
    if (is_blank(line)) {
      times[read++] = (double)NAN;
      continue;
    }
    if (!parse_time(line, &times[read++]))
      return fail(&l, "expected a time such as 2011-09-26 13:02:25.594360375, found '%.40s'", line);
    *count = read;
  }
  *seconds = pags_take(&times);
  return PAGS_OK;
}

/* ---- Labels ---- */

/* Sizes and places (m) and angles (rad) above these can't be right: a LiDAR reaches 250 m, a train's car has 30 m, and
 * no angle needs two turns. */
#define LARGEST_SIZE 100.0
#define LARGEST_DISTANCE 1000.0
#define LARGEST_ANGLE 12.6

void pags_kitti_labels_destroy(pags_kitti_labels *labels) {
  free(labels->rows);
  *labels = (pags_kitti_labels){0};
}

bool pags_kitti_label_is_box(const pags_kitti_label *label) {
  return strcasecmp(label->type, "DontCare") != 0;
}

/* Whether a label gives a box in space: those of detectors in pictures have sizes of -1 and a place of -1000. */
bool pags_kitti_label_has_volume(const pags_kitti_label *label) {
  return label->height > 0 && label->width > 0 && label->length > 0 && label->bottom[2] > -1000;
}

/* rotation_y is an angle about cam0's y axis, which points down: R_y (1, 0, 0) = (cos, 0, -sin). The label's position
 * is the centre of the bottom face, so that the centre of the box lies half its height above. */
void pags_kitti_label_pose(const pags_kitti_label *label, double out[12]) {
  const double c = pags_cos(label->rotation_y), s = pags_sin(label->rotation_y);
  const double forward[3] = {c, 0, -s}, left[3] = {s, 0, c}, up[3] = {0, -1, 0};
  for (int i = 0; i < 3; i++) {
    out[4 * i] = forward[i];
    out[4 * i + 1] = left[i];
    out[4 * i + 2] = up[i];
    out[4 * i + 3] = label->bottom[i] + up[i] * label->height / 2;
  }
}

/* Takes a whole number, which some programs write as "3.0" or "3.000000". */
static pags_result take_integer(const lines *l, char **text, const char *what, int64_t lo, int64_t hi, int *out) {
  double value;
  const char *word = take_word(text);
  if (!word || !pags_word_number(word, &value) || value != floor(value) || value < (double)lo || value > (double)hi)
    return fail(l, "expected an integer of %lld..%lld for '%s', found '%.40s'", (long long)lo, (long long)hi, what,
                word ? word : "");
  *out = (int)value;
  return PAGS_OK;
}

static pags_result take_number(const lines *l, char **text, const char *what, double *out) {
  const char *word = take_word(text);
  return word && pags_word_number(word, out)
             ? PAGS_OK
             : fail(l, "expected a number for '%s', found '%.40s'", what, word ? word : "");
}

static pags_result check_box(const lines *l, bool tracking, const pags_kitti_label *label) {
  char name[96];
  if (tracking && label->track < 0)
    return fail(l, "a %s without track id; expected labels of a tracker, which numbers the objects", label->type);
  snprintf(name, sizeof name, tracking ? "%s of track %d in frame %d" : "%s", label->type, label->track, label->frame);
  if (!pags_kitti_label_has_volume(label))
    return PAGS_OK;
  if (label->height > LARGEST_SIZE || label->width > LARGEST_SIZE || label->length > LARGEST_SIZE)
    return fail(l, "%s: expected a height, width and length below %g m, found %g x %g x %g", name, LARGEST_SIZE,
                label->height, label->width, label->length);
  if (fabs(label->rotation_y) > LARGEST_ANGLE)
    return fail(l, "%s: expected rotation_y in radians (-pi to pi), found %g: are these degrees?", name,
                label->rotation_y);
  for (int i = 0; i < 3; i++)
    if (fabs(label->bottom[i]) > LARGEST_DISTANCE)
      return fail(l, "%s: expected a place in the camera's axes in metres, below %g, found %g %g %g", name,
                  LARGEST_DISTANCE, label->bottom[0], label->bottom[1], label->bottom[2]);
  return PAGS_OK;
}

static pags_result read_label(const lines *l, char *text, bool tracking, pags_kitti_label *out) {
  double unused; /* checked to be a number */
  int occluded;
  *out = (pags_kitti_label){.frame = -1, .track = -1, .line = l->line};
  const struct {
    const char *name;
    double *value;
  } numbers[] = {{"alpha", &unused},      {"left", &out->box[0]},   {"top", &out->box[1]},
                 {"right", &out->box[2]}, {"bottom", &out->box[3]}, {"height", &out->height},
                 {"width", &out->width},  {"length", &out->length}, {"x", &out->bottom[0]},
                 {"y", &out->bottom[1]},  {"z", &out->bottom[2]},   {"rotation_y", &out->rotation_y}};
  if (tracking) {
    PAGS_TRY(take_integer(l, &text, "frame", 0, 1000000, &out->frame));
    PAGS_TRY(take_integer(l, &text, "track id", -1, 1000000, &out->track));
  }
  const char *type = take_word(&text);
  if (!type || strlen(type) >= sizeof out->type)
    return fail(l, "expected a class name shorter than 32 letters, found '%.40s'", type ? type : "");
  memcpy(out->type, type, strlen(type) + 1);
  PAGS_TRY(take_number(l, &text, "truncated", &unused));
  PAGS_TRY(take_integer(l, &text, "occluded", -1, 9, &occluded));
  for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++)
    PAGS_TRY(take_number(l, &text, numbers[i].name, numbers[i].value));
  const char *word = take_word(&text);
  out->scored = word && pags_word_number(word, &out->score);
  if ((word && !out->scored) || take_word(&text))
    return fail(l, "expected %d columns, or %d with a score, found more", tracking ? 17 : 15, tracking ? 18 : 16);
  return pags_kitti_label_is_box(out) ? check_box(l, tracking, out) : PAGS_OK;
}

pags_result pags_kitti_labels_read(const char *path, bool tracking, pags_kitti_labels *out) {
  PAGS_AUTO(pags_kitti_labels_destroy) pags_kitti_labels labels = {0};
  PAGS_AUTO(close_lines) lines l = {0};
  int64_t capacity = 0;
  char *line;
  *out = (pags_kitti_labels){0};
  PAGS_TRY(open_lines(path, &l));
  while ((line = next_line(&l))) {
    if (is_blank(line))
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&labels.rows, labels.count + 1, &capacity, sizeof *labels.rows), "%s: its rows", path);
    PAGS_TRY(read_label(&l, line, tracking, &labels.rows[labels.count]));
    labels.count++;
  }
  *out = labels;
  labels.rows = NULL;
  return PAGS_OK;
}

/* ---- Calibration ---- */

/* A line "key: numbers" to be read; the key has one of two names. */
typedef struct entry {
  const char *name, *other; /* `other` NULL: one name only */
  int count;
  double *out;
  bool optional;
  int line; /* line number where it was found; 0: not found yet */
} entry;

static pags_result read_entry(const lines *l, char *rest, const char *key, entry *e) {
  if (e->line)
    return fail(l, "'%s' stands here and in line %d", key, e->line);
  for (int i = 0; i < e->count; i++) {
    const char *word = take_word(&rest);
    if (!word || !pags_word_number(word, &e->out[i]))
      return fail(l, "expected %d numbers for '%s', found %s%.40s%s as number %d", e->count, key, word ? "'" : "",
                  word ? word : "nothing", word ? "'" : "", i + 1);
  }
  e->line = l->line;
  return take_word(&rest) ? fail(l, "expected %d numbers for '%s', found more", e->count, key) : PAGS_OK;
}

static pags_result read_entries(const char *path, entry *entries, int count) {
  PAGS_AUTO(close_lines) lines l = {0};
  char *line;
  PAGS_TRY(open_lines(path, &l));
  while ((line = next_line(&l))) {
    char *key = take_word(&line); /* "P2:"; in the tracking benchmark also "Tr_velo_cam" without the colon */
    if (!key)
      continue;
    const size_t length = strlen(key);
    if (key[length - 1] == ':')
      key[length - 1] = 0;
    for (entry *e = entries; e < entries + count; e++)
      if (!strcmp(e->name, key) || (e->other && !strcmp(e->other, key))) {
        PAGS_TRY(read_entry(&l, line, key, e));
        break;
      }
  }
  for (int i = 0; i < count; i++)
    if (!entries[i].optional && !entries[i].line)
      return pags_fail_at(path, "expected a line '%s:'", entries[i].name);
  return PAGS_OK;
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

static pags_result join_rectified(const char *path, const double rect[9], const double cam_from_velo[12],
                                  double out[12]) {
  double rectified[12];
  pags_pose_make(rect, (const double[3]){0}, rectified);
  pags_rigid_multiply(rectified, cam_from_velo, out);
  return make_rigid(path, "R_rect * Tr_velo_to_cam", out);
}

pags_result pags_kitti_calib_read(const char *path, pags_kitti_calib *out) {
  double rect[9], velo[12];
  *out = (pags_kitti_calib){0};
  entry entries[] = {{"P0", NULL, 12, out->projection[0], false, 0},
                     {"P1", NULL, 12, out->projection[1], false, 0},
                     {"P2", NULL, 12, out->projection[2], false, 0},
                     {"P3", NULL, 12, out->projection[3], false, 0},
                     {"R0_rect", "R_rect", 9, rect, false, 0},
                     {"Tr_velo_to_cam", "Tr_velo_cam", 12, velo, false, 0},
                     {"Tr_imu_to_velo", "Tr_imu_velo", 12, out->velo_from_imu, true, 0}};
  PAGS_TRY(read_entries(path, entries, sizeof entries / sizeof entries[0]));
  out->has_imu = entries[6].line != 0;
  PAGS_TRY(join_rectified(path, rect, velo, out->cam0_from_velo));
  return out->has_imu ? make_rigid(path, "Tr_imu_to_velo", out->velo_from_imu) : PAGS_OK;
}

/* Reads a raw calibration file that consists of a rotation R and a translation T. */
static pags_result read_rigid(const char *folder, const char *name, double out[12]) {
  double r[9], t[3];
  entry entries[] = {{"R", NULL, 9, r, false, 0}, {"T", NULL, 3, t, false, 0}};
  PAGS_AUTOFREE char *path = pags_path_join(folder, name);
  PAGS_CHECK_MEMORY(path, "%s", folder);
  PAGS_TRY(read_entries(path, entries, 2));
  pags_pose_make(r, t, out);
  return make_rigid(path, "R", out);
}

pags_result pags_kitti_calib_read_raw(const char *folder, pags_kitti_calib *out) {
  double rect[9], velo[12];
  *out = (pags_kitti_calib){.has_imu = true};
  entry entries[] = {{"P_rect_00", NULL, 12, out->projection[0], false, 0},
                     {"P_rect_01", NULL, 12, out->projection[1], false, 0},
                     {"P_rect_02", NULL, 12, out->projection[2], false, 0},
                     {"P_rect_03", NULL, 12, out->projection[3], false, 0},
                     {"R_rect_00", NULL, 9, rect, false, 0},
                     {"S_rect_02", NULL, 2, out->size[2], true, 0},
                     {"S_rect_03", NULL, 2, out->size[3], true, 0}};
  PAGS_AUTOFREE char *path = pags_path_join(folder, "calib_cam_to_cam.txt");
  PAGS_CHECK_MEMORY(path, "%s", folder);
  PAGS_TRY(read_entries(path, entries, sizeof entries / sizeof entries[0]));
  PAGS_TRY(read_rigid(folder, "calib_velo_to_cam.txt", velo));
  PAGS_TRY(join_rectified(path, rect, velo, out->cam0_from_velo));
  return read_rigid(folder, "calib_imu_to_velo.txt", out->velo_from_imu);
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
  const double k[4] = {p[0], p[5], p[2] + 0.5, p[6] + 0.5};
  memcpy(intrinsics, k, sizeof k);
  const double t[3] = {(p[3] - p[2] * p[11]) / p[0], (p[7] - p[6] * p[11]) / p[5], p[11]};
  const double pose[12] = {1, 0, 0, -t[0], 0, 1, 0, -t[1], 0, 0, 1, -t[2]};
  memcpy(cam0_from_camera, pose, sizeof pose);
  return PAGS_OK;
}
