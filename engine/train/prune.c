/* SPDX-License-Identifier: Apache-2.0 */
/* Pruning by score. The paper ranks all Gaussians by S_hybrid and removes the lowest; two ways to compute it are
 * offered:
 *
 *     sum      S_hybrid = alpha S_sem + (1 - alpha) S_grad (the paper's)
 *     product  S_hybrid = (1 - alpha + alpha S_sem) S_grad
 *
 * S_sem lies in 0..1; S_grad is heavy-tailed over many powers of ten, but its percentile rank is spread evenly over
 * 0..1, so that alpha is the true weight of the two. With the sum, Gaussians that show nothing critical score up to 1
 * - alpha, and those that show only critical things score at least alpha, even if no pixel needs them. The product
 * demands more of what isn't critical and keeps no Gaussian that doesn't matter to the picture. A Gaussian that no
 * training view shows has score 0, whatever S_sem it inherited. */
#include "train/prune.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/rng.h"
#include "base/sort.h"
#include "maths/maths.h"
#include "threads/record.h"
#include "train/score_pass.h"
#include "train/size_limit.h"

/* ---- Normalising scores ---- */

/* No prune leaves fewer Gaussians than this: a run that loses everything has failed already, and with a few rows it
 * can still end in an orderly way. */
static const int64_t least_survivors = 16;

typedef struct ranked {
  double value;
  uint32_t draw;
  int64_t row;
} ranked;

static int by_value(const void *a, const void *b) {
  const ranked *x = a, *y = b;
  if (x->value != y->value)
    return x->value < y->value ? -1 : 1;
  if (x->draw != y->draw)
    return x->draw < y->draw ? -1 : 1;
  return x->row < y->row ? -1 : x->row > y->row;
}

static pags_result make_list(int64_t count, ranked **out) {
  *out = malloc((size_t)(count > 0 ? count : 1) * sizeof **out);
  return *out ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)count);
}

static void rank_list(const ranked *list, int64_t count, float *out) {
  int64_t lower = 0;
  for (int64_t i = 0; i < count; i++) {
    if (i > 0 && list[i].value > list[i - 1].value)
      lower = i;
    out[list[i].row] = count > 1 ? (float)((double)lower / (double)(count - 1)) : 0.0f;
  }
}

static void log_list(const ranked *list, int64_t count, float *out) {
  int64_t zeros = 0;
  while (zeros < count && !(list[zeros].value > 0.0))
    zeros++;
  double median = zeros < count ? list[zeros + (count - zeros) / 2].value : 1.0;
  double most = count > zeros ? pags_log1p(list[count - 1].value / median) : 1.0;
  for (int64_t i = 0; i < count; i++)
    out[list[i].row] = (float)(pags_log1p(list[i].value / median) / most);
}

static void stretch_list(const ranked *list, int64_t count, float *out) {
  double least = count > 0 ? list[0].value : 0.0, range = count > 0 ? list[count - 1].value - least : 0.0;
  for (int64_t i = 0; i < count; i++)
    out[list[i].row] = range > 0.0 ? (float)((list[i].value - least) / range) : 0.0f;
}

pags_result pags_prune_normalise(pags_s_grad kind, const double *raw, int64_t count, float *out) {
  ranked *list;
  PAGS_TRY(make_list(count, &list));
  for (int64_t i = 0; i < count; i++)
    list[i] = (ranked){raw[i] > 0.0 ? raw[i] : 0.0, 0, i}; /* NaN counts as 0 */
  pags_sort(list, count, sizeof *list, by_value);
  if (kind == PAGS_S_GRAD_RANK)
    rank_list(list, count, out);
  else
    (kind == PAGS_S_GRAD_LOG ? log_list : stretch_list)(list, count, out);
  free(list);
  return PAGS_OK;
}

/* ---- Choosing rows ---- */

pags_result pags_prune_choose(const pags_prune_request *r, uint8_t *drop, int64_t *dropped) {
  ranked *list;
  *dropped = 0;
  PAGS_TRY(make_list(r->count, &list));
  int64_t *members = calloc((size_t)r->groups + 1, sizeof *members);
  if (!members) {
    free(list);
    return pags_out_of_memory("%lld groups", (long long)r->groups);
  }
  for (int64_t i = 0; i < r->count; i++) {
    uint32_t bits[4];
    pags_rng_u32x4(r->seed, r->draw, (uint64_t)i, bits);
    list[i] = (ranked){(double)r->score[i], bits[0], i};
    members[r->group[i]]++;
    drop[i] = 0;
  }
  pags_sort(list, r->count, sizeof *list, by_value);

  /* The floor of each group, lowered so that all floors together take at most half of the target. */
  int64_t groups = 0;
  for (int64_t g = 1; g < r->groups; g++)
    groups += members[g] > 0;
  int64_t most = groups > 0 ? r->target / 2 / groups : r->floor;
  int64_t floor = r->floor < most ? r->floor : most;

  for (int64_t i = 0; i < r->count && r->count - *dropped > r->target; i++) {
    int32_t group = r->group[list[i].row];
    if (group > 0 && members[group] <= floor)
      continue;
    members[group]--;
    drop[list[i].row] = 1;
    ++*dropped;
  }

  free(members);
  free(list);
  return PAGS_OK;
}

int64_t pags_prune_target(const pags_schedule *s, int index, int64_t count) {
  const int64_t most = s->config.size_limit.max_gaussians, growth_ends = s->densify_until - s->densify_every;
  int64_t target = count - (int64_t)(s->prune_rate[index] * (double)count);
  if (most > 0 && index == s->prunes - 1 && target > most)
    target = most;
  if (most > 0 && s->config.schedule.preset != PAGS_PRESET_PAPER && s->prune_step[index] >= growth_ends &&
      target < most)
    target = most < count ? most : count; /* nothing fills up again what is pruned now */
  return target > least_survivors ? target : least_survivors;
}

/* ---- The prune of a run ---- */

/* Arrays over the rows of all models, model after model. */
typedef struct row_lists {
  float *score;
  int32_t *group;
  uint8_t *drop;
  double *raw;
} row_lists;

static pags_result create_lists(row_lists *l, int64_t count) {
  size_t room = (size_t)(count > 0 ? count : 1);
  *l = (row_lists){malloc(room * sizeof(float)), malloc(room * sizeof(int32_t)), malloc(room),
                   malloc(room * sizeof(double))};
  return l->score && l->group && l->drop && l->raw ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)count);
}

static int32_t group_of(const pags_train_model *m, int64_t row) {
  if (m->object >= 0)
    return (int32_t)m->object + 1;
  return m->gaussians.object_id ? m->gaussians.object_id[row] + 1 : 0;
}

double pags_prune_hybrid(const pags_train_config *c, double s_sem, double s_grad) {
  return c->priority.hybrid == PAGS_HYBRID_PRODUCT ? (1.0 - c->priority.alpha + c->priority.alpha * s_sem) * s_grad
                                                   : c->priority.alpha * s_sem + (1.0 - c->priority.alpha) * s_grad;
}

/* Computes S_hybrid and the group (object) of all rows of all models. */
static pags_result score_rows(const pags_train_state *s, const pags_score_pass *scores, row_lists *l) {
  const pags_train_config *c = &s->schedule.config;
  int64_t at = 0;
  for (int64_t i = 0; i < s->model_count; i++)
    for (int64_t row = 0; row < s->models[i].gaussians.count; row++, at++)
      l->raw[at] = c->priority.s_grad_from == PAGS_S_GRAD_FROM_PASS ? scores->squared[at]
                                                                    : (double)s->models[i].density.squared[row];
  PAGS_TRY(pags_prune_normalise(c->priority.s_grad, l->raw, at, l->score));
  at = 0;
  for (int64_t i = 0; i < s->model_count; i++) {
    const pags_train_model *m = &s->models[i];
    for (int64_t row = 0; row < m->gaussians.count; row++, at++) {
      double s_sem = m->gaussians.s_sem ? (double)m->gaussians.s_sem[row] : 0.0;
      double hybrid = pags_prune_hybrid(c, s_sem, (double)l->score[at]);
      l->score[at] = scores->drawn[at] > 0.0 ? (float)hybrid : 0.0f;
      l->group[at] = group_of(m, row);
    }
  }
  return PAGS_OK;
}

static pags_result keep_rows(pags_train_model *m, const uint8_t *drop, pags_tasks *tasks) {
  int64_t count = m->gaussians.count, kept = 0;
  int64_t *source = malloc((size_t)(count > 0 ? count : 1) * sizeof *source);
  if (!source)
    return pags_out_of_memory("%lld Gaussians", (long long)count);
  for (int64_t row = 0; row < count; row++)
    if (!drop[row])
      source[kept++] = row;
  pags_result result = kept < count ? pags_model_gather(m, source, kept, kept, tasks) : PAGS_OK;
  free(source);
  if (result == PAGS_OK && kept < count)
    result = pags_model_sort(m, tasks);
  if (m->density.squared)
    memset(m->density.squared, 0, (size_t)m->density.capacity * sizeof *m->density.squared);
  return result;
}

/* Computes the number of Gaussians that a prune shall leave. The last prune also applies the size limit
 * target_size. */
static pags_result target_of(const pags_trainer *t, int index, int64_t count, int64_t *target) {
  const pags_train_state *s = &t->state;
  int64_t bytes = 0;
  int most = 1;
  *target = pags_prune_target(&s->schedule, index, count);
  if (index < s->schedule.prunes - 1 || s->schedule.config.size_limit.target_size <= 0.0)
    return PAGS_OK;
  PAGS_TRY(pags_size_limit_rows(t->dataset, s, &bytes));
  for (int64_t i = 0; i < s->model_count; i++)
    most = pags_size_limit_row(s, i) > most ? pags_size_limit_row(s, i) : most;
  int64_t fit = bytes > 0 ? bytes / most : 0;
  *target = fit < *target ? fit : *target;
  *target = *target > least_survivors ? *target : least_survivors;
  return PAGS_OK;
}

static pags_result prune_rows(pags_trainer *t, int index, const pags_score_pass *scores, row_lists *l,
                              int64_t *dropped) {
  pags_train_state *s = &t->state;
  pags_prune_request request = {.count = scores->count,
                                .score = l->score,
                                .group = l->group,
                                .groups = s->tracks.count + 1,
                                .floor = s->schedule.config.priority.prune_floor,
                                .seed = s->schedule.config.schedule.seed,
                                .draw = pags_draw(s->step, PAGS_DRAW_PRUNE)};
  int64_t at = 0;
  PAGS_TRY(target_of(t, index, scores->count, &request.target));
  PAGS_TRY(score_rows(s, scores, l));
  PAGS_TRY(pags_prune_choose(&request, l->drop, dropped));
  pags_tasks_mark(t->tasks, NULL, "gather");
  for (int64_t i = 0; i < s->model_count; i++) {
    int64_t count = s->models[i].gaussians.count;
    PAGS_TRY(keep_rows(&s->models[i], l->drop + at, t->tasks));
    at += count;
  }
  return PAGS_OK;
}

pags_result pags_prune(pags_trainer *t, int index) {
  pags_score_pass scores;
  row_lists lists;
  int64_t dropped = 0;
  pags_tasks_mark(t->tasks, "prune", "scores");
  PAGS_TRY(pags_score_pass_measure(t, 1, &scores));
  pags_tasks_mark(t->tasks, NULL, "choose");
  pags_score_pass_write_s_sem(&t->state, &scores);
  pags_result result = create_lists(&lists, scores.count);
  if (result == PAGS_OK)
    result = prune_rows(t, index, &scores, &lists, &dropped);

  free(lists.score);
  free(lists.group);
  free(lists.drop);
  free(lists.raw);

  int64_t before = scores.count;
  pags_score_pass_destroy(&scores);
  PAGS_TRY(result);
  pags_log_message(PAGS_LOG_INFO, "step %lld: %lld of %lld Gaussians pruned by score", (long long)t->state.step,
                   (long long)dropped, (long long)before);
  return t->output.lines.stream ? pags_output_log_prune(&t->output, t->state.step, dropped, before - dropped) : PAGS_OK;
}
