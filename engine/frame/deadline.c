/* SPDX-License-Identifier: Apache-2.0 */
/* Rendering with a time budget per frame. A controller learns from measured frame times what each quality step costs,
 * and picks the step of the next frame. The steps first reduce the quality of Gaussians that aren't critical
 * (S_sem <= 0.5); critical Gaussians change by a few grey levels only. The last steps make the picture smaller. */
#include <assert.h>
#include <math.h>
#include <pags/deadline.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "frame/owners.h"
#include "frame/stages.h"
#include "maths/maths.h"

/* ---- The steps ---- */

/* eps, SH degrees taken off, smallest opacity x area in px, sampled or not, divisor of the sides. Sorted by falling
 * cost, which was measured on trained streets. Smaller pictures aren't sampled: the distance of their samples would be
 * 6 to 16 pixels of the requested picture. */
#define GREY (1.0f / 255.0f)
static const pags_deadline_step steps[PAGS_DEADLINE_STEPS] = {
    {0.0f, 0, 0.0f, 0, 1},       {GREY, 0, 0.0f, 0, 1},     {GREY, 3, 0.25f, 0, 1},    {GREY, 3, 1.0f, 0, 1},
    {2 * GREY, 3, 4.0f, 0, 1},   {2 * GREY, 3, 1.0f, 1, 1}, {2 * GREY, 3, 4.0f, 1, 1}, {2 * GREY, 3, 16.0f, 1, 1},
    {4 * GREY, 3, 1.0f, 0, 1.5}, {4 * GREY, 3, 1.0f, 0, 2}, {4 * GREY, 3, 1.0f, 0, 3}, {4 * GREY, 3, 1.0f, 0, 4}};

/* Initial guesses of each step's cost as a fraction of a full frame's; measurements replace them. */
static const double first_shares[PAGS_DEADLINE_STEPS] = {1.0,  0.95, 0.9,  0.87, 0.83, 0.7,
                                                         0.65, 0.6,  0.55, 0.45, 0.38, 0.34};

const pags_deadline_step *pags_deadline_steps(void) {
  return steps;
}

/* ---- The controller ---- */

#define MARGIN 1.12     /* frame times along a camera path vary by about 12 % from frame to frame */
#define RISE_MARGIN 1.2 /* what a finer step has to promise */
#define OUTLIER 1.25    /* ratio to the expected time above which a frame counts only if the next one exceeds it too */
#define LEAST_HASTE 0.25
#define PAUSE_MS 500 /* a larger gap between pictures begins a new movement */

pags_deadline_controller pags_deadline_controller_begin(double target_ms) {
  pags_deadline_controller out = {
      .target = target_ms, .last = PAGS_DEADLINE_WHOLE_STEPS - 1, .haste = 1, .last_step = -1};
  memcpy(out.share, first_shares, sizeof out.share);
  return out;
}

pags_deadline_controller pags_deadline_controller_begin_live(double target_ms) {
  pags_deadline_controller out = pags_deadline_controller_begin(target_ms);
  out.first = 1;
  out.last = PAGS_DEADLINE_STEPS - 1;
  while (steps[out.step].divisor < 2)
    out.step++;
  return out;
}

/* Updates the cost shares after a frame of `ms` milliseconds at the current step, if the last frame was drawn at
 * another step: their views hardly differ, so the ratio of the times is the ratio of the steps' costs. The ratio is
 * corrected by half on a log scale, and those of the steps in between in proportion; the ratios of other
 * neighbouring steps stay. */
static void learn(pags_deadline_controller *c, double ms) {
  const int k = c->step, last = c->last_step;
  if (last < 0 || last == k)
    return;
  const int fine = k < last ? k : last, coarse = k < last ? last : k;
  const double told = k == coarse ? ms / c->last_ms : c->last_ms / ms;
  const double by = sqrt(fmin(fmax(told * c->share[fine] / c->share[coarse], 0.5), 2.0));
  for (int j = fine + 1; j < PAGS_DEADLINE_STEPS; j++) { /* a later step never costs more */
    const double way = j < coarse ? (double)(j - fine) / (coarse - fine) : 1.0;
    c->share[j] = fmin(fmax(c->share[j] * pags_pow(by, way), 0.002), c->share[j - 1]);
  }
}

void pags_deadline_controller_tell(pags_deadline_controller *c, double ms) {
  if (!(ms > 0.0) || !isfinite(ms))
    return;
  const bool first = c->last_step < 0;
  learn(c, ms);

  /* The expected time of a frame at step 0: a rise counts immediately, a fall gradually, an outlier not at all. A long
   * time at a new step is not an outlier, since the cost of that step may be a wrong guess. */
  const double now = ms / c->share[c->step];
  const bool outlier = now > OUTLIER * c->full && c->step == c->last_step;
  if (!outlier)
    c->full = now > c->full ? now : 0.7 * c->full + 0.3 * now;
  else if (c->last_full > OUTLIER * c->full)
    c->full = fmin(now, c->last_full);
  c->last_full = now;

  int next = c->first;
  while (next < c->last &&
         !(c->full * c->share[next] * (next < c->step ? RISE_MARGIN : MARGIN) <= c->target * c->haste))
    next++;
  c->last_step = c->step;
  c->last_ms = ms;
  c->step = !first && next < c->step - 1 ? c->step - 1 : next;
}

void pags_deadline_controller_pace(pags_deadline_controller *c, double ms, double wanted_ms) {
  if (ms > wanted_ms && ms < PAUSE_MS)
    c->haste = fmax(LEAST_HASTE, 0.93 * c->haste);
  else if (ms < 0.9 * wanted_ms)
    c->haste = fmin(1.0, 1.05 * c->haste);
}

/* ---- The renderer ---- */

struct pags_deadline {
  pags_frame *frame;
  uint8_t *critical; /* per id: 1 where the Gaussian's priority is above 0.5 */
  int64_t count;     /* ids */
  int64_t room;      /* ids that `critical` has room for */
};

pags_result pags_deadline_create(pags_tasks *tasks, const float *priority, int64_t count, pags_deadline **out) {
  assert(count >= 0);
  *out = NULL;
  PAGS_AUTO(pags_deadline_destroy_auto) pags_deadline *d = calloc(1, sizeof *d);
  PAGS_CHECK_MEMORY(d, "a frame");
  PAGS_TRY(pags_deadline_set_priorities(d, priority, count));
  PAGS_TRY(pags_frame_create(tasks, &d->frame));
  *out = pags_take(&d);
  return PAGS_OK;
}

pags_result pags_deadline_set_priorities(pags_deadline *d, const float *priority, int64_t count) {
  if (!d->critical || count > d->room) {
    const int64_t room = count + (d->critical ? count / 4 : 0) + 1;
    uint8_t *const grown = realloc(d->critical, (size_t)room);
    PAGS_CHECK_MEMORY(grown, "the priorities of %lld Gaussians", (long long)count);
    d->critical = grown;
    d->room = room;
  }
  d->count = count;
  for (int64_t i = 0; i < count; i++)
    d->critical[i] = priority && priority[i] > 0.5f;
  return PAGS_OK;
}

void pags_deadline_destroy(pags_deadline *d) {
  if (!d)
    return;
  pags_frame_destroy(d->frame);
  free(d->critical);
  free(d);
}

pags_frame *pags_deadline_frame(pags_deadline *d) {
  return d->frame;
}

pags_result pags_deadline_render_step(pags_deadline *d, int step, const pags_part *parts, int part_count,
                                      const pags_camera *camera, const pags_frame_options *options, pags_picture *out,
                                      pags_deadline_result *facts) {
  assert(step >= 0 && step < PAGS_DEADLINE_STEPS && options->early_z != PAGS_EARLY_Z_PAPER &&
         options->order == PAGS_ORDER_DEPTH);
  const double begun = pags_clock_ms();
  const pags_deadline_step *const s = steps + step;
  frame_variable_rate rate = {.critical = d->critical, .count = d->count, .full_tiles = 1.0};
  pags_camera smaller = *camera; /* with the same field of view */
  if (s->divisor > 1) {
    smaller.width = (int)fmax(floor(camera->width / s->divisor + 0.5), 1);
    smaller.height = (int)fmax(floor(camera->height / s->divisor + 0.5), 1);
    const double across = (double)smaller.width / camera->width, down = (double)smaller.height / camera->height;
    smaller.fx *= across, smaller.cx *= across;
    smaller.fy *= down, smaller.cy *= down;
  }
  pags_frame_options reduced = *options;
  if (s->eps > 0.0f && !options->keep_for_passes) {
    reduced.early_z_eps = options->early_z == PAGS_EARLY_Z_BOUNDED ? fmaxf(options->early_z_eps, s->eps) : s->eps;
    reduced.early_z = PAGS_EARLY_Z_BOUNDED;
    reduced.exp_degree = 3;
  }
  reduced.rest_cut = options->keep_for_passes ? 0.0f : s->cut;
  reduced.rest_sh_less = options->keep_for_passes ? 0 : s->sh_less;
  d->frame->variable_rate = s->sampled && !options->keep_for_passes ? &rate : NULL;
  const pags_result result = pags_frame_render(d->frame, parts, part_count, &smaller, &reduced, NULL, NULL, out);
  d->frame->variable_rate = NULL;
  PAGS_TRY(result);
  *facts =
      (pags_deadline_result){.step = step, .full_tiles = rate.full_tiles, .stats = *pags_frame_stats_get(d->frame)};
  facts->ms = pags_clock_ms() - begun;
  return PAGS_OK;
}

pags_result pags_deadline_render(pags_deadline *d, pags_deadline_controller *controller, const pags_part *parts,
                                 int part_count, const pags_camera *camera, const pags_frame_options *options,
                                 pags_picture *out, pags_deadline_result *facts) {
  const int drawings = controller->last_step < 0 ? 2 : 1;
  for (int i = 0; i < drawings && (i == 0 || !facts->met); i++) {
    PAGS_TRY(pags_deadline_render_step(d, controller->step, parts, part_count, camera, options, out, facts));
    facts->met = facts->ms <= controller->target;
    pags_deadline_controller_tell(controller, facts->ms);
  }
  return PAGS_OK;
}
