/* SPDX-License-Identifier: Apache-2.0 */
/* Rendering with a time budget per frame. A controller learns from measured frame times what each of eight quality
 * steps costs, and picks the step of the next frame. The steps reduce the quality of what isn't critical (S_sem <=
 * 0.5); critical Gaussians keep theirs but for a few grey levels. */
#include <assert.h>
#include <math.h>
#include <pags/deadline.h>
#include <stdlib.h>
#include <string.h>

#include "frame/stages.h"

#include "base/memory.h"

/* The steps (pags_deadline_step): eps, SH degrees taken off, smallest opacity x area in px, sampled or not. Sorted by
 * falling cost, which was measured on trained streets. */
#define GREY (1.0f / 255.0f)
static const pags_deadline_step steps[PAGS_DEADLINE_STEPS] = {
    {0.0f, 0, 0.0f, 0}, {GREY, 0, 0.0f, 0},     {GREY, 3, 0.25f, 0},    {GREY, 3, 1.0f, 0},
    {GREY, 3, 0.0f, 1}, {2 * GREY, 3, 1.0f, 1}, {4 * GREY, 3, 4.0f, 1}, {4 * GREY, 3, 16.0f, 1}};

/* Initial guesses of each step's cost as a fraction of a full frame's; measurements replace them. */
static const double first_shares[PAGS_DEADLINE_STEPS] = {1.0, 0.9, 0.85, 0.8, 0.65, 0.6, 0.55, 0.5};

#define MARGIN 1.12 /* frame times along a camera path vary by about 12 % from frame to frame */

const pags_deadline_step *pags_deadline_steps(void) {
  return steps;
}

pags_deadline_controller pags_deadline_controller_begin(double target_ms) {
  pags_deadline_controller out = {.target = target_ms, .last_step = -1};
  memcpy(out.share, first_shares, sizeof out.share);
  return out;
}

/* Updates the cost shares after a frame of `ms` milliseconds at the current step, if the last frame was drawn at
 * another step: their views hardly differ, so the ratio of the times is the ratio of the steps' costs. */
static void learn(pags_deadline_controller *c, double ms) {
  const int k = c->step;
  if (c->last_step < 0 || c->last_step == k || !(c->last_ms > 0.0))
    return;
  const double told = c->share[c->last_step] * ms / c->last_ms;
  if (k == 0) { /* share[0] is fixed at 1, so all other shares are scaled instead, half of the way on a log scale */
    const double by = fmin(fmax(c->share[c->last_step] / told, 0.5), 2.0);
    for (int j = 1; j < PAGS_DEADLINE_STEPS; j++)
      c->share[j] *= sqrt(by);
  } else {
    c->share[k] = 0.5 * (c->share[k] + told);
  }
  c->share[k] = k == 0 ? 1.0 : c->share[k];
  for (int j = 1; j < PAGS_DEADLINE_STEPS; j++) { /* keep the shares falling: a later step never costs more */
    c->share[j] = fmin(fmax(c->share[j], 0.01), 1.0);
    if (j < k)
      c->share[j] = fmax(c->share[j], c->share[k]);
    else if (j > k)
      c->share[j] = fmin(c->share[j], c->share[k]);
  }
}

void pags_deadline_controller_tell(pags_deadline_controller *c, double ms) {
  if (!(ms > 0.0) || !isfinite(ms))
    return;
  learn(c, ms);
  const double now = ms / c->share[c->step];
  c->full = now > c->full ? now : 0.7 * c->full + 0.3 * now; /* a rise counts at once, a fall only gradually */
  int next = 0;
  while (next + 1 < PAGS_DEADLINE_STEPS && c->full * c->share[next] * MARGIN > c->target)
    next++;
  c->last_step = c->step;
  c->last_ms = ms;
  c->step = next < c->step - 1 ? c->step - 1 : next;
}

struct pags_deadline {
  pags_deadline_controller controller;
  pags_frame *frame;
  uint8_t *critical; /* per id: 1 where the Gaussian's priority is above 0.5 */
  int64_t count;     /* ids */
  int64_t room;      /* ids that `critical` has room for */
};

pags_result pags_deadline_create(pags_tasks *tasks, double target_ms, const float *priority, int64_t count,
                                 pags_deadline **out) {
  assert(target_ms > 0.0 && count >= 0);
  *out = NULL;
  pags_deadline *const b = calloc(1, sizeof *b);
  if (!b)
    return pags_out_of_memory("a frame");
  b->controller = pags_deadline_controller_begin(target_ms);
  pags_result result = pags_deadline_set_priorities(b, priority, count);
  if (result == PAGS_OK)
    result = pags_frame_create(tasks, &b->frame);
  if (result != PAGS_OK) {
    pags_deadline_destroy(b);
    return result;
  }
  *out = b;
  return PAGS_OK;
}

pags_result pags_deadline_set_priorities(pags_deadline *b, const float *priority, int64_t count) {
  if (!b->critical || count > b->room) {
    const int64_t room = count + (b->critical ? count / 4 : 0) + 1;
    uint8_t *const grown = realloc(b->critical, (size_t)room);
    if (!grown)
      return pags_out_of_memory("the priorities of %lld Gaussians", (long long)count);
    b->critical = grown;
    b->room = room;
  }
  b->count = count;
  for (int64_t i = 0; i < count; i++)
    b->critical[i] = priority && priority[i] > 0.5f;
  return PAGS_OK;
}

void pags_deadline_destroy(pags_deadline *budget) {
  if (!budget)
    return;
  pags_frame_destroy(budget->frame);
  free(budget->critical);
  free(budget);
}

pags_result pags_deadline_render_step(pags_deadline *b, int step, const pags_part *parts, int part_count,
                                      const pags_camera *camera, const pags_frame_options *options, pags_picture *out,
                                      pags_deadline_result *facts) {
  assert(step >= 0 && step < PAGS_DEADLINE_STEPS && options->early_z != PAGS_EARLY_Z_PAPER &&
         options->order == PAGS_ORDER_DEPTH);
  const double begun = pags_clock_ms();
  const pags_deadline_step *const s = steps + step;
  frame_variable_rate rate = {.critical = b->critical, .count = b->count, .full_tiles = 1.0};
  pags_frame_options reduced = *options;
  if (s->eps > 0.0f) {
    reduced.early_z_eps = options->early_z == PAGS_EARLY_Z_BOUNDED ? fmaxf(options->early_z_eps, s->eps) : s->eps;
    reduced.early_z = PAGS_EARLY_Z_BOUNDED;
    reduced.exp_degree = 3;
  }
  reduced.rest_cut = s->cut;
  reduced.rest_sh_less = s->sh_less;
  b->frame->variable_rate = s->sampled ? &rate : NULL;
  const pags_result result = pags_frame_render(b->frame, parts, part_count, camera, &reduced, NULL, NULL, out);
  b->frame->variable_rate = NULL;
  PAGS_TRY(result);
  *facts =
      (pags_deadline_result){.step = step, .full_tiles = rate.full_tiles, .stats = *pags_frame_stats_get(b->frame)};
  facts->ms = pags_clock_ms() - begun;
  facts->met = facts->ms <= b->controller.target;
  return PAGS_OK;
}

pags_result pags_deadline_render(pags_deadline *b, const pags_part *parts, int part_count, const pags_camera *camera,
                                 const pags_frame_options *options, pags_picture *out, pags_deadline_result *facts) {
  const bool first = b->controller.last_step < 0;
  PAGS_TRY(pags_deadline_render_step(b, b->controller.step, parts, part_count, camera, options, out, facts));
  pags_deadline_controller_tell(&b->controller, facts->ms);
  if (!first || facts->met)
    return PAGS_OK;
  PAGS_TRY(pags_deadline_render_step(b, b->controller.step, parts, part_count, camera, options, out, facts));
  pags_deadline_controller_tell(&b->controller, facts->ms);
  return PAGS_OK;
}
