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

/* Collective: gives each rank its share of all models (pags_shares_cut). */
pags_result pags_share_run_begin(pags_trainer *trainer);
/* Collective, after the last view: collects the Gaussians at rank 0, which then writes the scene. */
pags_result pags_share_run_end(pags_trainer *trainer);
void pags_share_run_destroy(pags_trainer *trainer); /* a zeroed one is allowed */
/* Collective, after a step: sets *stop if one of the ranks wants to stop, and *save if rank 0 wants a checkpoint. Fails
 * if one rank has failed; `mine` is the result of this rank. */
pags_result pags_share_run_agree(const pags_trainer *trainer, pags_result mine, bool *stop, bool *save);

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
 * Collective: fills the results of all views of a round; rank r has drawn view r. `views` has one per rank. */
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
/* Draws this rank's view, if its number is below that of the views. */
pags_result pags_round_draw(pags_trainer *trainer, int64_t step, const pags_frame_options *options,
                            pags_picture *picture);

/* ---- PSNR of held-out views during a run: held_out.c ---- */

/* A view to measure, drawn as in training, at full size. Measuring changes no bit of the run. */
typedef struct pags_measured_view {
  int64_t view;          /* of the data set */
  pags_scene_view shown; /* camera, which may differ from the data set's, and exposure */
  double psnr;           /* dB, the result; NaN if no pixel counts */
  double uncovered;      /* mean transmittance of the Gaussians, the result; NaN if no pixel counts */
} pags_measured_view;

/* Collective: measures the views, which are the same at all ranks. Errors of photographs. */
pags_result pags_held_out_views(pags_trainer *trainer, pags_measured_view *views, int count);
/* Collective: measures at most PAGS_HELD_OUT_VIEWS held-out views, evenly spaced over the data set:
 * trainer->held_out. Does nothing without held-out views. Errors of photographs. */
pags_result pags_held_out_measure(pags_trainer *trainer);

/* ---- Holdout tests: holdout_decision.c ---- */

/* Returns whether a step skips the training photographs reserved for the tests. */
bool pags_holdout_tests_active(const pags_trainer *trainer, int64_t step);
/* At the step of the test: renders holdout photographs with and without the corrections, first of the camera poses,
 * then of vignetting and response curves, last of exposures. A correction stays if it pays (pags_holdout_pays);
 * otherwise it is discarded. Does nothing at other steps. Errors of photographs. */
pags_result pags_holdout_tests_decide(pags_trainer *trainer);

/* ---- Costs of what a run decides: decisions.c ---- */

/* Takes a correction from a view of the scene: its exposure, the correction of its pose, or its light. */
void pags_decision_leave_out(pags_train_decision part, const pags_dataset *dataset, int64_t index,
                             pags_scene_view *view);
/* Measures the bytes that a correction takes in the views of scene.json. PAGS_ERROR_MEMORY. */
pags_result pags_decision_bytes(pags_train_decision part, const pags_dataset *dataset, const pags_scene *scene,
                                int64_t *bytes);
/* Key of the decision in scene.json and report.json: "sky", "exposure", "camera_poses", "light". */
const char *pags_decision_name(pags_train_decision part);

/* ---- Colours that vary over time: color_over_time.c ---- */

/* Renders every training view with the current Gaussians and estimates, per moving object, how much of its error a
 * colour that varies over the track as five Fourier terms would remove: the mean error of the object's pixels at each
 * time step is fitted by least squares. Objects for which the fit promises at least fourier_gain dB get the Fourier
 * terms, all zero. No model may have pending Adam steps. */
pags_result pags_color_over_time_decide(pags_trainer *trainer);

/* ---- Report: model_report.c ---- */

/* Writes the member "modelled" of scene.json, as JSON: which parts the run models and why, and what they take of
 * `scene`, the rest of which is complete. The caller frees `text`. */
pags_result pags_model_report_write(const pags_dataset *dataset, const pags_train_state *state, const pags_scene *scene,
                                    char **text);

/* ---- Time and memory of a run, before it is run: estimate.c ---- */

/* Time and memory of a run. Seconds: step_seconds * steps + scoring_seconds. */
typedef struct pags_estimate {
  double step_seconds;    /* mean over the steps of the run */
  double scoring_seconds; /* of all score passes: one per prune, one at the end */
  uint64_t bytes;
} pags_estimate;

/* Measures a few passes at each resolution level, which change no bit of the run, and extrapolates. Assumes nothing
 * about the machine; the assumptions about growth are listed in estimate.c. */
pags_result pags_trainer_estimate(pags_trainer *trainer, pags_estimate *out);

/* Returns the bytes of the gradients that a step of several photographs adds up (gradient_store.h), with their room for
 * growth: those of Gaussians, and those of a sky of `sky_size` texels a side; 0 with one photograph a step. */
uint64_t pags_batch_bytes(const pags_train_config *config, int64_t gaussians, int sky_size);

/* ---- Density control after a step: density.c ---- */

/* Runs, each where the schedule has it due after the step just done: clone, split and prune (or MCMC's moves), the
 * choice of objects with colour over time, pruning by score, the pull of the background onto LiDAR planes, the reset
 * of opacities. Whatever looks at all Gaussians first applies all pending Adam steps. */
pags_result pags_density_control(pags_trainer *trainer);

/* ---- Parts that the blocks of a recording share: shared_parts.c ---- */

/* The training of a block (docs/blocks.md) takes the sky of a scene of the whole recording, which stays fixed, and its
 * exposures, which are optimised with a fixed mean. Otherwise each block would choose its own sky and brightness, which
 * photograph = gain * picture + offset leaves open.
 *
 * Fixes the sky and the mean exposure of a run to those of the scene that the data set names. `begin`: sky and
 * exposures start from that scene; otherwise they are those of a checkpoint. Does nothing if the data set names no
 * scene. PAGS_ERROR_FORMAT if the scene lacks a photograph of the data set. */
pags_result pags_shared_parts_load(const pags_dataset *dataset, bool begin, pags_train_state *state);

/* ---- The limit on the size of the scene: size_limit.c ---- */

/* --target-size limits the bytes of scene.json, PLYs and sky. Training keeps it by limiting the number of Gaussians,
 * the rows of the PLYs.
 *
 * Returns the bytes that a Gaussian of the model will take in the finished scene's PLY. */
int pags_size_limit_row(const pags_train_state *state, int64_t model);

/* Computes the bytes that all Gaussians together may take; below 0 if the rest of the scene alone is too large. Bytes
 * by which scene.json may still grow are set aside. */
pags_result pags_size_limit_rows(const pags_dataset *dataset, const pags_train_state *state, int64_t *bytes);

/* Computes how many more Gaussians fit, each counted as one of the largest kind; 0 if there are too many already;
 * INT32_MAX if growth isn't limited: no target size, or a prune by score still to come, which applies it. */
pags_result pags_size_limit_room(const pags_dataset *dataset, const pags_train_state *state, int64_t *gaussians);

/* Collective. Call before the first step: if no prune by score is to come, thins the background evenly so that the
 * start fits the target size. */
pags_result pags_size_limit_start(const pags_dataset *dataset, pags_train_state *state, pags_tasks *tasks);

#endif
