/* SPDX-License-Identifier: Apache-2.0 */
/* Files and folders of other programs: cameras and scene folders that PAGS reads, and splat formats that it does not.
 */
#ifndef PAGS_SCENE_OTHER_FORMATS_H
#define PAGS_SCENE_OTHER_FORMATS_H

#include <stdbool.h>

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/scene.h>

#include "base/json.h"

/* Checks a camera that was read from `value`, in PAGS' form or another; a message names the line. */
pags_result pags_camera_check_json(const pags_json *json, const pags_json_value *value, pags_camera *camera);

/* Whether the document is an array of cameras with position and rotation, at least one. */
bool pags_cameras_are_inria(const pags_json_value *root);
/* One camera of it: width, height, fx, fy, position and rotation (world from camera, OpenCV's axes; rows); the
 * principal point is the middle unless cx and cy are given. */
pags_result pags_camera_from_inria(const pags_json *json, const pags_json_value *value, pags_camera *out);

/* Whether the document is a camera path of nerfstudio. */
bool pags_cameras_are_nerfstudio(const pags_json_value *root);

/* Reads either as a path; 30 frames a second unless the file has a rate. Ignored content is logged. */
pags_result pags_camera_path_from_inria(const pags_json *json, pags_camera_path *out);
pags_result pags_camera_path_from_nerfstudio(const pags_json *json, pags_camera_path *out);

/* Returns the kind of a scene folder of another program (see other_folders.c), a static string; NULL: none. */
const char *pags_other_folder_kind(const char *folder);

/* Finds the file with the Gaussians, relative to the folder, freed by the caller: of several iterations the newest.
 * Skipped files are logged. PAGS_ERROR_IO, PAGS_ERROR_FORMAT or PAGS_ERROR_MEMORY. */
pags_result pags_other_folder_find(const char *folder, char **file);

/* Adds the views of cameras.json and the background of cfg_args to the scene, where the folder has them. */
pags_result pags_other_folder_views(const char *folder, pags_scene *scene);

/* Fails with PAGS_ERROR_UNSUPPORTED, naming the format and a remedy, if the file is in a splat format that PAGS does
 * not read (the table of unsupported_splats.c): by its first bytes, by the keys of its JSON, or by its extension.
 * `bytes` (with size 0) and `root` may be NULL if the content is unknown. */
pags_result pags_unsupported_splats_check(const char *path, const uint8_t *bytes, size_t size,
                                          const pags_json_value *root);

/* The same for a folder, by the names of its files. */
pags_result pags_unsupported_splats_check_folder(const char *folder);

#endif
