/* SPDX-License-Identifier: Apache-2.0 */
/* Reads cameras.json of INRIA's train.py and camera paths of nerfstudio. */
#include "scene/other_formats.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

static const double pi = 3.14159265358979323846;
enum { FRAMES_A_SECOND = 30 };

pags_result pags_camera_check_json(const pags_json *json, const pags_json_value *value, pags_camera *camera) {
  char what[900];
  snprintf(what, sizeof what, "%s:%d", pags_json_path(json), value->line);
  return pags_camera_check(camera, what);
}

/* ---- INRIA ---- */

bool pags_cameras_are_inria(const pags_json_value *root) {
  return root->type == PAGS_JSON_ARRAY && root->first && pags_json_member(root->first, "position") &&
         pags_json_member(root->first, "rotation");
}

pags_result pags_camera_from_inria(const pags_json *json, const pags_json_value *value, pags_camera *out) {
  double position[3], rotation[9];
  *out = (pags_camera){.time = (double)NAN};
  PAGS_TRY(pags_json_as_object(json, value, "a camera"));
  PAGS_TRY(pags_json_int(json, value, "width", 1, 65535, &out->width));
  PAGS_TRY(pags_json_int(json, value, "height", 1, 65535, &out->height));
  PAGS_TRY(pags_json_number(json, value, "fx", &out->fx));
  PAGS_TRY(pags_json_number(json, value, "fy", &out->fy));
  PAGS_TRY(pags_json_number_or(json, value, "cx", (double)out->width / 2, &out->cx));
  PAGS_TRY(pags_json_number_or(json, value, "cy", (double)out->height / 2, &out->cy));
  PAGS_TRY(pags_json_numbers(json, value, "position", 3, position));
  PAGS_TRY(pags_json_numbers(json, value, "rotation", 9, rotation));
  pags_pose_make(rotation, position, out->world_from_camera);
  return pags_camera_check_json(json, value, out);
}

pags_result pags_camera_path_from_inria(const pags_json *json, pags_camera_path *out) {
  const pags_json_value *root = pags_json_root(json);
  out->cameras = calloc((size_t)root->count, sizeof *out->cameras);
  PAGS_CHECK_MEMORY(out->cameras, "%s: its cameras", pags_json_path(json));
  out->fps = FRAMES_A_SECOND;
  for (const pags_json_value *v = root->first; v; v = v->next)
    PAGS_TRY(pags_camera_from_inria(json, v, &out->cameras[out->count++]));
  return PAGS_OK;
}

/* ---- nerfstudio ---- */

bool pags_cameras_are_nerfstudio(const pags_json_value *root) {
  const pags_json_value *path = pags_json_member(root, "camera_path");
  return path && path->type == PAGS_JSON_ARRAY;
}

/* A camera of the path: camera_to_world, 16 numbers row by row in OpenGL's axes, and fov, degrees of the height. Counts
 * it in `scaled` if the matrix has a scale, which is left out. */
static pags_result read_frame(const pags_json *json, const pags_json_value *value, int width, int height,
                              pags_camera *out, int64_t *scaled) {
  double m[16], fov;
  PAGS_TRY(pags_json_as_object(json, value, "a camera"));
  PAGS_TRY(pags_json_numbers(json, value, "camera_to_world", 16, m));
  PAGS_TRY(pags_json_number(json, value, "fov", &fov));
  if (!(fov > 0 && fov < 180))
    return pags_json_fail(json, value, "expected 0 < 'fov' < 180 degrees, found %g", fov);
  const double angle = fov * pi / 360, focal = height / 2.0 * pags_cos(angle) / pags_sin(angle);
  *out = (pags_camera){.width = width,
                       .height = height,
                       .fx = focal,
                       .fy = focal,
                       .cx = width / 2.0,
                       .cy = height / 2.0,
                       .time = (double)NAN};
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 4; j++)
      out->world_from_camera[4 * i + j] = m[4 * i + j] * (j == 1 || j == 2 ? -1 : 1);
  *scaled += pags_rigid_unscale(out->world_from_camera) != 1;
  return pags_camera_check_json(json, value, out);
}

pags_result pags_camera_path_from_nerfstudio(const pags_json *json, pags_camera_path *out) {
  const pags_json_value *root = pags_json_root(json), *frames, *crop = pags_json_member(root, "crop");
  const char *type;
  int64_t scaled = 0;
  int width, height;
  PAGS_TRY(pags_json_array(json, root, "camera_path", &frames));
  PAGS_TRY(pags_json_string_or(json, root, "camera_type", "perspective", &type));
  if (strcmp(type, "perspective") != 0)
    return pags_json_fail(json, root, "expected 'camera_type' perspective, found '%.40s', which PAGS can't draw", type);
  if (!frames->count)
    return pags_json_fail(json, frames, "expected at least one camera in 'camera_path'");
  PAGS_TRY(pags_json_int(json, root, "render_width", 1, 65535, &width));
  PAGS_TRY(pags_json_int(json, root, "render_height", 1, 65535, &height));
  PAGS_TRY(pags_json_number_or(json, root, "fps", FRAMES_A_SECOND, &out->fps));
  if (!(out->fps > 0))
    return pags_json_fail(json, root, "expected a positive number for 'fps', found %g", out->fps);
  out->cameras = calloc((size_t)frames->count, sizeof *out->cameras);
  PAGS_CHECK_MEMORY(out->cameras, "%s: its cameras", pags_json_path(json));
  for (const pags_json_value *v = frames->first; v; v = v->next)
    PAGS_TRY(read_frame(json, v, width, height, &out->cameras[out->count++], &scaled));
  if (scaled)
    PAGS_WARN("%s: 'camera_to_world' of %lld of %lld cameras has a scale, which is left out", pags_json_path(json),
              (long long)scaled, (long long)frames->count);
  if (crop && crop->type != PAGS_JSON_NULL)
    PAGS_WARN("%s: its 'crop' is ignored: everything is drawn", pags_json_path(json));
  return PAGS_OK;
}
