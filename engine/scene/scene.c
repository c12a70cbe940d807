/* A scene in memory, its folder, and bare splat files as scenes. */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/text.h"
#include "scene/scene_json.h"

static pags_result load_model(const char *folder, pags_model *model, int64_t expected) {
  int expected_degree = model->gaussians.sh_degree;
  char *path = pags_path_join(folder, model->file);
  if (!path)
    return pags_fail(PAGS_ERROR_MEMORY, "%s: no memory for a path", folder);
  pags_result result = pags_ply_load(path, &model->gaussians);
  if (result == PAGS_OK && (model->gaussians.count != expected || model->gaussians.sh_degree != expected_degree))
    result = pags_fail(
        PAGS_ERROR_FORMAT, "%s: scene.json promises %lld Gaussians of SH degree %d, found %lld of degree %d", path,
        (long long)expected, expected_degree, (long long)model->gaussians.count, model->gaussians.sh_degree);
  free(path);
  return result;
}

static pags_result load_folder(const char *folder, pags_scene *scene) {
  int64_t *counts = NULL;
  char *path = pags_path_join(folder, "scene.json");
  if (!path)
    return pags_fail(PAGS_ERROR_MEMORY, "%s: no memory for a path", folder);
  pags_result result = pags_file_exists(path)
                           ? pags_scene_json_read(path, scene, &counts)
                           : pags_fail(PAGS_ERROR_IO, "%s: expected a scene, but the folder has no scene.json", folder);
  for (int64_t i = 0; i < scene->model_count && result == PAGS_OK; ++i)
    result = load_model(folder, &scene->models[i], counts[i]);
  free(counts);
  free(path);
  return result;
}

static pags_result load_bare(const char *path, pags_scene *scene) {
  scene->models = calloc(1, sizeof *scene->models);
  if (!scene->models)
    return pags_fail(PAGS_ERROR_MEMORY, "%s: no memory for a model", path);
  scene->model_count = 1;
  scene->up = PAGS_UP_MINUS_Y;
  pags_model *model = scene->models;
  model->name = pags_text_copy("background");
  model->file = pags_text_copy("background.ply");
  if (!model->name || !model->file)
    return pags_fail(PAGS_ERROR_MEMORY, "%s: no memory for a model", path);
  return pags_splat_load(path, &model->gaussians, NULL, &scene->antialiased);
}

/* SCENE/scene.json means SCENE. */
static pags_result load_beside(const char *path, pags_scene *scene) {
  char *folder = pags_path_folder(path);
  if (!folder)
    return pags_fail(PAGS_ERROR_MEMORY, "%s: no memory for a path", path);
  pags_result result = load_folder(folder, scene);
  free(folder);
  return result;
}

pags_result pags_scene_load(const char *path, pags_scene *scene) {
  *scene = (pags_scene){0};
  pags_result result = pags_dir_exists(path)                             ? load_folder(path, scene)
                       : strcmp(pags_path_name(path), "scene.json") == 0 ? load_beside(path, scene)
                                                                         : load_bare(path, scene);
  if (result != PAGS_OK)
    pags_scene_destroy(scene);
  return result;
}

static pags_result save_model(const char *folder, const pags_model *model) {
  assert(pags_path_is_inside(model->file));
  char *path = pags_path_join(folder, model->file);
  char *parent = path ? pags_path_folder(path) : NULL;
  pags_result result =
      parent ? pags_make_dirs(parent) : pags_fail(PAGS_ERROR_MEMORY, "%s: no memory for a path", folder);
  if (result == PAGS_OK)
    result = pags_ply_save(path, &model->gaussians);
  free(parent);
  free(path);
  return result;
}

/* scene.json goes last: where it is new, all that it names is. */
pags_result pags_scene_save(const char *folder, const pags_scene *scene) {
  PAGS_TRY(pags_make_dirs(folder));
  for (int64_t i = 0; i < scene->model_count; ++i)
    PAGS_TRY(save_model(folder, &scene->models[i]));
  char *path = pags_path_join(folder, "scene.json");
  if (!path)
    return pags_fail(PAGS_ERROR_MEMORY, "%s: no memory for a path", folder);
  pags_result result = pags_scene_json_write(path, scene);
  free(path);
  return result;
}

void pags_scene_destroy(pags_scene *scene) {
  for (int64_t i = 0; i < scene->model_count; ++i) {
    free(scene->models[i].name);
    free(scene->models[i].file);
    pags_gaussians_destroy(&scene->models[i].gaussians);
  }
  for (int64_t i = 0; i < scene->view_count; ++i)
    free(scene->views[i].name);
  free(scene->models);
  free(scene->views);
  free(scene->dataset);
  free(scene->config);
  *scene = (pags_scene){0};
}

int64_t pags_scene_gaussian_count(const pags_scene *scene) {
  int64_t count = 0;
  for (int64_t i = 0; i < scene->model_count; ++i)
    count += scene->models[i].gaussians.count;
  return count;
}
