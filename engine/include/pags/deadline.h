/* SPDX-License-Identifier: Apache-2.0 */
/* Frames within a time budget: critical Gaussians (S_sem > 0.5) keep their quality longest, and that of all other
 * Gaussians ("the rest") is reduced only as much as the time requires.
 *
 * Quality is reduced along a ladder of steps (pags_deadline_steps). First, everywhere: pixels stop early, which loses
 * at most one or a few grey levels behind a nearly saturated pixel (PAGS_EARLY_Z_BOUNDED). Then, for the rest alone: SH
 * degrees of the colour, Gaussians of small contribution, and resolution: all tiles of 16x16 pixels
 * are shaded at samples 4 pixels apart (variable rate); tiles in which a sample shows something critical are drawn in
 * full, pixel by pixel, and the other tiles are interpolated between their samples, with the sky at full resolution.
 * To limit memory, scenes of more than eight million Gaussians, many of them hidden, are drawn in full at these steps,
 * too. The last steps draw a smaller picture, for viewers, which stretch it.
 *
 * Choice of the step: each measured frame is converted to the time of a full frame, by the step's estimated share of a
 * full frame's time (learned while drawing). The next frame gets the
 * lowest step that is expected to keep within the budget. Quality falls immediately when costs rise, but not for a
 * single frame that took far longer than its neighbours. It rises by one step per frame, and only if the frame would
 * stay within the budget by a margin, so that it doesn't oscillate between two steps. */
#ifndef PAGS_DEADLINE_H
#define PAGS_DEADLINE_H

#include <pags/base.h>
#include <pags/frame.h>

PAGS_BEGIN_C

enum {
  PAGS_DEADLINE_WHOLE_STEPS = 8, /* the first steps: pictures of the requested size */
  PAGS_DEADLINE_STEPS = 12
};

/* Reductions of one step. */
typedef struct pags_deadline_step {
  /* > 0: pixels stop as PAGS_EARLY_Z_BOUNDED with this eps, or with the options' own eps if they ask for BOUNDED
   * with a larger one, and the rasteriser's exp has degree 3. 0: early_z and exp_degree of the options. */
  float eps;
  int sh_less;    /* SH degrees taken off clusters without critical Gaussians */
  float cut;      /* px: non-critical Gaussians whose opacity times area on the picture is smaller are not drawn */
  int sampled;    /* 1: variable rate: tiles without critical content are interpolated from samples 4 pixels apart */
  double divisor; /* >= 1: width and height of the picture are divided by it and rounded; the field of view stays */
} pags_deadline_step;

/* Returns the ladder, PAGS_DEADLINE_STEPS steps from full quality to the fastest; step 0 reduces nothing.
 * Static. */
PAGS_API const pags_deadline_step *pags_deadline_steps(void);

/* The controller that chooses the steps of one view's frames, separate from clocks and frames. One that is zeroed must
 * not be used. */
typedef struct pags_deadline_controller {
  double target;                     /* time budget of a frame, ms; may be changed between frames */
  int first, last;                   /* the steps that it chooses from */
  double share[PAGS_DEADLINE_STEPS]; /* estimated time of a frame per step, as a share of step 0's; share[0] = 1 */
  double full;                       /* expected time of a frame at step 0, ms; 0: nothing measured yet */
  double haste;                      /* share of the target that a frame may take, see pags_deadline_controller_pace */
  int step;                          /* the step chosen for the next frame */
  int last_step;                     /* the step of the last frame reported; -1: none */
  double last_ms, last_full;         /* of the last frame reported: its time, and the time of step 0 derived from it */
} pags_deadline_controller;

/* Returns a controller for frames that are stored: of the requested size, in full where the time allows. It
 * begins at step 0, with guessed shares. */
PAGS_API pags_deadline_controller pags_deadline_controller_begin(double target_ms);

/* Returns a controller for moving interactive views: at least bounded Early-Z, and smaller pictures where no other step
 * keeps the time. The first picture has half the size, since no time is known yet. Once the view rests, the caller
 * draws step 0. */
PAGS_API pags_deadline_controller pags_deadline_controller_begin_live(double target_ms);

/* Reports that a frame at controller->step took `ms` milliseconds, including everything that the caller counts as part
 * of it: updates the estimates and chooses the step of the next frame. Times that are not positive and finite are
 * ignored. */
PAGS_API void pags_deadline_controller_tell(pags_deadline_controller *controller, double ms);

/* For a viewer whose own drawing takes the same processors: reports that a picture appeared `ms` milliseconds after
 * the previous one, the goal being `wanted_ms`. If pictures come too rarely, frames get a smaller share of the target,
 * down to a quarter; if they come soon enough, a larger one. */
PAGS_API void pags_deadline_controller_pace(pags_deadline_controller *controller, double ms, double wanted_ms);

/* Measurements of a frame. */
typedef struct pags_deadline_result {
  int step;               /* the step that it was drawn at */
  double ms;              /* wall-clock time of the whole frame */
  int met;                /* 1: ms <= target; 0 from pags_deadline_render_step */
  double full_tiles;      /* share of the tiles that were drawn in full, 0..1 */
  pags_frame_stats stats; /* pair counts are those of pixels drawn in full, without those of samples */
} pags_deadline_result;

/* A renderer that draws at any of the steps: a pags_frame and the priorities of its Gaussians. It may be used by one
 * thread at a time, for several controllers in turn. */
typedef struct pags_deadline pags_deadline;

/* Creates a renderer. `priority` is the priority of each id, 0 .. count - 1, as pags_composition_priorities writes it,
 * and is copied; it decides which tiles are drawn in full at the variable-rate steps (at the other steps the parts' own
 * s_sem decides). NULL: no Gaussian is critical. `tasks` must outlive the renderer. PAGS_ERROR_MEMORY;
 * PAGS_ERROR_UNSUPPORTED (see pags_frame_create). */
PAGS_API pags_result pags_deadline_create(pags_tasks *tasks, const float *priority, int64_t count, pags_deadline **out);

/* Replaces the priorities by those of other Gaussians; parameters as above. PAGS_ERROR_MEMORY; then the old ones stay.
 */
PAGS_API pags_result pags_deadline_set_priorities(pags_deadline *deadline, const float *priority, int64_t count);

/* Frees the renderer. NULL is allowed. */
PAGS_API void pags_deadline_destroy(pags_deadline *deadline);

/* The frame inside, for pictures without a deadline and for passes of the last picture (pags_frame_passes). */
PAGS_API pags_frame *pags_deadline_frame(pags_deadline *deadline);

/* Draws a frame at the step that the controller has chosen, measures it and reports it to the controller.
 * Parameters, result and errors are those of pags_frame_render. `options` describe a frame at full quality:
 * early_z may be any mode but PAPER, order must be DEPTH; rest_cut and rest_sh_less are replaced by the step's. With
 * keep_for_passes steps reduce the size only. Where nothing is known yet and the first frame takes longer than the
 * budget, it is drawn again at the step then chosen, and `out` and `facts` are of the second drawing. Where tiles are
 * interpolated, depth and ids are those of the nearest sample. */
PAGS_API pags_result pags_deadline_render(pags_deadline *deadline, pags_deadline_controller *controller,
                                          const pags_part *parts, int part_count, const pags_camera *camera,
                                          const pags_frame_options *options, pags_picture *out,
                                          pags_deadline_result *facts);

/* Draws one frame at a given step, 0 .. PAGS_DEADLINE_STEPS - 1, however long it takes. The caller reports the time to
 * its controller, with any further work that counts. */
PAGS_API pags_result pags_deadline_render_step(pags_deadline *deadline, int step, const pags_part *parts,
                                               int part_count, const pags_camera *camera,
                                               const pags_frame_options *options, pags_picture *out,
                                               pags_deadline_result *facts);

PAGS_END_C
#endif
