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
#include "dataset/driving/reader.h"

#include "base/file.h"
#include "base/json.h"
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

static pags_result take_pose(const reader *r, const pags_json_value *value, double out[12]) {
  double numbers[16];
  PAGS_TRY(take_array(r->info, value, "obj_to_world", 16, numbers));
  memcpy(out, numbers, 12 * sizeof *out);
  char *what = pags_text_format("%s:%d: obj_to_world", pags_json_path(r->info), value->line);
  pags_result result = what ? pags_rigid_check(out, what) : pags_out_of_memory("%s", pags_json_path(r->info));
  free(what);
  if (result == PAGS_OK && r->driving->rules.forward_y) {
    /* The columns are the object's x, y, z axes in the axes of the file's box. */
    static const double turn[12] = {0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0};
    pags_rigid_multiply(out, turn, out);
  }
  return result;
}

static pags_result take_size(const reader *r, const pags_json_value *value, double out[3]) {
  double size[3] = {0};
  PAGS_TRY(take_array(r->info, value, "box_size", 3, size));
  for (int i = 0; i < 3; i++)
    if (!(size[i] > 0 && size[i] < 1000))
      return pags_json_fail(r->info, value, "expected box_size above 0 and below 1000 m, found %g", size[i]);
  bool turned = r->driving->rules.forward_y;
  out[0] = size[turned ? 1 : 0];
  out[1] = size[turned ? 0 : 1];
  out[2] = size[2];
  return PAGS_OK;
}

/* ---- Knots and motion ---- */

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

static int by_frame(const void *a, const void *b) {
  return ((const pags_knot *)a)->frame - ((const pags_knot *)b)->frame;
}

static pags_result read_knots(const reader *r, const pags_json_value *instance, int64_t number, pags_object *object) {
  annotation at = {NULL, NULL, NULL};
  int64_t count = 0;
  PAGS_TRY(begin_annotations(r, instance, &at, &count));
  object->knots = calloc((size_t)count + 1, sizeof *object->knots);
  if (!object->knots)
    return pags_out_of_memory("%s", pags_json_path(r->info));
  for (; at.frame; at.frame = at.frame->next, at.pose = at.pose->next, at.size = at.size->next) {
    double frame;
    PAGS_TRY(pags_json_as_number(r->info, at.frame, "frame_idx", &frame));
    if (frame != floor(frame) || frame < 0 || frame > 1e9)
      return pags_json_fail(r->info, at.frame, "expected a frame number, found %g", frame);
    int64_t step = pags_driving_step(r->driving, (int64_t)frame);
    if (step >= 0 && (!r->present || r->present[number * r->driving->step_count + step])) {
      const pags_time_step *time = &r->driving->steps[step];
      pags_knot *knot = &object->knots[object->knot_count];
      double size[3] = {0};
      *knot = (pags_knot){.frame = time->frame, .trained = !time->test, .time = time->time};
      PAGS_TRY(take_pose(r, at.pose, knot->world_from_object));
      PAGS_TRY(take_size(r, at.size, size));
      /* The size of an object is the mean of its labelled sizes, as a running mean that leaves equal sizes
       * bit-identical. */
      for (int i = 0; i < 3; i++)
        object->size[i] = object->knot_count == 0
                              ? size[i]
                              : object->size[i] + (size[i] - object->size[i]) / (double)(object->knot_count + 1);
      object->knot_count++;
    }
  }
  pags_sort(object->knots, object->knot_count, sizeof *object->knots, by_frame);
  for (int64_t i = 1; i < object->knot_count; i++)
    if (object->knots[i].frame == object->knots[i - 1].frame)
      return pags_json_fail(r->info, instance, "expected one annotation a frame, frame %d has two",
                            object->knots[i].frame);
  return PAGS_OK;
}

/* Sets object->moving from all annotations of the instance, so that the result doesn't depend on the time steps
 * used. */
static pags_result classify(const reader *r, const pags_json_value *instance, pags_object *object) {
  annotation at = {NULL, NULL, NULL};
  pags_object whole = {0};
  int64_t count = 0;
  PAGS_TRY(begin_annotations(r, instance, &at, &count));
  whole.knots = calloc((size_t)count + 1, sizeof *whole.knots);
  if (!whole.knots)
    return pags_out_of_memory("%s", pags_json_path(r->info));
  pags_result result = PAGS_OK;
  for (; at.frame && result == PAGS_OK; at.frame = at.frame->next, at.pose = at.pose->next) {
    pags_knot *knot = &whole.knots[whole.knot_count++];
    double frame;
    result = pags_json_as_number(r->info, at.frame, "frame_idx", &frame);
    if (result == PAGS_OK)
      result = take_pose(r, at.pose, knot->world_from_object);
    knot->frame = result == PAGS_OK ? (int32_t)frame : 0;
  }
  pags_sort(whole.knots, whole.knot_count, sizeof *whole.knots, by_frame);
  if (result == PAGS_OK)
    pags_object_classify_motion(&whole);
  object->moving = whole.moving;
  free(whole.knots);
  return result;
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

static pags_result read_instance(const reader *r, const pags_json_value *instance, int64_t number,
                                 pags_object *object) {
  const char *class_name;
  PAGS_TRY(pags_json_as_object(r->info, instance, "an instance"));
  PAGS_TRY(pags_json_string(r->info, instance, "class_name", &class_name));
  PAGS_TRY(take_id(r, instance, &object->id));
  object->class_name = pags_text_copy(class_name);
  if (!object->class_name)
    return pags_out_of_memory("%s", pags_json_path(r->info));
  object->category = pags_category_of(class_name);
  PAGS_TRY(read_knots(r, instance, number, object));
  return object->knot_count > 0 ? classify(r, instance, object) : PAGS_OK;
}

static pags_result check_id(const reader *r, const pags_json_value *instance, const pags_object *object) {
  for (int64_t i = 0; i < r->driving->object_count; i++)
    if (strcmp(r->driving->objects[i].id, object->id) == 0)
      return pags_json_fail(r->info, instance, "the id '%s' occurs twice; expected unique ids", object->id);
  return PAGS_OK;
}

/* Parses the number of an instance, which is its key. */
static pags_result instance_number(const reader *r, const pags_json_value *instance, int64_t *out) {
  char *end;
  long long number = strtoll(instance->key, &end, 10);
  if (*end || end == instance->key || number < 0 || number >= r->instances)
    return pags_json_fail(r->info, instance, "expected the number of an instance below %lld, found '%s'",
                          (long long)r->instances, instance->key);
  *out = number;
  return PAGS_OK;
}

/* ---- Reading the files ---- */

static pags_result read_files(reader *r, const char *info, const char *frames) {
  PAGS_TRY(pags_json_parse_file(info, &r->info));
  PAGS_TRY(pags_json_as_object(r->info, pags_json_root(r->info), "the instances"));
  r->instances = pags_json_root(r->info)->count;
  if (pags_file_exists(frames)) {
    PAGS_TRY(pags_json_parse_file(frames, &r->frames));

    const pags_json_value *root = pags_json_root(r->frames);
    PAGS_TRY(pags_json_as_object(r->frames, root, "the instances of frames"));
    r->present = calloc((size_t)r->instances + 1, (size_t)r->driving->step_count);
    if (!r->present)
      return pags_out_of_memory("%s", pags_json_path(r->frames));
    for (const pags_json_value *list = root->first; list; list = list->next) {
      char *end;
      long long frame = strtoll(list->key, &end, 10);
      if (*end || end == list->key)
        return pags_json_fail(r->frames, list, "expected the number of a frame, found '%s'", list->key);
      int64_t step = pags_driving_step(r->driving, frame);
      if (step >= 0) {
        if (list->type != PAGS_JSON_ARRAY)
          return pags_json_fail(r->frames, list, "expected an array with the instances of frame '%s'", list->key);
        for (const pags_json_value *item = list->first; item; item = item->next) {
          double number;
          PAGS_TRY(pags_json_as_number(r->frames, item, "an instance", &number));
          if (number != floor(number) || number < 0 || number >= (double)r->instances)
            return pags_json_fail(r->frames, item, "expected an instance of instances_info.json (below %lld), found %g",
                                  (long long)r->instances, number);
          r->present[(int64_t)number * r->driving->step_count + step] = 1;
        }
      }
    }
  }

  /* Read the instances and drop those without an annotation at a used time step. */
  pags_driving *driving = r->driving;
  driving->objects = calloc((size_t)r->instances + 1, sizeof *driving->objects);
  if (!driving->objects)
    return pags_out_of_memory("%s", pags_json_path(r->info));
  for (const pags_json_value *item = pags_json_root(r->info)->first; item; item = item->next) {
    int64_t number = 0;
    pags_object object = {0};
    pags_result result = instance_number(r, item, &number);
    if (result == PAGS_OK)
      result = read_instance(r, item, number, &object);
    if (result == PAGS_OK && object.knot_count > 0)
      result = check_id(r, item, &object);
    if (result == PAGS_OK && object.knot_count > 0)
      driving->objects[driving->object_count++] = object;
    else
      pags_object_destroy(&object);
    PAGS_TRY(result);
  }

  r->driving->provides |= PAGS_PROVIDES_BOXES;

  int64_t moving = 0;
  for (int64_t i = 0; i < r->driving->object_count; i++)
    moving += r->driving->objects[i].moving;
  return pags_driving_note(r->driving, "boxes: %lld objects, %lld of them moving", (long long)r->driving->object_count,
                           (long long)moving);
}

pags_result pags_tracks_read(pags_driving *driving) {
  reader r = {.driving = driving};
  char *info = pags_path_join(driving->root, "instances/instances_info.json");
  char *frames = pags_path_join(driving->root, "instances/frame_instances.json");
  pags_result result = PAGS_OK;
  if (!info || !frames)
    result = pags_out_of_memory("%s", driving->root);
  else if (pags_file_exists(info))
    result = read_files(&r, info, frames);
  else
    result = pags_driving_note(driving, "boxes: none (no instances/instances_info.json)");
  pags_json_destroy(r.info);
  pags_json_destroy(r.frames);
  free(r.present);
  free(info);
  free(frames);
  return result;
}
