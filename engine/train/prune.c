/* SPDX-License-Identifier: Apache-2.0 */
/* Pruning by score: all Gaussians are ranked by S_hybrid, and the lowest are removed. There are two definitions:
 *
 *     default  S_hybrid = (1 - alpha + alpha S_sem) S_grad
 *     paper    S_hybrid = alpha S_sem + (1 - alpha) S_grad
 *
 * S_sem lies in 0..1; S_grad is heavy-tailed over many powers of ten, but its percentile rank is spread evenly over
 * 0..1, so that alpha is the true weight of the two. With the sum, Gaussians that show nothing critical score up to 1
 * - alpha, and those that show only critical things score at least alpha, even if no pixel needs them. The product
 * demands more of what isn't critical and keeps no Gaussian that doesn't matter to the picture. A Gaussian that no
 * training view shows has score 0 where a pass measures this, whatever S_sem it inherited; with the paper's S_grad, of
 * training's own steps, it keeps alpha S_sem. */
#include "train/prune.h"

#include "base/log.h"
#include "base/rng.h"
#include "cluster/order.h"
#include "cluster/shares.h"
#include "maths/maths.h"
#include "threads/record.h"
#include "train/score_pass.h"
#include "train/stages.h"

/* ---- Normalising scores ---- */

/* No prune leaves fewer Gaussians than this: a run that loses everything has failed already, and with a few rows it
 * can still end in an orderly way. */
static const int64_t least_survivors = 16;

static uint64_t number_of(const uint32_t *numbers, int64_t row) {
  return numbers ? numbers[row] : (uint64_t)row;
}

/* The lowest position of the value at the begin of this rank's part of an order. A run of equal values may have begun
 * at an earlier rank. */
static pags_result lowest_of_first(pags_transport *transport, const pags_spread_order *order, int64_t *lowest) {
  typedef struct part_end {
    int64_t count, first, last_lowest; /* last_lowest: the lowest position here of the last value */
    uint64_t first_value, last_value;
  } part_end;
  part_end mine = {order->count, order->first, order->first, 0, 0};
  for (int64_t i = 1; i < order->count; i++)
    if (order->keys[i].high != order->keys[i - 1].high)
      mine.last_lowest = order->first + i;
  if (order->count > 0) {
    mine.first_value = order->keys[0].high;
    mine.last_value = order->keys[order->count - 1].high;
  }
  PAGS_AUTOFREE part_end *all = malloc((size_t)pags_transport_ranks(transport) * sizeof *all);
  PAGS_CHECK_MEMORY(all, "the numbers of %d ranks", pags_transport_ranks(transport));
  PAGS_TRY(pags_share_all(transport, &mine, sizeof mine, all));
  int64_t carried = -1; /* the lowest position of the current value */
  uint64_t value = 0;
  for (int r = 0; r <= pags_transport_rank(transport); r++) {
    if (all[r].count == 0)
      continue;
    *lowest = carried >= 0 && all[r].first_value == value ? carried : all[r].first;
    carried = all[r].last_value == all[r].first_value ? *lowest : all[r].last_lowest;
    value = all[r].last_value;
  }
  return PAGS_OK;
}

/* A row's rank is the share of the other rows with lower values. */
pags_result pags_prune_rank(pags_transport *transport, const uint32_t *numbers, const double *raw, int64_t count,
                            float *out) {
  PAGS_AUTOFREE pags_key *keys = malloc((size_t)(count + 1) * sizeof *keys);
  PAGS_AUTO(pags_order_destroy) pags_spread_order order = {0};
  int64_t all = count, lower = 0;
  PAGS_TRY(pags_transport_agree(transport, keys ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)count)));
  for (int64_t i = 0; i < count; i++) /* NaN counts as 0 */
    keys[i] = (pags_key){pags_key_of_double(raw[i] > 0.0 ? raw[i] : 0.0), number_of(numbers, i)};
  PAGS_TRY(pags_share_sum(transport, &all, 1));
  PAGS_TRY(pags_order_create_even(transport, keys, count, &order));
  PAGS_TRY(lowest_of_first(transport, &order, &lower));
  PAGS_AUTOFREE float *placed = malloc((size_t)(order.count + 1) * sizeof *placed);
  PAGS_CHECK_MEMORY(placed, "%lld Gaussians", (long long)order.count);
  for (int64_t i = 0; i < order.count; i++) {
    if (i > 0 && order.keys[i].high != order.keys[i - 1].high)
      lower = order.first + i;
    placed[i] = all > 1 ? (float)((double)lower / (double)(all - 1)) : 0.0f;
  }
  return pags_order_move(transport, &order, out, placed, true);
}

/* ---- Choosing rows ---- */

typedef struct floors {
  int64_t floor;             /* rows that each group but 0 keeps at least */
  int64_t *members, *before; /* [groups] all rows; those that come before the next one of the group */
} floors;
/* Marks the rows to remove in the order of rising scores: of each group all but its `floor` highest may go, and of
 * these the lowest go until the target is reached. */
static pags_result mark_drops(const pags_prune_request *r, const pags_spread_order *order, const int32_t *group,
                              int64_t all, floors *f, uint32_t *drop, int64_t *dropped) {
  int64_t free_here = 0, before, free_all;
  for (int64_t i = 0; i < order->count; i++) {
    const int32_t g = group[i];
    drop[i] = g == 0 || f->before[g]++ < f->members[g] - f->floor;
    free_here += drop[i];
  }
  PAGS_TRY(pags_share_before(r->transport, free_here, &before, &free_all));
  const int64_t over = all > r->target ? all - r->target : 0;
  for (int64_t i = 0; i < order->count; i++)
    if (drop[i] && before++ >= over)
      drop[i] = 0;
  *dropped = free_all < over ? free_all : over;
  return PAGS_OK;
}

static pags_result choose(const pags_prune_request *r, const pags_spread_order *order, int32_t *group, uint32_t *drop,
                          uint32_t *own, int64_t *dropped) {
  const int ranks = pags_transport_ranks(r->transport), rank = pags_transport_rank(r->transport);
  PAGS_AUTOFREE int64_t *here = calloc((size_t)((3 + ranks) * r->groups), sizeof *here);
  PAGS_TRY(
      pags_transport_agree(r->transport, here ? PAGS_OK : pags_out_of_memory("%lld groups", (long long)r->groups)));
  memcpy(own, r->group, (size_t)r->count * sizeof *own);
  PAGS_TRY(pags_order_move(r->transport, order, own, group, false));

  /* Number of members of each group, and how many of them come before this rank's part of the order. */
  floors f = {.members = here + r->groups, .before = here + 2 * r->groups};
  int64_t *const of_ranks = here + 3 * r->groups, groups = 0, all = 0;
  for (int64_t i = 0; i < order->count; i++)
    here[group[i]]++;
  PAGS_TRY(pags_share_all(r->transport, here, r->groups * (int64_t)sizeof *here, of_ranks));
  for (int64_t g = 0; g < r->groups; g++) {
    for (int k = 0; k < ranks; k++) {
      f.members[g] += of_ranks[k * r->groups + g];
      f.before[g] += k < rank ? of_ranks[k * r->groups + g] : 0;
    }
    groups += g > 0 && f.members[g] > 0;
    all += f.members[g];
  }

  /* The floor of each group, lowered so that all floors together take at most half of the target. */
  const int64_t most = groups > 0 ? r->target / 2 / groups : r->floor;
  f.floor = r->floor < most ? r->floor : most;
  PAGS_TRY(mark_drops(r, order, group, all, &f, drop, dropped));
  return pags_order_move(r->transport, order, own, drop, true);
}

pags_result pags_prune_choose(const pags_prune_request *r, uint8_t *drop, int64_t *dropped) {
  const size_t room = (size_t)(r->count + 1);
  PAGS_AUTOFREE pags_key *keys = malloc(room * sizeof *keys);
  PAGS_AUTO(pags_order_destroy) pags_spread_order order = {0};
  *dropped = 0;
  PAGS_TRY(
      pags_transport_agree(r->transport, keys ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)r->count)));
  for (int64_t i = 0; i < r->count; i++) {
    uint32_t bits[4];
    const uint64_t number = number_of(r->numbers, i);
    pags_rng_u32x4(r->seed, r->draw, number, bits);
    keys[i] = (pags_key){pags_key_of_float(r->score[i]), (uint64_t)bits[0] << 32 | number};
  }
  PAGS_TRY(pags_order_create_even(r->transport, keys, r->count, &order));
  const size_t here = (size_t)order.count + 1;
  PAGS_AUTOFREE int32_t *group = malloc(here * sizeof *group);
  PAGS_AUTOFREE uint32_t *placed = malloc(here * sizeof *placed);
  PAGS_AUTOFREE uint32_t *own = malloc(room * sizeof *own);
  const pags_result mine = group && placed && own ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)r->count);
  PAGS_TRY(pags_transport_agree(r->transport, mine));
  PAGS_TRY(choose(r, &order, group, placed, own, dropped));
  for (int64_t i = 0; i < r->count; i++)
    drop[i] = (uint8_t)own[i];
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
  uint32_t *number; /* place among the rows of all ranks */
} row_lists;

static void destroy_lists(row_lists *l) {
  free(l->score);
  free(l->group);
  free(l->drop);
  free(l->raw);
  free(l->number);
}

double pags_prune_hybrid(const pags_train_config *c, double s_sem, double s_grad) {
  const double alpha = c->priority.alpha;
  return c->priority.score == PAGS_SCORE_PAPER ? alpha * s_sem + (1.0 - alpha) * s_grad
                                               : (1.0 - alpha + alpha * s_sem) * s_grad;
}

/* Computes S_hybrid and the group (object) of all rows of all models. `scores`: of the pass, if there was one. */
static pags_result score_rows(const pags_train_state *s, const pags_score_pass *scores, row_lists *l) {
  const pags_train_config *c = &s->schedule.config;
  int64_t at = 0, before = 0;
  for (int64_t i = 0; i < s->model_count; i++) {
    for (int64_t row = 0; row < s->models[i].gaussians.count; row++, at++) {
      l->number[at] = (uint32_t)(before + s->models[i].first_row + row);
      l->raw[at] =
          c->priority.score == PAGS_SCORE_PAPER ? (double)s->models[i].density.squared[row] : scores->squared[at];
    }
    before += s->models[i].total;
  }
  PAGS_TRY(pags_prune_rank(pags_model_transport(s->models), l->number, l->raw, at, l->score));
  at = 0;
  for (int64_t i = 0; i < s->model_count; i++) {
    const pags_train_model *m = &s->models[i];
    for (int64_t row = 0; row < m->gaussians.count; row++, at++) {
      double s_sem = m->gaussians.s_sem ? (double)m->gaussians.s_sem[row] : 0.0;
      double hybrid = pags_prune_hybrid(c, s_sem, (double)l->score[at]);
      l->score[at] = !scores->drawn || scores->drawn[at] > 0.0 ? (float)hybrid : 0.0f;
      l->group[at] = m->object >= 0           ? (int32_t)m->object + 1
                     : m->gaussians.object_id ? m->gaussians.object_id[row] + 1
                                              : 0;
    }
  }
  return PAGS_OK;
}

static pags_result keep_rows(pags_train_model *m, const uint8_t *drop, pags_tasks *tasks) {
  pags_transport *const transport = pags_model_transport(m);
  const int64_t count = m->gaussians.count, total = m->total;
  const size_t room = (size_t)(count > 0 ? count : 1);
  int64_t kept = 0, before, all;
  PAGS_AUTOFREE int64_t *source = malloc(room * sizeof *source);
  PAGS_AUTOFREE uint32_t *number = malloc(room * sizeof *number);
  const pags_result mine = source && number ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)count);
  PAGS_TRY(pags_transport_agree(transport, mine));
  for (int64_t row = 0; row < count; row++)
    if (!drop[row])
      source[kept++] = row;
  PAGS_TRY(pags_share_before(transport, kept, &before, &all));
  for (int64_t i = 0; i < kept; i++)
    number[i] = (uint32_t)(before + i);
  if (all < total) {
    PAGS_TRY(pags_transport_agree(transport, pags_model_gather(m, source, kept, kept, tasks)));
    PAGS_TRY(pags_model_sort(m, number, tasks));
  }
  if (m->density.squared)
    memset(m->density.squared, 0, (size_t)m->density.capacity * sizeof *m->density.squared);
  return PAGS_OK;
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

pags_result pags_prune(pags_trainer *t, int index) {
  pags_train_state *s = &t->state;
  PAGS_AUTO(pags_score_pass_destroy) pags_score_pass scores = {0};
  int64_t dropped = 0, at = 0, count = 0;
  pags_tasks_mark(t->tasks, "prune", "scores");
  const int64_t before = pags_state_gaussian_count(s);
  if (s->schedule.config.priority.score == PAGS_SCORE_DEFAULT) {
    PAGS_TRY(pags_score_pass_measure(t, PAGS_SCORE_PASS_ROUGH, &scores));
    pags_score_pass_write_s_sem(s, &scores);
  }
  pags_tasks_mark(t->tasks, NULL, "choose");
  for (int64_t i = 0; i < s->model_count; i++)
    count += s->models[i].gaussians.count;
  const size_t room = (size_t)(count > 0 ? count : 1);
  PAGS_AUTO(destroy_lists)
  row_lists l = {malloc(room * sizeof(float)), malloc(room * sizeof(int32_t)), malloc(room),
                 malloc(room * sizeof(double)), malloc(room * sizeof(uint32_t))};
  const bool has_room = l.score && l.group && l.drop && l.raw && l.number;
  const pags_result mine = has_room ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)count);
  PAGS_TRY(pags_transport_agree(pags_model_transport(s->models), mine));
  pags_prune_request request = {.count = count,
                                .score = l.score,
                                .group = l.group,
                                .groups = s->tracks.count + 1,
                                .floor = s->schedule.config.priority.prune_floor,
                                .transport = pags_model_transport(s->models),
                                .numbers = l.number,
                                .seed = s->schedule.config.schedule.seed,
                                .draw = pags_draw(s->step, PAGS_DRAW_PRUNE)};
  PAGS_TRY(target_of(t, index, before, &request.target));
  PAGS_TRY(score_rows(s, &scores, &l));
  PAGS_TRY(pags_prune_choose(&request, l.drop, &dropped));
  pags_tasks_mark(t->tasks, NULL, "gather");
  for (int64_t i = 0; i < s->model_count; i++) {
    const int64_t rows = s->models[i].gaussians.count;
    PAGS_TRY(keep_rows(&s->models[i], l.drop + at, t->tasks));
    at += rows;
  }
  pags_log_message(PAGS_LOG_INFO, "step %lld: %lld of %lld Gaussians pruned by score", (long long)s->step,
                   (long long)dropped, (long long)before);
  const pags_log_value values[] = {
      {"step", (double)s->step}, {"gaussians", (double)(before - dropped)}, {"pruned_by_score", (double)dropped}};
  return t->output.lines.stream ? pags_output_log(&t->output, values, 3) : PAGS_OK;
}
