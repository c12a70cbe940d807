/* SPDX-License-Identifier: Apache-2.0 */
/* The end of the trials; see trial_end.h. The photographs kept out moved neither what is on trial nor a Gaussian. Their
 * errors with and without it are compared photograph by photograph, which removes what makes one photograph harder than
 * another. */
#include "train/trial_end.h"

#include <math.h>
#include <string.h>

#include "base/log.h"
#include "maths/maths.h"
#include "train/held_out.h"

enum { MOST_VIEWS = 32 };
/* The Gaussians have been trained with what is on trial, which alone brings 0.15 dB where there is nothing to correct.
 */
static const double least_gain = 0.3, least_errors = 2.0;

typedef enum trial_of { OF_POSES, OF_LIGHT } trial_of;

bool pags_trials_keep_at(const pags_train_state *s, int64_t step) {
  return (s->cameras.trial.state != PAGS_TRIAL_NONE || s->photometry.trial.state != PAGS_TRIAL_NONE) &&
         step <= pags_trial_end(&s->schedule);
}

/* PSNR without what is on trial, subtracted from that with it. */
static pags_result gain_of(pags_trainer *t, trial_of what, int64_t view, double *gain) {
  const pags_view *const v = pags_dataset_view(t->dataset, view);
  const pags_camera corrected = pags_view_render_camera(t, view, 1);
  pags_camera recorded = corrected;
  memcpy(recorded.world_from_camera, v->camera.world_from_camera, sizeof recorded.world_from_camera);
  pags_scene_view with = {.gain = {1, 1, 1}};
  double value[6], before, after;
  if (t->state.exposures.count > 0) {
    pags_exposures_value(&t->state.exposures, t->dataset, view, value);
    for (int c = 0; c < 3; c++) {
      with.gain[c] = value[c];
      with.offset[c] = value[3 + c];
    }
  }
  with.light = pags_photometry_light(&t->state.photometry, v->sensor);
  pags_scene_view without = with;
  if (what == OF_LIGHT)
    without.light = (pags_light){.vignette = {0.0}};
  PAGS_TRY(pags_held_out_view(t, view, what == OF_POSES ? &recorded : &corrected, &without, &before));
  PAGS_TRY(pags_held_out_view(t, view, &corrected, &with, &after));
  *gain = after - before;
  return PAGS_OK;
}

static pags_result end(pags_trainer *t, trial_of what, const char *name, pags_trial *trial) {
  int64_t kept = 0, seen = 0, count = 0;
  double sum = 0.0, squares = 0.0;
  for (int64_t i = 0; i < t->view_count; i++)
    kept += pags_trial_keeps(i);
  const int64_t most = kept < MOST_VIEWS ? kept : MOST_VIEWS;
  for (int64_t i = 0, chosen = 0; i < t->view_count && chosen < most; i++) {
    double gain;
    if (!pags_trial_keeps(i) || seen++ != (2 * chosen + 1) * kept / (2 * most))
      continue;
    chosen++;
    PAGS_TRY(gain_of(t, what, t->views[i], &gain));
    if (!isfinite(gain)) /* no pixel of the photograph counts */
      continue;
    count++;
    sum += gain;
    squares += gain * gain;
  }
  trial->gain = count > 0 ? sum / (double)count : 0.0;
  trial->uncertain =
      count > 1 ? sqrt(fmax(squares / (double)count - trial->gain * trial->gain, 0.0) / (double)(count - 1)) : 0.0;
  const bool pays = count > 1 && trial->gain >= least_gain && trial->gain > least_errors * trial->uncertain;
  trial->state = pays ? PAGS_TRIAL_PAID : PAGS_TRIAL_FAILED;
  pags_log_message(PAGS_LOG_INFO, "%s: %+.2f dB (standard error %.2f) on %lld photographs kept out: %s", name,
                   trial->gain, trial->uncertain, (long long)count, pays ? "kept" : "left as recorded");
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
