/* scene.json: everything of a scene but its Gaussians. docs/scene.md lists the keys. */
#ifndef PAGS_SCENE_SCENE_JSON_H
#define PAGS_SCENE_SCENE_JSON_H

#include <pags/scene.h>

/* Fills `scene`, which must be zeroed, with models that have no Gaussians yet; `counts` receives how many each has
 * according to the file (freed by the caller). On failure what was filled stays for pags_scene_destroy. */
pags_result pags_scene_json_read(const char *path, pags_scene *scene, int64_t **counts);
pags_result pags_scene_json_write(const char *path, const pags_scene *scene);

#endif
