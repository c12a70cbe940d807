/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the label files of KITTI's tracking and object benchmarks. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/memory.h"
#include "import/kitti_files.h"
#include "import/kitti_text.h"
#include "maths/maths.h"

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
static pags_result take_integer(const pags_lines *lines, char **text, const char *what, int64_t lo, int64_t hi,
                                int *out) {
  double value;
  const char *word = pags_take_word(text);
  if (!word || !pags_word_number(word, &value) || value != floor(value) || value < (double)lo || value > (double)hi)
    return pags_lines_fail(lines, "expected an integer of %lld..%lld for '%s', found '%.40s'", (long long)lo,
                           (long long)hi, what, word ? word : "");
  *out = (int)value;
  return PAGS_OK;
}

static pags_result take_number(const pags_lines *lines, char **text, const char *what, double *out) {
  const char *word = pags_take_word(text);
  if (!word || !pags_word_number(word, out))
    return pags_lines_fail(lines, "expected a number for '%s', found '%.40s'", what, word ? word : "");
  return PAGS_OK;
}

static pags_result take_type(const pags_lines *lines, char **text, char type[32]) {
  const char *word = pags_take_word(text);
  if (!word || strlen(word) >= 32)
    return pags_lines_fail(lines, "expected a class name shorter than 32 letters, found '%.40s'", word ? word : "");
  memcpy(type, word, strlen(word) + 1);
  return PAGS_OK;
}

/* Whether a label gives a box in space: those of detectors in pictures have sizes of -1 and a place of -1000. */
bool pags_kitti_label_has_volume(const pags_kitti_label *label) {
  return label->height > 0 && label->width > 0 && label->length > 0 && label->bottom[2] > -1000;
}

static pags_result check_box(const pags_lines *lines, bool tracking, const pags_kitti_label *label) {
  char name[96];
  if (tracking && label->track < 0)
    return pags_lines_fail(lines, "a %s without track id; expected labels of a tracker, which numbers the objects",
                           label->type);
  snprintf(name, sizeof name, tracking ? "%s of track %d in frame %d" : "%s", label->type, label->track, label->frame);
  if (!pags_kitti_label_has_volume(label))
    return PAGS_OK;
  if (label->height > LARGEST_SIZE || label->width > LARGEST_SIZE || label->length > LARGEST_SIZE)
    return pags_lines_fail(lines, "%s: expected a height, width and length below %g m, found %g x %g x %g", name,
                           LARGEST_SIZE, label->height, label->width, label->length);
  if (fabs(label->rotation_y) > LARGEST_ANGLE)
    return pags_lines_fail(lines, "%s: expected rotation_y in radians (-pi to pi), found %g: are these degrees?", name,
                           label->rotation_y);
  for (int i = 0; i < 3; i++)
    if (fabs(label->bottom[i]) > LARGEST_DISTANCE)
      return pags_lines_fail(lines, "%s: expected a place in the camera's axes in metres, below %g, found %g %g %g",
                             name, LARGEST_DISTANCE, label->bottom[0], label->bottom[1], label->bottom[2]);
  return PAGS_OK;
}

static pags_result read_label(const pags_lines *lines, char *text, bool tracking, pags_kitti_label *out) {
  *out = (pags_kitti_label){.frame = -1, .track = -1, .line = lines->line};
  const struct {
    const char *name;
    double *value;
  } numbers[] = {{"alpha", &out->alpha},  {"left", &out->box[0]},   {"top", &out->box[1]},
                 {"right", &out->box[2]}, {"bottom", &out->box[3]}, {"height", &out->height},
                 {"width", &out->width},  {"length", &out->length}, {"x", &out->bottom[0]},
                 {"y", &out->bottom[1]},  {"z", &out->bottom[2]},   {"rotation_y", &out->rotation_y}};
  if (tracking) {
    PAGS_TRY(take_integer(lines, &text, "frame", 0, 1000000, &out->frame));
    PAGS_TRY(take_integer(lines, &text, "track id", -1, 1000000, &out->track));
  }
  PAGS_TRY(take_type(lines, &text, out->type));
  PAGS_TRY(take_number(lines, &text, "truncated", &out->truncated));
  PAGS_TRY(take_integer(lines, &text, "occluded", -1, 9, &out->occluded));
  for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++)
    PAGS_TRY(take_number(lines, &text, numbers[i].name, numbers[i].value));
  const char *word = pags_take_word(&text);
  out->scored = word && pags_word_number(word, &out->score);
  if ((word && !out->scored) || pags_take_word(&text))
    return pags_lines_fail(lines, "expected %d columns, or %d with a score, found more", tracking ? 17 : 15,
                           tracking ? 18 : 16);
  return pags_kitti_label_is_box(out) ? check_box(lines, tracking, out) : PAGS_OK;
}

static pags_result read_labels(pags_lines *lines, bool tracking, pags_kitti_labels *labels) {
  int64_t capacity = 0;
  char *line;
  while ((line = pags_lines_next(lines))) {
    if (!line[strspn(line, " \t")])
      continue;
    if (labels->count == capacity) {
      capacity = capacity ? 2 * capacity : 64;
      pags_kitti_label *larger = realloc(labels->rows, (size_t)capacity * sizeof *larger);
      if (!larger)
        return pags_out_of_memory("%s: its rows", lines->path);
      labels->rows = larger;
    }
    PAGS_TRY(read_label(lines, line, tracking, &labels->rows[labels->count]));
    labels->count++;
  }
  return PAGS_OK;
}

pags_result pags_kitti_labels_read(const char *path, bool tracking, pags_kitti_labels *out) {
  pags_lines lines;
  *out = (pags_kitti_labels){0};
  PAGS_TRY(pags_lines_open(&lines, path));
  const pags_result result = read_labels(&lines, tracking, out);
  pags_lines_close(&lines);
  if (result != PAGS_OK)
    pags_kitti_labels_destroy(out);
  return result;
}
