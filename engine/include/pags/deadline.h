/* SPDX-License-Identifier: Apache-2.0 */
/* Frames within a time budget: critical Gaussians (S_sem > 0.5) are drawn at full quality, and the quality of all
 * other Gaussians ("the rest") is reduced just as far as the time requires.
 *
 * A ladder of steps (pags_deadline_steps) says what is given up. First, everywhere: pixels stop early, which loses
 * what weighs no more than one or a few grey levels behind a nearly saturated pixel (PAGS_EARLY_Z_BOUNDED). Then, of
 * the rest alone: SH degrees of the colour, Gaussians of small contribution, and resolution. At the last steps
 * (variable rate) all tiles of 16x16 pixels are shaded at samples 4 pixels apart; tiles in which a sample shows
 * something critical are drawn in full, pixel by pixel, and the other tiles are interpolated between their samples,
 * with the sky at full resolution. To limit memory, scenes of more than eight million Gaussians many of which are
 * hidden are drawn in full at these steps, too.
 *
 * How the step is chosen: each measured frame is converted to the time that a full frame would have taken, by the
 * share of a full frame's time that each step is known to take (learned while drawing). The next frame gets the
 * lowest step that is expected to keep within the budget, so that quality falls at once but rises by at most one
 * step per frame. */
#ifndef PAGS_DEADLINE_H
#define PAGS_DEADLINE_H

#include <pags/base.h>
#include <pags/frame.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PAGS_DEADLINE_STEPS = 8 };

/* What one step gives up. */
typedef struct pags_deadline_step {
  /* > 0: pixels stop as PAGS_EARLY_Z_BOUNDED with this eps, or with the options' own eps if they ask for BOUNDED
   * with a larger one, and the rasteriser's exp has degree 3. 0: early_z and exp_degree of the options. */
  float eps;
  int sh_less; /* SH degrees taken off clusters without critical Gaussians */
  float cut;   /* px: non-critical Gaussians whose opacity times area on the picture is smaller are not drawn */
  int sampled; /* 1: variable rate: tiles without critical content are interpolated from samples 4 pixels apart */
} pags_deadline_step;

/* Returns the ladder, PAGS_DEADLINE_STEPS steps from full quality to the fastest; step 0 gives nothing up.
 * Static. */
PAGS_API const pags_deadline_step *pags_deadline_steps(void);

/* The controller that chooses the steps, separate from clocks and frames so that a caller can use it alone. */
typedef struct pags_deadline_controller {
  double target;                     /* time budget of a frame, ms */
  double share[PAGS_DEADLINE_STEPS]; /* estimated time of a frame per step, as a share of step 0's; share[0] = 1 */
  double full;                       /* expected time of a frame at step 0, ms; 0: nothing measured yet */
  int step;                          /* the step chosen for the next frame */
  int last_step;                     /* the step of the last frame reported; -1: none */
  double last_ms;                    /* the time of the last frame reported */
} pags_deadline_controller;

/* Returns a controller that begins at step 0, with guessed shares. */
PAGS_API pags_deadline_controller pags_deadline_controller_begin(double target_ms);

/* Reports that a frame at controller->step took `ms` milliseconds: updates the estimates and chooses the step of
 * the next frame. Times that are not positive and finite are ignored. */
PAGS_API void pags_deadline_controller_tell(pags_deadline_controller *controller, double ms);

/* What was measured of a frame. */
typedef struct pags_deadline_result {
  int step;               /* the step that it was drawn at */
  double ms;              /* wall-clock time of the whole frame */
  int met;                /* 1: ms <= target */
  double full_tiles;      /* share of the tiles that were drawn in full, 0..1 */
  pags_frame_stats stats; /* pair counts are those of pixels drawn in full, without those of samples */
} pags_deadline_result;

/* A renderer with a time budget: a pags_frame with a controller. It may be used by one thread at a time. */
typedef struct pags_deadline pags_deadline;

/* Creates a renderer with a time budget of target_ms > 0 milliseconds per frame. `priority` is the priority of
 * each id, 0 .. count - 1, as pags_composition_priorities writes it, and is copied; it decides which tiles are
 * drawn in full at the variable-rate steps (at the other steps the parts' own s_sem says what is critical). NULL:
 * none is. `tasks` must outlive the renderer. PAGS_ERROR_MEMORY; PAGS_ERROR_UNSUPPORTED (see pags_frame_create). */
PAGS_API pags_result pags_deadline_create(pags_tasks *tasks, double target_ms, const float *priority, int64_t count,
                                          pags_deadline **out);

/* Replaces the priorities by those of other Gaussians; parameters as above. PAGS_ERROR_MEMORY; then the old ones stay.
 */
PAGS_API pags_result pags_deadline_set_priorities(pags_deadline *budget, const float *priority, int64_t count);

/* Frees the renderer. NULL is allowed. */
PAGS_API void pags_deadline_destroy(pags_deadline *budget);

/* Draws a frame at the step that the controller has chosen, measures it and reports it to the controller.
 * Parameters, result and errors are those of pags_frame_render. `options` describe a frame at full quality:
 * early_z may be any mode but PAPER, order must be DEPTH; rest_cut and rest_sh_less are replaced by the step's.
 * The first frame is drawn at step 0; if that takes longer than the budget, it is drawn again at the step then
 * chosen, and `out` and `facts` are of the second drawing. Where tiles are interpolated, depth and ids are those
 * of the nearest sample. */
PAGS_API pags_result pags_deadline_render(pags_deadline *budget, const pags_part *parts, int part_count,
                                          const pags_camera *camera, const pags_frame_options *options,
                                          pags_picture *out, pags_deadline_result *facts);

/* Draws one frame at a given step, 0 .. PAGS_DEADLINE_STEPS - 1, however long it takes. The controller isn't
 * told. */
PAGS_API pags_result pags_deadline_render_step(pags_deadline *budget, int step, const pags_part *parts, int part_count,
                                               const pags_camera *camera, const pags_frame_options *options,
                                               pags_picture *out, pags_deadline_result *facts);

#ifdef __cplusplus
}
#endif
#endif
