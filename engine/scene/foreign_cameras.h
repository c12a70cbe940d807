/* SPDX-License-Identifier: Apache-2.0 */
/* Cameras as other programs write them: cameras.json of INRIA's train.py (also of OpenSplat and viewers), and camera
 * paths of nerfstudio. */
#ifndef PAGS_SCENE_FOREIGN_CAMERAS_H
#define PAGS_SCENE_FOREIGN_CAMERAS_H

#include <stdbool.h>

#include <pags/camera.h>

#include "base/json.h"

/* Whether the document is an array of cameras with position and rotation, at least one. */
bool pags_cameras_are_inria(const pags_json_value *root);
/* One camera of it: width, height, fx, fy, position and rotation (world from camera, OpenCV's axes; rows); the
 * principal point is the middle unless cx and cy are given. */
pags_result pags_camera_from_inria(const pags_json *json, const pags_json_value *value, pags_camera *out);

/* Whether the document is a camera path of nerfstudio. */
bool pags_cameras_are_nerfstudio(const pags_json_value *root);

/* Reads either as a path; 30 frames a second where the file says nothing. What is ignored goes to the log. */
pags_result pags_camera_path_from_inria(const pags_json *json, pags_camera_path *out);
pags_result pags_camera_path_from_nerfstudio(const pags_json *json, pags_camera_path *out);

#endif
