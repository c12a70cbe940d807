/* Frames within a time: what is critical (S_sem > 0.5) at full quality, the rest reduced just enough.
 *
 * A ladder of steps (pags_budget_steps) says what the rest gives up: degrees of colour, Gaussians of small contribution, resolution. From the
 * steps with a scale > 1 on a frame is drawn twice: everything at 1/scale of the size, then the tiles in which something critical shows in
 * full, with the bits that a full frame has there; the other tiles are the small picture, enlarged.
 *
 * Which step: each measured frame says what a full one would have cost, by the share that each step is known to cost (learned
 * while drawing). The next frame gets the lowest step that is expected to keep within the time, going down by one at most. */
#ifndef PAGS_BUDGET_H
#define PAGS_BUDGET_H

#include <pags/base.h>
#include <pags/frame.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PAGS_BUDGET_STEPS = 10 };

typedef struct pags_budget_step {
  float scale;     /* the rest is drawn at 1/scale of the size */
  int sh_less;     /* degrees of colour taken off it */
  float cut;       /* opacity x area below which it isn't drawn, px of the picture it is drawn in */
} pags_budget_step;

PAGS_API const pags_budget_step *pags_budget_steps(void); /* PAGS_BUDGET_STEPS of them; the first gives nothing up */

/* The choice of steps by itself: no clock, no frame. */
typedef struct pags_budget_controller {
  double target;                    /* ms */
  double share[PAGS_BUDGET_STEPS];  /* what a step costs, by the full frame's cost; share[0] = 1 */
  double full;                      /* what a full frame is expected to cost, ms; 0: nothing measured yet */
  int step;                         /* for the next frame */
  int last_step;                    /* of the last one told; -1: none */
  double last_ms;
} pags_budget_controller;

PAGS_API pags_budget_controller pags_budget_controller_begin(double target_ms);
/* A frame at the controller's step took so long; chooses the step of the next. */
PAGS_API void pags_budget_controller_tell(pags_budget_controller *controller, double ms);

/* What became of a frame. */
typedef struct pags_budget_facts {
  int step;
  double ms;          /* wall clock of the whole frame */
  int met;            /* ms <= target */
  double full_tiles;  /* share of tiles drawn in full */
  pags_frame_stats rest, full; /* of the small picture (zeros where there is none) and of what was drawn in full size */
} pags_budget_facts;

typedef struct pags_budget pags_budget;

/* `priority`: of each id, as pags_composition_priorities gives it, copied; NULL: nothing is critical. `count`: of ids. */
PAGS_API pags_result pags_budget_create(pags_tasks *tasks, double target_ms, const float *priority, int64_t count, pags_budget **out);
PAGS_API void pags_budget_destroy(pags_budget *budget); /* NULL is allowed */

/* As pags_frame_render; `options` are those of a full frame (early_z may be any but PAPER; tiles, rest_cut and rest_sh_less are the budget's).
 * The first frame is drawn in full, and once more, timed, where it took too long. Where tiles were enlarged, depth and ids are the nearest
 * small pixel's. */
PAGS_API pags_result pags_budget_render(pags_budget *budget, const pags_part *parts, int part_count, const pags_camera *camera,
                                        const pags_frame_options *options, pags_picture *out, pags_budget_facts *facts);
/* One frame at a given step, whatever the time. */
PAGS_API pags_result pags_budget_render_step(pags_budget *budget, int step, const pags_part *parts, int part_count,
                                             const pags_camera *camera, const pags_frame_options *options, pags_picture *out,
                                             pags_budget_facts *facts);

#ifdef __cplusplus
}
#endif
#endif
