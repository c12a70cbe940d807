/* SPDX-License-Identifier: Apache-2.0 */
/* Evaluates holdout tests; see stages.h. The holdout photographs have changed neither the correction nor a
 * Gaussian. Their errors with and without the correction are compared per photograph, which removes the differences in
 * difficulty between photographs.
 *
 * In a capture, the exposures of other photographs tell little about a photograph's. There exposures are tested on
 * photographs that they were fitted to: six numbers can't learn a photograph. In a driving set the exposure of a
 * holdout photograph lies between those of its camera's neighbours in time, as that of a held-out view. */
#include "train/stages.h"

#include "base/log.h"

enum { MOST_VIEWS = 32, MOST_FITTED = 8 };

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

static pags_holdout_test *test_of(pags_train_state *s, pags_train_decision part) {
  return part == PAGS_DECISION_EXPOSURE ? &s->exposures.holdout
         : part == PAGS_DECISION_POSES  ? &s->cameras.holdout
                                        : &s->photometry.holdout;
}

bool pags_holdout_tests_active(const pags_trainer *t, int64_t step) {
  const pags_train_state *const s = &t->state;
  const bool exposures = s->exposures.holdout.state != PAGS_HOLDOUT_NONE && pags_dataset_fps(t->dataset) > 0.0;
  return (exposures || s->cameras.holdout.state != PAGS_HOLDOUT_NONE ||
          s->photometry.holdout.state != PAGS_HOLDOUT_NONE) &&
         step <= pags_holdout_test_until(&s->schedule);
}

/* The photographs of a test. */
typedef enum choice { RESERVED, TRAINED, HELD_OUT } choice;

static bool is_of(const pags_trainer *t, choice what, int64_t view, int64_t index) {
  return what == HELD_OUT
             ? pags_dataset_view(t->dataset, view)->test
             : !pags_dataset_view(t->dataset, view)->test && pags_is_holdout_view(index) == (what == RESERVED);
}

/* Chooses at most `most` views, evenly spaced; returns their number. */
static int choose(const pags_trainer *t, int64_t most, choice what, int64_t chosen[MOST_VIEWS]) {
  int64_t kept = 0;
  int count = 0;
  for (int pass = 0; pass < 2; pass++) { /* count, then choose */
    int64_t seen = 0, index = 0;         /* of the training views */
    for (int64_t i = 0; i < pags_dataset_view_count(t->dataset); i++) {
      const bool found = is_of(t, what, i, index);
      index += !pags_dataset_view(t->dataset, i)->test;
      if (found && pass == 1 && count < most && seen == (2 * count + 1) * kept / (2 * most))
        chosen[count++] = i;
      seen += found;
    }
    kept = seen;
    most = kept < most ? kept : most;
  }
  return count;
}

/* Adds the gains of the chosen photographs with the correction. */
static pags_result compare(pags_trainer *t, pags_train_decision part, const pags_scene *scene, sums *gains) {
  PAGS_AUTOFREE pags_measured_view(*pairs)[2] = malloc(MOST_VIEWS * sizeof *pairs);
  PAGS_TRY(pags_transport_agree(t->shared.transport,
                                pairs ? PAGS_OK : pags_out_of_memory("the photographs of a holdout test")));
  int64_t chosen[MOST_VIEWS];
  const bool driving = pags_dataset_fps(t->dataset) > 0.0;
  int count = choose(t, MOST_VIEWS, driving ? RESERVED : TRAINED, chosen);
  if (count < 2 && part == PAGS_DECISION_EXPOSURE)
    count = choose(t, MOST_VIEWS, TRAINED, chosen);
  for (int i = 0; i < count; i++) { /* without the correction, and with it */
    pags_measured_view *const with = &pairs[i][1];
    *with = (pags_measured_view){.view = chosen[i], .shown = scene->views[chosen[i]]};
    if (driving && t->state.exposures.count > 0)
      pags_scene_exposure(scene, with->shown.sensor, with->shown.camera.time, with->shown.gain, with->shown.offset);
    pairs[i][0] = *with;
    pags_decision_leave_out(part, t->dataset, chosen[i], &pairs[i][0].shown);
  }
  PAGS_TRY(pags_held_out_views(t, pairs[0], 2 * count));
  double uncovered = 0.0;
  for (int i = 0; i < count; i++) {
    add(gains, pairs[i][1].psnr - pairs[i][0].psnr);
    uncovered += isfinite(pairs[i][1].uncovered) ? pairs[i][1].uncovered / count : 0.0;
  }
  t->state.costs.uncovered = fmin(uncovered, 1.0);
  return PAGS_OK;
}

/* Compares the right halves of at most `most` photographs, drawn with the recorded poses and with poses fitted to the
 * left halves. */
static pags_result compare_fitted(pags_trainer *t, const pags_scene *scene, choice what, int most, sums *gains) {
  int64_t chosen[MOST_VIEWS];
  const int count = choose(t, most, what, chosen);
  for (int i = 0; i < count; i++) {
    pags_render_context context = {t, t->state.step + 1, 0};
    pags_frame_options options = pags_view_render_options(t, context.step);
    const pags_scene_view *const shown = &scene->views[chosen[i]];
    const int level = what == RESERVED ? 1
                                       : pags_schedule_level(&t->state.schedule, context.step, shown->camera.width,
                                                             shown->camera.height);
    const pags_camera camera = pags_camera_downscale(&shown->camera, level);
    pags_fitted_pose fitted;
    pags_photo photo;
    PAGS_TRY(pags_photo_cache_get(t->cache, chosen[i], level, &photo));
    pags_frame_options_expose(&options, shown->gain, shown->offset);
    pags_view_render_compose(t, chosen[i]);
    PAGS_TRY(pags_view_render_prepare(t, context.step));
    PAGS_TRY(pags_fit_pose(t->render.frame, t->render.parts, t->render.part_count, &camera, &options,
                           pags_view_render_touch, &context, &photo, &fitted));
    add(gains, fitted.fitted - fitted.given);
  }
  return PAGS_OK;
}

/* Reserved photographs are in training only after the test: exposures of driving sets lie between those of others. */
static pags_result list_views(pags_trainer *t, pags_scene *scene) {
  const pags_result listed = pags_output_list_views(t->dataset, &t->state, scene);
  for (int64_t i = 0; listed == PAGS_OK && i < t->view_count; i++)
    scene->views[t->views[i]].test |= pags_is_holdout_view(i) && pags_holdout_tests_active(t, 0);
  return pags_transport_agree(t->shared.transport, listed);
}

/* Ends the test of a part; *kept: it stays. A capture whose poses aren't corrected has none, but its poses are looked
 * at: in two to four held-out photographs, at the size of training, which takes at most as long as 160 steps. */
static pags_result end(pags_trainer *t, pags_train_decision part, const char *name, bool *kept) {
  pags_stage_time clock = pags_stage_now();
  pags_holdout_test *const test = test_of(&t->state, part);
  sums gains = {0};
  pags_scene scene = {0};
  const bool running = test->state == PAGS_HOLDOUT_RUNNING, capture = pags_dataset_fps(t->dataset) <= 0.0;
  const pags_result listed = list_views(t, &scene);
  PAGS_AUTOFREE pags_scene_view *views = scene.views;
  PAGS_TRY(listed);
  if (!capture || part == PAGS_DECISION_EXPOSURE) {
    PAGS_TRY(compare(t, part, &scene, &gains));
  } else if (t->ranks == 1) { /* a run that continues on several ranks keeps the recorded poses */
    /* In a capture, corrections of other photographs don't apply to a holdout photograph. If the poses of holdout
     * photographs are inexact, the other poses are, too. */
    PAGS_TRY(compare_fitted(t, &scene, running ? RESERVED : HELD_OUT,
                            running                           ? MOST_FITTED
                            : t->state.schedule.length < 4000 ? 2
                                                              : 4,
                            &gains));
  }
  const double count = gains.count;
  test->gain = count > 1 ? gains.sum / count : (double)NAN;
  test->uncertain = count > 1 ? sqrt(fmax(gains.squares / count - test->gain * test->gain, 0.0) / (count - 1)) : 0.0;
  const bool pays = pags_holdout_pays(test, part, capture);
  *kept = pays && running;
  test->state = *kept ? PAGS_HOLDOUT_PASSED : PAGS_HOLDOUT_FAILED;
  if (running && !*kept)
    PAGS_TRY(pags_transport_agree(t->shared.transport,
                                  pags_decision_bytes(part, t->dataset, &scene, &t->state.costs.saved[part])));
  pags_log_message(PAGS_LOG_INFO, "%s: %+.2f dB (standard error %.2f) on %d photographs%s: %s", name, test->gain,
                   test->uncertain, gains.count,
                   capture && part == PAGS_DECISION_EXPOSURE ? "" : " kept out of training",
                   *kept  ? "kept"
                   : pays ? "left as recorded; --set camera_poses=1 corrects them"
                          : "left as recorded");
  pags_stage_lap(&clock, &t->ms.tests[part]);
  return PAGS_OK;
}

pags_result pags_holdout_tests_decide(pags_trainer *t) {
  pags_train_state *const s = &t->state;
  bool kept = true;
  if (s->step < pags_holdout_test_until(&s->schedule))
    return PAGS_OK;
  const bool looks = s->exposures.holdout.state == PAGS_HOLDOUT_RUNNING && pags_dataset_fps(t->dataset) <= 0.0 &&
                     s->cameras.holdout.state == PAGS_HOLDOUT_NONE && t->ranks == 1 && s->schedule.length >= 1000;
  if (looks || s->cameras.holdout.state == PAGS_HOLDOUT_RUNNING)
    PAGS_TRY(end(t, PAGS_DECISION_POSES, looks ? "other camera poses" : "corrected camera poses", &kept));
  if (!kept)
    pags_camera_poses_destroy(&s->cameras);
  kept = true;
  if (s->photometry.holdout.state == PAGS_HOLDOUT_RUNNING)
    PAGS_TRY(end(t, PAGS_DECISION_LIGHT, "vignettes and response curves", &kept));
  if (!kept)
    pags_photometry_destroy(&s->photometry);
  kept = true;
  if (s->exposures.holdout.state == PAGS_HOLDOUT_RUNNING)
    PAGS_TRY(end(t, PAGS_DECISION_EXPOSURE, "exposures", &kept));
  if (!kept)
    pags_exposures_destroy(&s->exposures);
  return PAGS_OK;
}
