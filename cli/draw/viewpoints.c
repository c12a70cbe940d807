/* SPDX-License-Identifier: Apache-2.0 */
/* Collects the cameras that pags render draws, with the names of their pictures: from a scene's views, a data set's
 * views, or the frames of a path. */
#include "cli/draw/viewpoints.h"

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "cli/draw/picture.h"

#include <stdlib.h>
#include <string.h>

static pags_result create(int64_t capacity, pags_viewpoints *out) {
  *out = (pags_viewpoints){.items = calloc((size_t)capacity + 1, sizeof *out->items)};
  return out->items ? PAGS_OK : pags_out_of_memory("%lld cameras", (long long)capacity);
}

void pags_viewpoints_destroy(pags_viewpoints *viewpoints) {
  for (int64_t i = 0; i < viewpoints->count; i++)
    free(viewpoints->items[i].name);
  free(viewpoints->items);
  memset(viewpoints, 0, sizeof *viewpoints);
}

static pags_result append(pags_viewpoints *viewpoints, const char *name, const pags_camera *camera) {
  pags_viewpoint *item = &viewpoints->items[viewpoints->count];
  item->name = pags_text_copy(name);
  item->camera = *camera;
  for (int c = 0; c < 3; c++)
    item->gain[c] = 1;
  if (!item->name)
    return pags_out_of_memory(NULL);
  viewpoints->count++;
  return PAGS_OK;
}

static bool wanted(pags_split split, int test) {
  return split == PAGS_SPLIT_ALL || (split == PAGS_SPLIT_TEST) == (test != 0);
}

/* Fails if there is no view; `way`: the remedy. */
static pags_result check_any(const pags_viewpoints *viewpoints, pags_split split, const char *where, const char *way) {
  if (viewpoints->count)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT, "%s has no %sviews: %s", where,
                   split == PAGS_SPLIT_TEST    ? "held-out "
                   : split == PAGS_SPLIT_TRAIN ? "training "
                                               : "",
                   way);
}

pags_result pags_viewpoints_of_scene(const pags_scene *scene, const char *path, pags_split split,
                                     pags_viewpoints *out) {
  pags_picture_names names;
  PAGS_TRY(create(scene->view_count, out));
  pags_result result = pags_picture_names_of_scene(scene, &names);
  for (int64_t i = 0; result == PAGS_OK && i < scene->view_count; i++) {
    const pags_scene_view *view = &scene->views[i];
    if (!wanted(split, view->test))
      continue;
    result = append(out, names.items[i], &view->camera);
    if (result == PAGS_OK) {
      memcpy(out->items[out->count - 1].gain, view->gain, sizeof view->gain);
      memcpy(out->items[out->count - 1].offset, view->offset, sizeof view->offset);
      out->items[out->count - 1].photometric = view->photometric;
    }
  }
  pags_picture_names_destroy(&names);
  if (result == PAGS_OK)
    result = check_any(out, split, path,
                       scene->view_count ? "expected --split all, or a training with another --split-every"
                                         : "it records none; expected --dataset DATASET, --path or --camera");
  if (result != PAGS_OK)
    pags_viewpoints_destroy(out);
  return result;
}

pags_result pags_viewpoints_of_dataset(const pags_dataset *dataset, pags_split split, pags_viewpoints *out) {
  int64_t count = pags_dataset_view_count(dataset);
  pags_picture_names names;
  PAGS_TRY(create(count, out));
  pags_result result = pags_picture_names_of_dataset(dataset, &names);
  for (int64_t i = 0; result == PAGS_OK && i < count; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    if (wanted(split, view->test))
      result = append(out, names.items[i], &view->camera);
  }
  pags_picture_names_destroy(&names);
  if (result == PAGS_OK)
    result = check_any(out, split, pags_dataset_path(dataset), "expected another --split or --split-every");
  if (result != PAGS_OK)
    pags_viewpoints_destroy(out);
  return result;
}

pags_result pags_viewpoints_of_path(const pags_camera_path *path, pags_viewpoints *out) {
  PAGS_TRY(create(path->count, out));
  pags_result result = PAGS_OK;
  for (int64_t i = 0; result == PAGS_OK && i < path->count; i++) {
    char name[24];
    snprintf(name, sizeof name, "%05lld", (long long)i);
    result = append(out, name, &path->cameras[i]);
  }
  if (result != PAGS_OK)
    pags_viewpoints_destroy(out);
  return result;
}
