/* SPDX-License-Identifier: Apache-2.0 */
/* The training loop: opens the run, does its steps, writes log, previews and checkpoints, and finally the scene.
 *
 * Step t renders the views that the current pass's permutation gives, at the resolution of t, and updates the
 * parameters by their backward passes (step.c). After the step, where the schedule says so, density control and the
 * opacity reset follow, which look at all Gaussians and first apply all pending Adam steps. */
#include <assert.h>

#include "base/log.h"
#include "base/psnr.h"
#include "dataset/photo_mask.h"
#include "port/port.h"
#include "threads/record.h"
#include "train/config.h"
#include "train/score_pass.h"
#include "train/sh_trim.h"
#include "train/shards.h"
#include "train/stages.h"
#include "train/views.h"

enum { ESTIMATE_STEPS = 50, MASKS_TEXT = 160 };

/* ---- One step ---- */

/* PSNR of a view; NaN if none of its pixels counts. */
static double view_psnr(const pags_photometric_loss *loss) {
  return loss->counted > 0 ? pags_psnr(loss->mse) : (double)NAN;
}

/* PSNR of the running mean; NaN if no pixel has counted yet. */
static double mean_psnr(const pags_trainer *t) {
  return t->counted || t->state.mse > 0 ? pags_psnr(t->state.mse) : (double)NAN;
}

static const char *bad_row_name(const pags_trainer *t) {
  int64_t object = t->state.nonfinite.first.object;
  return object >= 0 && object < t->state.tracks.count ? t->state.tracks.objects[object].id : NULL;
}

/* Fails if more updates were left out than bad_rows_most allows. Single numbers that aren't finite cost one Gaussian
 * one step; many of them are a sign that the run diverges. */
static pags_result check_nonfinite(const pags_trainer *t) {
  char text[PAGS_GUARD_TEXT];
  if (t->state.nonfinite.count <= t->options->bad_rows_most)
    return PAGS_OK;
  pags_nonfinite_describe(&t->state.nonfinite, bad_row_name(t), text);
  return pags_fail(
      PAGS_ERROR_LIMIT,
      "step %lld: %lld updates were left out because a number wasn't finite, %lld are allowed; the first was %s",
      (long long)t->state.step, (long long)t->state.nonfinite.count, (long long)t->options->bad_rows_most, text);
}

/* Does a round of the step's photographs, from its photograph number `first` on: one for each rank, as far as there are
 * any. `last` receives the last of its views. */
static pags_result do_round(pags_trainer *t, int64_t step, int64_t first, pags_step_view *last) {
  pags_train_state *s = &t->state;
  const int64_t left = s->schedule.batch - first;
  const int count = left < t->ranks ? (int)left : t->ranks;
  for (int i = 0; i < count; i++) {
    const int64_t number = s->step * s->schedule.batch + first + i + 1;
    int level;
    const int64_t view = pags_views_next(t, number, &level);
    t->round[i] = (pags_step_view){.number = number, .view = view, .level = level};
  }
  PAGS_TRY(pags_train_round(t, step, t->round, count));

  /* Running means: exponential, over about one pass. */
  for (int i = 0; i < count; i++) {
    const pags_step_view *const v = t->round + i;
    const double weight = 1.0 / (double)(v->number < t->view_count ? v->number : t->view_count);
    s->loss += weight * (v->result.loss.loss - s->loss);
    s->mse += weight * (v->result.loss.mse - s->mse);
    t->counted = t->counted || v->result.loss.counted > 0;
  }
  *last = t->round[count - 1];
  return PAGS_OK;
}

/* Does one step; `v` receives the last of its views. */
static pags_result do_step(pags_trainer *t, pags_step_view *v) {
  int64_t step = t->state.step + 1;
  pags_tasks_mark(t->tasks, "step", "photograph");
  pags_train_state *s = &t->state;
  t->shared_nonfinite = s->nonfinite.count;
  for (int64_t first = 0; first < s->schedule.batch; first += t->ranks)
    PAGS_TRY(do_round(t, step, first, v));
  PAGS_TRY(pags_train_finish(t, step));
  pags_tasks_mark(t->tasks, NULL, "end");
  pags_stage_time clock = pags_stage_now();
  pags_state_set_step(s, step);

  PAGS_TRY(check_nonfinite(t));
  PAGS_TRY(pags_holdout_tests_decide(t));
  PAGS_TRY(pags_density_control(t));
  if (pags_schedule_is_half_decision(&s->schedule, step)) {
    /* Decide how long photographs are shown at half size, from the pixels that they have for each Gaussian now. */
    const double ratio = pags_views_mean_pixels(t) / fmax((double)pags_state_gaussian_count(s), 1);
    const double fraction = pags_schedule_half_until(ratio);
    pags_schedule_set_half_until(&s->schedule, fraction);
    pags_log_message(PAGS_LOG_INFO, "%.2g pixels of a photograph for each Gaussian: half size until %.0f %% of the run",
                     ratio, 100 * fraction);
  }
  PAGS_TRY(check_nonfinite(t)); /* under MCMC, density control has updated the Gaussians that the view doesn't show */
  pags_stage_lap(&clock, &t->ms.density);
  return PAGS_OK;
}

/* ---- The loop ---- */

/* Clocks of this process's part of the run, in ms. Time spent in callbacks is excluded by moving all clocks
 * forward. */
typedef struct run_clock {
  double begin;
  double window; /* begin of the period for the displayed rate */
  int64_t window_step;
  double rate;  /* steps per second last displayed; 0: none yet */
  double tail;  /* begin of the run's last tenth */
  double saved; /* the last checkpoint, or the first step */
  int64_t tail_step, first_step;
  int64_t blank;        /* steps in a row in which no Gaussian was in view */
  int64_t masked;       /* steps whose photograph has no pixel that counts, unless a mask file alone does that */
  int64_t first_masked; /* the view of the first */
  uint64_t tail_heap_calls;
} run_clock;

static void update_clock(const pags_trainer *t, run_clock *clock) {
  const pags_train_state *s = &t->state;
  double now = pags_clock_ms();
  if (now - clock->window >= 1000.0) {
    clock->rate = 1e3 * (double)(s->step - clock->window_step) / (now - clock->window);
    clock->window = now;
    clock->window_step = s->step;
  }
  if (s->step == s->stop - s->stop / 10) {
    clock->tail = now;
    clock->tail_step = s->step;
    clock->tail_heap_calls = pags_frame_heap_calls(t->render.frame);
  }
}

/* Calls the callbacks for progress and snapshots; returns false if one of them, or the cancel flag, asks to stop. */
static bool call_host(pags_trainer *t, run_clock *clock, const pags_step_view *v) {
  const pags_train_options *o = t->options;
  const pags_train_state *s = &t->state;
  const double since = pags_clock_ms(), seconds = (since - clock->begin) / 1e3;
  const int64_t done = s->step - clock->first_step;
  const double rate = clock->rate > 0.0 ? clock->rate : seconds > 0.0 ? (double)done / seconds : 0.0;
  const pags_train_progress progress = {.step = s->step,
                                        .iterations = s->stop,
                                        .it_per_second = rate,
                                        .gaussians = pags_state_gaussian_count(s),
                                        .loss = s->loss,
                                        .psnr = mean_psnr(t),
                                        .seconds = seconds,
                                        .eta_seconds = rate > 0.0 ? (double)(s->stop - s->step) / rate : 0.0,
                                        .level = v->level,
                                        .bad_rows = s->nonfinite.count,
                                        .seen = {v->view, view_psnr(&v->result.loss)},
                                        .held_out_count = t->held_out.count,
                                        .held_out = t->held_out.scores,
                                        .held_out_psnr = t->held_out.psnr,
                                        .held_out_step = t->held_out.step,
                                        .moment = (pags_train_moment *)t};
  pags_tasks_mark(t->tasks, "host", NULL);
  const bool go_on = !o->progress || o->progress(o->progress_user, &progress);
  if (o->snapshot && o->snapshot_every > 0 && t->state.step % o->snapshot_every == 0) {
    pags_state_flush(&t->state, t->tasks);
    o->snapshot(o->snapshot_user, &progress, &t->state.models[0].gaussians, pags_dataset_origin(t->dataset));
  }
  /* Exclude the time of the callbacks. */
  const double passed = pags_clock_ms() - since;
  clock->begin += passed;
  clock->window += passed;
  clock->tail += passed;
  t->watched_ms += passed;
  return go_on && !(o->cancel && *o->cancel);
}

/* Writes what a step leaves in the folder: rank 0 the log, and the rank that has drawn the step's last view its
 * preview. */
static pags_result write_step(pags_trainer *t, const pags_step_view *v) {
  const pags_train_options *o = t->options;
  const pags_train_state *s = &t->state;
  if (t->shared.rank == 0 && o->log_every > 0 && s->step % o->log_every == 0) {
    const pags_log_value values[] = {
        {"step", (double)s->step},
        {"gaussians", (double)pags_state_gaussian_count(s)},
        {"shrink", v->level},
        {"sh_degree", pags_schedule_sh_degree(&s->schedule, s->step)},
        {"loss", s->loss},
        {"psnr", mean_psnr(t)},
        {"view_loss", v->result.loss.loss},
        {"view_l1", v->result.loss.l1},
        {"view_ssim", v->result.loss.ssim},
        {"view_psnr", view_psnr(&v->result.loss)},
        {"view_sky", v->result.terms.sky > 0.0 ? v->result.terms.sky : PAGS_LOG_NOTHING},
        {"view_depth", v->result.terms.depth > 0.0 ? v->result.terms.depth : PAGS_LOG_NOTHING},
        {"view_objects", v->result.terms.objects > 0.0 ? v->result.terms.objects : PAGS_LOG_NOTHING},
        {"bad_rows", s->nonfinite.count > 0 ? (double)s->nonfinite.count : PAGS_LOG_NOTHING}};
    PAGS_TRY(pags_output_log(&t->output, values, sizeof values / sizeof *values));
  }
  if (o->preview_every > 0 && s->step % o->preview_every == 0 && t->shared.rank == (s->schedule.batch - 1) % t->ranks)
    PAGS_TRY(pags_output_preview(&t->output, s->step, &v->picture, &v->photo));
  return PAGS_OK;
}

/* Measures held-out views after the steps that write a preview, whose view has no picture and no photograph from here
 * on. `written`: how that went. */
static pags_result measure_held_out(pags_trainer *t, pags_result written) {
  const pags_train_options *o = t->options;
  const int64_t step = t->state.step;
  if (!o->held_out || o->preview_every <= 0 || step % o->preview_every != 0)
    return written;
  PAGS_TRY(pags_transport_agree(o->transport, written));
  PAGS_TRY(pags_held_out_measure(t));
  if (t->held_out.count == 0 || t->shared.rank > 0)
    return PAGS_OK;
  const pags_log_value values[] = {{"step", (double)step},
                                   {"gaussians", (double)pags_state_gaussian_count(&t->state)},
                                   {"held_out_psnr", t->held_out.psnr},
                                   {"held_out_views", t->held_out.count}};
  return pags_output_log(&t->output, values, 4);
}

/* Sets the number of steps so that the run takes the time limit, by the estimate; rank 0 decides. Collective. */
static pags_result fit_to_clock(pags_trainer *t, const run_clock *clock) {
  pags_train_state *s = &t->state;
  pags_estimate estimate;
  PAGS_TRY(pags_trainer_estimate(t, &estimate));
  double left = t->options->time_limit_seconds - (pags_clock_ms() - clock->begin) / 1e3 - estimate.scoring_seconds;
  double fitted = fmax(left, 0.0) / fmax(estimate.step_seconds, 1e-9);
  int64_t steps = s->step + (int64_t)fmin(fmax(fitted, 1.0), 1e7 - ESTIMATE_STEPS);
  PAGS_TRY(pags_transport_broadcast(t->options->transport, 0, &steps, sizeof steps));
  pags_state_settle(s, t->tasks);
  pags_train_config config = s->schedule.config;
  config.schedule.iterations = steps * s->schedule.batch;
  config.schedule.schedule_iterations = 0;
  pags_schedule schedule = pags_schedule_make(&config, s->schedule.extent, s->schedule.views);
  s->clocked = 1;
  PAGS_TRY(pags_state_retime(s, &schedule, steps));
  for (int64_t i = 0; i < s->model_count; i++)
    pags_adam_bound_all(&s->models[i].adam, &s->models[i].gaussians, &s->models[i].clusters, t->tasks);
  pags_log_message(PAGS_LOG_INFO, "time limit: %lld steps", (long long)steps);
  return PAGS_OK;
}

static pags_result loop(pags_trainer *t, run_clock *clock) {
  pags_train_state *s = &t->state;
  const double limit = t->options->time_limit_seconds;
  const bool times = limit > 0.0 && t->shared.rank == 0; /* rank 0's clock decides when the time is over */
  for (bool stopped = false; s->step < s->stop && !stopped;) {
    pags_step_view v;
    PAGS_TRY(do_step(t, &v));
    update_clock(t, clock);
    char masks[MASKS_TEXT];
    if (v.result.loss.counted == 0 && pags_dataset_masks_of(t->dataset, v.view, masks, sizeof masks) &&
        clock->masked++ == 0)
      clock->first_masked = v.view;
    clock->blank = pags_frame_stats_get(t->render.frame)->binned > 0 ? 0 : clock->blank + 1;
    if (t->options->estimate) {
      stopped = s->step >= ESTIMATE_STEPS;
      continue;
    }
    const pags_result written = measure_held_out(t, write_step(t, &v));
    if (limit > 0.0 && !s->clocked && s->step >= ESTIMATE_STEPS) {
      PAGS_TRY(pags_transport_agree(t->options->transport, written));
      PAGS_TRY(fit_to_clock(t, clock));
    }
    stopped =
        (written == PAGS_OK && !call_host(t, clock, &v)) || (times && pags_clock_ms() - clock->begin > 1e3 * limit);
    const pags_train_options *o = t->options;
    const bool by_steps = o->checkpoint_every > 0 && s->step % o->checkpoint_every == 0;
    const bool by_time = o->checkpoint_minutes > 0 && pags_clock_ms() - clock->saved >= 60e3 * o->checkpoint_minutes;
    bool save = (by_steps || by_time) && s->step < s->stop;
    PAGS_TRY(pags_share_run_agree(t, written, &stopped, &save));
    if (!save || stopped) /* the end writes one, too */
      continue;
    pags_tasks_mark(t->tasks, "checkpoint", "write");
    PAGS_TRY(pags_train_moment_save((pags_train_moment *)t));
    clock->saved = pags_clock_ms();
  }
  return PAGS_OK;
}

/* ---- The end of a run ---- */

/* Collective: sets S_sem and the SH degrees of the finished scene, which both need the weights of its Gaussians. */
static pags_result finish_scene(pags_trainer *t) {
  PAGS_AUTO(pags_score_pass_destroy) pags_score_pass scores = {0};
  const pags_train_config *const c = &t->state.schedule.config;
  const bool labels = pags_score_pass_has_labels(t->dataset) && c->priority.score == PAGS_SCORE_DEFAULT;
  const bool trims = c->size_limit.sh_loss > 0.0 && c->color.sh_degree > 0;
  if (!labels && !trims)
    return PAGS_OK;
  PAGS_TRY(pags_score_pass_measure(t, PAGS_SCORE_PASS_WHOLE, &scores));
  if (labels)
    pags_score_pass_write_s_sem(&t->state, &scores);
  return trims ? pags_sh_trim(t, scores.drawn) : PAGS_OK;
}

/* Writes the results of a run. */
static pags_result write_end(pags_trainer *t, pags_train_result *r, const run_clock *clock) {
  pags_train_state *s = &t->state;

  /* A scene must hold finite numbers only; its reader would refuse it otherwise. */
  int64_t dropped = 0;
  for (int64_t i = 0; i < s->model_count; i++)
    PAGS_TRY(pags_model_drop_spoiled(&s->models[i], &dropped));
  if (dropped > 0)
    pags_log_message(PAGS_LOG_WARNING, "%lld Gaussians with parameters that are not finite are left out of the scene",
                     (long long)dropped);

  char masks[MASKS_TEXT];
  if (clock->masked > 0 && pags_dataset_masks_of(t->dataset, clock->first_masked, masks, sizeof masks))
    pags_log_message(
        PAGS_LOG_WARNING,
        "%s: %lld steps taught nothing, since no pixel of their photograph is used; the first photograph is "
        "%s, whose pixels are left out by %s",
        t->output.folder, (long long)clock->masked, pags_dataset_view(t->dataset, clock->first_masked)->name, masks);
  const int64_t done = s->step - clock->first_step, pass = pags_schedule_steps(&s->schedule, t->view_count);
  const int64_t turn = pass < done ? pass : done;
  if (turn > 0 && clock->blank >= turn)
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: nothing of the scene is in view of its %lld training views, which show the background alone",
                     t->output.folder, (long long)t->view_count);

  pags_tasks_mark(t->tasks, NULL, "write");
  PAGS_TRY(pags_output_scene(&t->output, t->dataset, s));
  r->seconds = (pags_clock_ms() - clock->begin) / 1e3;
  r->peak_rss_bytes = pags_port_peak_memory();
  pags_tasks_mark(t->tasks, NULL, "report");
  return pags_output_report(&t->output, r, t->options->command_line, t->tasks);
}

static pags_result run(pags_trainer *t, double begin, pags_train_result *r) {
  run_clock clock = {.begin = begin};
  clock.window = clock.tail = clock.saved = pags_clock_ms();
  clock.window_step = clock.tail_step = clock.first_step = t->state.step;
  const pags_result code = loop(t, &clock);

  /* Fill in the result, the times being means over this process's steps. */
  const pags_train_state *s = &t->state;
  double now = pags_clock_ms(), steps = (double)(s->step - clock.first_step);
  double per_step = steps > 0.0 ? 1.0 / steps : 0.0;
  r->finished = s->step >= s->stop;
  r->iterations = s->step * s->schedule.batch;
  r->gaussians = pags_state_gaussian_count(s);
  r->seconds = (now - clock.begin) / 1e3;
  if (s->step > clock.tail_step)
    r->iterations_per_second =
        1e3 * (double)((s->step - clock.tail_step) * s->schedule.batch) / fmax(now - clock.tail, 1e-6);
  r->peak_rss_bytes = pags_port_peak_memory();
  r->loss = s->loss;
  r->psnr = mean_psnr(t);
  r->bad_rows = s->nonfinite.count;
  if (s->nonfinite.count > 0)
    pags_nonfinite_describe(&s->nonfinite, bad_row_name(t), r->first_bad_row);
  r->heap_calls_steady = pags_frame_heap_calls(t->render.frame) - clock.tail_heap_calls;
  r->ms_wait = t->ms.wait.wall * per_step;
  r->ms_forward = t->ms.forward.wall * per_step;
  r->ms_loss = t->ms.loss.wall * per_step;
  r->ms_backward = t->ms.backward.wall * per_step;
  r->ms_density = t->ms.density.wall * per_step;
  r->ms_processor =
      per_step * (t->ms.forward.processor + t->ms.loss.processor + t->ms.backward.processor + t->ms.density.processor);
  for (int k = 0; k < PAGS_DECISIONS; k++) {
    r->decision_seconds[k] = 1e-3 * t->ms.of[k].wall;
    r->decision_steps[k] = t->done[k];
    r->decision_test_seconds[k] = 1e-3 * t->ms.tests[k].wall;
  }
  r->traffic = t->traffic;
  r->seconds_watched = 1e-3 * t->watched_ms;

  PAGS_TRY(code);
  if (t->options->estimate) {
    /* Only an estimate was asked for: fill it in and write no files. */
    pags_estimate estimate;
    PAGS_TRY(pags_trainer_estimate(t, &estimate));
    r->estimated_seconds = estimate.step_seconds * (double)t->state.stop + estimate.scoring_seconds;
    r->estimated_bytes = estimate.bytes;
    return PAGS_OK;
  }
  const bool writes = t->shared.rank == 0;

  /* What all ranks do at the end. The checkpoint is written first, so that nothing trained is lost if writing the scene
   * fails. */
  pags_tasks_mark(t->tasks, "checkpoint", "write");
  pags_state_flush(&t->state, t->tasks); /* no step is pending from here on */
  PAGS_TRY(pags_shards_save_whole(t->output.checkpoint, t->options->transport, s, t->fingerprint));
  pags_tasks_mark(t->tasks, "scene", "settle");
  if (s->step >= s->stop && s->step >= s->schedule.length) /* a run that will be resumed doesn't spend time on it */
    PAGS_TRY(finish_scene(t));
  PAGS_TRY(pags_share_run_end(t));
  r->peak_rss_bytes = pags_port_peak_memory();
  return writes ? write_end(t, r, &clock) : PAGS_OK;
}

/* ---- Opening and closing ---- */

pags_train_options pags_train_options_default(void) {
  return (pags_train_options){.image_cache = (uint64_t)1 << 30,
                              .checkpoint_every = 1000,
                              .log_every = 100,
                              .preview_every = 1000,
                              .bad_rows_most = 1000};
}

/* What a rank finds out by itself, before anything is written; rank 0 alone writes to the folder. */
static pags_result prepare(pags_trainer *t, const pags_train_config *asked, pags_train_config *config, bool *found,
                           bool *one_colour) {
  const pags_train_options *o = t->options;
  const bool driving = pags_dataset_fps(t->dataset) > 0.0;
  PAGS_TRY(pags_train_config_check(asked));
  if (!o->estimate)
    PAGS_TRY(pags_output_find(&t->output, o, found));
  PAGS_TRY(pags_views_list(t));
  PAGS_TRY(pags_photo_cache_create(t->dataset, t->tasks, o->image_cache, &t->cache));
  if (!driving)
    PAGS_TRY(pags_views_find_one_colour(t, one_colour));

  /* Fill in the fields set to auto. Blocks of a recording have one gauge of poses and brightness, which corrections of
   * each block by itself would move. Photographs of one colour have none that depends on the view. */
  *config = *asked;
  if (*one_colour && config->color.sh_degree < 0)
    config->color.sh_degree = 0;
  if (pags_dataset_block(t->dataset)) {
    config->cameras.camera_poses = config->cameras.camera_poses > 0;
    config->cameras.light = config->cameras.light > 0;
    config->exposure.exposure = config->exposure.exposure != 0;
  }
  *config = pags_config_resolve(config, driving);
  PAGS_TRY(pags_train_config_check(config)); /* chosen values can contradict those that were set */
  if (o->estimate && t->ranks > 1)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "--estimate requires one process; it can't be shared between ranks");
  return PAGS_OK;
}

static pags_result open_state(pags_trainer *t, const pags_train_config *config, bool found) {
  PAGS_TRY(found ? pags_trainer_resume(t, config) : pags_trainer_start(t, config));
  return pags_view_render_create(t);
}

static pags_result open_run(pags_trainer *t, const pags_train_config *asked, pags_train_result *result) {
  const pags_train_options *o = t->options;
  pags_train_config config;
  bool found = false, one_colour = false;
  PAGS_TRY(pags_transport_agree(o->transport, prepare(t, asked, &config, &found, &one_colour)));
  PAGS_TRY(pags_transport_agree(o->transport, open_state(t, &config, found)));
  t->state.one_colour = one_colour;
  PAGS_TRY(pags_share_run_begin(t));
  if (!found)
    PAGS_TRY(pags_size_limit_start(t->dataset, &t->state, t->tasks));
  if (!found && !o->estimate)
    PAGS_TRY(pags_score_pass_set_s_sem(t));
  result->resumed = found;
  pags_result mine = PAGS_OK;
  if (config.density.lidar_pull > 0.0 || config.density.lidar_lay > 0.0)
    mine = pags_lidar_planes_create(t->dataset, t->tasks, &t->lidar_planes);
  if (mine == PAGS_OK && !o->estimate && t->shared.rank == 0)
    mine = pags_output_open(&t->output, found, t->state.step);
  return pags_transport_agree(o->transport, mine);
}

pags_result pags_train(const pags_train_config *config, const pags_train_options *options, pags_train_result *result) {
  double begin = pags_clock_ms();
  assert(options->dataset && options->tasks && (options->output || options->estimate));
  *result = (pags_train_result){0};
  PAGS_AUTOFREE pags_trainer *t = calloc(1, sizeof *t);
  PAGS_CHECK_MEMORY(t, "a trainer");
  t->options = options;
  t->dataset = options->dataset;
  t->tasks = options->tasks;
  t->ranks = pags_transport_ranks(options->transport);
  pags_result code = open_run(t, config, result);
  if (code == PAGS_OK)
    code = run(t, begin, result);
  if (t->ranks > 1) /* where rank 0 has gone on alone, the others have done their part */
    pags_transport_give_up(options->transport, code);

  /* Free everything; close the output folder. */
  pags_output_close(&t->output, code != PAGS_OK);
  pags_photo_cache_destroy(t->cache);
  pags_view_render_destroy(t);
  pags_share_run_destroy(t);
  pags_state_destroy(&t->state);
  pags_lidar_planes_destroy(&t->lidar_planes);
  free(t->rest.photographs);
  free(t->rest.poses);
  free(t->views);
  free(t->order);
  return code;
}
