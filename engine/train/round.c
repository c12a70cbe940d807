/* SPDX-License-Identifier: Apache-2.0 */
/* Draws views outside of a step; see stages.h. */
#include "train/stages.h"

pags_result pags_round_project(pags_trainer *t, int64_t step, int count, const pags_frame_options *options) {
  if (t->ranks == 1)
    return PAGS_OK;
  pags_frame_options shared = *options;
  shared.keep_for_backward = 1; /* splats that one frame projects and another draws need what the backward pass needs */
  pags_shared_views_begin(&t->shared, count);
  pags_render_context context = {t, step, 0};
  pags_result mine = PAGS_OK;
  for (int i = 0; i < count && mine == PAGS_OK; i++) {
    pags_view_render_compose(t, t->round[i].view);
    mine = pags_view_render_prepare(t, step);
    if (mine == PAGS_OK)
      mine = pags_shared_views_project(&t->shared, i, t->render.frame, t->render.parts, t->render.part_count,
                                       &t->round[i].camera, &shared, pags_view_render_touch, &context);
  }
  return pags_shared_views_send(&t->shared, mine);
}

pags_result pags_round_draw(pags_trainer *t, int64_t step, const pags_frame_options *options, pags_picture *picture) {
  const pags_step_view *const own = t->round + t->shared.rank;
  if (t->ranks == 1) {
    pags_view_render_compose(t, own->view);
    return pags_view_render_draw(t, step, &own->camera, options, picture);
  }
  pags_frame_options shared = *options;
  shared.keep_for_backward = 1;
  return pags_shared_views_draw(&t->shared, t->render.frame, false, t->state.models[0].gaussians.alpha_min,
                                &own->camera, &shared, picture);
}
