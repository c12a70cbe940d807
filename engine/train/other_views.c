/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the first difference between a data set's views and those of a scene.json (other_views.c). */
#include "train/stages.h"

#include "base/file.h"
#include "base/text.h"
#include "scene/scene_json.h"

/* What differs between a view now and as the scene records it; NULL: nothing. */
static char *compare(const pags_view *now, const pags_scene_view *then) {
  const pags_camera *a = &now->camera, *b = &then->camera;
  double square = 0, turn = 0;
  for (int i = 0; i < 12; i++) {
    const double step = a->world_from_camera[i] - b->world_from_camera[i];
    square += i % 4 == 3 ? step * step : 0;
    turn = i % 4 == 3 ? turn : fmax(turn, fabs(step));
  }
  if (now->test != then->test)
    return pags_text_format("%s is %s now", now->name, now->test ? "held out" : "for training");
  if (a->width != b->width || a->height != b->height)
    return pags_text_format("%s has %d x %d pixels now, not %d x %d", now->name, a->width, a->height, b->width,
                            b->height);
  if (fabs(a->fx - b->fx) > 1e-6 * b->fx || fabs(a->fy - b->fy) > 1e-6 * b->fy || fabs(a->cx - b->cx) > 1e-6 * b->fx ||
      fabs(a->cy - b->cy) > 1e-6 * b->fy)
    return pags_text_format("the camera of %s has focal lengths %g, %g and centre %g, %g now, not %g, %g and %g, %g",
                            now->name, a->fx, a->fy, a->cx, a->cy, b->fx, b->fy, b->cx, b->cy);
  if (pags_camera_bends(a) != pags_camera_bends(b))
    return pags_text_format("the camera of %s %s its lens now", now->name, pags_camera_bends(a) ? "keeps" : "loses");
  if (!pags_lens_model_same(&a->lens, &b->lens))
    return pags_text_format("the lens of %s has other numbers now", now->name);
  if (square > 1e-10)
    return pags_text_format("the camera of %s stands %.3g m from where it stood", now->name, sqrt(square));
  return turn > 1e-6 ? pags_text_format("the camera of %s is turned", now->name) : NULL;
}

static char *compare_all(const pags_scene *scene, const pags_dataset *dataset) {
  const int64_t count = pags_dataset_view_count(dataset);
  if (count != scene->view_count)
    return pags_text_format("it has %lld views now, not %lld", (long long)count, (long long)scene->view_count);
  for (int64_t i = 0; i < count; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    const pags_scene_view *then = scene->views, *const end = then + count;
    while (then < end && strcmp(then->name, view->name) != 0)
      then++;
    char *text = then < end ? compare(view, then) : pags_text_format("%s is new", view->name);
    if (text)
      return text;
  }
  return NULL;
}

char *pags_other_views(const char *folder, const pags_dataset *dataset) {
  PAGS_AUTOFREE char *path = pags_path_join(folder, "scene.json");
  PAGS_AUTO(pags_scene_destroy) pags_scene scene = {0};
  PAGS_AUTO(pags_scene_files_destroy) pags_scene_files files = {0};
  const bool is_read = path && pags_file_exists(path) && pags_scene_json_read(path, &scene, &files) == PAGS_OK;
  return is_read ? compare_all(&scene, dataset) : NULL;
}
