/* SPDX-License-Identifier: Apache-2.0 */
/* Describes a scene as JSON: for pages (start camera, recorded cameras, objects with boxes and tracks), and
 * the objects.json of pictures (docs/render.md). */
#include "cli/draw/camera_paths.h"
#include "cli/draw/picture.h"

#include <math.h>
#include "base/memory.h"
#include "base/vec3.h"
#include "scene/object.h"
#include "scene/scene_json.h"

/* ---- Where to begin ---- */

pags_result pags_view_start_find(const pags_scene *scene, pags_view_start *out) {
  enum { FRAMES = 8, AHEAD = 10 };
  PAGS_AUTO(pags_camera_path_destroy) pags_camera_path path = {0};
  const bool drive = pags_scene_is_drive(scene) && pags_camera_path_drive(scene, 0, 0, &path) == PAGS_OK;
  if (!drive)
    PAGS_TRY(pags_camera_path_orbit(scene, FRAMES, PAGS_STAND_AUTO, &path));
  const pags_camera *const first = path.cameras;
  *out = (pags_view_start){.camera = *first, .up = {0, 0, 1}, .distance = AHEAD};
  if (scene->up != PAGS_UP_Z)
    pags_cameras_up(scene, out->up);
  if (!drive) /* the distance between opposite cameras of an orbit is twice its radius */
    out->distance = fmax(0.5 * pags_pose_distance(first->world_from_camera, first[FRAMES / 2].world_from_camera), 1e-3);
  return PAGS_OK;
}

/* ---- The description ---- */

static void put_camera(pags_json_writer *json, const char *key, const pags_camera *camera) {
  pags_json_begin_object(json, key);
  pags_camera_lens_to_json(json, camera);
  pags_json_put_numbers(json, "pose", camera->world_from_camera, 12);
  pags_json_put_number(json, "time", camera->time);
  pags_json_end_object(json);
}

static void put_objects(pags_json_writer *json, const pags_composition *composition, const int64_t *gaussians) {
  const pags_scene *scene = pags_composition_scene(composition);
  pags_json_begin_array(json, "objects");
  for (int64_t i = 0; i < scene->object_count; i++) {
    const pags_scene_object *object = &scene->objects[i];
    const pags_object *record = &object->record;
    pags_json_begin_object(json, NULL);
    pags_json_put_string(json, "id", record->id);
    pags_json_put_string(json, "class", record->class_name);
    pags_json_put_string(json, "category", pags_category_name(record->category));
    pags_json_put_numbers(json, "size", record->size, 3);
    pags_json_put_bool(json, "critical", object->critical);
    pags_json_put_bool(json, "tracked", pags_composition_is_tracked(composition, i));
    pags_json_put_integer(json, "gaussians", gaussians[i]);
    pags_json_begin_array(json, "track");
    for (int64_t k = 0; k < record->keyframe_count; k++) {
      double pose[12], row[13] = {record->keyframes[k].time};
      if (!pags_object_pose(record, record->keyframes[k].time, pose))
        continue;
      for (int n = 0; n < 12; n++)
        row[1 + n] = round(pose[n] * 1e4) * 1e-4; /* tenths of a millimetre, for a short text */
      pags_json_put_numbers(json, NULL, row, 13);
    }
    pags_json_end_array(json);
    pags_json_end_object(json);
  }
  pags_json_end_array(json);
}

/* Counts the Gaussians of each object. */
static pags_result count_gaussians(const pags_composition *composition, int64_t **out) {
  const int64_t count = pags_composition_gaussian_count(composition);
  const int64_t objects = pags_composition_scene(composition)->object_count;
  PAGS_AUTOFREE int32_t *object_of = malloc(((size_t)count + 1) * sizeof *object_of);
  *out = calloc((size_t)objects + 1, sizeof **out);
  PAGS_CHECK_MEMORY(object_of && *out, "the objects of %lld Gaussians", (long long)count);
  pags_composition_objects(composition, object_of);
  for (int64_t i = 0; i < count; i++)
    if (object_of[i] >= 0 && object_of[i] < objects)
      (*out)[object_of[i]]++;
  return PAGS_OK;
}

pags_result pags_view_describe(const pags_composition *composition, const pags_view_start *start, const char *name,
                               bool live, pags_json_writer *out) {
  const pags_scene *scene = pags_composition_scene(composition);
  const double time[2] = {scene->time_begin, scene->time_end};
  PAGS_AUTOFREE int64_t *gaussians = NULL;
  pags_json_writer_init(out, 0);
  PAGS_TRY(count_gaussians(composition, &gaussians));
  pags_json_begin_object(out, NULL);
  pags_json_put_string(out, "name", name);
  pags_json_put_string(out, "version", PAGS_VERSION_STRING);
  pags_json_put_bool(out, "live", live);
  pags_json_put_integer(out, "gaussians", pags_composition_gaussian_count(composition));
  pags_json_put_numbers(out, "time", time, 2);
  pags_json_put_number(out, "fps", scene->fps);
  pags_json_put_numbers(out, "up", start->up, 3);
  pags_json_put_number(out, "distance", start->distance);
  put_camera(out, "start", &start->camera);
  pags_json_put_integer(out, "driveSensor", pags_camera_path_drive_sensor(scene));
  pags_json_begin_array(out, "views");
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_scene_view *view = &scene->views[i];
    pags_json_begin_object(out, NULL);
    pags_json_put_string(out, "name", view->name);
    pags_json_put_bool(out, "test", view->test);
    pags_json_put_integer(out, "sensor", view->sensor);
    put_camera(out, "camera", &view->camera);
    pags_json_end_object(out);
  }
  pags_json_end_array(out);
  put_objects(out, composition, gaussians);
  pags_json_end_object(out);
  return pags_json_writer_finish(out);
}

/* ---- objects.json ---- */

pags_result pags_object_table_write(const pags_scene *scene, const char *folder) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {.indent = 2};
  pags_json_begin_object(&writer, NULL);
  pags_json_put_integer(&writer, "version", 1);
  pags_json_put_string(&writer, "channel", "object");
  pags_json_put_integer(&writer, "background", -1);
  pags_json_begin_array(&writer, "objects");
  for (int64_t i = 0; i < scene->object_count; i++) {
    const pags_scene_object *const object = &scene->objects[i];
    char name[PAGS_OBJECT_NAME];
    pags_object_plain_name(object->record.class_name, i, name);
    pags_json_begin_object(&writer, NULL);
    pags_json_put_integer(&writer, "number", i);
    pags_json_put_string(&writer, "name", name);
    pags_json_put_string(&writer, "id", object->record.id);
    pags_json_put_string(&writer, "class", object->record.class_name);
    pags_json_put_string(&writer, "category", pags_category_name(object->record.category));
    pags_json_put_bool(&writer, "critical", object->critical);
    pags_json_put_bool(&writer, "moving", object->record.moving);
    pags_json_put_numbers(&writer, "size", object->record.size, 3);
    pags_json_end_object(&writer);
  }
  pags_json_end_array(&writer);
  pags_json_end_object(&writer);
  return pags_json_writer_save_in_folder(&writer, folder, "objects.json");
}
