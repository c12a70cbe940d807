/* SPDX-License-Identifier: Apache-2.0 */
/* Draws a report's views and compares them with their photographs; see page.h. */
#include "cli/html_report/page.h"

#include <math.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "cli/draw/picture.h"
#include "frame/owners.h"
#include "image/formats.h"
#include "image/pixels.h"

enum {
  PICTURE_WIDTH = 320, /* most pixels of a small picture's row: three of them fill a page, one a phone */
  QUALITY = 82,        /* of JPEG: about 10 kB a picture */
  ERROR_GAIN = 4       /* an error of a quarter of the range is the brightest of the map */
};

/* ---- Opening ---- */

/* Whether a failure means missing or unreadable photographs, without which the page is written. */
static bool is_absence(pags_result result) {
  return result != PAGS_OK && result != PAGS_ERROR_MEMORY && result != PAGS_CANCELLED;
}

/* Keeps the last message, the first of several, and warns. */
static pags_result note_absence(const char *path, pags_report_views *views) {
  if (views->absent)
    return PAGS_OK;
  views->absent = pags_text_copy(pags_error_message());
  PAGS_CHECK_MEMORY(views->absent, "%s", path);
  pags_log_message(PAGS_LOG_WARNING, "%s: the report has no photographs: %s", path, views->absent);
  return PAGS_OK;
}

/* A view of the data set or, without photographs, of the scene. */
static pags_report_view view_at(const pags_scene *scene, const pags_report_views *views, int64_t i) {
  if (!views->opened)
    return (pags_report_view){.name = scene->views[i].name,
                              .scene_view = &scene->views[i],
                              .photograph = -1,
                              .score = pags_view_score_make(scene->views[i].name, scene->views[i].test)};
  const pags_photographs_view *const view = &views->photographs.views[i];
  const char *const name = pags_dataset_view(views->photographs.dataset, view->index)->name;
  return (pags_report_view){
      .name = name, .scene_view = view->scene_view, .photograph = i, .score = pags_view_score_make(name, view->test)};
}

pags_result pags_report_views_open(const pags_scene *scene, const char *path, const pags_html_report_settings *settings,
                                   pags_report_views *out) {
  enum { CACHE = 64 << 20 }; /* bytes of decoded photographs */
  *out = (pags_report_views){0};
  const pags_result result =
      settings->dataset || scene->dataset
          ? pags_photographs_open_for(scene, settings->dataset, &settings->dataset_options, settings->session->tasks,
                                      CACHE, &out->photographs)
          : pags_fail(PAGS_ERROR_ARGUMENT, "%s: doesn't name its training data; expected --dataset DATASET", path);
  out->opened = result == PAGS_OK;
  PAGS_TRY(!settings->dataset && is_absence(result) ? note_absence(path, out) : result);
  const int64_t all = out->opened ? out->photographs.count : scene->view_count;
  for (int64_t i = 0; i < all; i++)
    out->held_out = out->held_out || view_at(scene, out, i).score.test;
  out->items = calloc((size_t)all + 1, sizeof *out->items);
  PAGS_CHECK_MEMORY(out->items, "%lld views", (long long)all);
  for (int64_t i = 0; i < all; i++) {
    out->items[out->count] = view_at(scene, out, i);
    out->count += out->items[out->count].score.test || !out->held_out;
  }
  return PAGS_OK;
}

void pags_report_views_destroy(pags_report_views *views) {
  for (int64_t i = 0; i < views->count; i++)
    for (int k = 0; k < PAGS_VIEW_PICTURES; k++)
      free(views->items[i].jpeg[k].bytes);
  free(views->items);
  free(views->absent);
  if (views->opened)
    pags_photographs_close(&views->photographs);
}

int64_t pags_report_views_pictures(const pags_report_views *views) {
  int64_t count = 0;
  for (int64_t i = 0; i < views->count; i++)
    count += views->items[i].jpeg[PAGS_VIEW_PICTURE_RENDER].size > 0;
  return count;
}

pags_report_view *pags_report_views_find(const pags_report_views *views, const char *name) {
  for (int64_t i = 0; i < views->count; i++)
    if (!strcmp(views->items[i].name, name))
      return &views->items[i];
  return NULL;
}

/* ---- An order that is evenly spread at any time ---- */

/* The successor of `index` in the van der Corput sequence of `count` numbers: increments the bit-reversed number and
 * skips numbers of `count` or more. Starts with 0, ends with `count`. */
static int64_t next_spread(int64_t index, int64_t count) {
  int64_t top = 1;
  while (top < count)
    top *= 2;
  do {
    int64_t bit = top / 2;
    for (; bit > 0 && (index & bit); bit /= 2)
      index -= bit;
    if (bit == 0)
      return count;
    index += bit;
  } while (index >= count);
  return index;
}

void pags_report_views_choose(pags_report_views *views, pags_report_views *other, int64_t most) {
  int64_t chosen = 0;
  for (int64_t i = 0; i < views->count && chosen < most; i = next_spread(i, views->count)) {
    pags_report_view *twin = other ? pags_report_views_find(other, views->items[i].name) : NULL;
    if (other && !twin)
      continue;
    views->items[i].shown = true;
    if (twin)
      twin->shown = true;
    chosen++;
  }
}

/* ---- Drawing and measuring ---- */

/* Shrinks a U8 picture to at most PICTURE_WIDTH and encodes it. `tint` (may be NULL) makes colours of grey values. */
static pags_result encode(const pags_image *from, const uint8_t (*tint)[3], pags_report_view *view,
                          pags_view_picture which) {
  const double step = from->width > PICTURE_WIDTH ? (double)from->width / PICTURE_WIDTH : 1;
  const double height = floor(from->height / step + 0.5);
  PAGS_AUTO(pags_image_destroy) pags_image small = {0}, colored = {0};
  PAGS_TRY(pags_image_create(&small, (int)(from->width / step + 0.5), height < 1 ? 1 : (int)height, from->channels,
                             PAGS_U8));
  view->width = small.width;
  view->height = small.height;
  PAGS_TRY(pags_shrink_mean(from, step, step, &small));
  if (!tint)
    return pags_jpeg_encode(view->name, &small, QUALITY, &view->jpeg[which]);
  PAGS_TRY(pags_image_create(&colored, small.width, small.height, 3, PAGS_U8));
  const size_t pixels = (size_t)small.width * (size_t)small.height;
  for (size_t i = 0; i < pixels; i++)
    memcpy((uint8_t *)colored.data + 3 * i, tint[((const uint8_t *)small.data)[i]], 3);
  return pags_jpeg_encode(view->name, &colored, QUALITY, &view->jpeg[which]);
}

/* ERROR_GAIN times the error of each pixel (mean over channels); 0 where masked. */
static pags_result encode_error(const pags_image *render, const pags_photograph *photograph, pags_report_view *view) {
  uint8_t tint[256][3];
  float rgb[3];
  PAGS_AUTO(pags_image_destroy) pags_image grey = {0};
  for (int i = 0; i < 256; i++) {
    pags_colormap_heat((float)i / 255, rgb);
    for (int c = 0; c < 3; c++)
      tint[i][c] = (uint8_t)(255 * rgb[c] + 0.5F);
  }
  PAGS_TRY(pags_image_create(&grey, render->width, render->height, 1, PAGS_U8));
  const float *a = render->data, *b = photograph->image.data;
  const size_t pixels = (size_t)render->width * (size_t)render->height;
  for (size_t i = 0; i < pixels; i++) {
    float sum = 0;
    for (size_t c = 0; c < 3; c++)
      sum += fabsf(a[3 * i + c] - b[3 * i + c]);
    const float error = photograph->mask && !photograph->mask[i] ? 0 : ERROR_GAIN * sum / 3;
    ((uint8_t *)grey.data)[i] = (uint8_t)(255 * fminf(error, 1) + 0.5F);
  }
  return encode(&grey, (const uint8_t(*)[3])tint, view, PAGS_VIEW_PICTURE_ERROR);
}

static pags_result encode_float(const pags_image *image, pags_report_view *view, pags_view_picture which) {
  PAGS_AUTO(pags_image_destroy) pags_image bytes = {0};
  PAGS_TRY(pags_image_converted(image, PAGS_U8, 3, &bytes));
  return encode(&bytes, NULL, view, which);
}

/* Renders a view and reads its photograph, if it is there. */
static pags_result render_view(pags_report_views *views, const pags_report_view *view, pags_composition *composition,
                               pags_frame *frame, pags_image *render, pags_photograph *photograph, bool *there) {
  pags_frame_options options = pags_composition_options(composition);
  *there = view->photograph >= 0;
  if (*there) {
    const pags_result read = pags_photographs_read(&views->photographs, view->photograph, photograph);
    PAGS_TRY(is_absence(read) ? note_absence(view->name, views) : read);
    *there = read == PAGS_OK;
  }
  const pags_camera camera =
      view->photograph >= 0 ? pags_photographs_camera(&views->photographs, view->photograph) : view->scene_view->camera;
  const pags_part *parts;
  int part_count;
  pags_picture picture;
  pags_compose(composition, camera.time, &parts, &part_count);
  if (view->scene_view) {
    options.photometric = view->scene_view->photometric;
    pags_frame_options_expose(&options, view->scene_view->gain, view->scene_view->offset);
  }
  PAGS_TRY(pags_frame_render(frame, parts, part_count, &camera, &options, NULL, NULL, &picture));
  return pags_picture_to_image(&picture, PAGS_F32, render);
}

/* Renders a view, measures PSNR and SSIM against its photograph, if that is there, and makes the small pictures. */
static pags_result draw_view(pags_report_views *views, pags_report_view *view, pags_composition *composition,
                             pags_frame *frame, const pags_html_report_settings *settings) {
  PAGS_AUTO(pags_photograph_destroy) pags_photograph photograph = {0};
  PAGS_AUTO(pags_image_destroy) pags_image render = {0};
  bool there;
  PAGS_TRY(render_view(views, view, composition, frame, &render, &photograph, &there));
  if (there)
    PAGS_TRY(pags_view_score_measure(&render, &photograph, settings->session->tasks, &view->score));
  view->drawn = true;
  if (view->shown)
    PAGS_TRY(encode_float(&render, view, PAGS_VIEW_PICTURE_RENDER));
  if (!view->shown || !there)
    return PAGS_OK;
  PAGS_TRY(encode_float(&photograph.image, view, PAGS_VIEW_PICTURE_PHOTOGRAPH));
  return encode_error(&render, &photograph, view);
}

/* Renders a view again for its LPIPS. */
static pags_result add_lpips(pags_report_views *views, pags_report_view *view, pags_composition *composition,
                             pags_frame *frame, const pags_html_report_settings *settings) {
  PAGS_AUTO(pags_photograph_destroy) pags_photograph photograph = {0};
  PAGS_AUTO(pags_image_destroy) pags_image render = {0};
  bool there;
  PAGS_TRY(render_view(views, view, composition, frame, &render, &photograph, &there));
  return there ? pags_view_score_lpips(settings->lpips, &render, &photograph, settings->session->tasks, &view->score)
               : PAGS_OK;
}

pags_result pags_report_views_draw(pags_report_views *views, pags_composition *composition,
                                   const pags_html_report_settings *settings) {
  const double begun = pags_seconds();
  PAGS_AUTO(pags_frame_destroy_auto) pags_frame *frame = NULL;
  PAGS_TRY(pags_frame_create(settings->session->tasks, &frame));
  for (int64_t i = 0; i < views->count; i = next_spread(i, views->count)) {
    if (views->items[i].photograph < 0 && !views->items[i].shown)
      continue; /* nothing to measure, and no picture */
    if (settings->cancel && *settings->cancel)
      return PAGS_CANCELLED;
    if (settings->seconds > 0 && views->drawn > 0 && pags_seconds() - begun > settings->seconds)
      break;
    PAGS_TRY(draw_view(views, &views->items[i], composition, frame, settings));
    views->drawn++;
    if (pags_progress_due(settings->progress))
      pags_progress_show(settings->progress, "report: view %lld of %lld", (long long)views->drawn,
                         (long long)views->count);
  }

  /* LPIPS takes many times as long as drawing: it gets the time that is left, and at least one view. */
  for (int64_t i = 0; settings->lpips && i < views->count; i = next_spread(i, views->count)) {
    if (settings->cancel && *settings->cancel)
      return PAGS_CANCELLED;
    if (settings->seconds > 0 && i > 0 && pags_seconds() - begun > settings->seconds)
      break;
    if (isnan(views->items[i].score.psnr[PAGS_REGION_WHOLE]))
      continue;
    PAGS_TRY(add_lpips(views, &views->items[i], composition, frame, settings));
    views->with_lpips += !isnan(views->items[i].score.lpips);
    if (pags_progress_due(settings->progress))
      pags_progress_show(settings->progress, "report: LPIPS of view %lld of %lld", (long long)views->with_lpips,
                         (long long)views->count);
  }

  /* The mean over the views that were measured. */
  PAGS_AUTOFREE pags_view_score *scores = calloc((size_t)views->count + 1, sizeof *scores);
  int64_t count = 0;
  PAGS_CHECK_MEMORY(scores, "%lld views", (long long)views->count);
  for (int64_t i = 0; i < views->count; i++)
    if (!isnan(views->items[i].score.psnr[PAGS_REGION_WHOLE])) {
      scores[count] = views->items[i].score;
      scores[count++].test = 1;
    }
  views->mean = pags_view_scores_mean(scores, count, 1);
  return PAGS_OK;
}
