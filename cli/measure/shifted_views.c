/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval --shift: PSNR and SSIM of renderings from shifted cameras against a synthetic set's true pictures. */
#include "cli/measure/errors.h"

#include "cli/common/progress.h"
#include "cli/draw/camera_paths.h"
#include "cli/draw/picture.h"

#include <math.h>
#include <pags/eval.h>
#include "base/file.h"
#include "base/memory.h"
#include "base/psnr.h"
#include "image/pixels.h"

typedef struct shifting {
  const char *images;
  double downscale;
  pags_composition *composition;
  pags_frame *frame;
  const pags_session *session;
  const pags_frame_options *options;
} shifting;

static pags_result check_size(const char *path, const pags_image *image, const pags_camera *camera) {
  if (image->width == camera->width && image->height == camera->height)
    return PAGS_OK;
  return pags_fail_at(path, "is %dx%d, expected %dx%d as in path.json", image->width, image->height, camera->width,
                      camera->height);
}

/* Loads a true picture as F32 in [0, 1], shrunk to the size of `small` by area means as training photographs are. */
static pags_result load_truth(const char *folder, int64_t i, const pags_camera *full, const pags_camera *small,
                              pags_image *out) {
  char file[32];
  snprintf(file, sizeof file, "%05lld.png", (long long)i);
  PAGS_AUTOFREE char *path = pags_path_join(folder, file);
  PAGS_CHECK_MEMORY(path, NULL);
  PAGS_AUTO(pags_image_destroy) pags_image bytes = {0}, shrunk = {0};
  PAGS_TRY(pags_image_load_display(path, 3, &bytes));
  PAGS_TRY(check_size(path, &bytes, full));
  if (small->width == full->width)
    return pags_image_converted(&bytes, PAGS_F32, 3, out);
  PAGS_TRY(pags_image_create(&shrunk, small->width, small->height, 3, PAGS_U8));
  PAGS_TRY(pags_shrink_mean(&bytes, full->fx / small->fx, full->fy / small->fy, &shrunk));
  return pags_image_converted(&shrunk, PAGS_F32, 3, out);
}

static pags_result save(const shifting *s, const char *name, int64_t i, const char *what, const pags_image *image) {
  char file[128];
  snprintf(file, sizeof file, "%s_%05lld_%s.png", name, (long long)i, what);
  return pags_image_save_in(s->images, file, image);
}

/* Compares the pixels of the road, class 0 of the Cityscapes train ids, where the set has the classes. */
static pags_result compare_road(const pags_image *render, const pags_image *truth, const char *folder,
                                const pags_camera *full, int64_t i, pags_shifted_view_score *score) {
  char file[64];
  double psnr;
  snprintf(file, sizeof file, "%05lld_semantic.png", (long long)i);
  PAGS_AUTOFREE char *path = pags_path_join(folder, file);
  PAGS_CHECK_MEMORY(path, NULL);
  if (!pags_file_exists(path))
    return PAGS_OK;
  PAGS_AUTO(pags_image_destroy) pags_image classes = {0};
  PAGS_TRY(pags_image_load(path, PAGS_U8, 1, &classes));
  PAGS_TRY(check_size(path, &classes, full));
  PAGS_AUTOFREE uint8_t *road = calloc((size_t)render->width * (size_t)render->height, 1);
  PAGS_CHECK_MEMORY(road, "%s", path);
  for (int y = 0; y < render->height; y++)
    for (int x = 0; x < render->width; x++) {
      const int64_t column = ((int64_t)2 * x + 1) * full->width / (2 * render->width);
      const int64_t row = ((int64_t)2 * y + 1) * full->height / (2 * render->height);
      road[(int64_t)y * render->width + x] = ((const uint8_t *)classes.data)[row * full->width + column] == 0;
    }
  PAGS_TRY(pags_eval_psnr(render, truth, road, &psnr));
  if (!isnan(psnr)) {
    score->road_psnr += pags_psnr_capped(psnr);
    score->road_views++;
  }
  return PAGS_OK;
}

static pags_result measure_view(const shifting *s, const char *folder, const pags_camera *full, int64_t i,
                                pags_shifted_view_score *score) {
  const pags_camera camera = s->downscale == 1 ? *full : pags_camera_downscale(full, s->downscale);
  PAGS_AUTO(pags_image_destroy) pags_image render = {0}, truth = {0};
  pags_picture picture;
  pags_frame_options options = *s->options;
  double gain[3], offset[3], psnr, ssim;
  const pags_scene *scene = pags_composition_scene(s->composition);
  pags_scene_exposure(scene, pags_camera_path_drive_sensor(scene), camera.time, gain, offset);
  pags_frame_options_expose(&options, gain, offset);
  PAGS_TRY(pags_picture_render(s->composition, s->frame, &camera, &options, &picture));
  PAGS_TRY(load_truth(folder, i, full, &camera, &truth));
  PAGS_TRY(pags_picture_to_image(&picture, PAGS_F32, &render));
  PAGS_TRY(pags_eval_psnr(&render, &truth, NULL, &psnr));
  PAGS_TRY(pags_eval_ssim(&render, &truth, NULL, s->session->tasks, &ssim));
  score->psnr += pags_psnr_capped(psnr);
  score->ssim += ssim;
  score->views++;
  if (s->images) {
    PAGS_TRY(save(s, score->name, i, "render", &render));
    PAGS_TRY(save(s, score->name, i, "truth", &truth));
  }
  return compare_road(&render, &truth, folder, full, i, score);
}

static pags_result measure_path(const shifting *s, const char *folder, pags_shifted_view_score *score) {
  PAGS_AUTO(pags_camera_path_destroy) pags_camera_path cameras = {0};
  PAGS_AUTOFREE char *file = pags_path_join(folder, "path.json");
  PAGS_CHECK_MEMORY(file, NULL);
  PAGS_TRY(pags_camera_path_load(file, &cameras));
  PAGS_AUTO(pags_progress_end) pags_progress progress = pags_progress_begin(s->session->people);
  for (int64_t i = 0; i < cameras.count; i++) {
    if (pags_interrupted())
      return pags_fail(PAGS_CANCELLED, "interrupted");
    PAGS_TRY(measure_view(s, folder, &cameras.cameras[i], i, score));
    if (pags_progress_due(&progress))
      pags_progress_show(&progress, "%s: view %lld of %lld", score->name, (long long)i + 1, (long long)cameras.count);
  }
  score->psnr /= (double)score->views;
  score->ssim /= (double)score->views;
  score->road_psnr = score->road_views > 0 ? score->road_psnr / (double)score->road_views : (double)NAN;
  return PAGS_OK;
}

pags_result pags_shifted_views_measure(const char *dataset, double downscale, pags_composition *composition,
                                       pags_frame *frame, const pags_frame_options *options,
                                       const pags_session *session, const char *images, pags_shifted_view_scores *out) {
  const shifting s = {images, downscale, composition, frame, session, options};
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_AUTOFREE char *shifts = pags_path_join(dataset, "truth/shift");
  memset(out, 0, sizeof *out);
  PAGS_CHECK_MEMORY(shifts, NULL);
  if (!pags_dir_exists(shifts))
    return pags_fail_at(dataset, "has no pictures from shifted cameras, expected a folder truth/shift");
  PAGS_TRY(pags_dir_list_read(shifts, &list));
  out->items = calloc((size_t)list.count + 1, sizeof *out->items);
  PAGS_CHECK_MEMORY(out->items, NULL);
  for (int64_t i = 0; i < list.count; i++) {
    PAGS_AUTOFREE char *folder = pags_path_join(shifts, list.names[i]);
    PAGS_CHECK_MEMORY(folder, NULL);
    if (!pags_dir_exists(folder))
      continue;
    pags_shifted_view_score *const score = &out->items[out->count++];
    snprintf(score->name, sizeof score->name, "%s", list.names[i]);
    PAGS_TRY(measure_path(&s, folder, score));
  }
  return PAGS_OK;
}
