/* SPDX-License-Identifier: Apache-2.0 */
/* Opens a data set's photographs for comparison with a scene, matching the scene's views with the data set's by name
 * and checking that their cameras agree. */
#include "cli/common/photographs.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/vec3.h"

/* Tolerance for poses, which are rounded when they are written as decimals: metres, relative for large coordinates;
 * entries of the rotation matrix. */
static const double pose_tolerance = 1e-5;

static const pags_scene_view *find_view(const pags_scene *scene, const char *name) {
  for (int64_t i = 0; i < scene->view_count; i++)
    if (!strcmp(scene->views[i].name, name))
      return &scene->views[i];
  return NULL;
}

static int64_t find_dataset_view(const pags_dataset *dataset, const char *name) {
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++)
    if (!strcmp(pags_dataset_view(dataset, i)->name, name))
      return i;
  return -1;
}

/* Computes the factor by which the scene's pictures are smaller than the data set's: the quotient of the focal
 * lengths, rounded to 6 decimals, at least 1. */
static pags_result scene_downscale(const pags_scene *scene, const pags_dataset *dataset, bool given, double *out) {
  int64_t index = -1, mine = 0;
  for (; mine < scene->view_count && index < 0; mine++)
    index = find_dataset_view(dataset, scene->views[mine].name);
  mine = index < 0 ? 0 : mine - 1;
  if (index < 0 && given && !pags_dir_exists(pags_dataset_path(dataset)))
    index = 0; /* another part of the capture, by the same camera */
  if (index < 0)
    return pags_fail_at(pags_dataset_path(dataset), "has no photograph '%s', which the scene was trained on",
                        scene->views[0].name);
  double quotient = pags_dataset_view(dataset, index)->camera.fx / scene->views[mine].camera.fx;
  double rounded = floor(quotient * 1e6 + 0.5) / 1e6;
  *out = rounded < 1 ? 1 : rounded;
  return PAGS_OK;
}

static bool same_camera(const pags_camera *a, const pags_camera *b) {
  if (a->width != b->width || a->height != b->height)
    return false;
  for (int i = 0; i < 12; i++) {
    double size = i % 4 == 3 ? 1 + fabs(a->world_from_camera[i]) : 1;
    if (fabs(a->world_from_camera[i] - b->world_from_camera[i]) > pose_tolerance * size)
      return false;
  }
  return fabs(a->fx - b->fx) <= 1e-4 * a->fx && fabs(a->fy - b->fy) <= 1e-4 * a->fy &&
         pags_lens_model_same(&a->lens, &b->lens);
}

/* Whether two cameras are at different places, beyond rounding. */
static bool far_apart(const pags_camera *a, const pags_camera *b) {
  double distance = 0, size = 1;
  for (int i = 3; i < 12; i += 4) {
    distance = fmax(distance, fabs(a->world_from_camera[i] - b->world_from_camera[i]));
    size = fmax(size, fabs(a->world_from_camera[i]));
  }
  return distance > pose_tolerance * size;
}

static pags_result check_same_camera(const pags_dataset *dataset, const pags_scene_view *mine,
                                     const pags_camera *other) {
  const pags_camera recorded = pags_scene_view_recorded(mine);
  if (same_camera(&recorded, other))
    return PAGS_OK;
  return pags_fail(
      PAGS_ERROR_FORMAT,
      "%s: the camera of '%s' (%dx%d) is not the one that the scene was trained with (%dx%d); expected the same "
      "data set, with --colmap if it was trained so",
      pags_dataset_path(dataset), mine->name, other->width, other->height, mine->camera.width, mine->camera.height);
}

/* Whether the data set is another part of the capture, without any view of the scene. A view of the same name at
 * another place is a different view. */
static bool is_other_part(const pags_scene *scene, const pags_dataset *dataset) {
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    const pags_scene_view *mine = find_view(scene, view->name);
    const pags_camera recorded = mine ? pags_scene_view_recorded(mine) : view->camera;
    if (mine && !far_apart(&recorded, &view->camera))
      return false;
  }
  return true;
}

static pags_result choose_views(const pags_scene *scene, bool given, pags_photographs *photographs) {
  const pags_dataset *dataset = photographs->dataset;
  const int64_t count = pags_dataset_view_count(dataset);
  const char *const path = pags_dataset_path(dataset);
  const bool file = given && scene->view_count && !pags_dir_exists(path), other = file && is_other_part(scene, dataset);
  if (other)
    pags_log_message(PAGS_LOG_INFO, "%s: has no view that the scene was trained with: all %lld count as held out", path,
                     (long long)count);
  photographs->views = calloc((size_t)count + 1, sizeof *photographs->views);
  PAGS_CHECK_MEMORY(photographs->views, "%lld views", (long long)count);
  for (int64_t i = 0; i < count; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    const pags_scene_view *mine = other ? NULL : find_view(scene, view->name);
    if (scene->view_count && !mine && !other)
      continue;
    if (mine)
      PAGS_TRY(check_same_camera(dataset, mine, &view->camera));
    photographs->views[photographs->count++] =
        (pags_photographs_view){i, mine ? mine->test : other || view->test, mine};
  }
  int64_t lacking = 0;
  if (!other)
    for (int64_t i = 0; i < scene->view_count; i++) {
      const bool missing = find_dataset_view(dataset, scene->views[i].name) < 0;
      lacking += missing;
      if (missing && !file)
        return pags_fail_at(path, "the photograph '%s', which the scene was trained on, is missing",
                            scene->views[i].name);
    }
  if (lacking)
    pags_log_message(PAGS_LOG_INFO, "%s: %lld of the scene's %lld views are not in it and not compared", path,
                     (long long)lacking, (long long)scene->view_count);
  return photographs->count ? PAGS_OK : pags_fail_at(path, "has no views");
}

pags_dataset_options pags_photographs_options(const pags_scene *scene, const char *dataset,
                                              const pags_dataset_options *options) {
  pags_dataset_options chosen = *options;
  if (!chosen.colmap && !dataset)
    chosen.colmap = scene->colmap;
  if (!chosen.image_folder)
    chosen.image_folder = scene->image_folder;
  chosen.image_alpha = (pags_image_alpha)scene->image_alpha;
  pags_widen3(scene->background, chosen.background);
  return chosen;
}

pags_result pags_photographs_open(const pags_scene *scene, const char *dataset, const pags_dataset_options *options,
                                  pags_tasks *tasks, uint64_t image_cache, pags_photographs *out) {
  const char *path = dataset ? dataset : scene->dataset;
  const bool given = dataset != NULL;
  pags_dataset_options chosen = *options;
  PAGS_AUTO(pags_photographs_close) pags_photographs opened = {.downscale = options->downscale};
  *out = (pags_photographs){0};
  if (scene->view_count) {
    chosen.downscale = 1;
    chosen.split_every = scene->fps > 0 ? chosen.split_every : 0; /* the scene stores which views are held out */
    chosen.undistort = 1;
    for (int64_t i = 0; i < scene->view_count; i++)
      if (pags_camera_bends(&scene->views[i].camera))
        chosen.undistort = 0; /* as in training */
    chosen.allow_missing = 1; /* the scene's own views decide which photographs are needed */
  }
  PAGS_TRY(pags_dataset_open(path, &chosen, &opened.dataset));
  if (scene->view_count) {
    PAGS_TRY(scene_downscale(scene, opened.dataset, given, &opened.downscale));
    chosen.downscale = opened.downscale;
    if (opened.downscale != 1) {
      pags_dataset_close(opened.dataset);
      PAGS_TRY(pags_dataset_open(path, &chosen, &opened.dataset));
    }
  }
  PAGS_TRY(choose_views(scene, given, &opened));
  PAGS_TRY(pags_photo_cache_create(opened.dataset, tasks, image_cache, &opened.photos));
  *out = opened;
  opened = (pags_photographs){0};
  return PAGS_OK;
}

pags_result pags_photographs_open_for(const pags_scene *scene, const char *dataset, const pags_dataset_options *options,
                                      pags_tasks *tasks, uint64_t image_cache, pags_photographs *out) {
  const pags_dataset_options chosen = pags_photographs_options(scene, dataset, options);
  return pags_photographs_open(scene, dataset, &chosen, tasks, image_cache, out);
}

pags_result pags_photographs_of(pags_dataset *dataset, pags_tasks *tasks, uint64_t image_cache, pags_photographs *out) {
  const int64_t count = pags_dataset_view_count(dataset);
  *out = (pags_photographs){0};
  PAGS_AUTO(pags_photographs_close)
  pags_photographs opened = {.dataset = dataset, .borrowed = true, .downscale = 1, .count = count};
  opened.views = calloc((size_t)count + 1, sizeof *opened.views);
  PAGS_CHECK_MEMORY(opened.views, "%lld views", (long long)count);
  for (int64_t i = 0; i < count; i++)
    opened.views[i] = (pags_photographs_view){.index = i, .test = pags_dataset_view(dataset, i)->test};
  PAGS_TRY(pags_photo_cache_create(dataset, tasks, image_cache, &opened.photos));
  *out = opened;
  opened = (pags_photographs){0};
  return PAGS_OK;
}

void pags_photographs_close(pags_photographs *photographs) {
  pags_photo_cache_destroy(photographs->photos);
  if (!photographs->borrowed)
    pags_dataset_close(photographs->dataset);
  free(photographs->views);
  *photographs = (pags_photographs){0};
}

static void copy_photo(const pags_photo *photo, pags_image *image, uint8_t *mask) {
  float *out = image->data;
  size_t plane = (size_t)photo->height * (size_t)photo->stride;
  for (int y = 0; y < photo->height; y++) {
    const uint8_t *row = photo->rgb + (size_t)y * (size_t)photo->stride;
    for (int x = 0; x < photo->width; x++)
      for (size_t c = 0; c < 3; c++)
        *out++ = (float)row[c * plane + (size_t)x] / 255.0f;
    if (mask)
      memcpy(mask + (size_t)y * (size_t)photo->width, photo->mask + (size_t)y * (size_t)photo->stride,
             (size_t)photo->width);
  }
}

void pags_photograph_destroy(pags_photograph *photo) {
  pags_image_destroy(&photo->image);
  free(photo->mask);
  *photo = (pags_photograph){0};
}

pags_camera pags_photographs_camera(const pags_photographs *photographs, int64_t i) {
  const pags_photographs_view *at = &photographs->views[i];
  pags_camera camera = pags_dataset_view(photographs->dataset, at->index)->camera;
  if (at->scene_view && pags_scene_view_is_corrected(at->scene_view))
    return at->scene_view->camera;
  if (at->scene_view)
    camera.shutter = at->scene_view->camera.shutter;
  return camera;
}

pags_result pags_photographs_read(pags_photographs *photographs, int64_t i, pags_photograph *out) {
  pags_photo *photo = &out->photo;
  PAGS_TRY(pags_photo_cache_get(photographs->photos, photographs->views[i].index, 1, photo));
  PAGS_TRY(pags_image_create(&out->image, photo->width, photo->height, 3, PAGS_F32));
  if (photo->mask) {
    out->mask = malloc((size_t)photo->width * (size_t)photo->height);
    PAGS_CHECK_MEMORY(out->mask, "a mask of %dx%d", photo->width, photo->height);
  }
  copy_photo(photo, &out->image, out->mask);
  return PAGS_OK;
}
