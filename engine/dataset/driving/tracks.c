/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the labelled objects of a driving set with their boxes over time, from instances/instances_info.json and
 * instances/frame_instances.json.
 *
 *   instances_info:  {"0": {"id", "class_name", "frame_annotations": {"frame_idx": [t], "obj_to_world": [4x4],
 *     "box_size": [3]}}}
 *   frame_instances: {"0": [instances present in frame 0], ...}
 * box_size is given along the box's own axes. The front of a pags_object is +x: a box whose front is +y gets axes
 * rotated by 90 degrees about z, and its first two extents are swapped. An annotation is used only if frame_instances
 * lists the instance at that frame; without that file all annotations are used. */
#include "dataset/driving/labels.h"
#include "dataset/driving/reader.h"

#include "base/json.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"

#include <pags/camera.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct reader {
  pags_driving *driving;
  pags_json *info;
  pags_json *frames; /* NULL if there is no frame_instances.json */
  uint8_t *present;  /* [instances][steps], 1 if listed in frame_instances.json; NULL without `frames` */
  int64_t instances;
  int64_t *numbers; /* key of each instance in the file's order; keys may have gaps, where objects were removed */
  pags_tally unknown;
  pags_labels labels;
} reader;

/* ---- Numbers, poses and sizes ---- */

/* Appends the numbers of an array, which may be nested, to `out`; *taken counts them. More than `count` numbers are
 * an error. */
static pags_result take_numbers(const pags_json *json, const pags_json_value *value, const char *what, int count,
                                double *out, int *taken) {
  if (value->type != PAGS_JSON_ARRAY)
    return pags_json_fail(json, value, "expected an array of %d numbers for %s", count, what);
  for (const pags_json_value *item = value->first; item; item = item->next) {
    if (item->type == PAGS_JSON_ARRAY) {
      PAGS_TRY(take_numbers(json, item, what, count, out, taken));
      continue;
    }
    if (*taken == count)
      return pags_json_fail(json, item, "expected %d numbers for %s, found more", count, what);
    PAGS_TRY(pags_json_as_number(json, item, what, &out[*taken]));
    ++*taken;
  }
  return PAGS_OK;
}

static pags_result take_array(const pags_json *json, const pags_json_value *value, const char *what, int count,
                              double *out) {
  int taken = 0;
  PAGS_TRY(take_numbers(json, value, what, count, out, &taken));
  if (taken != count)
    return pags_json_fail(json, value, "expected %d numbers for %s, found %d", count, what, taken);
  return PAGS_OK;
}

/* An annotation, for messages. */
typedef struct place {
  const char *id, *class_name;
  int frame;
} place;

static pags_result take_pose(const reader *r, const pags_json_value *value, const place *at, double out[12]) {
  double numbers[16];
  char what[192];
  snprintf(what, sizeof what, "obj_to_world of %.64s '%.64s' in frame %d", at->class_name, at->id, at->frame);
  PAGS_TRY(take_array(r->info, value, what, 16, numbers));
  memcpy(out, numbers, 12 * sizeof *out);
  PAGS_AUTOFREE char *where = pags_text_format("%s:%d: %s", pags_json_path(r->info), value->line, what);
  PAGS_CHECK_MEMORY(where, "%s", pags_json_path(r->info));
  PAGS_TRY(pags_rigid_check(out, where));
  /* The columns are the object's x, y, z axes in the axes of the file's box. */
  static const double turn[12] = {0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0};
  if (r->driving->rules.forward_y)
    pags_rigid_multiply(out, turn, out);
  return PAGS_OK;
}

static pags_result take_size(const reader *r, const pags_json_value *value, const place *at, double out[3]) {
  double size[3] = {0};
  PAGS_TRY(take_array(r->info, value, "box_size", 3, size));
  for (int i = 0; i < 3; i++)
    if (!(size[i] < 1000))
      return pags_json_fail(r->info, value, "%s '%s' in frame %d: expected box_size above 0 and below 1000 m, found %g",
                            at->class_name, at->id, at->frame, size[i]);
  bool turned = r->driving->rules.forward_y;
  out[0] = size[turned ? 1 : 0];
  out[1] = size[turned ? 0 : 1];
  out[2] = size[2];
  return PAGS_OK;
}

/* ---- Keyframes and motion ---- */

/* Position in the three parallel lists of frame_annotations. */
typedef struct annotation {
  const pags_json_value *frame, *pose, *size;
} annotation;

static pags_result begin_annotations(const reader *r, const pags_json_value *instance, annotation *out,
                                     int64_t *count) {
  const pags_json_value *group, *frames, *poses, *sizes;
  PAGS_TRY(pags_json_object(r->info, instance, "frame_annotations", &group));
  PAGS_TRY(pags_json_array(r->info, group, "frame_idx", &frames));
  PAGS_TRY(pags_json_array(r->info, group, "obj_to_world", &poses));
  PAGS_TRY(pags_json_array(r->info, group, "box_size", &sizes));
  if (poses->count != frames->count || sizes->count != frames->count)
    return pags_json_fail(r->info, group,
                          "expected frame_idx, obj_to_world and box_size of one length, found %lld, %lld and %lld",
                          (long long)frames->count, (long long)poses->count, (long long)sizes->count);
  *out = (annotation){frames->first, poses->first, sizes->first};
  *count = frames->count;
  return PAGS_OK;
}

/* Reads all boxes of an instance. */
static pags_result read_boxes(reader *r, const char *id, const char *class_name, annotation at, pags_label *labels) {
  for (int64_t i = 0; at.frame; at.frame = at.frame->next, at.pose = at.pose->next, at.size = at.size->next, i++) {
    double frame;
    PAGS_TRY(pags_json_as_number(r->info, at.frame, "frame_idx", &frame));
    if (frame != floor(frame) || frame < 0 || frame > 1e9)
      return pags_json_fail(r->info, at.frame, "%s '%s': expected a frame number, found %g", class_name, id, frame);
    const place where = {id, class_name, (int)frame};
    labels[i] = (pags_label){.keyframe = {.frame = (int32_t)frame}};
    PAGS_TRY(take_pose(r, at.pose, &where, labels[i].keyframe.world_from_object));
    PAGS_TRY(take_size(r, at.size, &where, labels[i].size));
  }
  return PAGS_OK;
}

/* ---- Instances ---- */

/* Reads the id of an instance, which converters write as a text or as a number; without an id, its key is used. */
static pags_result take_id(const reader *r, const pags_json_value *instance, char **out) {
  const pags_json_value *id = pags_json_member(instance, "id");
  if (!id || id->type == PAGS_JSON_NULL)
    *out = pags_text_copy(instance->key);
  else if (id->type == PAGS_JSON_STRING || id->type == PAGS_JSON_NUMBER)
    *out = pags_text_copy(id->text);
  else
    return pags_json_fail(r->info, id, "expected a text or a number for 'id'");
  return *out ? PAGS_OK : pags_out_of_memory("%s", pags_json_path(r->info));
}

static pags_result read_instance(reader *r, const pags_json_value *instance, int64_t row) {
  const char *class_name;
  PAGS_AUTOFREE char *id = NULL;
  annotation at = {NULL, NULL, NULL};
  int64_t count = 0;
  PAGS_TRY(pags_json_as_object(r->info, instance, "an instance"));
  PAGS_TRY(pags_json_string(r->info, instance, "class_name", &class_name));
  PAGS_TRY(begin_annotations(r, instance, &at, &count));
  PAGS_TRY(take_id(r, instance, &id));
  PAGS_AUTOFREE pags_label *labels = malloc(((size_t)count + 1) * sizeof *labels);
  PAGS_CHECK_MEMORY(labels, "%s", pags_json_path(r->info));
  PAGS_TRY(read_boxes(r, id, class_name, at, labels));
  const uint8_t *present = r->present ? r->present + row * r->driving->step_count : NULL;
  return pags_labels_take(&r->labels, id, class_name, present, labels, count);
}

static int by_number(const void *a, const void *b) {
  const int64_t left = *(const int64_t *)a, right = *(const int64_t *)b;
  return (left > right) - (left < right);
}

/* Reads the numbers of the instances, which are their keys, and sorts them. */
static pags_result read_numbers(reader *r) {
  int64_t count = 0;
  r->instances = pags_json_root(r->info)->count;
  r->numbers = malloc(((size_t)r->instances + 1) * sizeof *r->numbers);
  PAGS_CHECK_MEMORY(r->numbers, "%s", pags_json_path(r->info));
  for (const pags_json_value *item = pags_json_root(r->info)->first; item; item = item->next) {
    char *end;
    long long number = strtoll(item->key, &end, 10);
    if (*end || end == item->key || number < 0 || number > 1000000000)
      return pags_json_fail(r->info, item, "expected the number of an instance as its key, found '%s'", item->key);
    r->numbers[count++] = number;
  }
  pags_sort(r->numbers, count, sizeof *r->numbers, by_number);
  return PAGS_OK;
}

/* Returns the index of an instance's row in `present`; -1 if there is no such instance. */
static int64_t row_of(const reader *r, int64_t number) {
  const int64_t *found = bsearch(&number, r->numbers, (size_t)r->instances, sizeof *r->numbers, by_number);
  return found ? found - r->numbers : -1;
}

/* ---- Reading the files ---- */

/* Reads which instances frame_instances.json lists at each time step used. */
static pags_result read_present(reader *r) {
  const pags_json_value *root = pags_json_root(r->frames);
  PAGS_TRY(pags_json_as_object(r->frames, root, "the instances of frames"));
  r->present = calloc((size_t)r->instances + 1, (size_t)r->driving->step_count);
  PAGS_CHECK_MEMORY(r->present, "%s", pags_json_path(r->frames));
  for (const pags_json_value *list = root->first; list; list = list->next) {
    char *end;
    long long frame = strtoll(list->key, &end, 10);
    if (*end || end == list->key)
      return pags_json_fail(r->frames, list, "expected the number of a frame, found '%s'", list->key);
    int64_t step = pags_driving_step(r->driving, frame);
    if (step < 0)
      continue;
    if (list->type != PAGS_JSON_ARRAY)
      return pags_json_fail(r->frames, list, "expected an array with the instances of frame '%s'", list->key);
    for (const pags_json_value *item = list->first; item; item = item->next) {
      double number;
      PAGS_TRY(pags_json_as_number(r->frames, item, "an instance", &number));
      if (number != floor(number) || number < 0 || number > 1e9)
        return pags_json_fail(r->frames, item, "expected the number of an instance, found %g", number);
      const int64_t row = row_of(r, (int64_t)number);
      if (row >= 0)
        r->present[row * r->driving->step_count + step] = 1;
      else
        pags_tally_add(&r->unknown, "%lld in frame %lld", (long long)number, frame);
    }
  }
  return PAGS_OK;
}

/* Names the classes that are neither vehicles nor pedestrians nor cyclists, as a misspelt one would be. */
static pags_result note_others(pags_driving *driving) {
  char names[400] = "";
  size_t length = 0;
  for (int64_t i = 0; i < driving->object_count; i++) {
    const pags_object *object = &driving->objects[i];
    bool known = object->category != PAGS_CATEGORY_OTHER;
    for (int64_t j = 0; j < i && !known; j++)
      known = strcmp(driving->objects[j].class_name, object->class_name) == 0;
    const size_t room = sizeof names - length, wanted = strlen(object->class_name) + 2;
    if (known || wanted >= room)
      continue;
    snprintf(names + length, room, "%s%s", length ? ", " : "", object->class_name);
    length = strlen(names);
  }
  return length ? pags_driving_note(driving, "neither vehicles nor pedestrians nor cyclists: %s", names) : PAGS_OK;
}

static void reader_destroy(reader *r) {
  pags_json_destroy(r->info);
  pags_json_destroy(r->frames);
  free(r->present);
  free(r->numbers);
}

static pags_result read_files(reader *r) {
  r->labels = (pags_labels){.driving = r->driving, .source = pags_json_path(r->info)};
  PAGS_TRY(pags_json_as_object(r->info, pags_json_root(r->info), "the instances"));
  PAGS_TRY(read_numbers(r));
  PAGS_TRY(pags_json_parse_in_folder(r->driving->root, "instances/frame_instances.json", &r->frames));
  if (r->frames)
    PAGS_TRY(read_present(r));

  for (const pags_json_value *item = pags_json_root(r->info)->first; item; item = item->next)
    PAGS_TRY(read_instance(r, item, row_of(r, strtoll(item->key, NULL, 10))));
  if (r->unknown.count)
    PAGS_WARN("%s: %lld entries name instances that instances_info.json doesn't have; the first is %s",
              pags_json_path(r->frames), (long long)r->unknown.count, r->unknown.first);
  PAGS_TRY(pags_labels_end(&r->labels, ""));
  return note_others(r->driving);
}

pags_result pags_tracks_read(pags_driving *driving) {
  PAGS_AUTO(reader_destroy) reader r = {.driving = driving};
  PAGS_TRY(pags_json_parse_in_folder(driving->root, "instances/instances_info.json", &r.info));
  return r.info ? read_files(&r) : pags_driving_note(driving, "boxes: none (no instances/instances_info.json)");
}
