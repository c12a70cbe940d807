/* SPDX-License-Identifier: Apache-2.0 */
/* The end of the trials; see trial_end.h. The photographs kept out moved neither what is on trial nor a Gaussian. Their
 * errors with and without it are compared photograph by photograph, which removes what makes one photograph harder than
 * another. */
#include "train/trial_end.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "maths/maths.h"
#include "train/fit_pose.h"
#include "train/held_out.h"

enum { MOST_VIEWS = 32, MOST_FITTED = 8 };
/* The Gaussians have been trained with what is on trial, which alone brings 0.15 dB where there is nothing to correct,
 * and poses that are each by themselves 0.33. */
static const double least_gain = 0.3, least_gain_alone = 0.6, least_errors = 2.0;

typedef enum trial_of { OF_POSES, OF_LIGHT } trial_of;

typedef struct sums { /* over photographs, of what is gained, dB */
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

bool pags_trials_keep_at(const pags_train_state *s, int64_t step) {
  return (s->cameras.trial.state != PAGS_TRIAL_NONE || s->photometry.trial.state != PAGS_TRIAL_NONE) &&
         step <= pags_trial_end(&s->schedule);
}

/* The view as it is shown without what is on trial and with it. */
static void set_pair(const pags_trainer *t, trial_of what, int64_t view, const pags_scene_view *shown,
                     pags_measured_view pair[2]) {
  pags_measured_view *const without = pair, *const with = pair + 1;
  *without = *with = (pags_measured_view){.view = view, .shown = *shown};
  if (what == OF_POSES)
    memcpy(without->shown.camera.world_from_camera, pags_dataset_view(t->dataset, view)->camera.world_from_camera,
           sizeof without->shown.camera.world_from_camera);
  else
    without->shown.photometric = (pags_photometric){.vignette = {0.0}};
}

/* Chooses at most `most` views of those that are kept out, spread evenly over them; returns their number. */
static int choose(const pags_trainer *t, int64_t most, int64_t chosen[MOST_VIEWS]) {
  int64_t kept = 0, seen = 0;
  int count = 0;
  for (int64_t i = 0; i < t->view_count; i++)
    kept += pags_trial_keeps(i);
  most = kept < most ? kept : most;
  for (int64_t i = 0; i < t->view_count && count < most; i++)
    if (pags_trial_keeps(i) && seen++ == (2 * count + 1) * kept / (2 * most))
      chosen[count++] = t->views[i];
  return count;
}

/* Compares the chosen photographs drawn without what is on trial and with it. */
static pags_result compare(pags_trainer *t, trial_of what, const pags_scene_view *views, sums *gains) {
  pags_measured_view(*const pairs)[2] = malloc(MOST_VIEWS * sizeof *pairs);
  pags_result result = pairs ? PAGS_OK : pags_out_of_memory("the photographs of a trial");
  result = pags_transport_agree(t->shared.transport, result);
  int64_t chosen[MOST_VIEWS];
  const int count = choose(t, MOST_VIEWS, chosen);
  for (int i = 0; result == PAGS_OK && i < count; i++)
    set_pair(t, what, chosen[i], views + chosen[i], pairs[i]);
  if (result == PAGS_OK)
    result = pags_held_out_views(t, pairs[0], 2 * count);
  for (int i = 0; result == PAGS_OK && i < count; i++)
    add(gains, pairs[i][1].psnr - pairs[i][0].psnr);
  free(pairs);
  return result;
}

/* Compares the right half of a photograph, drawn from where it was recorded and from where its left half fits. */
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

/* The same for photographs of a capture, whose corrections say nothing of a photograph kept out: if the poses of these
 * aren't exact, those of the others aren't either. */
static pags_result compare_alone(pags_trainer *t, const pags_scene_view *views, sums *gains) {
  int64_t chosen[MOST_VIEWS];
  const int count = choose(t, MOST_FITTED, chosen);
  for (int i = 0; i < count; i++)
    PAGS_TRY(compare_fitted(t, views + chosen[i], chosen[i], gains));
  return PAGS_OK;
}

static pags_result end(pags_trainer *t, trial_of what, const char *name, pags_trial *trial) {
  sums gains = {0};
  pags_scene scene = {0};
  const bool alone = what == OF_POSES && t->state.cameras.alone;
  pags_result result = pags_output_list_views(t->dataset, &t->state, &scene);
  result = pags_transport_agree(t->shared.transport, result);
  if (result == PAGS_OK && !alone)
    result = compare(t, what, scene.views, &gains);
  else if (result == PAGS_OK && t->ranks == 1) /* a run that goes on on several ranks leaves poses as recorded */
    result = compare_alone(t, scene.views, &gains);
  free(scene.views);
  PAGS_TRY(result);
  const double count = gains.count;
  trial->gain = count > 0 ? gains.sum / count : 0.0;
  trial->uncertain = count > 1 ? sqrt(fmax(gains.squares / count - trial->gain * trial->gain, 0.0) / (count - 1)) : 0.0;
  const bool pays = count > 1 && trial->gain >= (alone ? least_gain_alone : least_gain) &&
                    trial->gain > least_errors * trial->uncertain;
  trial->state = pays ? PAGS_TRIAL_PAID : PAGS_TRIAL_FAILED;
  pags_log_message(PAGS_LOG_INFO, "%s: %+.2f dB (standard error %.2f) on %d photographs kept out: %s", name,
                   trial->gain, trial->uncertain, gains.count, pays ? "kept" : "left as recorded");
  return PAGS_OK;
}

pags_result pags_trials_end(pags_trainer *t) {
  pags_camera_poses *const poses = &t->state.cameras;
  pags_photometry *const light = &t->state.photometry;
  if (t->state.step < pags_trial_end(&t->state.schedule))
    return PAGS_OK;
  if (poses->trial.state == PAGS_TRIAL_RUNS) {
    PAGS_TRY(end(t, OF_POSES, "corrected camera poses", &poses->trial));
    if (poses->trial.state == PAGS_TRIAL_FAILED)
      pags_camera_poses_destroy(poses);
  }
  if (light->trial.state == PAGS_TRIAL_RUNS) {
    PAGS_TRY(end(t, OF_LIGHT, "vignettes and response curves", &light->trial));
    if (light->trial.state == PAGS_TRIAL_FAILED)
      pags_photometry_destroy(light);
  }
  return PAGS_OK;
}
