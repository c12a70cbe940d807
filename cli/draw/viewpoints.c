/* SPDX-License-Identifier: Apache-2.0 */
/* Collects the cameras that pags render draws, with the names of their pictures: from a scene's views, a data set's
 * views, or the frames of a path. --shutter drops their rolling shutters, or gives them one of the scene's views. */
#include "cli/draw/viewpoints.h"

#include <stdio.h>

#include "base/memory.h"
#include "base/text.h"
#include "cli/draw/picture.h"

static pags_result create(int64_t capacity, pags_viewpoints *out) {
  *out = (pags_viewpoints){.items = calloc((size_t)capacity + 1, sizeof *out->items)};
  PAGS_CHECK_MEMORY(out->items, "%lld cameras", (long long)capacity);
  return PAGS_OK;
}

void pags_viewpoints_destroy(pags_viewpoints *viewpoints) {
  for (int64_t i = 0; i < viewpoints->count; i++)
    free(viewpoints->items[i].name);
  free(viewpoints->items);
}

static pags_result append(pags_viewpoints *viewpoints, const char *name, const pags_camera *camera) {
  pags_viewpoint *const item = &viewpoints->items[viewpoints->count];
  *item = (pags_viewpoint){.name = pags_text_copy(name), .camera = *camera, .gain = {1, 1, 1}};
  PAGS_CHECK_MEMORY(item->name, NULL);
  viewpoints->count++;
  return PAGS_OK;
}

static bool wanted(pags_split split, int test) {
  return split == PAGS_SPLIT_ALL || (split == PAGS_SPLIT_TEST) == (test != 0);
}

/* Fails if there is no view; `way`: the remedy. */
static pags_result check_any(const pags_viewpoints *viewpoints, pags_split split, const char *where, const char *way) {
  static const char *const kinds[] = {"training ", "held-out ", ""};
  return viewpoints->count ? PAGS_OK
                           : pags_fail(PAGS_ERROR_ARGUMENT, "%s has no %sviews: %s", where, kinds[split], way);
}

pags_result pags_viewpoints_of_scene(const pags_scene *scene, const char *path, pags_split split,
                                     pags_viewpoints *out) {
  PAGS_AUTO(pags_picture_names_destroy) pags_picture_names names = {0};
  PAGS_TRY(create(scene->view_count, out));
  PAGS_TRY(pags_picture_names_make(scene, NULL, &names));
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_scene_view *const view = &scene->views[i];
    if (!wanted(split, view->test))
      continue;
    pags_viewpoint *const item = &out->items[out->count];
    PAGS_TRY(append(out, names.items[i], &view->camera));
    memcpy(item->gain, view->gain, sizeof view->gain);
    memcpy(item->offset, view->offset, sizeof view->offset);
    item->photometric = view->photometric;
  }
  return check_any(out, split, path,
                   scene->view_count ? "expected --split all, or a training with another --split-every"
                                     : "it records none; expected --dataset DATASET, --path or --camera");
}

pags_result pags_viewpoints_of_dataset(const pags_dataset *dataset, pags_split split, pags_viewpoints *out) {
  const int64_t count = pags_dataset_view_count(dataset);
  PAGS_AUTO(pags_picture_names_destroy) pags_picture_names names = {0};
  PAGS_TRY(create(count, out));
  PAGS_TRY(pags_picture_names_make(NULL, dataset, &names));
  for (int64_t i = 0; i < count; i++) {
    const pags_view *const view = pags_dataset_view(dataset, i);
    if (wanted(split, view->test))
      PAGS_TRY(append(out, names.items[i], &view->camera));
  }
  return check_any(out, split, pags_dataset_path(dataset), "expected another --split or --split-every");
}

pags_result pags_viewpoints_of_path(const pags_camera_path *path, pags_viewpoints *out) {
  PAGS_TRY(create(path->count, out));
  for (int64_t i = 0; i < path->count; i++) {
    char name[24];
    snprintf(name, sizeof name, "%05lld", (long long)i);
    PAGS_TRY(append(out, name, &path->cameras[i]));
  }
  return PAGS_OK;
}

/* ---- Shutters ---- */

/* Gives each camera the readout of `from` and its mean velocity between the cameras before and after it. */
static pags_result roll_along(const pags_shutter *from, pags_viewpoints *v) {
  for (int64_t i = 0; i < v->count; i++) {
    const int64_t before = i > 0 ? i - 1 : i, behind = i + 1 < v->count ? i + 1 : i;
    const pags_camera *const a = &v->items[before].camera, *const b = &v->items[behind].camera;
    pags_camera *const camera = &v->items[i].camera;
    if (!(b->time - a->time > 0))
      return pags_fail(PAGS_ERROR_ARGUMENT,
                       "--shutter rolling: expected a path whose times increase, which gives the cameras' velocities; "
                       "%s is at %g s and %s at %g s",
                       v->items[before].name, a->time, v->items[behind].name, b->time);
    camera->shutter.across = from->across, camera->shutter.down = from->down;
    pags_rigid_velocity(a->world_from_camera, camera->world_from_camera, b->world_from_camera, b->time - a->time,
                        camera->shutter.velocity);
  }
  return PAGS_OK;
}

pags_result pags_shutter_choose(pags_shutter_choice choice, const pags_scene *scene, pags_viewpoints *viewpoints) {
  bool rolls = false;
  for (int64_t i = 0; i < viewpoints->count; i++) {
    if (choice == PAGS_SHUTTER_GLOBAL)
      viewpoints->items[i].camera.shutter = (pags_shutter){0};
    rolls = rolls || pags_camera_rolls(&viewpoints->items[i].camera);
  }
  if (choice != PAGS_SHUTTER_ROLLING || rolls)
    return PAGS_OK;
  for (int64_t i = 0; i < scene->view_count; i++)
    if (pags_camera_rolls(&scene->views[i].camera))
      return roll_along(&scene->views[i].camera.shutter, viewpoints);
  return pags_fail(PAGS_ERROR_ARGUMENT,
                   "--shutter rolling: neither the cameras nor the scene's views have a rolling shutter; expected "
                   "cameras with rolling_shutter (docs/lenses.md), or --shutter global");
}
