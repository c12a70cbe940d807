/* SPDX-License-Identifier: Apache-2.0 */
/* scene.json: everything of a scene but its Gaussians. docs/scene-folder.md lists the keys. */
#ifndef PAGS_SCENE_SCENE_JSON_H
#define PAGS_SCENE_SCENE_JSON_H

#include <pags/scene.h>

#define PAGS_SKY_FILE "sky.npy"

/* What scene.json says of the files beside it. */
typedef struct pags_scene_files {
  int64_t *counts; /* Gaussians of each model */
  char *sky;       /* relative path; NULL: no sky */
} pags_scene_files;

/* Fills `scene`, which must be zeroed, with models that have no Gaussians yet, and `files`, whose members the caller
 * frees. On failure what was filled stays for pags_scene_destroy. */
pags_result pags_scene_json_read(const char *path, pags_scene *scene, pags_scene_files *files);
pags_result pags_scene_json_write(const char *path, const pags_scene *scene);
/* Bytes of what it writes. */
pags_result pags_scene_json_size(const pags_scene *scene, uint64_t *bytes);

#endif
