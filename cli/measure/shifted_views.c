/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval --shift: PSNR and SSIM of renderings from shifted cameras against a synthetic set's true pictures. */
#include "cli/measure/shifted_views.h"

#include "cli/common/progress.h"
#include "cli/draw/camera_paths.h"
#include "cli/draw/picture.h"

#include <math.h>
#include <pags/eval.h>
#include <stdlib.h>
#include <string.h>
#include "base/file.h"
#include "base/memory.h"
#include "base/psnr.h"
#include "image/resample.h"

typedef struct shifting {
  const char *folder, *images;
  double downscale;
  pags_composition *composition;
  pags_frame *frame;
  const pags_session *session;
  pags_frame_options options;
} shifting;

void pags_shifted_view_scores_destroy(pags_shifted_view_scores *scores) {
  free(scores->items);
  memset(scores, 0, sizeof *scores);
}

/* Loads a true picture as F32 in [0, 1], shrunk to the size of `small` by area means as training photographs are. */
static pags_result open_photographs(const char *path, const pags_camera *full, const pags_camera *small,
                                    pags_image *out) {
  pags_image bytes, shrunk;
  PAGS_TRY(pags_image_load_display(path, 3, &bytes));
  pags_result result = PAGS_OK;
  if (bytes.width != full->width || bytes.height != full->height)
    result = pags_fail(PAGS_ERROR_FORMAT, "%s: is %dx%d, expected %dx%d as in path.json", path, bytes.width,
                       bytes.height, full->width, full->height);
  if (result == PAGS_OK && small->width != full->width) {
    result = pags_image_create(&shrunk, small->width, small->height, 3, PAGS_U8);
    if (result == PAGS_OK) {
      result = pags_shrink_mean(&bytes, full->fx / small->fx, full->fy / small->fy, &shrunk);
      pags_image_destroy(&bytes);
      bytes = shrunk;
    }
  }
  if (result == PAGS_OK)
    result = pags_image_create(out, bytes.width, bytes.height, 3, PAGS_F32);
  if (result == PAGS_OK)
    for (size_t i = 0; i < (size_t)bytes.width * (size_t)bytes.height * 3; i++)
      ((float *)out->data)[i] = (float)((const uint8_t *)bytes.data)[i] / 255.0f;
  pags_image_destroy(&bytes);
  return result;
}

static pags_result save(const shifting *s, const char *name, int64_t i, const char *what, const pags_image *image) {
  char file[128];
  snprintf(file, sizeof file, "%s_%05lld_%s.png", name, (long long)i, what);
  return pags_image_save_in(s->images, file, image);
}

/* Compares the pixels of the road, class 0 of the Cityscapes train ids, where the set has the classes. */
static pags_result compare_road(const pags_image *render, const pags_image *photographs, const char *folder,
                                const pags_camera *full, int64_t i, pags_shifted_view_score *score) {
  char file[64];
  double psnr;
  pags_image classes;
  snprintf(file, sizeof file, "%05lld_semantic.png", (long long)i);
  char *path = pags_path_join(folder, file);
  if (!path)
    return pags_out_of_memory(NULL);
  pags_result result = PAGS_OK;
  const bool there = pags_file_exists(path);
  if (there)
    result = pags_image_load(path, PAGS_U8, 1, &classes);
  if (there && result == PAGS_OK) {
    if (classes.width != full->width || classes.height != full->height)
      result = pags_fail(PAGS_ERROR_FORMAT, "%s: is %dx%d, expected %dx%d as in path.json", path, classes.width,
                         classes.height, full->width, full->height);
    uint8_t *const road = calloc((size_t)render->width * (size_t)render->height, 1);
    if (!road)
      result = pags_out_of_memory("%s", path);
    for (int y = 0; result == PAGS_OK && y < render->height; y++)
      for (int x = 0; x < render->width; x++) {
        const int64_t column = ((int64_t)2 * x + 1) * full->width / (2 * render->width);
        const int64_t row = ((int64_t)2 * y + 1) * full->height / (2 * render->height);
        road[(int64_t)y * render->width + x] = ((const uint8_t *)classes.data)[row * full->width + column] == 0;
      }
    if (result == PAGS_OK)
      result = pags_eval_psnr(render, photographs, road, &psnr);
    if (result == PAGS_OK && !isnan(psnr)) {
      score->road_psnr += pags_psnr_capped(psnr);
      score->road_views++;
    }
    free(road);
    pags_image_destroy(&classes);
  }
  free(path);
  return result;
}

static pags_result compare(const shifting *s, const pags_image *render, const pags_image *photographs, int64_t i,
                           pags_shifted_view_score *score) {
  double psnr, ssim;
  PAGS_TRY(pags_eval_psnr(render, photographs, NULL, &psnr));
  PAGS_TRY(pags_eval_ssim(render, photographs, NULL, s->session->tasks, &ssim));
  score->psnr += pags_psnr_capped(psnr);
  score->ssim += ssim;
  score->views++;
  if (!s->images)
    return PAGS_OK;
  PAGS_TRY(save(s, score->name, i, "render", render));
  return save(s, score->name, i, "truth", photographs);
}

static pags_result measure_view(const shifting *s, const char *folder, const pags_camera *full, int64_t i,
                                pags_shifted_view_score *score) {
  pags_camera camera = s->downscale == 1 ? *full : pags_camera_downscale(full, s->downscale);
  pags_image render, photographs;
  pags_picture picture;
  const pags_part *parts;
  int part_count;
  char file[32];
  snprintf(file, sizeof file, "%05lld.png", (long long)i);
  pags_compose(s->composition, camera.time, &parts, &part_count);
  pags_frame_options options = s->options;
  double gain[3], offset[3];
  const pags_scene *scene = pags_composition_scene(s->composition);
  pags_scene_exposure(scene, pags_camera_path_drive_sensor(scene), camera.time, gain, offset);
  pags_frame_options_expose(&options, gain, offset);
  PAGS_TRY(pags_frame_render(s->frame, parts, part_count, &camera, &options, NULL, NULL, &picture));
  char *path = pags_path_join(folder, file);
  if (!path)
    return pags_out_of_memory(NULL);
  pags_result result = open_photographs(path, full, &camera, &photographs);
  free(path);
  if (result != PAGS_OK)
    return result;
  result = pags_picture_to_image(&picture, PAGS_F32, &render);
  if (result == PAGS_OK) {
    result = compare(s, &render, &photographs, i, score);
    if (result == PAGS_OK)
      result = compare_road(&render, &photographs, folder, full, i, score);
    pags_image_destroy(&render);
  }
  pags_image_destroy(&photographs);
  return result;
}

static pags_result measure_path(const shifting *s, const char *folder, pags_shifted_view_score *score) {
  pags_camera_path cameras;
  char *file = pags_path_join(folder, "path.json");
  if (!file)
    return pags_out_of_memory(NULL);
  pags_result result = pags_camera_path_load(file, &cameras);
  free(file);
  if (result != PAGS_OK)
    return result;
  pags_progress progress = pags_progress_begin(s->session->people);
  for (int64_t i = 0; result == PAGS_OK && i < cameras.count; i++) {
    if (pags_interrupted())
      result = pags_fail(PAGS_CANCELLED, "interrupted");
    else
      result = measure_view(s, folder, &cameras.cameras[i], i, score);
    if (pags_progress_due(&progress))
      pags_progress_show(&progress, "%s: view %lld of %lld", score->name, (long long)i + 1, (long long)cameras.count);
  }
  pags_progress_end(&progress);
  pags_camera_path_destroy(&cameras);
  score->psnr /= (double)score->views;
  score->ssim /= (double)score->views;
  score->road_psnr = score->road_views > 0 ? score->road_psnr / (double)score->road_views : (double)NAN;
  return result;
}

static pags_result measure_all(const shifting *s, const pags_dir_list *list, pags_shifted_view_scores *out) {
  out->items = calloc((size_t)list->count + 1, sizeof *out->items);
  if (!out->items)
    return pags_out_of_memory(NULL);
  for (int64_t i = 0; i < list->count; i++) {
    char *folder = pags_path_join(s->folder, list->names[i]);
    pags_shifted_view_score *score = &out->items[out->count];
    if (!folder)
      return pags_out_of_memory(NULL);
    pags_result result = PAGS_OK;
    if (pags_dir_exists(folder)) {
      snprintf(score->name, sizeof score->name, "%s", list->names[i]);
      result = measure_path(s, folder, score);
      out->count++;
    }
    free(folder);
    PAGS_TRY(result);
  }
  return PAGS_OK;
}

pags_result pags_shifted_views_measure(const char *dataset, double downscale, pags_composition *composition,
                                       pags_frame *frame, const pags_frame_options *options,
                                       const pags_session *session, const char *images, pags_shifted_view_scores *out) {
  pags_dir_list list;
  memset(out, 0, sizeof *out);
  char *folder = pags_path_join(dataset, "truth/shift");
  if (!folder)
    return pags_out_of_memory(NULL);
  shifting s = {folder, images, downscale, composition, frame, session, *options};
  pags_result result =
      pags_dir_exists(folder)
          ? pags_dir_list_read(folder, &list)
          : pags_fail(PAGS_ERROR_FORMAT, "%s: has no pictures from shifted cameras, expected a folder truth/shift",
                      dataset);
  if (result == PAGS_OK) {
    result = measure_all(&s, &list, out);
    pags_dir_list_destroy(&list);
  }
  free(folder);
  if (result != PAGS_OK)
    pags_shifted_view_scores_destroy(out);
  return result;
}
