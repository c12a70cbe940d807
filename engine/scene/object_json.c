/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and checks the objects (box, class, track, model) of scene.json, and writes them. */
#include "scene/scene_json.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "base/vec3.h"

/* ---- Checks ---- */

static const double usual_fps = 10; /* of scenes that state none, as of data sets */

/* Sorts the names and compares neighbours, so that a file of very many names takes no quadratic time. */
pags_result pags_json_names_differ(const pags_json *json, const pags_json_value *value, const char *what,
                                   const void *first, size_t stride, int64_t count) {
  PAGS_AUTOFREE char **sorted = malloc((size_t)(count + 1) * sizeof *sorted);
  PAGS_CHECK_MEMORY(sorted, "%s: the %s", pags_json_path(json), what);
  for (int64_t i = 0; i < count; i++)
    memcpy(&sorted[i], (const char *)first + (size_t)i * stride, sizeof *sorted);
  pags_sort(sorted, count, sizeof *sorted, pags_text_compare);
  for (int64_t i = 1; i < count; i++)
    if (strcmp(sorted[i - 1], sorted[i]) == 0)
      return pags_json_fail(json, value, "two %s are named \"%.80s\"", what, sorted[i]);
  return PAGS_OK;
}

/* Checks that the 3x3 part of the pose m is a rotation: R R^T within 2e-3 of the identity, determinant positive.
 * Unlike pags_rigid_check, leaves m as it is. */
static pags_result check_rigid(const pags_json *json, const pags_json_value *value, const double m[12]) {
  double error = 0;
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      error = fmax(error, fabs(pags_dot3(m + 4 * i, m + 4 * j) - (i == j)));
  double determinant =
      m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) + m[2] * (m[4] * m[9] - m[5] * m[8]);
  if (!(error <= 2e-3) || determinant < 0)
    return pags_json_fail(json, value, "expected a rotation and a translation for 'world_from_object' (off by %.3g)",
                          determinant < 0 ? 2.0 : error);
  return PAGS_OK;
}

/* Checks that a pose and its correction are of a size that arithmetic, and the float positions made of them, can hold.
 */
static pags_result check_sizes(const pags_json *json, const pags_json_value *value, const pags_keyframe *k) {
  static const double farthest = 1e12, most_turn = 1e3; /* metres, radians */
  double away = 0, moved = 0, turned = 0;
  for (int i = 0; i < 3; i++) {
    away = fmax(away, fabs(k->world_from_object[4 * i + 3]));
    moved = fmax(moved, fabs(k->translation[i]));
    turned = fmax(turned, fabs(k->rotation[i]));
  }
  if (!(away <= farthest && moved <= farthest && turned <= most_turn))
    return pags_json_fail(
        json, value, "a pose %.3g m away, corrected by %.3g m and %.3g rad; expected at most %g m, %g m and %g rad",
        away, moved, turned, farthest, farthest, most_turn);
  return PAGS_OK;
}

/* ---- Reading ---- */

static pags_result read_category(const pags_json *json, const pags_json_value *object, pags_category *category) {
  const char *name;
  PAGS_TRY(pags_json_string(json, object, "category", &name));
  for (*category = 0; *category <= PAGS_CATEGORY_CYCLIST; ++*category)
    if (strcmp(name, pags_category_name(*category)) == 0)
      return PAGS_OK;
  return pags_json_fail(
      json, pags_json_member(object, "category"),
      "expected \"vehicle\", \"pedestrian\", \"cyclist\" or \"other\" for 'category', found \"%.40s\"", name);
}

static pags_result read_record(const pags_json *json, const pags_json_value *object, pags_object *record) {
  PAGS_TRY(pags_json_string_copy(json, object, "id", &record->id));
  PAGS_TRY(pags_json_string_copy(json, object, "class", &record->class_name));
  PAGS_TRY(read_category(json, object, &record->category));
  PAGS_TRY(pags_json_numbers(json, object, "size", 3, record->size));
  if (!(record->size[0] > 0 && record->size[1] > 0 && record->size[2] > 0))
    return pags_json_fail(json, pags_json_member(object, "size"), "expected three positive numbers for 'size'");
  PAGS_TRY(pags_json_flag_or(json, object, "moving", false, &record->moving));

  /* The keyframes: labelled poses in ascending order of time. */
  const pags_json_value *keyframes;
  PAGS_TRY(pags_json_array(json, object, "knots", &keyframes));
  if (keyframes->count == 0)
    return pags_json_fail(json, keyframes, "expected at least one pose in 'knots'");
  record->keyframes = calloc((size_t)keyframes->count, sizeof *record->keyframes);
  PAGS_CHECK_MEMORY(record->keyframes, "%s: the objects", pags_json_path(json));
  for (const pags_json_value *value = keyframes->first; value; value = value->next) {
    pags_keyframe *keyframe = &record->keyframes[record->keyframe_count++];
    PAGS_TRY(pags_json_int(json, value, "frame", INT32_MIN, INT32_MAX, &keyframe->frame));
    PAGS_TRY(pags_json_number(json, value, "time", &keyframe->time));
    PAGS_TRY(pags_json_flag_or(json, value, "trained", false, &keyframe->trained));
    PAGS_TRY(pags_json_numbers(json, value, "world_from_object", 12, keyframe->world_from_object));
    PAGS_TRY(check_rigid(json, pags_json_member(value, "world_from_object"), keyframe->world_from_object));
    PAGS_TRY(pags_json_numbers(json, value, "rotation", 3, keyframe->rotation));
    PAGS_TRY(pags_json_numbers(json, value, "translation", 3, keyframe->translation));
    PAGS_TRY(check_sizes(json, value, keyframe));
    if (keyframe > record->keyframes && !(keyframe->time > keyframe[-1].time))
      return pags_json_fail(json, value, "expected a 'time' after the previous one's %.17g, found %.17g",
                            keyframe[-1].time, keyframe->time);
  }
  return PAGS_OK;
}

/* Looks up the object's own model by its name; *model is its index, or -1 if the object has none. Model 0 is the
 * background and no object's. `taken` marks the models that another object has, and then this one, too. */
static pags_result read_model(const pags_json *json, const pags_json_value *object, const pags_scene *scene,
                              bool *taken, int64_t *model) {
  const char *name;
  *model = -1;
  PAGS_TRY(pags_json_string_or(json, object, "model", NULL, &name));
  if (!name)
    return PAGS_OK;
  for (int64_t i = 1; i < scene->model_count; i++)
    if (!taken[i] && strcmp(scene->models[i].name, name) == 0) {
      taken[i] = true;
      *model = i;
      return PAGS_OK;
    }
  return pags_json_fail(json, pags_json_member(object, "model"),
                        "expected the name of a model that is no other object's and not the first, found \"%.80s\"",
                        name);
}

pags_result pags_scene_objects_from_json(const pags_json *json, const pags_json_value *root, pags_scene *scene) {
  const pags_json_value *objects = pags_json_member(root, "objects");
  if (!objects || objects->type == PAGS_JSON_NULL)
    return PAGS_OK;
  PAGS_TRY(pags_json_array(json, root, "objects", &objects));
  if (objects->count > INT32_MAX)
    return pags_json_fail(json, objects, "expected at most 2147483647 objects");
  PAGS_AUTOFREE bool *taken = calloc((size_t)scene->model_count + 1, sizeof *taken);
  scene->objects = calloc((size_t)objects->count + 1, sizeof *scene->objects);
  PAGS_CHECK_MEMORY(taken && scene->objects, "%s: the objects", pags_json_path(json));
  for (const pags_json_value *value = objects->first; value; value = value->next) {
    pags_scene_object *object = &scene->objects[scene->object_count++];
    PAGS_TRY(read_record(json, value, &object->record));
    object->record.time_step = 1 / (scene->fps > 0 ? scene->fps : usual_fps);
    const bool critical = pags_category_is_critical(object->record.category);
    PAGS_TRY(pags_json_flag_or(json, value, "critical", critical, &object->critical));
    PAGS_TRY(pags_json_flag_or(json, value, "rigid", true, &object->rigid));
    PAGS_TRY(read_model(json, value, scene, taken, &object->model));
  }
  return pags_json_names_differ(json, objects, "objects", &scene->objects->record.id, sizeof *scene->objects,
                                scene->object_count);
}

/* ---- Writing ---- */

static void write_keyframes(pags_json_writer *w, const pags_object *record) {
  pags_json_begin_array(w, "knots");
  for (int64_t i = 0; i < record->keyframe_count; i++) {
    const pags_keyframe *keyframe = &record->keyframes[i];
    pags_json_begin_object(w, NULL);
    pags_json_put_integer(w, "frame", keyframe->frame);
    pags_json_put_number(w, "time", keyframe->time);
    pags_json_put_bool(w, "trained", keyframe->trained);
    pags_json_put_numbers(w, "world_from_object", keyframe->world_from_object, 12);
    pags_json_put_numbers(w, "rotation", keyframe->rotation, 3);
    pags_json_put_numbers(w, "translation", keyframe->translation, 3);
    pags_json_end_object(w);
  }
  pags_json_end_array(w);
}

void pags_scene_objects_to_json(pags_json_writer *writer, const pags_scene *scene) {
  pags_json_begin_array(writer, "objects");
  for (int64_t i = 0; i < scene->object_count; i++) {
    const pags_scene_object *object = &scene->objects[i];
    const pags_object *record = &object->record;
    pags_json_begin_object(writer, NULL);
    pags_json_put_string(writer, "id", record->id);
    pags_json_put_string(writer, "class", record->class_name);
    pags_json_put_string(writer, "category", pags_category_name(record->category));
    pags_json_put_bool(writer, "critical", object->critical);
    pags_json_put_numbers(writer, "size", record->size, 3);
    pags_json_put_bool(writer, "moving", record->moving);
    pags_json_put_bool(writer, "rigid", object->rigid);
    pags_json_put_string(writer, "model", object->model >= 0 ? scene->models[object->model].name : NULL);
    write_keyframes(writer, record);
    pags_json_end_object(writer);
  }
  pags_json_end_array(writer);
}
