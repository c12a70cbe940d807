/* SPDX-License-Identifier: Apache-2.0 */
/* The state of a training run: its models, their tracks, the sky, the exposures and a few numbers; see state.h. */
#include "train/state.h"

#include "base/memory.h"

pags_result pags_state_create(pags_train_state *state, const pags_schedule *schedule, int64_t stop, int64_t models) {
  *state = (pags_train_state){.schedule = *schedule, .stop = stop, .cap = schedule->config.size_limit.max_gaussians};
  atomic_flag_clear(&state->nonfinite.busy);
  state->models = calloc((size_t)(models > 0 ? models : 1), sizeof *state->models);
  PAGS_CHECK_MEMORY(state->models, "%lld models", (long long)models);
  return PAGS_OK;
}

void pags_state_destroy(pags_train_state *state) {
  for (int64_t i = 0; i < state->model_count; i++)
    pags_model_destroy(&state->models[i]);
  free(state->models);
  pags_track_poses_destroy(&state->tracks);
  pags_sky_fit_destroy(&state->sky);
  pags_exposures_destroy(&state->exposures);
  pags_camera_poses_destroy(&state->cameras);
  pags_photometry_destroy(&state->photometry);
  *state = (pags_train_state){0};
}

pags_result pags_state_add_model(pags_train_state *state, int64_t object, double extent, pags_gaussians *g) {
  pags_schedule schedule = state->schedule;
  schedule.extent = extent;
  pags_train_model *model = &state->models[state->model_count];
  PAGS_TRY(pags_model_create(model, &schedule, state->stop, g));
  model->object = object;
  model->step = state->step;
  state->model_count++;
  return PAGS_OK;
}

int64_t pags_state_gaussian_count(const pags_train_state *state) {
  int64_t count = 0;
  for (int64_t i = 0; i < state->model_count; i++)
    count += state->models[i].total;
  return count;
}

void pags_state_set_step(pags_train_state *state, int64_t step) {
  state->step = step;
  for (int64_t i = 0; i < state->model_count; i++)
    state->models[i].step = step;
}

void pags_state_settle(pags_train_state *state, pags_tasks *tasks) {
  for (int64_t i = 0; i < state->model_count; i++)
    pags_adam_settle(&state->models[i].adam, &state->models[i].gaussians, state->step, tasks);
}

void pags_state_flush(pags_train_state *state, pags_tasks *tasks) {
  for (int64_t i = 0; i < state->model_count; i++)
    pags_adam_flush(&state->models[i].adam, &state->models[i].gaussians, state->step, tasks);
}

pags_result pags_state_retime(pags_train_state *state, const pags_schedule *schedule, int64_t stop) {
  state->schedule = *schedule;
  state->stop = stop;
  for (int64_t i = 0; i < state->model_count; i++) {
    pags_train_model *model = &state->models[i];
    double extent = model->schedule.extent;
    model->schedule = *schedule;
    model->schedule.extent = extent;
    PAGS_TRY(pags_adam_retime(&model->adam, stop));
  }
  return PAGS_OK;
}

void pags_state_fit_box(pags_train_state *s, int64_t model) {
  pags_train_model *m = &s->models[model];
  for (int k = 0; m->object >= 0 && s->schedule.config.objects.box_prune && k < 3; k++)
    m->half_size[k] = 0.5 * s->tracks.objects[m->object].size[k];
}
