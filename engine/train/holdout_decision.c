/* SPDX-License-Identifier: Apache-2.0 */
/* Evaluates holdout tests; see stages.h. The holdout photographs have changed neither the correction nor a
 * Gaussian. Their errors with and without the correction are compared per photograph, which removes the differences in
 * difficulty between photographs. */
#include "train/stages.h"

#include "base/log.h"

enum { MOST_VIEWS = 32, MOST_FITTED = 8 };
/* The Gaussians were trained with the correction, which alone brings 0.15 dB where there is nothing to correct; with
 * independent poses it is 0.33 dB. */
static const double least_gain = 0.3, least_gain_alone = 0.6, least_errors = 2.0;

typedef struct sums { /* of the gains of photographs, dB */
  int count;
  double sum, squares;
} sums;

static void add(sums *s, double gain) {
  if (!isfinite(gain)) /* no pixel of the photograph counts */
    return;
  s->count++;
  s->sum += gain;
  s->squares += gain * gain;
}

bool pags_holdout_tests_active(const pags_train_state *s, int64_t step) {
  return (s->cameras.holdout.state != PAGS_HOLDOUT_NONE || s->photometry.holdout.state != PAGS_HOLDOUT_NONE) &&
         step <= pags_holdout_test_until(&s->schedule);
}

/* Chooses at most `most` of the holdout views, evenly spaced; returns their number. */
static int choose(const pags_trainer *t, int64_t most, int64_t chosen[MOST_VIEWS]) {
  int64_t kept = 0, seen = 0;
  int count = 0;
  for (int64_t i = 0; i < t->view_count; i++)
    kept += pags_is_holdout_view(i);
  most = kept < most ? kept : most;
  for (int64_t i = 0; i < t->view_count && count < most; i++)
    if (pags_is_holdout_view(i) && seen++ == (2 * count + 1) * kept / (2 * most))
      chosen[count++] = t->views[i];
  return count;
}

/* Adds the gains of the chosen photographs with the correction. */
static pags_result compare(pags_trainer *t, bool of_poses, const pags_scene_view *views, sums *gains) {
  PAGS_AUTOFREE pags_measured_view(*pairs)[2] = malloc(MOST_VIEWS * sizeof *pairs);
  PAGS_TRY(pags_transport_agree(t->shared.transport,
                                pairs ? PAGS_OK : pags_out_of_memory("the photographs of a holdout test")));
  int64_t chosen[MOST_VIEWS];
  const int count = choose(t, MOST_VIEWS, chosen);
  for (int i = 0; i < count; i++) { /* without the correction, and with it */
    pags_measured_view *const without = &pairs[i][0];
    *without = pairs[i][1] = (pags_measured_view){.view = chosen[i], .shown = views[chosen[i]]};
    if (of_poses)
      memcpy(without->shown.camera.world_from_camera,
             pags_dataset_view(t->dataset, chosen[i])->camera.world_from_camera,
             sizeof without->shown.camera.world_from_camera);
    else
      without->shown.photometric = (pags_photometric){.vignette = {0.0}};
  }
  PAGS_TRY(pags_held_out_views(t, pairs[0], 2 * count));
  for (int i = 0; i < count; i++)
    add(gains, pairs[i][1].psnr - pairs[i][0].psnr);
  return PAGS_OK;
}

/* Compares the right half of a photograph, drawn with the recorded pose and with the pose fitted to its left half. */
static pags_result compare_fitted(pags_trainer *t, const pags_scene_view *shown, int64_t view, sums *gains) {
  pags_render_context context = {t, t->state.step + 1, 0};
  pags_frame_options options = pags_view_render_options(t, context.step);
  pags_fitted_pose fitted;
  pags_photo photo;
  PAGS_TRY(pags_photo_cache_get(t->cache, view, 1, &photo));
  pags_frame_options_expose(&options, shown->gain, shown->offset);
  pags_view_render_compose(t, view);
  PAGS_TRY(pags_view_render_prepare(t, context.step));
  PAGS_TRY(pags_fit_pose(t->render.frame, t->render.parts, t->render.part_count, &shown->camera, &options,
                         pags_view_render_touch, &context, &photo, &fitted));
  add(gains, fitted.fitted - fitted.given);
  return PAGS_OK;
}

static pags_result end(pags_trainer *t, bool of_poses, const char *name, pags_holdout_test *test) {
  sums gains = {0};
  pags_scene scene = {0};
  const bool alone = of_poses && t->state.cameras.alone;
  const pags_result listed = pags_output_list_views(t->dataset, &t->state, &scene);
  PAGS_AUTOFREE pags_scene_view *views = scene.views;
  PAGS_TRY(pags_transport_agree(t->shared.transport, listed));
  if (!alone) {
    PAGS_TRY(compare(t, of_poses, views, &gains));
  } else if (t->ranks == 1) { /* a run that continues on several ranks keeps the recorded poses */
    /* In a capture, corrections of other photographs don't apply to a holdout photograph. If the poses of holdout
     * photographs are inexact, the other poses are, too. */
    int64_t chosen[MOST_VIEWS];
    const int fitted = choose(t, MOST_FITTED, chosen);
    for (int i = 0; i < fitted; i++)
      PAGS_TRY(compare_fitted(t, views + chosen[i], chosen[i], &gains));
  }
  const double count = gains.count;
  test->gain = count > 0 ? gains.sum / count : 0.0;
  test->uncertain = count > 1 ? sqrt(fmax(gains.squares / count - test->gain * test->gain, 0.0) / (count - 1)) : 0.0;
  const bool pays =
      count > 1 && test->gain >= (alone ? least_gain_alone : least_gain) && test->gain > least_errors * test->uncertain;
  test->state = pays ? PAGS_HOLDOUT_PASSED : PAGS_HOLDOUT_FAILED;
  pags_log_message(PAGS_LOG_INFO, "%s: %+.2f dB (standard error %.2f) on %d photographs kept out of training: %s", name,
                   test->gain, test->uncertain, gains.count, pays ? "kept" : "left as recorded");
  return PAGS_OK;
}

pags_result pags_holdout_tests_decide(pags_trainer *t) {
  pags_camera_poses *const poses = &t->state.cameras;
  pags_photometry *const light = &t->state.photometry;
  if (t->state.step < pags_holdout_test_until(&t->state.schedule))
    return PAGS_OK;
  if (poses->holdout.state == PAGS_HOLDOUT_RUNNING) {
    PAGS_TRY(end(t, true, "corrected camera poses", &poses->holdout));
    if (poses->holdout.state == PAGS_HOLDOUT_FAILED)
      pags_camera_poses_destroy(poses);
  }
  if (light->holdout.state == PAGS_HOLDOUT_RUNNING) {
    PAGS_TRY(end(t, false, "vignettes and response curves", &light->holdout));
    if (light->holdout.state == PAGS_HOLDOUT_FAILED)
      pags_photometry_destroy(light);
  }
  return PAGS_OK;
}
