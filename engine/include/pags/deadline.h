/* SPDX-License-Identifier: Apache-2.0 */
/* Frames within a time: what is critical (S_sem > 0.5) at full quality, the rest reduced just enough.
 *
 * A ladder of steps (pags_deadline_steps) says what is given up: first, everywhere, what weighs no more than a grey
 * level or a few behind a nearly full pixel (PAGS_EARLY_Z_BOUNDED), then, of the rest alone, degrees of colour,
 * Gaussians of small contribution, resolution. At sampled steps all tiles of 16 x 16 px are looked at by samples 4
 * pixels apart; those in which something critical shows are drawn in full, pixel by pixel, and the others interpolated
 * between samples, with the sky of the full size. Scenes of more than eight million Gaussians of which much hides are
 * drawn in full at these steps, too, for the sake of memory.
 *
 * Which step: each measured frame says what a full one would have cost, by the share that each step is known to cost
 * (learned while drawing). The next frame gets the lowest step that is expected to keep within the time, going down by
 * one at most. */
#ifndef PAGS_DEADLINE_H
#define PAGS_DEADLINE_H

#include <pags/base.h>
#include <pags/frame.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PAGS_DEADLINE_STEPS = 8 };

typedef struct pags_deadline_step {
  float
      eps; /* > 0: pixels are bounded by it, or by the options' own bound where that is larger, and exp has degree 3 */
  int sh_less; /* degrees of colour taken off the rest */
  float cut;   /* opacity x area below which it isn't drawn, px */
  int sampled; /* 1: it is drawn from samples 4 pixels apart */
} pags_deadline_step;

PAGS_API const pags_deadline_step *pags_deadline_steps(
    void); /* PAGS_DEADLINE_STEPS of them; the first gives nothing up */

/* The choice of steps by itself: no clock, no frame. */
typedef struct pags_deadline_controller {
  double target;                     /* ms */
  double share[PAGS_DEADLINE_STEPS]; /* what a step costs, by the full frame's cost; share[0] = 1 */
  double full;                       /* what a full frame is expected to cost, ms; 0: nothing measured yet */
  int step;                          /* for the next frame */
  int last_step;                     /* of the last one told; -1: none */
  double last_ms;
} pags_deadline_controller;

PAGS_API pags_deadline_controller pags_deadline_controller_begin(double target_ms);
/* A frame at the controller's step took so long; chooses the step of the next. */
PAGS_API void pags_deadline_controller_tell(pags_deadline_controller *controller, double ms);

/* What became of a frame. */
typedef struct pags_deadline_result {
  int step;
  double ms;              /* wall clock of the whole frame */
  int met;                /* ms <= target */
  double full_tiles;      /* share of tiles drawn in full */
  pags_frame_stats stats; /* pairs are those of pixels alone, without samples' */
} pags_deadline_result;

typedef struct pags_deadline pags_deadline;

/* `priority`: of each id, as pags_composition_priorities gives it, copied; NULL: nothing is critical. `count`: of ids.
 */
PAGS_API pags_result pags_deadline_create(pags_tasks *tasks, double target_ms, const float *priority, int64_t count,
                                          pags_deadline **out);
PAGS_API void pags_deadline_destroy(pags_deadline *budget); /* NULL is allowed */

/* As pags_frame_render; `options` are those of a full frame (early_z may be any but PAPER, order DEPTH; rest_cut and
 * rest_sh_less are the budget's). The first frame is drawn in full, and once more, timed, where it took too long. Where
 * tiles are interpolated, depth and ids are the nearest sample's. */
PAGS_API pags_result pags_deadline_render(pags_deadline *budget, const pags_part *parts, int part_count,
                                          const pags_camera *camera, const pags_frame_options *options,
                                          pags_picture *out, pags_deadline_result *facts);
/* One frame at a given step, whatever the time. */
PAGS_API pags_result pags_deadline_render_step(pags_deadline *budget, int step, const pags_part *parts, int part_count,
                                               const pags_camera *camera, const pags_frame_options *options,
                                               pags_picture *out, pags_deadline_result *facts);

#ifdef __cplusplus
}
#endif
#endif
