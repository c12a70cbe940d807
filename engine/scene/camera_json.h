/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes the JSON keys of one camera, which camera files, path files and scene.json share. */
#ifndef PAGS_SCENE_CAMERA_JSON_H
#define PAGS_SCENE_CAMERA_JSON_H

#include <pags/camera.h>

#include "base/json.h"

/* Reads a camera from the keys of the JSON object `object` and checks it with pags_camera_check. */
pags_result pags_camera_from_json(const pags_json *json, const pags_json_value *object, pags_camera *camera);

/* Reads a lens: an object with kind and, where they aren't 0, k, d, p, s and field. It is to be checked with
 * pags_lens_model_check. */
pags_result pags_lens_from_json(const pags_json *json, const pags_json_value *object, pags_lens_model *lens);
/* Writes it under `key`. */
void pags_lens_to_json(pags_json_writer *writer, const char *key, const pags_lens_model *lens);

/* Writes the keys of `camera` into the JSON object that is open in `writer`. */
void pags_camera_to_json(pags_json_writer *writer, const pags_camera *camera);
/* Those of its picture and lens alone: width, height, fx, fy, cx, cy. */
void pags_camera_lens_to_json(pags_json_writer *writer, const pags_camera *camera);

#endif
