/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes scene.json: everything of a scene but its Gaussians and its sky, which are files beside it.
 * docs/scene-folder.md lists the keys. */
#ifndef PAGS_SCENE_SCENE_JSON_H
#define PAGS_SCENE_SCENE_JSON_H

#include <pags/scene.h>

#define PAGS_SKY_FILE "sky.npy"

/* What scene.json gives about the files beside it, to find and check them. */
typedef struct pags_scene_files {
  int64_t *counts; /* number of Gaussians of each model */
  char *sky;       /* path of the sky relative to the scene folder; NULL: no sky */
} pags_scene_files;

/* Fills `scene`, which must be zeroed; its models have no Gaussians yet. Fills `files`, whose members the caller
 * frees, also on failure. On failure `scene` is filled in part and must still be destroyed with
 * pags_scene_destroy. */
pags_result pags_scene_json_read(const char *path, pags_scene *scene, pags_scene_files *files);
pags_result pags_scene_json_write(const char *path, const pags_scene *scene);
/* Computes the size in bytes of the file that pags_scene_json_write would write. */
pags_result pags_scene_json_size(const pags_scene *scene, uint64_t *bytes);

/* As pags_scene_save (scene.c), into a folder that is there and that the caller has locked (base/lock.h). */
pags_result pags_scene_write(const char *folder, const pags_scene *scene);

#endif
