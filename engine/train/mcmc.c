/* SPDX-License-Identifier: Apache-2.0 */
/* MCMC density control (Kheradmand et al. 2024). Noise and regularisers move every Gaussian at each step, so no Adam
 * step stays pending under this strategy: a step's cost follows the number of Gaussians, not of those in view. */
#include "train/mcmc.h"

#include <math.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "base/rng.h"
#include "maths/maths.h"

static const double dead_opacity = 0.005; /* a Gaussian at or below it is dead: relocated, and given most noise */
static const double gate_slope = 100.0;   /* slope of the noise's gate over opacity */
static const double growth = 0.05;        /* Gaussians added at each densify step, per existing one */
enum { MOST_COPIES = 51, NOISE_GRAIN = 16 };

/* ---- Relocation and growth ---- */

static double sigmoid(double x) {
  return 1.0 / (1.0 + pags_exp(-x));
}

/* n copies of opacity o' = 1 - (1 - o)^(1/n) transmit as much light as one Gaussian of opacity o. The factor on their
 * sigma keeps the integral along a ray:
 *
 *     factor = o / sum over i = 1 .. n, k = 0 .. i - 1 of C(i - 1, k) (-1)^k o'^(k + 1) / sqrt(k + 1) */
void pags_mcmc_relocation(double opacity, int copies, double *new_opacity, double *factor) {
  int n = copies < MOST_COPIES ? copies : MOST_COPIES;
  double o = 1.0 - pags_pow(1.0 - opacity, 1.0 / n), sum = 0.0;
  for (int i = 1; i <= n; i++) {
    double binomial = 1.0, power = o;
    for (int k = 0; k < i; k++) {
      sum += binomial * power / sqrt(k + 1.0);
      binomial *= -(double)(i - 1 - k) / (k + 1.0);
      power *= o;
    }
  }
  *new_opacity = fmin(fmax(o, dead_opacity), 1.0 - 1e-6);
  *factor = sum > 0.0 ? opacity / sum : 1.0;
}

/* Data for drawing rows at random in proportion to opacity. With several ranks each has its rows, in the order of the
 * ranks. */
typedef struct lottery {
  pags_transport *transport;
  int rank, ranks;
  double *total;  /* total[i]: sum of the opacities of all rows up to row i of this rank, dead Gaussians left out */
  int64_t *dead;  /* rows of dead Gaussians */
  int32_t *drawn; /* per row: how often it was drawn */
  int64_t dead_count, count;
  /* Per rank: `total` of its last row, its dead Gaussians, its rows. */
  struct rank_rows {
    double total;
    int64_t dead, rows;
  } *of_rank;
  int64_t all_dead, all_rows;
} lottery;

static void free_lottery(lottery *l) {
  free(l->total);
  free(l->dead);
  free(l->drawn);
  free(l->of_rank);
}

/* Fills this rank's rows, `sum` being the total of the rows before them; returns the total with them. */
static double add_up(const pags_train_model *model, lottery *l, double sum) {
  const float *opacity = pags_plane(&model->gaussians, PAGS_OPACITY);
  for (int64_t i = 0; i < l->count; i++) {
    double o = sigmoid((double)opacity[i]);
    if (o > dead_opacity) /* false for NaN, which counts as dead */
      sum += o;
    else
      l->dead[l->dead_count++] = i;
    l->total[i] = sum;
  }
  return sum;
}

/* Collective. One rank after the other adds up its rows, since the bits of a sum depend on their order. The lottery
 * must be destroyed on failure, too. */
static pags_result make_lottery(const pags_train_model *model, lottery *l) {
  pags_transport *const transport = pags_model_transport(model);
  const int ranks = pags_transport_ranks(transport);
  size_t n = (size_t)(model->gaussians.count > 0 ? model->gaussians.count : 1);
  *l = (lottery){.transport = transport,
                 .rank = pags_transport_rank(transport),
                 .ranks = ranks,
                 .total = malloc(n * sizeof(double)),
                 .dead = malloc(n * sizeof(int64_t)),
                 .drawn = calloc(n, sizeof(int32_t)),
                 .count = model->gaussians.count,
                 .of_rank = calloc((size_t)ranks, sizeof *l->of_rank)};
  const bool room = l->total && l->dead && l->drawn && l->of_rank;
  PAGS_TRY(pags_transport_agree(transport, room ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)l->count)));
  for (int r = 0; r < ranks; r++) {
    struct rank_rows *const rows = l->of_rank + r;
    if (r == l->rank) {
      rows->total = add_up(model, l, r > 0 ? rows[-1].total : 0.0);
      rows->dead = l->dead_count;
      rows->rows = l->count;
    }
    PAGS_TRY(pags_transport_broadcast(transport, r, rows, sizeof *rows));
    l->all_dead += rows->dead;
    l->all_rows += rows->rows;
  }
  return PAGS_OK;
}

/* Draws `count` rows in proportion to opacity: moves[i].from_rank has them, which alone knows moves[i].from; then gives
 * each drawn row the opacity and sigma of one of 1 + (times drawn) copies of it. */
static void draw_and_thin(pags_train_model *model, lottery *l, int purpose, pags_row_move *moves, int64_t count) {
  pags_gaussians *g = &model->gaussians;
  const uint64_t seed = model->schedule.config.schedule.seed;
  const double all = l->of_rank[l->ranks - 1].total;
  for (int64_t i = 0; i < l->count; i++)
    l->drawn[i] = 0;
  for (int64_t i = 0; i < count; i++) {
    const double at = pags_rng_uniform(seed, pags_draw(model->step, purpose), (uint64_t)i) * all;

    /* The rank with the row whose interval of the cumulative opacities contains `at`; the last with any row behind the
     * end of all. */
    moves[i].from_rank = 0;
    for (int r = 0; r < l->ranks; r++) {
      if (l->of_rank[r].rows == 0)
        continue;
      moves[i].from_rank = r;
      if (l->of_rank[r].total > at)
        break;
    }
    if (moves[i].from_rank != l->rank)
      continue;

    /* Find the row whose interval contains u times the total, by bisection. */
    int64_t lo = 0, hi = l->count - 1;
    while (lo < hi) {
      int64_t middle = lo + (hi - lo) / 2;
      if (l->total[middle] > at)
        hi = middle;
      else
        lo = middle + 1;
    }
    moves[i].from = lo;
    l->drawn[lo]++;
  }
  for (int64_t row = 0; row < l->count; row++) {
    if (!l->drawn[row])
      continue;
    double opacity, factor;
    float *o = &pags_plane(g, PAGS_OPACITY)[row];
    pags_mcmc_relocation(sigmoid((double)*o), l->drawn[row] + 1, &opacity, &factor);
    *o = (float)pags_log(opacity / (1.0 - opacity));
    for (int k = 0; k < 3; k++)
      pags_plane(g, PAGS_SCALE + k)[row] += (float)pags_log(factor);
  }
}

/* Moves each dead Gaussian onto a drawn one. */
static pags_result relocate(pags_train_model *model) {
  PAGS_AUTO(free_lottery) lottery l = {0};
  PAGS_TRY(make_lottery(model, &l));
  PAGS_AUTOFREE pags_row_move *moves = malloc((size_t)(l.all_dead > 0 ? l.all_dead : 1) * sizeof *moves);
  PAGS_CHECK_MEMORY(moves, "Gaussians");
  if (l.all_dead >= l.all_rows)
    return PAGS_OK;
  draw_and_thin(model, &l, PAGS_DRAW_RELOCATE, moves, l.all_dead);
  int64_t i = 0;
  for (int r = 0; r < l.ranks; r++)
    for (int64_t k = 0; k < l.of_rank[r].dead; k++, i++) {
      moves[i].to_rank = r;
      moves[i].to = r == l.rank ? l.dead[k] : 0;
    }
  return pags_model_relocate(model, moves, l.all_dead);
}

/* Adds copies of drawn Gaussians behind all rows; each comes about at the rank that has the drawn one. *numbers, which
 * the caller frees, receives the places of this rank's rows among those of all. */
static pags_result grow(pags_train_model *model, pags_tasks *tasks, uint32_t **numbers) {
  const int64_t own = model->gaussians.count, count = model->total, most = model->cap > 0 ? model->cap : 1000000;
  int64_t target = (int64_t)((1.0 + growth) * (double)count), added = 0;
  target = target > most ? most : target;
  target = target > count ? target : count;
  const size_t room = (size_t)(own + target - count + 1);
  PAGS_AUTO(free_lottery) lottery l = {0};
  PAGS_AUTOFREE pags_row_move *moves = malloc((size_t)(target - count + 1) * sizeof *moves);
  PAGS_AUTOFREE int64_t *source = malloc(room * sizeof *source);
  *numbers = malloc(room * sizeof **numbers);
  PAGS_CHECK_MEMORY(moves && source && *numbers, "%lld Gaussians", (long long)target);
  for (int64_t i = 0; i < own; i++) {
    source[i] = i;
    (*numbers)[i] = (uint32_t)(model->first_row + i);
  }
  if (target > count)
    PAGS_TRY(make_lottery(model, &l));
  if (l.all_dead >= l.all_rows)
    return PAGS_OK;
  draw_and_thin(model, &l, PAGS_DRAW_ADD, moves, target - count);
  for (int64_t i = 0; i < target - count; i++)
    if (moves[i].from_rank == l.rank) {
      source[own + added] = moves[i].from;
      (*numbers)[own + added++] = (uint32_t)(count + i);
    }
  return pags_model_gather(model, source, own + added, own, tasks);
}

pags_result pags_mcmc_refine(pags_train_model *model, pags_tasks *tasks) {
  PAGS_AUTOFREE uint32_t *numbers = NULL;
  PAGS_TRY(relocate(model));
  PAGS_TRY(grow(model, tasks, &numbers));
  pags_model_clear_density(model);
  return pags_model_sort(model, numbers, tasks);
}

/* ---- Regularisers and noise ---- */

/* Returns the factor from metres to the lengths of a world scaled down to an extent of 20, or 1 if the extent is
 * less. The regulariser adds up metres, and the noise grows with sigma squared times a rate that itself grows with
 * the extent: at an extent of 2009 the two outweighed the rest of the loss entirely (gsplat's issue 542). */
static double shrink_of(const pags_train_model *model) {
  const double most = 20.0, extent = model->schedule.extent;
  return extent > most ? most / extent : 1.0;
}

/* The gradients added are d/d(logit o) of w mean(o) = w o (1 - o) / N and, over 3 N sigmas, d/d(ln sigma) of w
 * mean(sigma) = w sigma / (3 N). */
void pags_mcmc_regularise(const pags_train_model *model, int64_t first, int rows, float *gradient, int64_t stride) {
  const pags_gaussians *g = &model->gaussians;
  const pags_train_config *c = &model->schedule.config;
  float opacity_weight = (float)(c->mcmc.mcmc_opacity_reg / (double)model->total);
  float scale_weight = (float)(c->mcmc.mcmc_scale_reg * shrink_of(model) / (3.0 * (double)model->total));
  for (int i = 0; i < rows; i++) {
    float o = 1.0f / (1.0f + pags_expf(-pags_plane(g, PAGS_OPACITY)[first + i]));
    gradient[PAGS_OPACITY * stride + i] += opacity_weight * o * (1.0f - o);
    for (int k = PAGS_SCALE; k < PAGS_SCALE + 3; k++)
      gradient[k * stride + i] += scale_weight * pags_expf(pags_plane(g, k)[first + i]);
  }
}

typedef struct noise_job {
  pags_train_model *model;
  int64_t step;
  double weight; /* mcmc_noise times the position rate */
} noise_job;

/* Adds noise to a Gaussian's mean: mean += S n gate weight, with S the covariance, n normal deviates, gate =
 * sigmoid(-100 (o - 0.005)). */
static void shake_row(const noise_job *job, int64_t row) {
  pags_gaussians *g = &job->model->gaussians;
  double gate = sigmoid(-gate_slope * (sigmoid((double)pags_plane(g, PAGS_OPACITY)[row]) - dead_opacity));
  if (gate < 1e-9)
    return; /* opacity over 0.21: by default, weight is at most 80 extents and a move under 1e-7 extents sigma^2 */
  double n[4], q[4], r[9], local[3];
  uint64_t seed = job->model->schedule.config.schedule.seed;
  const uint64_t number = (uint64_t)(job->model->first_row + row);
  pags_rng_normal2(seed, pags_draw(job->step, PAGS_DRAW_NOISE), number, n);
  pags_rng_normal2(seed, pags_draw(job->step, PAGS_DRAW_NOISE + 1), number, n + 2);
  for (int i = 0; i < 4; i++)
    q[i] = (double)pags_plane(g, PAGS_ROTATION + i)[row];
  pags_rotation_from_quaternion(q, r);
  for (int k = 0; k < 3; k++) { /* local = diag(sigma^2) R^T n */
    double sigma = pags_exp((double)pags_plane(g, PAGS_SCALE + k)[row]);
    local[k] = sigma * sigma * (r[k] * n[0] + r[3 + k] * n[1] + r[6 + k] * n[2]);
  }
  for (int i = 0; i < 3; i++) {
    double move = r[3 * i] * local[0] + r[3 * i + 1] * local[1] + r[3 * i + 2] * local[2];
    float *mean = &pags_plane(g, PAGS_MEAN + i)[row];
    double moved = (double)*mean + move * gate * job->weight;
    *mean = fabs(moved) < 3e38 ? (float)moved : *mean; /* sigma may be so large that the mean would overflow */
  }
}

static void shake_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const noise_job *job = context;
  pags_train_model *model = job->model;
  for (int64_t c = begin; c < end; c++) {
    int64_t last = (c + 1) * model->adam.cluster_size;
    last = last < model->gaussians.count ? last : model->gaussians.count;
    for (int64_t row = c * model->adam.cluster_size; row < last; row++)
      shake_row(job, row);
    pags_adam_bound(&model->adam, &model->gaussians, &model->clusters, c);
  }
}

pags_result pags_mcmc_noise(pags_train_model *model, int64_t step, pags_tasks *tasks) {
  double rates[PAGS_RATE_GROUPS];
  pags_schedule_rates(&model->schedule, step, rates);
  const double shrink = shrink_of(model);
  noise_job job = {model, step, model->schedule.config.mcmc.mcmc_noise * rates[PAGS_RATE_POSITION] * shrink * shrink};
  /* When cancelled, some rows have moved, some not: this state must not be saved. */
  return pags_parallel_run(tasks, model->adam.cluster_count, NOISE_GRAIN, shake_block, &job);
}
