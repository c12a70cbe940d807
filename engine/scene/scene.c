/* SPDX-License-Identifier: Apache-2.0 */
/* Loads and saves scenes (pags/scene.h): a scene folder with scene.json, a PLY per model and sky.npz, a bare splat
 * file, which is read as a scene of one model, or a folder of another program with one (other_formats.h). */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <pags/packed.h>

#include "base/file.h"
#include "base/lock.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/vec3.h"
#include "scene/other_formats.h"
#include "scene/scene_json.h"
#include "scene/splat_formats.h"

enum { SAFE_NAME = 100 }; /* bytes of an object's id in a file name, with the final zero */

/* ---- Loading ---- */

/* Loads the PLY of a model and checks its count and SH degree against those that scene.json gives. For the background,
 * the first model, an origin that reading took off large positions is added to the scene's. */
static pags_result load_model(const char *folder, pags_scene *scene, pags_model *model, int64_t expected) {
  const int expected_degree = model->gaussians.sh_degree, changing = model->gaussians.fourier_degree;
  const float alpha_min = model->gaussians.alpha_min;
  PAGS_AUTOFREE char *path = pags_path_join(folder, model->file);
  PAGS_CHECK_MEMORY(path, "%s: a path", folder);
  pags_splat_facts facts;
  PAGS_TRY(pags_splat_read(path, PAGS_AXES_UNKNOWN, &model->gaussians, &facts));
  const int64_t found = model->gaussians.count + facts.left_out;
  if (found != expected || model->gaussians.sh_degree != expected_degree)
    return pags_fail_at(path, "scene.json promises %lld Gaussians of SH degree %d, found %lld of degree %d",
                        (long long)expected, expected_degree, (long long)found, model->gaussians.sh_degree);
  if (model->gaussians.fourier_degree != changing && found > 0)
    return pags_fail_at(path, "scene.json promises Fourier terms up to SH degree %d, found degree %d", changing,
                        model->gaussians.fourier_degree);
  if (alpha_min > 0.0f)
    model->gaussians.alpha_min = alpha_min;
  if (model == scene->models)
    pags_add3(scene->origin, facts.taken_off, scene->origin);
  else
    pags_large_put_back(&model->gaussians, facts.taken_off);

  /* An object_id can be used as an index of scene->objects. In a scene without objects any object_id is allowed. */
  const int32_t *id = model->gaussians.object_id;
  for (int64_t i = 0; id && scene->object_count && i < model->gaussians.count; i++)
    if (id[i] >= scene->object_count)
      return pags_fail(PAGS_ERROR_FORMAT, "%s/%s: vertex %lld: expected 'object_id' of one of %lld objects, found %d",
                       folder, model->file, (long long)i, (long long)scene->object_count, id[i]);
  return PAGS_OK;
}

static pags_result refuse_folder(const char *folder) {
  PAGS_TRY(pags_unsupported_splats_check_folder(folder));
  static const char *const names[] = {"transforms.json", "transforms_train.json", "dataset.json", "sparse", "images"};
  bool photographs = false;
  for (size_t i = 0; i < sizeof names / sizeof *names; i++)
    photographs |= pags_folder_has_entry(folder, names[i]);
  return pags_fail(PAGS_ERROR_IO,
                   "%s: expected a scene, but the folder has no scene.json, no point_cloud/iteration_N of a training "
                   "and no meta.json of a SOG%s",
                   folder, photographs ? "; it looks like a data set, of which 'pags train' makes a scene" : "");
}

/* Loads a folder of PAGS, which has a scene.json. */
static pags_result load_own(const char *folder, pags_scene *scene) {
  PAGS_AUTO(pags_scene_files_destroy) pags_scene_files files = {0};
  PAGS_AUTOFREE char *path = pags_path_join(folder, "scene.json");
  PAGS_CHECK_MEMORY(path, "%s: a path", folder);
  if (!pags_file_exists(path))
    return refuse_folder(folder);
  PAGS_TRY(pags_scene_json_read(path, scene, &files));
  for (int64_t i = 0; i < scene->model_count; i++)
    PAGS_TRY(load_model(folder, scene, &scene->models[i], files.counts[i]));
  if (!files.sky)
    return PAGS_OK;
  PAGS_AUTOFREE char *sky = pags_path_join(folder, files.sky);
  PAGS_CHECK_MEMORY(sky, "%s: a path", folder);
  return pags_sky_load(sky, &scene->sky);
}

/* Loads a bare splat file as a scene of one model, "background"; its up axis is -y unless it names another. `file` is
 * the file name of the model. */
static pags_result load_bare(const char *path, const char *file, int axes, pags_scene *scene) {
  pags_model *model = scene->models = calloc(1, sizeof *scene->models);
  PAGS_CHECK_MEMORY(model, "%s: a model", path);
  scene->model_count = 1;
  model->name = pags_text_copy("background");
  model->file = pags_text_copy(file);
  PAGS_CHECK_MEMORY(model->name && model->file, "%s: a model", path);
  if (pags_packed_is_file(path)) {
    /* A packed file also holds the background colour of the scene that it was made from. */
    PAGS_AUTO(pags_packed_destroy) pags_packed packed = {0};
    PAGS_TRY(pags_packed_open(path, &packed));
    pags_copy3f(packed.background, scene->background);
  }
  PAGS_TRY(pags_splat_read(path, axes, &model->gaussians, &scene->file));
  scene->up = scene->file.up == PAGS_UP_UNKNOWN ? PAGS_UP_MINUS_Y : scene->file.up;
  scene->antialiased = scene->file.antialiased;
  pags_copy3(scene->file.origin, scene->origin);
  return PAGS_OK;
}

static pags_result load_folder(const char *folder, int axes, pags_scene *scene) {
  if (pags_folder_has(folder, "scene.json") || !pags_other_folder_kind(folder)) {
    if (axes != PAGS_AXES_UNKNOWN)
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: a scene folder's axes are known: expected no other ones", folder);
    return load_own(folder, scene);
  }
  PAGS_AUTOFREE char *file = NULL;
  PAGS_TRY(pags_other_folder_find(folder, &file));
  PAGS_AUTOFREE char *path = pags_path_join(folder, file);
  PAGS_CHECK_MEMORY(path, "%s: a path", folder);
  PAGS_TRY(load_bare(path, file, axes, scene));
  return pags_other_folder_views(folder, scene);
}

const char *pags_scene_folder_kind(const char *path) {
  return pags_folder_has(path, "scene.json") ? "scene" : pags_other_folder_kind(path);
}

pags_result pags_scene_load(const char *path, pags_scene *scene) {
  return pags_scene_load_in_axes(path, PAGS_AXES_UNKNOWN, scene);
}

pags_result pags_scene_load_in_axes(const char *path, int axes, pags_scene *scene) {
  *scene = (pags_scene){0};
  const bool folder = pags_dir_exists(path), in_folder = !folder && strcmp(pags_path_name(path), "scene.json") == 0;
  PAGS_AUTOFREE char *parent = in_folder ? pags_path_folder(path) : NULL;
  PAGS_CHECK_MEMORY(parent || !in_folder, "%s: a path", path);
  const pags_result result = folder || in_folder ? load_folder(in_folder ? parent : path, axes, scene)
                                                 : load_bare(path, "background.ply", axes, scene);
  if (result != PAGS_OK)
    pags_scene_destroy(scene);
  return result;
}

/* ---- Saving ---- */

/* scene.json is written last: if saving is interrupted, a new scene.json never names a model or sky that has not been
 * written completely. */
pags_result pags_scene_write(const char *folder, const pags_scene *scene) {
  for (int64_t i = 0; i < scene->model_count; i++) {
    /* The PLY of the background repeats the metadata of scene.json, for programs that open it alone. Those of objects
     * are in the object's frame, whose z is up. */
    const pags_model *const model = &scene->models[i];
    pags_splat_facts facts = {.antialiased = scene->antialiased, .up = i == 0 ? scene->up : PAGS_UP_Z};
    if (i == 0)
      pags_copy3(scene->origin, facts.origin);
    assert(pags_path_is_inside(model->file));
    PAGS_AUTOFREE char *path = pags_path_join(folder, model->file);
    PAGS_AUTOFREE char *parent = path ? pags_path_folder(path) : NULL;
    PAGS_CHECK_MEMORY(parent, "%s: a path", folder);
    PAGS_TRY(pags_make_dirs(parent));
    PAGS_TRY(pags_ply_save_facts(path, &model->gaussians, &facts));
  }
  PAGS_AUTOFREE char *sky = pags_path_join(folder, PAGS_SKY_FILE), *json = pags_path_join(folder, "scene.json");
  PAGS_CHECK_MEMORY(sky && json, "%s: a path", folder);
  if (scene->sky.size > 0)
    PAGS_TRY(pags_sky_save(sky, &scene->sky));
  return pags_scene_json_write(json, scene);
}

pags_result pags_scene_save(const char *folder, const pags_scene *scene) {
  pags_lock *lock;
  PAGS_TRY(pags_lock_folder(folder, &lock));
  const pags_result result = pags_scene_write(folder, scene);
  pags_lock_release(lock);
  return result;
}

char *pags_scene_model_file(const pags_scene *scene, const char *id) {
  char safe[SAFE_NAME], file[SAFE_NAME + 64];

  /* Keeps the id's letters, digits and '-', and a '.' unless it is the first character; other characters become '_'. */
  size_t length = 0;
  for (const char *c = id; *c && length + 1 < sizeof safe; c++) {
    const bool plain = (*c >= '0' && *c <= '9') || (*c >= 'A' && *c <= 'Z') || (*c >= 'a' && *c <= 'z') || *c == '-' ||
                       (*c == '.' && length > 0);
    safe[length++] = plain ? *c : '_';
  }
  if (length == 0)
    safe[length++] = '_';
  safe[length] = 0;

  /* Numbers the file from 2 on until no model of the scene has it; comparing starts again with each number. */
  snprintf(file, sizeof file, "objects/%s.ply", safe);
  for (int64_t i = 0, number = 2; i < scene->model_count; i++)
    if (scene->models[i].file && strcasecmp(scene->models[i].file, file) == 0) {
      snprintf(file, sizeof file, "objects/%s-%lld.ply", safe, (long long)number++);
      i = -1;
    }
  return pags_text_copy(file);
}

/* ---- Objects, destruction, counts ---- */

const pags_scene_object *pags_scene_find_object(const pags_scene *scene, const char *id) {
  for (int64_t i = 0; i < scene->object_count; i++)
    if (!strcmp(scene->objects[i].record.id, id))
      return &scene->objects[i];
  return NULL;
}

void pags_scene_destroy(pags_scene *scene) {
  for (int64_t i = 0; i < scene->model_count; i++) {
    free(scene->models[i].name);
    free(scene->models[i].file);
    pags_gaussians_destroy(&scene->models[i].gaussians);
  }
  for (int64_t i = 0; i < scene->view_count; i++)
    free(scene->views[i].name);
  for (int64_t i = 0; i < scene->object_count; i++)
    pags_object_destroy(&scene->objects[i].record);
  pags_sky_destroy(&scene->sky);
  free(scene->objects);
  free(scene->block);
  free(scene->notes);
  free(scene->models);
  free(scene->views);
  free(scene->dataset);
  free(scene->colmap);
  free(scene->image_folder);
  free(scene->config);
  *scene = (pags_scene){0};
}

int64_t pags_scene_gaussian_count(const pags_scene *scene) {
  int64_t count = 0;
  for (int64_t i = 0; i < scene->model_count; i++)
    count += scene->models[i].gaussians.count;
  return count;
}
