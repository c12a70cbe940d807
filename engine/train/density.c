/* SPDX-License-Identifier: Apache-2.0 */
/* Density control after a training step: adaptive density control (Kerbl et al. 2023) or MCMC (Kheradmand et al.
 * 2024), and the other operations on all Gaussians that the schedule names: pruning by score, colour over time, the
 * pull onto LiDAR planes, opacity resets. */
#include "base/parallel.h"
#include "threads/record.h"
#include "train/densify.h"
#include "train/mcmc.h"
#include "train/prune.h"
#include "train/stages.h"

enum { UNSEEN_GRAIN = 4 };

typedef struct unseen_job {
  pags_train_model *model;
  pags_nonfinite *nonfinite;
  float *rows; /* of the trainer's view_render */
} unseen_job;

static void move_unseen_block(void *context, int64_t begin, int64_t end, int worker) {
  const unseen_job *job = context;
  pags_train_model *m = job->model;
  const int64_t step = m->step;
  const int stride = m->adam.cluster_size;
  const int planes = pags_plane_count(pags_schedule_sh_degree(&m->schedule, step));
  const int columns = pags_gradient_planes(&m->gaussians, planes);
  float *const data = job->rows + (int64_t)worker * pags_row_floats(&m->schedule.config);
  for (int64_t c = begin; c < end; c++) {
    if (m->adam.moment_step[c] == step)
      continue;
    memset(data, 0, (size_t)columns * (size_t)stride * sizeof(float));
    pags_adam_touch(&m->adam, &m->gaussians, c, step);
    pags_mcmc_regularise(m, c * stride, pags_cluster_rows(m->gaussians.count, stride, c), data, stride);
    pags_model_update(m, job->nonfinite, c, data, stride, planes);
  }
}

static pags_result densify(pags_trainer *t, pags_train_model *m, pags_edits *change) {
  PAGS_AUTO(pags_edits_destroy) pags_edits edits = {0};
  pags_tasks_mark(t->tasks, NULL, "decide");
  PAGS_TRY(pags_densify_decide(m, t->tasks, &edits));
  pags_tasks_mark(t->tasks, NULL, "apply");
  change->cloned += edits.cloned;
  change->split += edits.split;
  change->pruned += edits.pruned;
  change->wanted += edits.wanted;
  return pags_densify_apply(m, &edits, t->tasks);
}

/* Runs densify of all models, or MCMC's relocation and growth, after the step just done. The models must be settled
 * (no pending Adam steps). The number of Gaussians that the limits (max_gaussians, memory, target_size) still allow is
 * shared out in proportion to the models' numbers of Gaussians. */
static pags_result refine(pags_trainer *t) {
  pags_train_state *s = &t->state;
  const bool mcmc = s->schedule.config.density.strategy == PAGS_STRATEGY_MCMC;
  const int64_t total = pags_state_gaussian_count(s);
  pags_edits change = {0}; /* sums over all models */
  int64_t room;
  PAGS_TRY(pags_size_limit_room(t->dataset, s, &room));
  const bool bounded = s->cap > 0 || room < INT32_MAX;
  if (s->cap > 0)
    room = s->cap < total ? 0 : s->cap - total < room ? s->cap - total : room;
  for (int64_t i = 0; i < s->model_count; i++) {
    const int64_t count = s->models[i].total;
    const double share = (double)count / (double)(total > 0 ? total : 1);
    s->models[i].cap = bounded ? count + (int64_t)((double)room * share) : 0;
  }
  for (int64_t i = 0; i < s->model_count; i++)
    PAGS_TRY(mcmc ? pags_mcmc_refine(&s->models[i], t->tasks) : densify(t, &s->models[i], &change));
  if (mcmc || !t->output.lines.stream)
    return PAGS_OK;
  const pags_log_value values[] = {
      {"step", (double)s->step},         {"gaussians", (double)pags_state_gaussian_count(s)},
      {"cloned", (double)change.cloned}, {"split", (double)change.split},
      {"pruned", (double)change.pruned}, {"wanted", (double)change.wanted}};
  return pags_output_log(&t->output, values, sizeof values / sizeof *values);
}

/* Under MCMC, the regularisers and the noise also move the Gaussians that the step's view doesn't show. */
static pags_result move_unseen(pags_trainer *t) {
  pags_train_state *s = &t->state;
  t->shared_nonfinite = s->nonfinite.count;
  for (int64_t i = 0; i < s->model_count; i++) {
    pags_train_model *const m = &s->models[i];
    pags_adam_begin(&m->adam, m->step);
    PAGS_TRY(pags_parallel_run(t->tasks, m->adam.cluster_count, UNSEEN_GRAIN, move_unseen_block,
                               &(unseen_job){m, &s->nonfinite, t->render.rows}));
    PAGS_TRY(pags_mcmc_noise(m, m->step, t->tasks));
  }
  return t->ranks > 1 ? pags_shared_step_nonfinite(t) : PAGS_OK;
}

pags_result pags_density_control(pags_trainer *t) {
  pags_train_state *s = &t->state;
  const pags_schedule *d = &s->schedule;
  const double pull = d->config.density.lidar_pull, lay = d->config.density.lidar_lay;
  const bool due = pags_schedule_is_densify(d, s->step), reset = pags_schedule_is_reset(d, s->step);
  const bool fourier =
      d->config.objects.fourier == PAGS_FOURIER_BY_GAIN && s->step == d->fourier_from && s->model_count > 1;
  const int prune = pags_schedule_prune(d, s->step);
  if (d->config.density.strategy == PAGS_STRATEGY_MCMC)
    PAGS_TRY(move_unseen(t));
  const bool planes = t->lidar_planes.count > 0, pulls = pull > 0 && planes && pags_schedule_is_draw(d, s->step);
  const bool lays = lay > 0 && planes && pags_schedule_is_lay(d, s->step);
  const bool scales = pags_schedule_is_scale_reset(d, s->step);
  if (!due && !reset && !fourier && !pulls && !lays && !scales && prune < 0)
    return PAGS_OK;
  pags_tasks_mark(t->tasks, "densify", "settle");
  pags_state_settle(s, t->tasks);
  if (due)
    PAGS_TRY(refine(t));
  pags_tasks_mark(t->tasks, NULL, "other");
  if (fourier)
    PAGS_TRY(pags_color_over_time_decide(t));
  if (prune >= 0)
    PAGS_TRY(pags_prune(t, prune));
  pags_tasks_mark(t->tasks, NULL, "other");
  if (pulls || lays) { /* move the background's Gaussians to the LiDAR planes, then recompute its clusters' bounds */
    pags_train_model *m = &s->models[0];
    if ((pulls && !pags_lidar_planes_pull(&t->lidar_planes, &m->gaussians, pull, t->tasks)) ||
        (lays && !pags_lidar_planes_lay(&t->lidar_planes, &m->gaussians, lay, t->tasks)))
      return pags_fail(PAGS_CANCELLED, "cancelled");
    pags_adam_bound_all(&m->adam, &m->gaussians, &m->clusters, t->tasks);
  }
  for (int64_t i = 0; i < s->model_count; i++) {
    if (scales)
      pags_densify_reset_scales(&s->models[i], t->tasks);
    if (reset)
      pags_densify_reset(&s->models[i]);
  }
  s->resets += reset;
  return PAGS_OK;
}
