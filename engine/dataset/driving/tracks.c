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
#include "dataset/driving/motion.h"
#include "dataset/driving/reader.h"

#include "base/file.h"
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
  int64_t boxes;    /* number of annotations */
  pags_tally flat, sized, turned, moved, leaping, unlisted, renamed, unknown;
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
  char *where = pags_text_format("%s:%d: %s", pags_json_path(r->info), value->line, what);
  pags_result result = where ? pags_rigid_check(out, where) : pags_out_of_memory("%s", pags_json_path(r->info));
  free(where);
  if (result == PAGS_OK && r->driving->rules.forward_y) {
    /* The columns are the object's x, y, z axes in the axes of the file's box. */
    static const double turn[12] = {0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0};
    pags_rigid_multiply(out, turn, out);
  }
  return result;
}

/* Reads the size of a box; *flat: it has none, as some programs write for the two-wheelers of CARLA. */
static pags_result take_size(const reader *r, const pags_json_value *value, const place *at, double out[3],
                             bool *flat) {
  double size[3] = {0};
  PAGS_TRY(take_array(r->info, value, "box_size", 3, size));
  *flat = false;
  for (int i = 0; i < 3; i++) {
    *flat = *flat || size[i] <= 0;
    if (!(size[i] < 1000))
      return pags_json_fail(r->info, value, "%s '%s' in frame %d: expected box_size above 0 and below 1000 m, found %g",
                            at->class_name, at->id, at->frame, size[i]);
  }
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

/* A labelled box: the pose as it is in the file, then as mended. */
typedef struct box {
  pags_knot knot;
  double size[3];
} box;

static int by_frame(const void *a, const void *b) {
  return ((const box *)a)->knot.frame - ((const box *)b)->knot.frame;
}

/* The time of a frame in seconds: of its time step; between two steps in proportion, beyond them at the usual rate. */
static double time_of(const pags_driving *driving, int frame) {
  int64_t low = 0, high = driving->step_count - 1; /* the steps before and behind, or the two at an end */
  while (high - low > 1) {
    const int64_t middle = (low + high) / 2;
    *(driving->steps[middle].frame <= frame ? &low : &high) = middle;
  }
  const pags_time_step *a = &driving->steps[low], *b = &driving->steps[high];
  if (frame <= a->frame)
    return a->time + (frame - a->frame) / driving->fps;
  if (frame >= b->frame)
    return b->time + (frame - b->frame) / driving->fps;
  return a->time + (b->time - a->time) * (frame - a->frame) / (b->frame - a->frame);
}

/* Reads all boxes of an instance, sorted by frame; those without a size are left out. */
static pags_result read_boxes(reader *r, const pags_json_value *instance, const pags_object *object, box *boxes,
                              annotation at, int64_t *count) {
  for (*count = 0; at.frame; at.frame = at.frame->next, at.pose = at.pose->next, at.size = at.size->next) {
    double frame;
    bool flat;
    box *next = &boxes[*count];
    PAGS_TRY(pags_json_as_number(r->info, at.frame, "frame_idx", &frame));
    if (frame != floor(frame) || frame < 0 || frame > 1e9)
      return pags_json_fail(r->info, at.frame, "%s '%s': expected a frame number, found %g", object->class_name,
                            object->id, frame);
    const place where = {object->id, object->class_name, (int)frame};
    *next = (box){.knot = {.frame = (int32_t)frame, .time = time_of(r->driving, (int)frame)}};
    PAGS_TRY(take_pose(r, at.pose, &where, next->knot.world_from_object));
    PAGS_TRY(take_size(r, at.size, &where, next->size, &flat));
    r->boxes++;
    if (flat)
      pags_tally_add(&r->flat, "%s '%s' in frame %d", object->class_name, object->id, where.frame);
    else
      ++*count;
  }
  pags_sort(boxes, *count, sizeof *boxes, by_frame);
  for (int64_t i = 1; i < *count; i++)
    if (boxes[i].knot.frame == boxes[i - 1].knot.frame)
      return pags_json_fail(r->info, instance, "%s '%s': expected one annotation a frame, frame %d has two",
                            object->class_name, object->id, boxes[i].knot.frame);
  return PAGS_OK;
}

/* Mends the poses of the boxes, counts what was done, and sets object->moving: from all annotations of the instance,
 * so that the result doesn't depend on the time steps used. */
static pags_result mend_and_classify(reader *r, pags_object *object, box *boxes, int64_t count) {
  pags_object whole = {.knot_count = count, .category = object->category};
  uint8_t *mended = malloc((size_t)count + 1);
  whole.knots = calloc((size_t)count + 1, sizeof *whole.knots);
  if (!mended || !whole.knots) {
    free(mended);
    free(whole.knots);
    return pags_out_of_memory("%s", pags_json_path(r->info));
  }
  for (int64_t i = 0; i < count; i++)
    whole.knots[i] = boxes[i].knot;
  pags_track_mend(&whole, mended);
  for (int64_t i = 0; i < count; i++) {
    boxes[i].knot = whole.knots[i];
    if (mended[i] != PAGS_MENDED_NOT)
      pags_tally_add(mended[i] == PAGS_MENDED_TURNED ? &r->turned : &r->moved, "%s '%s' in frame %d",
                     object->class_name, object->id, boxes[i].knot.frame);
  }
  const pags_track_leap leap = pags_track_find_leap(&whole);
  if (leap.metres > 0)
    pags_tally_add(&r->leaping, "%s '%s' from frame %d to %d, %.2f m off in %.2f s", object->class_name, object->id,
                   whole.knots[leap.knot].frame, whole.knots[leap.knot + 1].frame, leap.metres, leap.seconds);
  pags_object_classify_motion(&whole);
  object->moving = whole.moving;
  free(mended);
  free(whole.knots);
  return PAGS_OK;
}

/* Gives a box the extents that its object has in the middle of all labels where its own are three times or a third of
 * them, since an object's size is the mean of its labels'. */
static pags_result mend_sizes(reader *r, const pags_object *object, box *boxes, int64_t count) {
  double *sorted = malloc(((size_t)count + 1) * sizeof *sorted), middle[3];
  if (!sorted)
    return pags_out_of_memory("%s", pags_json_path(r->info));
  for (int k = 0; k < 3 && count; k++) {
    for (int64_t i = 0; i < count; i++)
      sorted[i] = boxes[i].size[k];
    pags_sort_doubles(sorted, count);
    middle[k] = sorted[count / 2];
  }
  free(sorted);
  for (int64_t i = 0; i < count && count > 2; i++) {
    bool wrong = false;
    for (int k = 0; k < 3; k++)
      if (boxes[i].size[k] > 3 * middle[k] || boxes[i].size[k] < middle[k] / 3) {
        boxes[i].size[k] = middle[k];
        wrong = true;
      }
    if (wrong)
      pags_tally_add(&r->sized, "%s '%s' in frame %d", object->class_name, object->id, boxes[i].knot.frame);
  }
  return PAGS_OK;
}

/* Makes the knots of the boxes at the time steps used. */
static void use_boxes(reader *r, int64_t number, const box *boxes, int64_t count, pags_object *object) {
  for (int64_t i = 0; i < count; i++) {
    int64_t step = pags_driving_step(r->driving, boxes[i].knot.frame);
    if (step < 0)
      continue;
    if (r->present && !r->present[number * r->driving->step_count + step]) {
      pags_tally_add(&r->unlisted, "%s '%s' in frame %d", object->class_name, object->id, boxes[i].knot.frame);
      continue;
    }
    const pags_time_step *time = &r->driving->steps[step];
    pags_knot *knot = &object->knots[object->knot_count];
    *knot = boxes[i].knot;
    knot->trained = !time->test;
    knot->time = time->time;
    /* The size of an object is the mean of its labelled sizes, as a running mean that leaves equal sizes
     * bit-identical. */
    for (int k = 0; k < 3; k++)
      object->size[k] = object->knot_count == 0
                            ? boxes[i].size[k]
                            : object->size[k] + (boxes[i].size[k] - object->size[k]) / (double)(object->knot_count + 1);
    object->knot_count++;
  }
}

static pags_result read_knots(reader *r, const pags_json_value *instance, int64_t number, pags_object *object) {
  annotation at = {NULL, NULL, NULL};
  int64_t count = 0;
  PAGS_TRY(begin_annotations(r, instance, &at, &count));
  box *boxes = malloc(((size_t)count + 1) * sizeof *boxes);
  object->knots = calloc((size_t)count + 1, sizeof *object->knots);
  pags_result result = boxes && object->knots ? PAGS_OK : pags_out_of_memory("%s", pags_json_path(r->info));
  if (result == PAGS_OK)
    result = read_boxes(r, instance, object, boxes, at, &count);
  if (result == PAGS_OK)
    result = mend_sizes(r, object, boxes, count);
  if (result == PAGS_OK && count)
    result = mend_and_classify(r, object, boxes, count);
  if (result == PAGS_OK)
    use_boxes(r, number, boxes, count, object);
  free(boxes);
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

static pags_result read_instance(reader *r, const pags_json_value *instance, int64_t number, pags_object *object) {
  const char *class_name;
  PAGS_TRY(pags_json_as_object(r->info, instance, "an instance"));
  PAGS_TRY(pags_json_string(r->info, instance, "class_name", &class_name));
  PAGS_TRY(take_id(r, instance, &object->id));
  object->class_name = pags_text_copy(class_name);
  if (!object->class_name)
    return pags_out_of_memory("%s", pags_json_path(r->info));
  object->category = pags_category_of(class_name);
  return read_knots(r, instance, number, object);
}

static const pags_object *object_of_id(const reader *r, const char *id) {
  for (int64_t i = 0; i < r->driving->object_count; i++)
    if (strcmp(r->driving->objects[i].id, id) == 0)
      return &r->driving->objects[i];
  return NULL;
}

/* Ids must be unique. Those of per-class trackers are within a class only, whose name is then added. */
static pags_result check_id(reader *r, const pags_json_value *instance, pags_object *object) {
  const pags_object *other = object_of_id(r, object->id);
  if (!other)
    return PAGS_OK;
  char *longer = pags_text_format("%s-%s", object->id, object->class_name);
  if (!longer)
    return pags_out_of_memory("%s", pags_json_path(r->info));
  if (strcmp(other->class_name, object->class_name) == 0 || object_of_id(r, longer)) {
    free(longer);
    return pags_json_fail(r->info, instance, "the id '%s' occurs twice, both times of a %s; expected unique ids",
                          object->id, object->class_name);
  }
  pags_tally_add(&r->renamed, "'%s', of a %s and a %s", object->id, other->class_name, object->class_name);
  free(object->id);
  object->id = longer;
  return PAGS_OK;
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
  if (!r->numbers)
    return pags_out_of_memory("%s", pags_json_path(r->info));
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
static pags_result read_present(reader *r, const char *path) {
  PAGS_TRY(pags_json_parse_file(path, &r->frames));
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

/* Says what was left out, renamed or mended, in one line a kind. */
static void warn(const reader *r) {
  const char *info = pags_json_path(r->info);
  const struct {
    const pags_tally *tally;
    const char *what;
  } kinds[] = {{&r->flat, "boxes are left out, as their size is 0 or less"},
               {&r->sized, "boxes are three times as large as their object's others, or a third, and got their size"},
               {&r->turned, "boxes are turned against most others of their object and were turned back"},
               {&r->moved, "boxes lie aside of those before and after and were put between them"},
               {&r->unlisted, "boxes are left out, as frame_instances.json doesn't list them"}};
  for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
    if (kinds[i].tally->count)
      pags_log_message(PAGS_LOG_WARNING, "%s: %lld of %lld %s; the first is %s", info, (long long)kinds[i].tally->count,
                       (long long)r->boxes, kinds[i].what, kinds[i].tally->first);
  if (r->leaping.count)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: the boxes of %lld of %lld objects leap as nothing does that moves, so some may be wrong; the "
                     "first is %s",
                     info, (long long)r->leaping.count, (long long)r->instances, r->leaping.first);
  if (r->renamed.count)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: %lld ids are used in several classes, the class was added to them; the first is %s", info,
                     (long long)r->renamed.count, r->renamed.first);
  if (r->unknown.count)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: %lld entries name instances that instances_info.json doesn't have; the first is %s",
                     pags_json_path(r->frames), (long long)r->unknown.count, r->unknown.first);
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

static pags_result read_files(reader *r, const char *info, const char *frames) {
  PAGS_TRY(pags_json_parse_file(info, &r->info));
  PAGS_TRY(pags_json_as_object(r->info, pags_json_root(r->info), "the instances"));
  PAGS_TRY(read_numbers(r));
  if (pags_file_exists(frames))
    PAGS_TRY(read_present(r, frames));

  /* Read the instances and drop those without an annotation at a used time step. */
  pags_driving *driving = r->driving;
  driving->objects = calloc((size_t)r->instances + 1, sizeof *driving->objects);
  if (!driving->objects)
    return pags_out_of_memory("%s", pags_json_path(r->info));
  for (const pags_json_value *item = pags_json_root(r->info)->first; item; item = item->next) {
    pags_object object = {0};
    pags_result result = read_instance(r, item, row_of(r, strtoll(item->key, NULL, 10)), &object);
    if (result == PAGS_OK && object.knot_count > 0)
      result = check_id(r, item, &object);
    if (result == PAGS_OK && object.knot_count > 0)
      driving->objects[driving->object_count++] = object;
    else
      pags_object_destroy(&object);
    PAGS_TRY(result);
  }

  r->driving->provides |= PAGS_PROVIDES_BOXES;
  warn(r);

  int64_t moving = 0;
  for (int64_t i = 0; i < r->driving->object_count; i++)
    moving += r->driving->objects[i].moving;
  PAGS_TRY(pags_driving_note(r->driving, "boxes: %lld objects, %lld of them moving",
                             (long long)r->driving->object_count, (long long)moving));
  return note_others(r->driving);
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
  free(r.numbers);
  free(info);
  free(frames);
  return result;
}
