/* SPDX-License-Identifier: Apache-2.0 */
/* Adaptive density control of Kerbl et al. (2023), section 5, with the constants and the order of their program.
 *
 * The statistic is the norm of the gradient by a Gaussian's projected mean, in NDC, averaged over the views in which
 * the Gaussian was drawn. Where it is large, the Gaussian covers too much or too little: a large one is split into
 * two samples of itself with smaller sigmas, a small one is cloned in place (the two then separate by the
 * optimiser's noise). Gaussians that have become transparent are pruned, and, once opacities have been reset, those
 * that have become too large. If the limit on Gaussians leaves no room for all clones and splits, those with the
 * largest gradients are done, ties by row. */
#include "train/densify.h"

#include <math.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "base/rng.h"
#include "cluster/order.h"
#include "cluster/shares.h"
#include "maths/maths.h"

enum { ROWS_AT_A_TIME = 1024 }; /* a worker's block */

/* ---- Deciding ---- */

/* Prunes that would leave fewer Gaussians than this are withdrawn: a run that loses everything has failed already,
 * and with a few rows it can still end in an orderly way. */
static const int64_t least_survivors = 16;

/* Kerbl et al. (2023). Fractions of the extent: a Gaussian with a larger sigma is split, others are cloned; one with a
 * larger sigma is removed after the first reset. Ratio of the parent's sigma to that of a split's children. */
static const double dense_sigma = 0.01, most_sigma = 0.1, split_divisor = 1.6;

static float logit(double probability) {
  return (float)pags_log(probability / (1.0 - probability));
}

/* Returns the mean gradient of a Gaussian, reweighted. The loss counts critical pixels critical_weight times, growth
 * shall count them critical_growth times; S_sem is the share of critical pixels among those that show the
 * Gaussian. */
static float mean_gradient(const pags_train_model *model, int64_t row) {
  const pags_density *density = &model->density;
  const pags_train_config *c = &model->schedule.config;
  float mean = density->seen[row] > 0 ? density->gradient[row] / (float)density->seen[row] : 0.0f;
  if (!model->gaussians.s_sem)
    return mean;
  double s_sem = (double)model->gaussians.s_sem[row];
  return mean * (float)((1.0 + (c->priority.critical_growth - 1.0) * s_sem) /
                        (1.0 + (c->priority.critical_weight - 1.0) * s_sem));
}

/* An opacity that density control goes by: times 255 alpha_min where that is set. */
static double scaled_opacity(const pags_schedule *s, double opacity) {
  const double alpha_min = s->config.picture.alpha_min;
  return alpha_min > 0 ? fmin(255.0 * alpha_min * opacity, 1.0 - 1e-6) : opacity;
}

typedef struct decide_job {
  const pags_train_model *model;
  float gradient, dense_sigma, prune_logit, prune_sigma; /* thresholds */
  uint8_t *kind;                                         /* a pags_edit per row */
} decide_job;

/* An object's Gaussians are kept in its box times this factor: boxes are labelled tightly, and mirrors and other
 * parts that the label misses stick out. */
static const double box_margin = 1.5;

static bool strays(const pags_train_model *model, int64_t row) {
  for (int k = 0; k < 3 && model->half_size[k] > 0.0; k++)
    if (fabs((double)pags_plane(&model->gaussians, PAGS_MEAN + k)[row]) > box_margin * model->half_size[k])
      return true;
  return false;
}

static pags_edit decide_row(const decide_job *t, int64_t row) {
  const pags_train_model *model = t->model;
  const pags_gaussians *g = &model->gaussians;
  if (!pags_model_is_finite_row(g, row) || pags_plane(g, PAGS_OPACITY)[row] < t->prune_logit || strays(model, row))
    return PAGS_EDIT_PRUNE;
  float sigma = pags_expf(fmaxf(fmaxf(pags_plane(g, PAGS_SCALE)[row], pags_plane(g, PAGS_SCALE + 1)[row]),
                                pags_plane(g, PAGS_SCALE + 2)[row]));
  const bool pulled = mean_gradient(model, row) >= t->gradient;
  if (pulled && sigma > t->dense_sigma) /* the limit on sigma applies to its children */
    return sigma / (float)split_divisor > t->prune_sigma ? PAGS_EDIT_PRUNE : PAGS_EDIT_SPLIT;
  if (sigma > t->prune_sigma)
    return PAGS_EDIT_PRUNE;
  return pulled ? PAGS_EDIT_CLONE : PAGS_EDIT_KEEP;
}

static void decide_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const decide_job *const job = context;
  for (int64_t row = begin; row < end; row++)
    job->kind[row] = (uint8_t)decide_row(job, row);
}

static bool grows(const pags_edits *edits, int64_t row) {
  return edits->kind[row] == PAGS_EDIT_CLONE || edits->kind[row] == PAGS_EDIT_SPLIT;
}

/* Orders Gaussians by falling gradient, then by row. */
static pags_key growth_key(const pags_train_model *model, int64_t row) {
  return (pags_key){~pags_key_of_float(mean_gradient(model, row)), (uint64_t)(model->first_row + row)};
}

/* Where there is room for only `room` more Gaussians: keeps the clones and splits with the largest gradients and
 * cancels the rest. */
static pags_result cut_growth(const pags_train_model *model, pags_edits *edits, int64_t room) {
  pags_transport *const transport = pags_model_transport(model);
  PAGS_AUTOFREE pags_key *keys = malloc((size_t)(edits->count + 1) * sizeof *keys);
  pags_key first_cut;
  int64_t n = 0;
  for (int64_t row = 0; keys && row < edits->count; row++)
    if (grows(edits, row))
      keys[n++] = growth_key(model, row);
  PAGS_TRY(pags_transport_agree(
      transport, keys ? pags_keys_sort(keys, n) : pags_out_of_memory("%lld Gaussians", (long long)edits->count)));
  PAGS_TRY(pags_order_find(transport, keys, n, &room, 1, &first_cut));
  for (int64_t row = 0; row < edits->count; row++)
    if (grows(edits, row) && !pags_key_less(growth_key(model, row), first_cut))
      edits->kind[row] = PAGS_EDIT_KEEP;
  return PAGS_OK;
}

/* Counts what happens to the Gaussians of all ranks. */
static pags_result count_edits(const pags_train_model *model, pags_edits *edits) {
  int64_t counts[4] = {0};
  for (int64_t row = 0; row < edits->count; row++)
    counts[edits->kind[row]]++;
  PAGS_TRY(pags_share_sum(pags_model_transport(model), counts, 4));
  edits->cloned = counts[PAGS_EDIT_CLONE];
  edits->split = counts[PAGS_EDIT_SPLIT];
  edits->pruned = counts[PAGS_EDIT_PRUNE];
  return PAGS_OK;
}

/* Withdraws prunes that would leave too few Gaussians, and growth beyond the limit on Gaussians. */
static pags_result keep_limits(const pags_train_model *model, pags_edits *edits) {
  const int64_t count = model->total;
  PAGS_TRY(count_edits(model, edits));
  edits->wanted = edits->cloned + edits->split;
  if (edits->pruned > 0 && count - edits->pruned < least_survivors) {
    /* No warning for objects: those far away may well start from so few Gaussians. */
    if (model->object < 0)
      pags_log_message(PAGS_LOG_WARNING, "densify would leave %lld of %lld Gaussians: nothing is pruned",
                       (long long)(count - edits->pruned), (long long)count);
    for (int64_t row = 0; row < edits->count; row++)
      if (edits->kind[row] == PAGS_EDIT_PRUNE)
        edits->kind[row] = PAGS_EDIT_KEEP;
    edits->pruned = 0;
  }
  const int64_t left = (model->cap > 0 ? model->cap : INT32_MAX - 64) - (count - edits->pruned);
  const int64_t room = left < 0 ? 0 : left;
  if (edits->wanted <= room)
    return PAGS_OK;
  PAGS_TRY(cut_growth(model, edits, room));
  return count_edits(model, edits);
}

pags_result pags_densify_decide(const pags_train_model *model, pags_tasks *tasks, pags_edits *edits) {
  const pags_schedule *s = &model->schedule;
  const int64_t count = model->gaussians.count;
  *edits = (pags_edits){.count = count, .kind = malloc((size_t)(count > 0 ? count : 1))};
  decide_job job = {
      .model = model,
      .gradient = (float)s->config.density.densify_gradient,
      .dense_sigma = (float)(dense_sigma * s->extent),
      .prune_logit = logit(scaled_opacity(s, s->config.density.prune_opacity)),
      .prune_sigma = pags_schedule_prunes_large(s, model->step) ? (float)(most_sigma * s->extent) : INFINITY,
      .kind = edits->kind};
  const pags_result mine = edits->kind ? pags_parallel_run(tasks, count, ROWS_AT_A_TIME, decide_rows, &job)
                                       : pags_out_of_memory("%lld Gaussians", (long long)count);
  PAGS_TRY(pags_transport_agree(pags_model_transport(model), mine));
  return keep_limits(model, edits);
}

void pags_edits_destroy(pags_edits *edits) {
  free(edits->kind);
  *edits = (pags_edits){0};
}

/* ---- Applying ---- */

/* Turns `row`, a copy of its parent, into a child of a split: draws its mean from the parent's distribution and
 * divides its sigmas. (step, child, parent) determine the random numbers. With long_axis_split, the children lie on
 * either side on the longest axis instead, by sqrt(1 - 1 / split_divisor^2) sigma, and only that axis' sigma is
 * divided, so that both together have the parent's variance. */
static void make_child(const pags_train_model *model, pags_gaussians *g, int64_t row, int child, int64_t parent) {
  const pags_train_config *c = &model->schedule.config;
  const int purpose = PAGS_DRAW_SPLIT + 2 * child;
  double n[4] = {0}, q[4], r[9], offset[3];
  int axis = c->density.long_axis_split ? 0 : -1;
  for (int i = 1; i < 3 && axis >= 0; i++)
    if (pags_plane(g, PAGS_SCALE + i)[row] > pags_plane(g, PAGS_SCALE + axis)[row])
      axis = i;
  if (axis >= 0) {
    n[axis] = (child ? -1.0 : 1.0) * sqrt(1.0 - 1.0 / (split_divisor * split_divisor));
  } else {
    pags_rng_normal2(c->schedule.seed, pags_draw(model->step, purpose), (uint64_t)parent, n);
    pags_rng_normal2(c->schedule.seed, pags_draw(model->step, purpose + 1), (uint64_t)parent, n + 2);
  }
  for (int i = 0; i < 4; i++)
    q[i] = (double)pags_plane(g, PAGS_ROTATION + i)[row];
  pags_rotation_from_quaternion(q, r);
  for (int i = 0; i < 3; i++)
    offset[i] = n[i] * pags_exp((double)pags_plane(g, PAGS_SCALE + i)[row]);
  for (int i = 0; i < 3; i++) {
    float *mean = &pags_plane(g, PAGS_MEAN + i)[row];
    const double moved = (double)*mean + r[3 * i] * offset[0] + r[3 * i + 1] * offset[1] + r[3 * i + 2] * offset[2];
    *mean = fabs(moved) < 3e38 ? (float)moved : *mean; /* sigma may be so large that the mean would overflow */
    if (axis < 0 || i == axis)
      pags_plane(g, PAGS_SCALE + i)[row] -= (float)pags_log(split_divisor);
  }
}

/* New rows of each kind, in their order: those that stay, the copies of cloned rows, the first and the second children
 * of split rows. */
enum { STAY, COPY, FIRST_CHILD, SECOND_CHILD, KINDS };
typedef struct new_rows {
  int64_t count[KINDS];  /* at this rank */
  int64_t number[KINDS]; /* of the first of them, among the rows of all ranks: kind after kind */
} new_rows;

static pags_result count_new(const pags_train_model *model, const pags_edits *edits, new_rows *n) {
  int64_t at = 0;
  *n = (new_rows){{0}, {0}};
  for (int64_t row = 0; row < edits->count; row++) {
    n->count[STAY] += edits->kind[row] == PAGS_EDIT_KEEP || edits->kind[row] == PAGS_EDIT_CLONE;
    n->count[COPY] += edits->kind[row] == PAGS_EDIT_CLONE;
    n->count[FIRST_CHILD] += edits->kind[row] == PAGS_EDIT_SPLIT;
  }
  n->count[SECOND_CHILD] = n->count[FIRST_CHILD];
  for (int k = 0; k < KINDS; k++) {
    int64_t before, all;
    PAGS_TRY(pags_share_before(pags_model_transport(model), n->count[k], &before, &all));
    n->number[k] = at + before;
    at += all;
  }
  return PAGS_OK;
}

/* Fills `source` with the old row of each new row, and `numbers` with the new row's place among those of all ranks. */
static void list_sources(const pags_edits *edits, const new_rows *n, int64_t *source, uint32_t *numbers) {
  int64_t at[KINDS] = {0}, done[KINDS] = {0};
  for (int k = 1; k < KINDS; k++)
    at[k] = at[k - 1] + n->count[k - 1];
  for (int64_t row = 0; row < edits->count; row++) {
    const uint8_t kind = edits->kind[row];
    const bool wanted[KINDS] = {kind == PAGS_EDIT_KEEP || kind == PAGS_EDIT_CLONE, kind == PAGS_EDIT_CLONE,
                                kind == PAGS_EDIT_SPLIT, kind == PAGS_EDIT_SPLIT};
    for (int k = 0; k < KINDS; k++)
      if (wanted[k]) {
        source[at[k] + done[k]] = row;
        numbers[at[k] + done[k]] = (uint32_t)(n->number[k] + done[k]);
        done[k]++;
      }
  }
}

typedef struct children_job {
  const pags_train_model *model;
  pags_gaussians *gaussians;
  const int64_t *source;
  int64_t first, second; /* the rows of the first and of the second children begin there */
  int64_t first_row;     /* that the sources' numbers begin with */
} children_job;

static void make_children(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const children_job *const job = context;
  for (int64_t i = job->first + begin; i < job->first + end; i++)
    make_child(job->model, job->gaussians, i, i >= job->second, job->first_row + job->source[i]);
}

pags_result pags_densify_apply(pags_train_model *model, const pags_edits *edits, pags_tasks *tasks) {
  const int64_t first_row = model->first_row;
  new_rows n;
  PAGS_TRY(count_new(model, edits, &n));
  const int64_t half = n.count[STAY] + n.count[COPY], count = half + 2 * n.count[FIRST_CHILD];
  PAGS_AUTOFREE int64_t *source = malloc((size_t)(count + 1) * sizeof *source);
  PAGS_AUTOFREE uint32_t *numbers = malloc((size_t)(count + 1) * sizeof *numbers);
  pags_result result = source && numbers ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)count);
  if (result == PAGS_OK) {
    list_sources(edits, &n, source, numbers);
    result = pags_model_gather(model, source, count, n.count[STAY], tasks);
  }
  children_job job = {model, &model->gaussians, source, half, half + n.count[FIRST_CHILD], first_row};
  if (result == PAGS_OK && !pags_parallel_for(tasks, count - half, ROWS_AT_A_TIME / 4, make_children, &job))
    result = pags_fail(PAGS_CANCELLED, "cancelled while Gaussians were split"); /* must not be saved */
  pags_model_clear_density(model);
  PAGS_TRY(pags_transport_agree(pags_model_transport(model), result));
  return pags_model_sort(model, numbers, tasks);
}

void pags_densify_reset(pags_train_model *model) {
  float *opacity = pags_plane(&model->gaussians, PAGS_OPACITY);
  const double reset = model->schedule.config.density.reset_opacity;
  float most = logit(fmin(scaled_opacity(&model->schedule, reset), 1.0 - 1e-6));
  for (int64_t i = 0; i < model->gaussians.count; i++)
    opacity[i] = opacity[i] > most ? most : opacity[i];
  pags_adam_forget(&model->adam, PAGS_OPACITY, PAGS_OPACITY + 1);
}

void pags_densify_reset_scales(pags_train_model *model, pags_tasks *tasks) {
  const float step = (float)pags_log(model->schedule.config.density.scale_reset);
  for (int k = 0; k < 3; k++) {
    float *scale = pags_plane(&model->gaussians, PAGS_SCALE + k);
    for (int64_t i = 0; i < model->gaussians.count; i++)
      scale[i] += step;
  }
  pags_adam_forget(&model->adam, PAGS_SCALE, PAGS_SCALE + 3);
  pags_adam_bound_all(&model->adam, &model->gaussians, &model->clusters, tasks);
}
