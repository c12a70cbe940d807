/* SPDX-License-Identifier: Apache-2.0 */
/* Loads the parts that blocks share; see shared_parts.h. */
#include "train/shared_parts.h"

#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/sort.h"
#include "scene/scene_json.h"

typedef struct shared_parts {
  pags_scene scene; /* without its Gaussians */
  char *sky;        /* file of the sky; NULL: it has none */
} shared_parts;

static void destroy(shared_parts *w) {
  pags_scene_destroy(&w->scene);
  free(w->sky);
  *w = (shared_parts){0};
}

static pags_result load(const char *folder, shared_parts *w) {
  pags_scene_files files = {0};
  char *path = pags_path_join(folder, "scene.json");
  *w = (shared_parts){0};
  if (!path)
    return pags_out_of_memory("%s", folder);
  pags_result result = pags_scene_json_read(path, &w->scene, &files);
  if (result == PAGS_OK && files.sky && !(w->sky = pags_path_join(folder, files.sky)))
    result = pags_out_of_memory("%s", folder);
  free(files.counts);
  free(files.sky);
  free(path);
  return result;
}

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

static pags_result take_sky(const shared_parts *w, pags_sky_fit *fit) {
  pags_sky sky;
  if (!w->sky)
    return PAGS_OK;
  PAGS_TRY(pags_sky_load(w->sky, &sky));
  const pags_result result = pags_sky_fit_prepare(fit, sky.size);
  if (result == PAGS_OK) {
    pags_sky_destroy(&fit->sky);
    fit->sky = sky;
    return PAGS_OK;
  }
  pags_sky_destroy(&sky);
  return result;
}

pags_result pags_shared_parts_load(const pags_dataset *dataset, bool begin, pags_train_state *state) {
  const pags_block *block = pags_dataset_block(dataset);
  shared_parts w;
  if (!block || !block->whole)
    return PAGS_OK;
  pags_result result = load(block->whole, &w);
  if (result == PAGS_OK && begin && state->schedule.config.sky.sky)
    result = take_sky(&w, &state->sky);
  if (result == PAGS_OK && state->exposures.count > 0)
    result = take_exposures(block->whole, dataset, &w.scene, begin, &state->exposures);
  state->sky.fixed = true;
  destroy(&w);
  return result;
}
