/* Loading a scene for rendering. */
#include "model_view.h"

#include <base/json.h>
#include <stdlib.h>
#include <string.h>

enum { CLUSTER_SIZE = 64 };

static pags_result out_of_memory(const pags_scene *scene) {
  return pags_fail(PAGS_ERROR_MEMORY, "out of memory preparing %lld Gaussians for rendering",
                   (long long)pags_scene_gaussian_count(scene));
}

/* Brings one model into Morton order; id[i] becomes first_id + the row that is now i-th. */
static pags_result sort_model(pags_gaussians *gaussians, int32_t first_id, int32_t *id, int64_t *order) {
  pags_gaussians sorted = {0};
  PAGS_TRY(pags_gaussians_morton_order(gaussians, order));
  PAGS_TRY(pags_gaussians_create(&sorted, gaussians->count, gaussians->sh_degree));
  pags_gaussians_gather(gaussians, order, gaussians->count, &sorted);
  for (int64_t i = 0; i < gaussians->count; ++i)
    id[i] = first_id + (int32_t)order[i];
  pags_gaussians_destroy(gaussians);
  *gaussians = sorted;
  return PAGS_OK;
}

static pags_result add_model(pags_model_view *view, pags_gaussians *gaussians, int32_t first_id) {
  int index = view->part_count;
  int64_t count = gaussians->count;
  int32_t *id = malloc((size_t)(count ? count : 1) * sizeof *id);
  int64_t *order = malloc((size_t)(count ? count : 1) * sizeof *order);
  view->ids[index] = id;
  pags_result result = id && order ? sort_model(gaussians, first_id, id, order) : out_of_memory(&view->scene);
  free(order);
  if (result == PAGS_OK)
    result = pags_clusters_create(&view->clusters[index], count, CLUSTER_SIZE);
  view->part_count = index + 1; /* from here on destroy frees this model's arrays */
  if (result != PAGS_OK)
    return result;
  pags_clusters *clusters = &view->clusters[index];
  pags_clusters_update(clusters, gaussians, 0, clusters->count);
  view->parts[index] = (pags_part){.gaussians = gaussians, .clusters = clusters, .id = id, .first_id = first_id};
  for (int axis = 0; axis < 3; ++axis)
    view->parts[index].world_from_model[5 * axis] = 1;
  return PAGS_OK;
}

static pags_result build(pags_model_view *view) {
  pags_scene *scene = &view->scene;
  size_t models = (size_t)scene->model_count;
  view->gaussian_count = pags_scene_gaussian_count(scene);
  if (view->gaussian_count > INT32_MAX - 64)
    return pags_fail(PAGS_ERROR_LIMIT, "%lld Gaussians are more than the 2^31 - 64 that can be rendered at once",
                     (long long)view->gaussian_count);
  view->parts = calloc(models + 1, sizeof *view->parts);
  view->clusters = calloc(models + 1, sizeof *view->clusters);
  view->ids = calloc(models + 1, sizeof *view->ids);
  if (!view->parts || !view->clusters || !view->ids)
    return out_of_memory(scene);
  int32_t first_id = 0;
  for (size_t i = 0; i < models; ++i) {
    PAGS_TRY(add_model(view, &scene->models[i].gaussians, first_id));
    first_id += (int32_t)scene->models[i].gaussians.count;
  }
  return PAGS_OK;
}

pags_result pags_model_view_load(const char *path, pags_model_view *view) {
  memset(view, 0, sizeof *view);
  PAGS_TRY(pags_scene_load(path, &view->scene));
  pags_result result = build(view);
  if (result != PAGS_OK)
    pags_model_view_destroy(view);
  return result;
}

void pags_model_view_destroy(pags_model_view *view) {
  for (int i = 0; i < view->part_count; ++i) {
    pags_clusters_destroy(&view->clusters[i]);
    free(view->ids[i]);
  }
  free(view->parts);
  free(view->clusters);
  free(view->ids);
  pags_scene_destroy(&view->scene);
  memset(view, 0, sizeof *view);
}

/* Near plane and low-pass of the training, where the scene's configuration names them: a scene is to be drawn as it was
 * trained. A configuration of another program's is no error; the defaults stay. */
static void read_config(const pags_scene *scene, pags_frame_options *options) {
  pags_json *json;
  double value;
  if (!scene->config || pags_json_parse_text("config", scene->config, strlen(scene->config), &json) != PAGS_OK)
    return;
  const pags_json_value *root = pags_json_root(json);
  if (pags_json_number_or(json, root, "near_plane", (double)options->near_plane, &value) == PAGS_OK && value > 0)
    options->near_plane = (float)value;
  if (pags_json_number_or(json, root, "low_pass", (double)options->low_pass, &value) == PAGS_OK && value >= 0)
    options->low_pass = (float)value;
  pags_json_destroy(json);
}

pags_frame_options pags_model_view_options(const pags_model_view *view) {
  pags_frame_options options = pags_frame_options_default();
  for (int i = 0; i < 3; ++i) {
    options.origin[i] = view->scene.origin[i];
    options.background[i] = view->scene.background[i];
  }
  options.antialiased = view->scene.antialiased;
  read_config(&view->scene, &options);
  return options;
}

void pags_model_view_objects(const pags_model_view *view, int32_t *out) {
  for (int m = 0; m < view->part_count; ++m) {
    const pags_gaussians *gaussians = view->parts[m].gaussians;
    for (int64_t i = 0; i < gaussians->count; ++i)
      out[view->ids[m][i]] = gaussians->object_id ? gaussians->object_id[i] : -1;
  }
}

bool pags_model_view_priorities(const pags_model_view *view, float *out) {
  bool known = false;
  for (int m = 0; m < view->part_count; ++m) {
    const pags_gaussians *gaussians = view->parts[m].gaussians;
    known = known || gaussians->s_sem;
    for (int64_t i = 0; i < gaussians->count; ++i)
      out[view->ids[m][i]] = gaussians->s_sem ? gaussians->s_sem[i] : 0;
  }
  return known;
}
