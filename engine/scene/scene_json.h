/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes scene.json (everything in a scene except its Gaussians and its sky, which are files in the same
 * folder; docs/scene-folder.md lists the keys) and the parts of it that other JSON files share: cameras, lenses, places
 * and objects. */
#ifndef PAGS_SCENE_SCENE_JSON_H
#define PAGS_SCENE_SCENE_JSON_H

#include <stdlib.h>

#include <pags/camera.h>
#include <pags/place.h>
#include <pags/scene.h>

#include "base/json.h"

#define PAGS_SKY_FILE "sky.npz"

/* The entries of scene.json about the other files of the folder, to find and check them. */
typedef struct pags_scene_files {
  int64_t *counts; /* number of Gaussians of each model */
  char *sky;       /* path of the sky relative to the scene folder; NULL: no sky */
} pags_scene_files;

static inline void pags_scene_files_destroy(pags_scene_files *files) {
  free(files->counts);
  free(files->sky);
}

/* Fills `scene`, which must be zeroed; its models have no Gaussians yet. Fills `files`, which must be destroyed on
 * failure, too. On failure `scene` is filled in part and must still be destroyed with
 * pags_scene_destroy. */
pags_result pags_scene_json_read(const char *path, pags_scene *scene, pags_scene_files *files);
pags_result pags_scene_json_write(const char *path, const pags_scene *scene);
/* Computes the size in bytes of the file that pags_scene_json_write would write. */
pags_result pags_scene_json_size(const pags_scene *scene, uint64_t *bytes);

/* As pags_scene_save (scene.c), into a folder that is there and that the caller has locked (base/lock.h). */
pags_result pags_scene_write(const char *folder, const pags_scene *scene);

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

/* Reads the optional array "objects" of `root` into scene->objects. The scene's models must have been read before,
 * since objects name them. */
pags_result pags_scene_objects_from_json(const pags_json *json, const pags_json_value *root, pags_scene *scene);
void pags_scene_objects_to_json(pags_json_writer *writer, const pags_scene *scene);

/* Fails with "two <what> are named ..." and the line of `value` if two of the `count` names are the same. `first` is
 * the first name, a char *; the others follow at intervals of `stride` bytes. */
pags_result pags_json_names_differ(const pags_json *json, const pags_json_value *value, const char *what,
                                   const void *first, size_t stride, int64_t count);

/* Reads the place from the JSON object `root`. A latitude beyond +-90 or a longitude beyond +-180 degrees is an error
 * that names the line. If the key is missing, out->known is 0. */
pags_result pags_place_from_json(const pags_json *json, const pags_json_value *root, pags_place *out);
/* Writes the key; writes nothing if the place isn't known. */
void pags_place_to_json(pags_json_writer *writer, const pags_place *place);

#endif
