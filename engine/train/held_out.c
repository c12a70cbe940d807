/* SPDX-License-Identifier: Apache-2.0 */
/* Measures held-out views between two steps (held_out.c). Pictures are exposed as `pags eval` exposes them. */
#include "train/stages.h"

#include "base/psnr.h"
#include "cluster/shares.h"
#include "threads/record.h"

/* Compares a picture with its photograph, both within 0..1, over the pixels that count. */
static void compare(const pags_picture *picture, const pags_photo *photo, const pags_camera *camera,
                    pags_measured_view *out) {
  const pags_scene_view *const view = &out->shown;
  double sum = 0, uncovered = 0;
  int64_t counted = 0;
  for (int y = 0; y < picture->height; y++) {
    double row = 0;
    for (int x = 0; x < picture->width; x++) {
      const int64_t at = (int64_t)y * photo->stride + x;
      if (photo->mask && photo->mask[at] == 0)
        continue;
      counted++;
      uncovered += (double)picture->transmittance[(int64_t)y * picture->stride + x];
      const double bright =
          pags_photometric_vignetting(&view->photometric, pags_photometric_radius2(camera, x + 0.5, y + 0.5));
      for (int c = 0; c < 3; c++) {
        const double drawn = (double)picture->rgb[c][(int64_t)y * picture->stride + x];
        const double seen = pags_photometric_response(&view->photometric, bright * drawn, NULL);
        const double exposed = fmin(fmax(view->gain[c] * seen + view->offset[c], 0), 1);
        const double away = exposed - photo->rgb[((int64_t)c * photo->height + y) * photo->stride + x] / 255.0;
        row += away * away;
      }
    }
    sum += row;
  }
  out->psnr = counted > 0 ? pags_psnr(sum / (3 * (double)counted)) : (double)NAN;
  out->uncovered = uncovered / (double)counted;
}

/* Draws this rank's view of the round and compares it with its photograph. */
static pags_result measure(pags_trainer *t, int64_t step, const pags_frame_options *options, pags_measured_view *out) {
  const pags_step_view *const own = t->round + t->shared.rank;
  pags_picture picture;
  pags_photo photo;
  PAGS_TRY(pags_photo_cache_get(t->cache, own->view, 1, &photo));
  PAGS_TRY(pags_round_draw(t, step, options, &picture));
  compare(&picture, &photo, &own->camera, out);
  return PAGS_OK;
}

/* Measures `count` views, one a rank. */
static pags_result measure_round(pags_trainer *t, pags_measured_view *views, int count) {
  const int64_t step = t->state.step + 1; /* draws with all steps done, of which this applies the pending ones */
  const pags_frame_options options = pags_view_render_options(t, step);
  pags_transport *const transport = t->shared.transport;
  const int rank = t->shared.rank;
  double all[PAGS_RANKS_MOST][2];
  for (int i = 0; i < count; i++)
    t->round[i] = (pags_step_view){.view = views[i].view, .camera = views[i].shown.camera};
  PAGS_TRY(pags_round_project(t, step, count, &options));
  pags_measured_view *const own = views + (rank < count ? rank : 0);
  PAGS_TRY(pags_transport_agree(transport, rank < count ? measure(t, step, &options, own) : PAGS_OK));
  PAGS_TRY(pags_share_all(transport, (double[]){own->psnr, own->uncovered}, sizeof *all, all));
  for (int i = 0; i < count; i++) {
    views[i].psnr = all[i][0];
    views[i].uncovered = all[i][1];
  }
  return PAGS_OK;
}

pags_result pags_held_out_views(pags_trainer *t, pags_measured_view *views, int count) {
  for (int i = 0; i < count; i += t->ranks)
    PAGS_TRY(measure_round(t, views + i, count - i < t->ranks ? count - i : t->ranks));
  return PAGS_OK;
}

pags_result pags_held_out_measure(pags_trainer *t) {
  const int64_t all = pags_dataset_view_count(t->dataset), held = all - t->view_count;
  const int64_t chosen = held < PAGS_HELD_OUT_VIEWS ? held : PAGS_HELD_OUT_VIEWS;
  pags_held_out *h = &t->held_out;
  if (chosen == 0)
    return PAGS_OK;
  pags_tasks_mark(t->tasks, "held out", NULL);
  pags_scene scene = {0};
  PAGS_TRY(pags_output_list_views(t->dataset, &t->state, &scene));
  PAGS_AUTOFREE pags_scene_view *listed = scene.views;
  pags_measured_view views[PAGS_HELD_OUT_VIEWS];
  h->count = 0;
  for (int64_t i = 0, seen = 0; i < all; i++)
    /* view k of the chosen ones is number (k + 1/2) held / chosen of those held out */
    if (listed[i].test && h->count < chosen && seen++ == (2 * h->count + 1) * held / (2 * chosen))
      views[h->count++] = (pags_measured_view){.view = i, .shown = listed[i]};
  PAGS_TRY(pags_held_out_views(t, views, h->count));

  double sum = 0;
  int known = 0;
  for (int i = 0; i < h->count; i++) {
    h->scores[i].view = views[i].view;
    h->scores[i].psnr = views[i].psnr;
    if (isfinite(views[i].psnr)) {
      sum += views[i].psnr;
      known++;
    }
  }
  h->psnr = known > 0 ? sum / known : (double)NAN;
  h->step = t->state.step;
  return PAGS_OK;
}
