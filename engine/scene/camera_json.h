/* SPDX-License-Identifier: Apache-2.0 */
/* The keys of a camera in JSON, shared by camera files, path files and scene.json. */
#ifndef PAGS_SCENE_CAMERA_JSON_H
#define PAGS_SCENE_CAMERA_JSON_H

#include <pags/camera.h>

#include "base/json.h"

/* Reads and checks the camera whose keys `object` has. */
pags_result pags_camera_from_json(const pags_json *json, const pags_json_value *object, pags_camera *camera);

/* Puts the keys into the object that `writer` has open. */
void pags_camera_to_json(pags_json_writer *writer, const pags_camera *camera);

#endif
