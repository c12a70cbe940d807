/* SPDX-License-Identifier: Apache-2.0 */
/* Draws views outside of a step; see stages.h. */
#include "train/stages.h"

/* Splats that one frame projects and another draws need what the backward pass needs. */
static pags_frame_options shared_options(const pags_frame_options *options) {
  pags_frame_options shared = *options;
  shared.keep_for_backward = 1;
  return shared;
}

static pags_result project_all(pags_trainer *t, int64_t step, int count, const pags_frame_options *options) {
  pags_render_context context = {t, step, 0};
  for (int i = 0; i < count; i++) {
    pags_view_render_compose(t, t->round[i].view);
    PAGS_TRY(pags_view_render_prepare(t, step));
    PAGS_TRY(pags_shared_views_project(&t->shared, i, t->render.frame, t->render.parts, t->render.part_count,
                                       &t->round[i].camera, options, pags_view_render_touch, &context));
  }
  return PAGS_OK;
}

pags_result pags_round_project(pags_trainer *t, int64_t step, int count, const pags_frame_options *options) {
  if (t->ranks == 1)
    return PAGS_OK;
  const pags_frame_options shared = shared_options(options);
  pags_shared_views_begin(&t->shared, count);
  return pags_shared_views_send(&t->shared, project_all(t, step, count, &shared));
}

bool pags_round_draws(const pags_trainer *t, int count) {
  return t->shared.rank < count;
}

pags_result pags_round_draw(pags_trainer *t, int64_t step, const pags_frame_options *options, pags_picture *picture) {
  const pags_step_view *const own = t->round + t->shared.rank;
  if (t->ranks == 1) {
    pags_view_render_compose(t, own->view);
    return pags_view_render_draw(t, step, &own->camera, options, picture);
  }
  const pags_frame_options shared = shared_options(options);
  return pags_shared_views_draw(&t->shared, t->render.frame, false, t->state.models[0].gaussians.alpha_min,
                                &own->camera, &shared, picture);
}
