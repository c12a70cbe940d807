/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes "objects" of scene.json: boxes, tracks, and the pose increments and model that training adds. */
#ifndef PAGS_SCENE_OBJECT_JSON_H
#define PAGS_SCENE_OBJECT_JSON_H

#include <pags/scene.h>

#include "base/json.h"

/* Reads the optional array "objects" of `root` into scene->objects. The scene's models must have been read before,
 * since objects name them. */
pags_result pags_scene_objects_from_json(const pags_json *json, const pags_json_value *root, pags_scene *scene);
void pags_scene_objects_to_json(pags_json_writer *writer, const pags_scene *scene);

/* Fails with "two <what> are named ..." and the line of `value` if two of the `count` names are the same. */
pags_result pags_json_names_differ(const pags_json *json, const pags_json_value *value, const char *what,
                                   const char *const *names, int64_t count);

#endif
