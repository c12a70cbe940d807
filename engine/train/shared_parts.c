/* SPDX-License-Identifier: Apache-2.0 */
/* Loads the parts that blocks share; see stages.h. */
#include "train/stages.h"

#include "base/file.h"
#include "base/sort.h"
#include "scene/scene_json.h"

static int by_name(const void *a, const void *b) {
  return strcmp(((const pags_scene_view *)a)->name, ((const pags_scene_view *)b)->name);
}

/* Finds the scene's view of each of the data set's views and adds up the exposures of those that are trained on:
 * exposures->mean becomes their mean. With `begin` each photograph begins with its own. */
static pags_result take_exposures(const char *folder, const pags_dataset *dataset, pags_scene *scene, bool begin,
                                  pags_exposures *exposures) {
  double mean[6] = {0.0};
  int64_t training = 0;
  pags_sort(scene->views, scene->view_count, sizeof *scene->views, by_name);
  for (int64_t i = 0; i < exposures->count; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    const pags_scene_view key = {.name = (char *)(uintptr_t)view->name};
    const pags_scene_view *found =
        bsearch(&key, scene->views, (size_t)scene->view_count, sizeof *scene->views, by_name);
    if (view->test)
      continue;
    if (!found)
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s: has no photograph %s, which %s trains on; expected a scene of the whole recording", folder,
                       view->name, pags_dataset_path(dataset));
    training++;
    for (int k = 0; k < 6; k++) {
      const double value = k < 3 ? found->gain[k] : found->offset[k - 3];
      exposures->items[i].value[k] = begin ? value : exposures->items[i].value[k];
      mean[k] += value;
    }
  }
  for (int k = 0; k < 6 && training > 0; k++)
    exposures->mean[k] = mean[k] / (double)training;
  return PAGS_OK;
}

static pags_result take_sky(const char *folder, const char *file, pags_sky_fit *fit) {
  PAGS_AUTOFREE char *path = pags_path_join(folder, file);
  PAGS_AUTO(pags_sky_destroy) pags_sky sky = {0};
  PAGS_CHECK_MEMORY(path, "%s", folder);
  PAGS_TRY(pags_sky_load(path, &sky));
  PAGS_TRY(pags_sky_fit_prepare(fit, sky.size));
  const pags_sky empty = fit->sky;
  fit->sky = sky;
  sky = empty;
  return PAGS_OK;
}

pags_result pags_shared_parts_load(const pags_dataset *dataset, bool begin, pags_train_state *state) {
  const pags_block *block = pags_dataset_block(dataset);
  if (!block || !block->whole)
    return PAGS_OK;
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0}; /* without its Gaussians */
  PAGS_AUTO(pags_scene_files_destroy) pags_scene_files files = {0};
  PAGS_AUTOFREE char *path = pags_path_join(block->whole, "scene.json");
  PAGS_CHECK_MEMORY(path, "%s", block->whole);
  PAGS_TRY(pags_scene_json_read(path, &scene, &files));
  if (files.sky && begin && state->schedule.config.sky.sky)
    PAGS_TRY(take_sky(block->whole, files.sky, &state->sky));
  if (state->exposures.count > 0)
    PAGS_TRY(take_exposures(block->whole, dataset, &scene, begin, &state->exposures));
  state->sky.fixed = true;
  return PAGS_OK;
}
