/* SPDX-License-Identifier: Apache-2.0 */
/* The stages of a training run, each in the file that its section names. Functions marked as collective are called by
 * all ranks. */
#ifndef PAGS_TRAIN_STAGES_H
#define PAGS_TRAIN_STAGES_H

#include "train/run.h"

/* ---- Opening a run: open_run.c ---- */

/* Creates the state of a new run (start), or loads that of an interrupted one (resume). A resumed run keeps the
 * configuration of its checkpoint, and `config` must agree with it. Before the call, the training views must have
 * been listed (pags_views_list). */
pags_result pags_trainer_start(pags_trainer *trainer, const pags_train_config *config);
pags_result pags_trainer_resume(pags_trainer *trainer, const pags_train_config *config);

/* ---- Differences between data sets: other_views.c ---- */

/* Compares the data set's views with those that scene.json in `folder` records, for the error message of a resume with
 * another data set. Returns a text such as "the camera of 0003.png stands 1 m from where it stood" that the caller
 * frees; NULL if scene.json is missing or records no difference. */
char *pags_other_views(const char *folder, const pags_dataset *dataset);

/* ---- Sharing a run between ranks: share_run.c ---- */

/* Refuses options that several ranks don't support. */
pags_result pags_share_run_check(const pags_train_options *options);
/* Collective: gives each rank its share of all models (pags_shares_cut). */
pags_result pags_share_run_begin(pags_trainer *trainer);
/* Collective, after the last view: collects the Gaussians at rank 0, which then writes the scene. */
pags_result pags_share_run_end(pags_trainer *trainer);
void pags_share_run_destroy(pags_trainer *trainer); /* a zeroed one is allowed */
/* Collective, after a step: sets *stop if one of the ranks wants to stop, and *save if rank 0 wants a checkpoint. Fails
 * if one rank has failed; `mine` is the result of this rank. */
pags_result pags_share_run_agree(const pags_trainer *trainer, pags_result mine, int *stop, bool *save);

/* ---- One training step: step.c ---- */

/* Collective: draws a round of `count` views, at most one per rank: view v->view at level v->level, as photograph
 * v->number of the run in step `step`; evaluates the losses and runs the backward pass. Fills the rest of each `v`;
 * adds the times of its phases to trainer->ms. */
pags_result pags_train_round(pags_trainer *trainer, int64_t step, pags_step_view *views, int count);
/* Collective: ends the step after its last view, with the updates that need all of its views. */
pags_result pags_train_finish(pags_trainer *trainer, int64_t step);

/* ---- Results of a step that all ranks share: shared_step.c ---- */

/* Losses of photographs drawn by other ranks, gradients of poses whose objects other ranks own, and skipped updates.
 * Every rank updates tracks, exposures, cameras and the sky from the same numbers, so that they stay the same.
 *
 * Collective: fills losses, terms and the photometric gradient of all views of a round; rank r has drawn view r. */
pags_result pags_shared_step_results(pags_trainer *trainer, pags_step_view *views, int count);
/* Collective, at the end of a step, after the updates of Gaussians: merges trainer->rest and state.nonfinite. */
pags_result pags_shared_step_rest(pags_trainer *trainer);
/* Collective: merges the changes of state.nonfinite since trainer->shared_nonfinite. */
pags_result pags_shared_step_nonfinite(pags_trainer *trainer);

/* ---- Views outside of a step: round.c ---- */

/* A process alone draws one view per round, several ranks one each (shared_views.h). The views are trainer->round[0 ..
 * count), of which `view` and `camera` are set.
 *
 * Collective: sends the splats of all views to the ranks that draw them; nothing with one process. `step`: as of
 * pags_view_render_draw. */
pags_result pags_round_project(pags_trainer *trainer, int64_t step, int count, const pags_frame_options *options);
/* Returns whether this rank draws one of `count` views. */
bool pags_round_draws(const pags_trainer *trainer, int count);
/* Draws this rank's view. */
pags_result pags_round_draw(pags_trainer *trainer, int64_t step, const pags_frame_options *options,
                            pags_picture *picture);

/* ---- PSNR of held-out views during a run: held_out.c ---- */

/* A view to measure, drawn as in training, at full size. Measuring changes no bit of the run. */
typedef struct pags_measured_view {
  int64_t view;          /* of the data set */
  pags_scene_view shown; /* camera, which may differ from the data set's, and exposure */
  double psnr;           /* dB, the result; NaN if no pixel counts */
} pags_measured_view;

/* Collective: measures the views, which are the same at all ranks. Errors of photographs. */
pags_result pags_held_out_views(pags_trainer *trainer, pags_measured_view *views, int count);
/* Collective: measures at most PAGS_HELD_OUT_VIEWS held-out views, evenly spaced over the data set:
 * trainer->held_out. Does nothing without held-out views. Errors of photographs. */
pags_result pags_held_out_measure(pags_trainer *trainer);

/* ---- Holdout tests: holdout_decision.c ---- */

/* Returns whether a step skips the training photographs reserved for the tests. */
bool pags_holdout_tests_active(const pags_train_state *state, int64_t step);
/* At the step of the test: renders holdout photographs with and without the corrections, first of the camera poses,
 * then of vignetting and response curves. A correction stays if it brings 0.3 dB and more than twice the standard
 * error; otherwise it is discarded. Does nothing at other steps. Errors of photographs. */
pags_result pags_holdout_tests_decide(pags_trainer *trainer);

/* ---- Colours that vary over time: color_over_time.c ---- */

/* Renders every training view with the current Gaussians and estimates, per moving object, how much of its error a
 * colour that varies over the track as five Fourier terms would remove: the mean error of the object's pixels at each
 * time step is fitted by least squares. Objects for which the fit promises at least fourier_gain dB get the Fourier
 * terms, all zero. No model may have pending Adam steps. */
pags_result pags_color_over_time_decide(pags_trainer *trainer);

/* ---- Report: model_report.c ---- */

/* Writes the member "modelled" of scene.json, as JSON: which parts the run models and why (sky, exposure, tracks, each
 * object). The caller frees `text`. */
pags_result pags_model_report_write(const pags_dataset *dataset, const pags_train_state *state, char **text);

#endif
