/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the labelled objects of a set that Street Gaussians' converter wrote (github.com/zju3dv/street_gaussians,
 * script/waymo/waymo_converter.py): track/track_info.txt has a line of names and then a line a box,
 *     frame_id track_id object_class alpha height width length center_x center_y center_z heading speed
 * in metres and radians, in the frame of the car at that frame: x forward, y left, z up, the heading about z. The car's
 * poses are ego_pose/TTT.txt. */
#include "dataset/driving/reader.h"

#include "base/file.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "maths/maths.h"

#include <pags/camera.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const char *const track_file = "track/track_info.txt";

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

bool pags_street_tracks_exist(const char *root) {
  return pags_folder_has(root, track_file);
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
                       "%s:%lld: %d words, expected at least %d: frame_id, track_id, object_class, "
                       "alpha, height, width, length, center_x, center_y, center_z, heading",
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
    if (!(out->size[k] > 0 && out->size[k] < 1000))
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

static pags_result add_row(rows *list, const row *item) {
  if (list->count == list->capacity) {
    const int64_t capacity = list->capacity ? 2 * list->capacity : 256;
    row *grown = realloc(list->items, (size_t)capacity * sizeof *grown);
    if (!grown)
      return pags_out_of_memory("%s", list->path);
    list->items = grown;
    list->capacity = capacity;
  }
  list->items[list->count++] = *item;
  return PAGS_OK;
}

static pags_result read_rows(rows *list, const char *text) {
  int64_t line = 1;
  for (const char *at = text; *at; line++) {
    const size_t length = strcspn(at, "\n");
    row item;
    const bool blank = strspn(at, " \t\r") >= length, names = line == 1 && strncmp(at, "frame", 5) == 0;
    if (!blank && !names) {
      PAGS_TRY(read_row(list, at, line, &item));
      PAGS_TRY(add_row(list, &item));
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
      char *path = pags_text_format("%s/ego_pose/%0*d.txt", driving->root, driving->digits, item->frame);
      if (!path)
        return pags_out_of_memory("%s", driving->root);
      frame = item->frame;
      known = pags_file_exists(path);
      pags_result result = known ? pags_text_pose_read(path, ego) : PAGS_OK;
      free(path);
      PAGS_TRY(result);
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

/* Makes an object of the rows of one track; it gets a knot for each used time step. */
static pags_result make_object(const pags_driving *driving, const rows *list, const row *items, int64_t count,
                               pags_object *object) {
  pags_object whole = {.knot_count = count};
  object->id = pags_text_format("%lld", (long long)items->track);
  object->class_name = pags_text_copy(items->class_name);
  object->knots = calloc((size_t)count, sizeof *object->knots);
  whole.knots = calloc((size_t)count, sizeof *whole.knots);
  if (!object->id || !object->class_name || !object->knots || !whole.knots) {
    free(whole.knots);
    return pags_out_of_memory("%s", list->path);
  }
  object->category = pags_category_of(object->class_name);
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < count && result == PAGS_OK; i++) {
    if (i > 0 && items[i].frame == items[i - 1].frame)
      result = pags_fail(PAGS_ERROR_FORMAT, "%s:%lld: track %lld has a second box at frame %d; expected one",
                         list->path, (long long)(items[i].line > items[i - 1].line ? items[i].line : items[i - 1].line),
                         (long long)items[i].track, items[i].frame);
    const int64_t step = pags_driving_step(driving, items[i].frame);
    memcpy(whole.knots[i].world_from_object, items[i].pose, sizeof items[i].pose);
    if (step < 0)
      continue;
    const pags_time_step *time = &driving->steps[step];
    pags_knot *knot = &object->knots[object->knot_count++];
    *knot = (pags_knot){.frame = time->frame, .trained = !time->test, .time = time->time};
    memcpy(knot->world_from_object, items[i].pose, sizeof items[i].pose);
    for (int k = 0; k < 3; k++) /* a running mean, which leaves equal sizes as they are */
      object->size[k] += (items[i].size[k] - object->size[k]) / (double)object->knot_count;
  }
  pags_object_classify_motion(&whole);
  object->moving = whole.moving;
  free(whole.knots);
  return result;
}

static pags_result make_objects(pags_driving *driving, const rows *list) {
  driving->objects = calloc((size_t)list->count + 1, sizeof *driving->objects);
  if (!driving->objects)
    return pags_out_of_memory("%s", list->path);
  for (int64_t begin = 0, end; begin < list->count; begin = end) {
    pags_object object = {0};
    for (end = begin + 1; end < list->count && list->items[end].track == list->items[begin].track;)
      end++;
    pags_result result = make_object(driving, list, &list->items[begin], end - begin, &object);
    if (result == PAGS_OK && object.knot_count > 0)
      driving->objects[driving->object_count++] = object;
    else
      pags_object_destroy(&object);
    PAGS_TRY(result);
  }
  return PAGS_OK;
}

pags_result pags_street_tracks_read(pags_driving *driving) {
  uint8_t *bytes = NULL;
  size_t size;
  int64_t lone = 0, moving = 0;
  char *path = pags_path_join(driving->root, track_file);
  if (!path)
    return pags_out_of_memory("%s", driving->root);
  rows list = {.path = path};
  pags_result result = pags_file_read(path, &bytes, &size);
  if (result == PAGS_OK)
    result = read_rows(&list, (const char *)bytes);
  if (result == PAGS_OK)
    result = place(driving, &list, &lone);
  if (result == PAGS_OK)
    result = make_objects(driving, &list);
  for (int64_t i = 0; i < driving->object_count; i++)
    moving += driving->objects[i].moving;
  if (result == PAGS_OK) {
    driving->provides |= PAGS_PROVIDES_BOXES;
    result = pags_driving_note(driving, "boxes: %lld objects of %s, %lld of them moving",
                               (long long)driving->object_count, track_file, (long long)moving);
  }
  if (result == PAGS_OK && lone > 0)
    result = pags_driving_note(driving, "boxes: %lld are left out, whose frames have no ego_pose", (long long)lone);
  free(list.items);
  free(bytes);
  free(path);
  return result;
}
