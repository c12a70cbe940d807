/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the labelled objects of a set that Street Gaussians' converter wrote (github.com/zju3dv/street_gaussians,
 * script/waymo/waymo_converter.py): track/track_info.txt has a line of names and then a line a box,
 *     frame_id track_id object_class alpha height width length center_x center_y center_z heading speed
 * in metres and radians, in the frame of the car at that frame: x forward, y left, z up, the heading about z. The car's
 * poses are ego_pose/TTT.txt. */
#include "dataset/driving/labels.h"
#include "dataset/driving/reader.h"

#include "base/file.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "maths/maths.h"

#include <pags/camera.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Columns of a line, and the longest word of one. */
enum { COLUMNS = 11, WORD = 64 };

typedef struct row {
  int frame;
  int64_t track, line;
  char class_name[WORD];
  double size[3], pose[12]; /* length, width, height; world from box */
} row;

typedef struct rows {
  const char *path;
  int64_t count, capacity;
  row *items;
} rows;

static void rows_destroy(rows *list) {
  free(list->items);
}

/* ---- Lines ---- */

/* Takes the next word of a line; returns false at the end of the line. */
static bool next_word(const char **at, char out[WORD]) {
  while (**at == ' ' || **at == '\t' || **at == '\r')
    ++*at;
  size_t length = 0;
  for (; **at && !strchr(" \t\r\n", **at); ++*at)
    if (length + 1 < WORD)
      out[length++] = **at;
  out[length] = '\0';
  return length > 0;
}

/* Reads a line into a row; the pose is the box's in the car's frame. */
static pags_result read_row(const rows *list, const char *at, int64_t line, row *out) {
  char word[WORD];
  double n[COLUMNS] = {0};
  *out = (row){.line = line};
  for (int i = 0; i < COLUMNS; i++) {
    char *end;
    if (!next_word(&at, word))
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s:%lld: %d words, expected at least %d: frame_id, track_id, object_class, alpha, height, "
                       "width, length, center_x, center_y, center_z, heading",
                       list->path, (long long)line, i, (int)COLUMNS);
    if (i == 2) {
      memcpy(out->class_name, word, sizeof word);
      continue;
    }
    n[i] = pags_text_to_double(word, &end);
    if (*end || !isfinite(n[i]))
      return pags_fail(PAGS_ERROR_FORMAT, "%s:%lld: expected a number, found '%s'", list->path, (long long)line, word);
  }
  if (n[0] != floor(n[0]) || n[1] != floor(n[1]) || !(n[0] >= 0 && n[0] <= 99999999 && fabs(n[1]) < 1e15))
    return pags_fail(PAGS_ERROR_FORMAT, "%s:%lld: expected the numbers of a frame and a track, found %g and %g",
                     list->path, (long long)line, n[0], n[1]);
  for (int k = 0; k < 3; k++) {
    out->size[k] = n[6 - k];
    if (!(out->size[k] < 1000))
      return pags_fail(PAGS_ERROR_FORMAT, "%s:%lld: expected extents above 0 and below 1000 m, found %g", list->path,
                       (long long)line, out->size[k]);
  }
  out->frame = (int)n[0];
  out->track = (int64_t)n[1];
  const double c = pags_cos(n[10]), s = pags_sin(n[10]);
  const double pose[12] = {c, -s, 0, n[7], s, c, 0, n[8], 0, 0, 1, n[9]};
  memcpy(out->pose, pose, sizeof pose);
  return PAGS_OK;
}

static pags_result read_rows(rows *list, const char *text) {
  int64_t line = 1;
  for (const char *at = text; *at; line++) {
    const size_t length = strcspn(at, "\n");
    const bool blank = strspn(at, " \t\r") >= length, names = line == 1 && pags_text_starts(at, "frame");
    if (!blank && !names) {
      PAGS_CHECK_MEMORY(pags_grow(&list->items, list->count + 1, &list->capacity, sizeof *list->items), "%s",
                        list->path);
      PAGS_TRY(read_row(list, at, line, &list->items[list->count]));
      list->count++;
    }
    at += length + (at[length] == '\n');
  }
  return PAGS_OK;
}

/* ---- Objects ---- */

static int by_frame(const void *a, const void *b) {
  const row *left = a, *right = b;
  return left->frame != right->frame ? (left->frame < right->frame ? -1 : 1)
                                     : (left->track > right->track) - (left->track < right->track);
}

static int by_track(const void *a, const void *b) {
  const row *left = a, *right = b;
  return left->track != right->track ? (left->track < right->track ? -1 : 1)
                                     : (left->frame > right->frame) - (left->frame < right->frame);
}

/* Moves the boxes to the world. Those of frames that the set has no pose for are dropped; *lone counts them. */
static pags_result place(const pags_driving *driving, rows *list, int64_t *lone) {
  double ego[12] = {0};
  int frame = -1;
  bool known = false;
  int64_t kept = 0;
  *lone = 0;
  pags_sort(list->items, list->count, sizeof *list->items, by_frame);
  for (int64_t i = 0; i < list->count; i++) {
    row *item = &list->items[i];
    if (item->frame != frame) {
      PAGS_AUTOFREE char *path = pags_text_format("%s/ego_pose/%0*d.txt", driving->root, driving->digits, item->frame);
      PAGS_CHECK_MEMORY(path, "%s", driving->root);
      frame = item->frame;
      known = pags_file_exists(path);
      if (known)
        PAGS_TRY(pags_text_pose_read(path, ego));
    }
    *lone += !known;
    if (!known)
      continue;
    pags_rigid_multiply(ego, item->pose, item->pose);
    list->items[kept++] = *item;
  }
  list->count = kept;
  pags_sort(list->items, list->count, sizeof *list->items, by_track);
  return PAGS_OK;
}

static pags_result make_objects(pags_labels *all, const rows *list) {
  PAGS_AUTOFREE pags_label *labels = malloc(((size_t)list->count + 1) * sizeof *labels);
  PAGS_CHECK_MEMORY(labels, "%s", list->path);
  for (int64_t begin = 0, end; begin < list->count; begin = end) {
    const row *first = &list->items[begin];
    char id[32];
    for (end = begin; end < list->count && list->items[end].track == first->track; end++) {
      const row *item = &list->items[end];
      pags_label *label = &labels[end - begin];
      *label = (pags_label){.keyframe = {.frame = item->frame}};
      memcpy(label->keyframe.world_from_object, item->pose, sizeof item->pose);
      memcpy(label->size, item->size, sizeof item->size);
    }
    snprintf(id, sizeof id, "%lld", (long long)first->track);
    PAGS_TRY(pags_labels_take(all, id, first->class_name, NULL, labels, end - begin));
  }
  return PAGS_OK;
}

pags_result pags_street_tracks_read(pags_driving *driving) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  int64_t lone = 0;
  PAGS_AUTOFREE char *path = pags_path_join(driving->root, PAGS_STREET_TRACKS);
  PAGS_CHECK_MEMORY(path, "%s", driving->root);
  PAGS_AUTO(rows_destroy) rows list = {.path = path};
  pags_labels all = {.driving = driving, .source = path};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  PAGS_TRY(read_rows(&list, (const char *)bytes));
  PAGS_TRY(place(driving, &list, &lone));
  PAGS_TRY(make_objects(&all, &list));
  PAGS_TRY(pags_labels_end(&all, " of track/track_info.txt"));
  if (lone == 0)
    return PAGS_OK;
  return pags_driving_note(driving, "boxes: %lld are left out, whose frames have no ego_pose", (long long)lone);
}
