/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes camera files (one camera) and path files (fps and an array of cameras), both JSON, and the keys of
 * one camera, which scene.json shares. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene_json.h"

#include "base/memory.h"
#include "base/vec3.h"
#include "scene/other_formats.h"

static pags_result read_shutter(const pags_json *json, const pags_json_value *object, pags_shutter *shutter) {
  const pags_json_value *value;
  const char *direction;
  double seconds;
  *shutter = (pags_shutter){0};
  if (!pags_json_member(object, "rolling_shutter"))
    return PAGS_OK;
  PAGS_TRY(pags_json_object(json, object, "rolling_shutter", &value));
  PAGS_TRY(pags_json_string(json, value, "direction", &direction));
  PAGS_TRY(pags_json_number(json, value, "seconds", &seconds));
  PAGS_TRY(pags_json_numbers(json, value, "velocity", 6, shutter->velocity));
  if (!(seconds >= 0) || !pags_shutter_set(shutter, direction, seconds))
    return pags_json_fail(json, value,
                          "expected a direction top_to_bottom, bottom_to_top, left_to_right, right_to_left or none, "
                          "and 0 seconds or more; found '%s' and %g",
                          direction, seconds);
  return PAGS_OK;
}

pags_result pags_lens_from_json(const pags_json *json, const pags_json_value *value, pags_lens_model *lens) {
  const char *kind;
  int found = 0;
  *lens = (pags_lens_model){0};
  PAGS_TRY(pags_json_as_object(json, value, "a lens"));
  PAGS_TRY(pags_json_string(json, value, "kind", &kind));
  while (found < PAGS_LENS_KINDS && strcmp(kind, pags_lens_kind_name((pags_lens_kind)found)) != 0)
    found++;
  if (found == PAGS_LENS_KINDS)
    return pags_json_fail(json, value,
                          "expected a lens of kind perspective, fisheye, rational, fov, thin_prism, aria, division, "
                          "eucm, ftheta or equirectangular, found '%s'",
                          kind);
  lens->kind = (pags_lens_kind)found;
  PAGS_TRY(pags_json_numbers_if(json, value, "k", 6, lens->k));
  PAGS_TRY(pags_json_numbers_if(json, value, "d", 3, lens->d));
  PAGS_TRY(pags_json_numbers_if(json, value, "p", 2, lens->p));
  PAGS_TRY(pags_json_numbers_if(json, value, "s", 4, lens->s));
  return pags_json_number_or(json, value, "field", 0, &lens->field);
}

pags_result pags_camera_from_json(const pags_json *json, const pags_json_value *object, pags_camera *camera) {
  PAGS_TRY(pags_json_int(json, object, "width", 1, 65535, &camera->width));
  PAGS_TRY(pags_json_int(json, object, "height", 1, 65535, &camera->height));
  PAGS_TRY(pags_json_number(json, object, "fx", &camera->fx));
  PAGS_TRY(pags_json_number(json, object, "fy", &camera->fy));
  PAGS_TRY(pags_json_number(json, object, "cx", &camera->cx));
  PAGS_TRY(pags_json_number(json, object, "cy", &camera->cy));
  PAGS_TRY(pags_json_number_or(json, object, "time", (double)NAN, &camera->time));
  PAGS_TRY(read_shutter(json, object, &camera->shutter));
  const pags_json_value *const lens = pags_json_member(object, "lens");
  camera->lens = (pags_lens_model){0};
  if (lens)
    PAGS_TRY(pags_lens_from_json(json, lens, &camera->lens));

  /* The file holds camera_from_world as a quaternion of any length and a translation, the struct the inverse. */
  double q[4], t[3], r[9], pose[12];
  PAGS_TRY(pags_json_numbers(json, object, "camera_from_world_quaternion_wxyz", 4, q));
  PAGS_TRY(pags_json_numbers(json, object, "camera_from_world_translation", 3, t));
  double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(norm > 1e-6 && isfinite(norm)))
    return pags_json_fail(
        json, object,
        "expected a quaternion of about unit length for 'camera_from_world_quaternion_wxyz', found one of length %g",
        norm);
  pags_rotation_from_quaternion(q, r);
  pags_pose_make(r, t, pose);
  pags_rigid_inverse(pose, camera->world_from_camera);
  return pags_camera_check_json(json, object, camera);
}

void pags_camera_lens_to_json(pags_json_writer *writer, const pags_camera *camera) {
  pags_json_put_integer(writer, "width", camera->width);
  pags_json_put_integer(writer, "height", camera->height);
  pags_json_put_number(writer, "fx", camera->fx);
  pags_json_put_number(writer, "fy", camera->fy);
  pags_json_put_number(writer, "cx", camera->cx);
  pags_json_put_number(writer, "cy", camera->cy);
}

void pags_lens_to_json(pags_json_writer *writer, const char *key, const pags_lens_model *lens) {
  const struct {
    const char *key;
    const double *numbers;
    int count;
  } terms[] = {{"k", lens->k, 6}, {"d", lens->d, 3}, {"p", lens->p, 2}, {"s", lens->s, 4}};
  pags_json_begin_object(writer, key);
  pags_json_put_string(writer, "kind", pags_lens_kind_name(lens->kind));
  for (size_t i = 0; i < sizeof terms / sizeof *terms; i++) {
    double size = 0;
    for (int k = 0; k < terms[i].count; k++)
      size += fabs(terms[i].numbers[k]);
    if (size > 0)
      pags_json_put_numbers(writer, terms[i].key, terms[i].numbers, terms[i].count);
  }
  if (lens->field > 0)
    pags_json_put_number(writer, "field", lens->field);
  pags_json_end_object(writer);
}

void pags_camera_to_json(pags_json_writer *writer, const pags_camera *camera) {
  double pose[12], r[9], q[4], t[3];
  pags_rigid_inverse(camera->world_from_camera, pose);
  pags_pose_rotation(pose, r);
  pags_pose_position(pose, t);
  pags_quaternion_from_rotation(r, q);
  pags_camera_lens_to_json(writer, camera);
  pags_json_put_numbers(writer, "camera_from_world_quaternion_wxyz", q, 4);
  pags_json_put_numbers(writer, "camera_from_world_translation", t, 3);
  if (!isnan(camera->time))
    pags_json_put_number(writer, "time", camera->time);
  if (pags_camera_bends(camera))
    pags_lens_to_json(writer, "lens", &camera->lens);
  if (!pags_camera_rolls(camera))
    return;
  pags_json_begin_object(writer, "rolling_shutter");
  pags_json_put_string(writer, "direction", pags_shutter_direction(&camera->shutter));
  pags_json_put_number(writer, "seconds", fabs(camera->shutter.across + camera->shutter.down));
  pags_json_put_numbers(writer, "velocity", camera->shutter.velocity, 6);
  pags_json_end_object(writer);
}

/* Reads a path file, which has the key "frames", the files of other programs, or else a camera file, as a path of one
 * camera with fps 0. */
static pags_result read_path(const pags_json *json, pags_camera_path *path) {
  const pags_json_value *root = pags_json_root(json);
  if (pags_cameras_are_inria(root))
    return pags_camera_path_from_inria(json, path);
  PAGS_TRY(pags_json_as_object(json, root, "a camera or a path"));
  if (pags_cameras_are_nerfstudio(root))
    return pags_camera_path_from_nerfstudio(json, path);
  if (pags_json_member(root, "frames")) {
    /* A path file. */
    const pags_json_value *frames;
    PAGS_TRY(pags_json_array(json, root, "frames", &frames));
    if (frames->first && pags_json_member(frames->first, "transform_matrix"))
      return pags_json_fail(
          json, root,
          "expected a path, found a data set (transforms.json): --split all --dataset FOLDER draws its views");
    PAGS_TRY(pags_json_number(json, root, "fps", &path->fps));
    if (!(path->fps > 0))
      return pags_json_fail(json, root, "expected a positive number for 'fps', found %g", path->fps);
    if (frames->count == 0)
      return pags_json_fail(json, frames, "expected at least one camera in 'frames'");
    path->cameras = calloc((size_t)frames->count, sizeof *path->cameras);
    PAGS_CHECK_MEMORY(path->cameras, "%s: its cameras", pags_json_path(json));
    for (const pags_json_value *frame = frames->first; frame; frame = frame->next)
      PAGS_TRY(pags_camera_from_json(json, frame, &path->cameras[path->count++]));
    return PAGS_OK;
  }
  path->cameras = calloc(1, sizeof *path->cameras);
  PAGS_CHECK_MEMORY(path->cameras, "%s: its camera", pags_json_path(json));
  path->count = 1;
  return pags_camera_from_json(json, root, path->cameras);
}

pags_result pags_camera_path_load(const char *path, pags_camera_path *out) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  *out = (pags_camera_path){0};
  PAGS_TRY(pags_json_parse_file(path, &json));
  const pags_result result = read_path(json, out);
  if (result != PAGS_OK)
    pags_camera_path_destroy(out);
  return result;
}

pags_result pags_camera_path_save(const char *path, const pags_camera_path *cameras) {
  assert(cameras->fps > 0 || cameras->count == 1);
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {.indent = 1};
  pags_json_begin_object(&writer, NULL);
  if (cameras->fps > 0) {
    pags_json_put_number(&writer, "fps", cameras->fps);
    pags_json_begin_array(&writer, "frames");
    for (int64_t i = 0; i < cameras->count; i++) {
      pags_json_begin_object(&writer, NULL);
      pags_camera_to_json(&writer, &cameras->cameras[i]);
      pags_json_end_object(&writer);
    }
    pags_json_end_array(&writer);
  } else {
    pags_camera_to_json(&writer, cameras->cameras);
  }
  pags_json_put_string(&writer, "axes", "OpenCV: x right, y down, z forward; pixel centres at i + 0.5");
  pags_json_end_object(&writer);
  return pags_json_writer_save(&writer, path);
}

void pags_camera_path_destroy(pags_camera_path *path) {
  free(path->cameras);
  *path = (pags_camera_path){0};
}
