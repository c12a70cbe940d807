/* SPDX-License-Identifier: Apache-2.0 */
/* The keys of "objects" in scene.json: boxes, tracks and what training found out about them. */
#ifndef PAGS_SCENE_OBJECT_JSON_H
#define PAGS_SCENE_OBJECT_JSON_H

#include <pags/scene.h>

#include "base/json.h"

/* Reads the optional array "objects" of `root`; the scene's models must have been read. */
pags_result pags_scene_objects_from_json(const pags_json *json, const pags_json_value *root, pags_scene *scene);
void pags_scene_objects_to_json(pags_json_writer *writer, const pags_scene *scene);

/* Fails at `value` when two of `count` names are the same; "two <what> are named ..." */
pags_result pags_json_names_differ(const pags_json *json, const pags_json_value *value, const char *what,
                                   const char *const *names, int64_t count);

#endif
