/* SPDX-License-Identifier: Apache-2.0 */
/* Deferred Adam: keeps account of the pending steps of each cluster and computes cluster bounds that hold while steps
 * are pending. The arithmetic of a step is in simd/adam.c.
 *
 * Bounds. Without further gradients, step s + j moves a parameter by rate c_(s+j) q^j u, where u has one sign, so the
 * parameter stays between p and p - W u, with W = sum over all j >= 1 of rate c_(s+j) q^j. (With a constant rate, c
 * <= 1 gives W <= rate q / (1 - q) = 9.045 rate for the usual betas; the sum itself is tighter while c is small, and
 * it holds for rates that rise.) A cluster's box is the hull of both ends over its Gaussians, its sigma is e to the
 * power of the largest end of ln sigma. Replaying the steps rounds `reach` times, by half an ulp each: the box is
 * widened by (reach + 8) 2^-24 of the largest coordinate to allow for that. */
#include "train/adam.h"

#include <assert.h>
#include <math.h>

#include "base/memory.h"
#include "maths/maths.h"
#include "simd/kernels.h"

enum { REPLAY_CHUNK = 64, GROUPS = PAGS_RATE_GROUPS };

/* ---- Access to planes and clusters ---- */

/* Pointers to row `first` of one parameter and of its two moments. Columns are counted over the `planes` active
 * planes first, then over the Fourier terms. */
typedef struct column {
  float *p, *m, *v;
  pags_rate_group group;
} column;

static column column_at(const pags_adam *adam, const pags_gaussians *g, int planes, int index, int64_t first) {
  const int plane = index < planes ? index : index - planes + pags_plane_count(g->sh_degree);
  const pags_rate_group group = index >= planes + PAGS_FOURIER_PLANES ? PAGS_RATE_SH_REST
                                : index >= planes                     ? PAGS_RATE_FOURIER
                                : plane < PAGS_SCALE                  ? PAGS_RATE_POSITION
                                : plane < PAGS_ROTATION               ? PAGS_RATE_SCALE
                                : plane < PAGS_OPACITY                ? PAGS_RATE_ROTATION
                                : plane < PAGS_SH                     ? PAGS_RATE_OPACITY
                                : plane < PAGS_SH + 3                 ? PAGS_RATE_SH_DC
                                                                      : PAGS_RATE_SH_REST;
  return (column){pags_any_plane(g, plane) + first, pags_any_plane(&adam->first, plane) + first,
                  pags_any_plane(&adam->second, plane) + first, group};
}

static const pags_train_config *config_of(const pags_adam *adam) {
  return &adam->schedule->config;
}

/* Returns the number of rows of a cluster; `first` receives its first row. */
static int cluster_rows(const pags_adam *adam, int64_t cluster, int64_t *first) {
  *first = cluster * adam->cluster_size;
  return pags_cluster_rows(adam->first.count, adam->cluster_size, cluster);
}

static int active_planes(const pags_adam *adam, int64_t step) {
  return pags_plane_count(pags_schedule_sh_degree(adam->schedule, step));
}

/* Returns e_k of simd/adam.c: Adam's epsilon times sqrt(1 - beta2^k), k = step. */
static float epsilon_at(const pags_adam *adam, int64_t step) {
  const pags_train_config *c = config_of(adam);
  return (float)(c->optimiser.epsilon * sqrt(-pags_expm1((double)step * pags_log(adam->schedule->beta2))));
}

static int64_t table_index(const pags_adam *adam, int64_t step) {
  return step < adam->table_steps ? step : adam->table_steps - 1;
}

/* ---- Tables, creation and memory ---- */

pags_result pags_adam_retime(pags_adam *adam, int64_t last_step) {
  const pags_schedule *const s = adam->schedule;
  const int64_t steps = last_step + adam->reach + 2;
  double *const tables = malloc(3 * (size_t)steps * sizeof *tables);
  PAGS_CHECK_MEMORY(tables, "the rates of %lld steps", (long long)last_step);
  free(adam->correction);
  adam->table_steps = steps;
  adam->correction = tables;
  adam->fall = tables + steps;
  adam->position_rate = tables + 2 * steps;
  for (int64_t k = 0; k < steps; k++) {
    double rates[GROUPS];
    pags_schedule_rates(s, k, rates);
    adam->position_rate[k] = rates[PAGS_RATE_POSITION];
    adam->fall[k] = pags_schedule_fall(s, k);
    adam->correction[k] = k == 0 ? 0.0
                                 : sqrt(-pags_expm1((double)k * pags_log(s->beta2))) /
                                       (s->beta1 > 0.0 ? -pags_expm1((double)k * pags_log(s->beta1)) : 1.0);
  }
  return PAGS_OK;
}

/* Makes room for the clusters of `capacity` rows. */
static pags_result reserve_clusters(pags_adam *adam, int64_t capacity) {
  int64_t clusters = (capacity + adam->cluster_size - 1) / adam->cluster_size;
  if (clusters <= adam->cluster_capacity)
    return PAGS_OK;
  int32_t *moment = realloc(adam->moment_step, (size_t)clusters * sizeof(int32_t));
  if (moment)
    adam->moment_step = moment;
  int32_t *param = realloc(adam->param_step, (size_t)clusters * sizeof(int32_t));
  if (param)
    adam->param_step = param;
  if (!moment || !param)
    return pags_out_of_memory("%lld clusters", (long long)clusters);
  adam->cluster_capacity = clusters;
  return PAGS_OK;
}

pags_result pags_adam_create(pags_adam *adam, const pags_schedule *schedule, const pags_gaussians *g, int64_t step,
                             int64_t last_step) {
  *adam = (pags_adam){.schedule = schedule, .cluster_size = schedule->config.picture.cluster_size};
  const char *why = NULL;
  adam->kernels = pags_kernels_get(&why);
  if (!adam->kernels)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s", why);
  const double q = schedule->beta1 / sqrt(schedule->beta2);
  adam->reach = q > 0.0 ? (int)ceil(pags_log(1e-9) / pags_log(q)) : 0;
  adam->decay = malloc((size_t)(adam->reach + 1) * sizeof(double));
  PAGS_CHECK_MEMORY(adam->decay, "the optimiser");
  adam->decay[0] = 1.0;
  for (int j = 1; j <= adam->reach; j++)
    adam->decay[j] = adam->decay[j - 1] * q;
  PAGS_TRY(pags_adam_retime(adam, last_step));
  PAGS_TRY(pags_gaussians_create(&adam->first, g->count, g->sh_degree));
  PAGS_TRY(pags_gaussians_create(&adam->second, g->count, g->sh_degree));
  PAGS_TRY(pags_adam_reserve(adam, g->stride));
  return pags_adam_regroup(adam, g->count, step);
}

void pags_adam_destroy(pags_adam *adam) {
  pags_gaussians_destroy(&adam->first);
  pags_gaussians_destroy(&adam->second);
  free(adam->moment_step);
  free(adam->param_step);
  free(adam->correction);
  free(adam->decay);
  *adam = (pags_adam){0};
}

pags_result pags_adam_reserve(pags_adam *adam, int64_t capacity) {
  PAGS_TRY(pags_gaussians_reserve(&adam->first, capacity));
  PAGS_TRY(pags_gaussians_reserve(&adam->second, capacity));
  return reserve_clusters(adam, capacity);
}

pags_result pags_adam_regroup(pags_adam *adam, int64_t count, int64_t step) {
  PAGS_TRY(reserve_clusters(adam, count));
  assert(count <= adam->first.stride && count <= adam->second.stride);
  adam->first.count = count;
  adam->second.count = count;
  adam->cluster_count = (count + adam->cluster_size - 1) / adam->cluster_size;
  for (int64_t c = 0; c < adam->cluster_count; c++) {
    adam->moment_step[c] = (int32_t)step;
    adam->param_step[c] = (int32_t)step;
  }
  return PAGS_OK;
}

/* ---- Applying pending steps ---- */

/* Computes the sums of rate c_(step+j) q^j over all j >= 1, of positions and of what begins with a rate of 1. The terms
 * beyond the table of q^j are covered by a relative 1e-8 on top. */
static void reach_sums(const pags_adam *adam, int64_t step, double *position, double *unit) {
  double p = 0.0, u = 0.0;
  for (int j = adam->reach; j >= 1; j--) {
    int64_t k = table_index(adam, step + j);
    double w = adam->correction[k] * adam->decay[j];
    u += w * adam->fall[k];
    p += w * adam->position_rate[k];
  }
  *position = p * (1.0 + 1e-8);
  *unit = u * (1.0 + 1e-8);
}

void pags_adam_begin(pags_adam *adam, int64_t step) {
  adam->step = step;
  reach_sums(adam, step, &adam->reach_position, &adam->reach_unit);
}

/* The rates of pags_schedule_rates at entry k of the tables. */
static void group_rates(const pags_adam *adam, int64_t k, double rates[GROUPS]) {
  rates[PAGS_RATE_POSITION] = adam->position_rate[k];
  pags_schedule_falling_rates(config_of(adam), adam->fall[k], rates);
}

/* Applies the pending steps k0 .. k0 + count - 1 to a cluster whose last gradient came at step `last`. */
static void replay(const pags_adam *adam, pags_gaussians *g, int64_t cluster, int64_t last, int64_t k0, int count) {
  float weights[GROUPS][REPLAY_CHUNK];
  double rates[GROUPS];
  for (int i = 0; i < count; i++) {
    int64_t k = table_index(adam, k0 + i);
    double unit = adam->correction[k] * adam->decay[k0 + i - last];
    group_rates(adam, k, rates);
    for (int group = 0; group < GROUPS; group++)
      weights[group][i] = (float)(unit * rates[group]);
  }
  const pags_kernels *kernels = adam->kernels;
  int64_t first;
  int rows = cluster_rows(adam, cluster, &first), planes = active_planes(adam, last);
  float eps = epsilon_at(adam, last);
  for (int i = 0; i < pags_gradient_planes(g, planes); i++) {
    column c = column_at(adam, g, planes, i, first);
    kernels->adam_replay(c.p, c.m, c.v, rows, weights[c.group], count, eps);
  }
}

void pags_adam_touch(pags_adam *adam, pags_gaussians *g, int64_t cluster, int64_t step) {
  const int64_t last = adam->moment_step[cluster], most = last + adam->reach, end = step - 1 < most ? step - 1 : most;
  int64_t k = adam->param_step[cluster] + 1;
  if (k >= step)
    return;
  adam->param_step[cluster] = (int32_t)(step - 1);
  if (last == 0)
    return; /* no gradient yet: both moments are zero and nothing moves */
  for (; k <= end; k += REPLAY_CHUNK)
    replay(adam, g, cluster, last, k, end - k + 1 < REPLAY_CHUNK ? (int)(end - k + 1) : REPLAY_CHUNK);
}

/* ---- One step with gradients ---- */

/* The rows of a cluster that keep their parameters and moments in this step because a number isn't finite: one bit
 * each. */
typedef struct left_out {
  uint16_t bits[PAGS_LARGEST_CLUSTER / 16];
  int any;
} left_out;

static bool is_left_out(const left_out *l, int row) {
  return l->bits[row / 16] >> (row % 16) & 1;
}

/* Returns the number of left-out rows; `out` (may be NULL) receives the first of them, its first offending plane and
 * the reason. */
static int name_left_out(const pags_adam *adam, const pags_gaussians *g, const left_out *l, int64_t first, int rows,
                         const float *gradient, int64_t stride, int planes, pags_nonfinite_row *out) {
  int count = 0, row = -1;
  for (int i = 0; i < rows; i++)
    if (is_left_out(l, i) && count++ == 0)
      row = i;
  for (int i = 0; out && i < pags_gradient_planes(g, planes); i++) {
    const int sound = fabsf(column_at(adam, g, planes, i, first).p[row]) < 3e38f;
    if (sound && fabsf(gradient[i * stride + row]) < 1e18f)
      continue;
    *out = (pags_nonfinite_row){.step = adam->step,
                                .row = first + row,
                                .plane = i < planes ? i : PAGS_MAX_PLANES + i - planes,
                                .kind = sound ? PAGS_NONFINITE_GRADIENT : PAGS_NONFINITE_PARAMETER};
    break;
  }
  return count;
}

/* Updates one plane of a cluster, then restores the left-out rows to what they were. */
static void update_others(const pags_adam *adam, column c, const float *gradient, int rows, const left_out *l,
                          const pags_adam_step *s) {
  float kept[3][PAGS_LARGEST_CLUSTER];
  float *const planes[3] = {c.p, c.m, c.v};
  for (int k = 0; k < 3; k++)
    memcpy(kept[k], planes[k], (size_t)rows * sizeof(float));
  adam->kernels->adam_update(c.p, c.m, c.v, gradient, rows, s);
  for (int i = 0; i < rows; i++)
    for (int k = 0; k < 3 && is_left_out(l, i); k++)
      planes[k][i] = kept[k][i];
}

int pags_adam_update(pags_adam *adam, pags_gaussians *g, pags_clusters *clusters, int64_t cluster,
                     const float *gradient, int64_t stride, int planes, pags_nonfinite_row *bad_row) {
  int64_t step = adam->step, first, k = table_index(adam, step);
  const int rows = cluster_rows(adam, cluster, &first), columns = pags_gradient_planes(g, planes);
  pags_adam_touch(adam, g, cluster, step);

  /* Find the rows whose parameters or gradients aren't finite. */
  left_out l = {.any = 0};
  l.any = adam->kernels->adam_check(g->data + first, g->stride, gradient, stride, planes, rows, l.bits);
  if (g->fourier)
    l.any |= adam->kernels->adam_check(g->fourier + first, g->stride, gradient + planes * stride, stride,
                                       columns - planes, rows, l.bits);

  int64_t n = step - adam->moment_step[cluster];
  const double beta1 = adam->schedule->beta1, beta2 = adam->schedule->beta2;
  pags_adam_step s = {.decay1 = (float)(n == 1 ? beta1 : pags_pow(beta1, (double)n)),
                      .decay2 = (float)(n == 1 ? beta2 : pags_pow(beta2, (double)n)),
                      .blend1 = (float)(1.0 - beta1),
                      .blend2 = (float)(1.0 - beta2),
                      .eps = epsilon_at(adam, step)};
  double rates[GROUPS];
  group_rates(adam, k, rates);
  for (int i = 0; i < columns; i++) {
    column at = column_at(adam, g, planes, i, first);
    s.rate = (float)(rates[at.group] * adam->correction[k]);
    if (l.any)
      update_others(adam, at, gradient + i * stride, rows, &l, &s);
    else
      adam->kernels->adam_update(at.p, at.m, at.v, gradient + i * stride, rows, &s);
  }
  adam->moment_step[cluster] = (int32_t)step;
  adam->param_step[cluster] = (int32_t)step;
  pags_adam_bound(adam, g, clusters, cluster);
  return l.any ? name_left_out(adam, g, &l, first, rows, gradient, stride, planes, bad_row) : 0;
}

/* ---- Bounds and passes over all clusters ---- */

/* Computes the interval that a plane's parameters stay in over the rows of a cluster, while no further gradient
 * arrives. `weight`: the sum W of the head comment. */
static void plane_reach(const pags_adam *adam, const pags_gaussians *g, int plane, int64_t cluster, double weight,
                        float range[2]) {
  int64_t first;
  int rows = cluster_rows(adam, cluster, &first);
  range[0] = INFINITY;
  range[1] = -INFINITY;
  /* If the cluster has had no gradient yet, both moments are 0 and any positive eps will do. */
  int64_t last = adam->moment_step[cluster] > 0 ? adam->moment_step[cluster] : 1;
  adam->kernels->adam_reach(pags_plane(g, plane) + first, pags_plane(&adam->first, plane) + first,
                            pags_plane(&adam->second, plane) + first, rows, (float)weight, epsilon_at(adam, last),
                            range);
  float largest = fmaxf(fabsf(range[0]), fabsf(range[1]));
  float allowance = largest * (float)(adam->reach + 8) * 0x1p-24f;
  range[0] -= allowance;
  range[1] += allowance;
}

void pags_adam_bound(const pags_adam *adam, const pags_gaussians *g, pags_clusters *clusters, int64_t cluster) {
  double position = adam->reach_position, unit = adam->reach_unit;
  if (adam->moment_step[cluster] != adam->step)
    reach_sums(adam, adam->moment_step[cluster], &position, &unit);
  float range[2], sigma = -INFINITY;
  for (int axis = 0; axis < 3; axis++) {
    plane_reach(adam, g, PAGS_MEAN + axis, cluster, position, range);
    clusters->lo[axis][cluster] = range[0];
    clusters->hi[axis][cluster] = range[1];
    plane_reach(adam, g, PAGS_SCALE + axis, cluster, unit * config_of(adam)->optimiser.scale_rate, range);
    sigma = fmaxf(sigma, range[1]);
  }
  clusters->sigma[cluster] = pags_expf(sigma) * 1.00001f; /* covers exp's rounding in the projection kernel */
}

typedef struct sweep {
  pags_adam *adam;
  pags_gaussians *g;
  const pags_gaussians *read;
  pags_clusters *clusters;
  int64_t step;
} sweep;

static void flush_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  sweep *s = context;
  for (int64_t c = begin; c < end; c++)
    pags_adam_touch(s->adam, s->g, c, s->step + 1);
}

/* Multiplies moments by a factor; results below `least` become zero, as in adam_update. */
static void scale_rows(float *x, int rows, float factor, float least) {
  for (int i = 0; i < rows; i++) {
    float y = x[i] * factor;
    x[i] = fabsf(y) >= least ? y : 0.0f;
  }
}

static void settle_block(void *context, int64_t begin, int64_t end, int worker) {
  sweep *s = context;
  pags_adam *adam = s->adam;
  const pags_train_config *config = config_of(adam);
  flush_block(context, begin, end, worker);
  for (int64_t c = begin; c < end; c++) {
    double n = (double)(s->step - adam->moment_step[c]);
    int64_t first;
    int rows = cluster_rows(adam, c, &first), planes = n > 0 ? active_planes(adam, adam->moment_step[c]) : 0;
    float decay1 = (float)pags_pow(config->optimiser.beta1, n), decay2 = (float)pags_pow(config->optimiser.beta2, n);
    for (int i = 0; n > 0 && i < pags_gradient_planes(s->g, planes); i++) {
      column at = column_at(adam, s->g, planes, i, first);
      scale_rows(at.m, rows, decay1, 1e-30f);
      scale_rows(at.v, rows, decay2, 1e-36f);
    }
    adam->moment_step[c] = (int32_t)s->step;
  }
}

static void bound_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  sweep *s = context;
  for (int64_t c = begin; c < end; c++)
    pags_adam_bound(s->adam, s->read, s->clusters, c);
}

enum { SWEEP_GRAIN = 16 }; /* clusters per task */

/* Runs `fn` over all clusters. If the parallel loop is cancelled, the whole range is run again here, so that a pass
 * is never left half done: no checkpointed step could produce such a state. */
static void run(pags_adam *adam, pags_block_fn *fn, sweep *s, pags_tasks *tasks) {
  if (!tasks || !pags_parallel_for(tasks, adam->cluster_count, SWEEP_GRAIN, fn, s))
    fn(s, 0, adam->cluster_count, 0);
}

void pags_adam_settle(pags_adam *adam, pags_gaussians *g, int64_t step, pags_tasks *tasks) {
  run(adam, settle_block, &(sweep){.adam = adam, .g = g, .step = step}, tasks);
}

void pags_adam_flush(pags_adam *adam, pags_gaussians *g, int64_t step, pags_tasks *tasks) {
  run(adam, flush_block, &(sweep){.adam = adam, .g = g, .step = step}, tasks);
}

void pags_adam_bound_all(pags_adam *adam, const pags_gaussians *g, pags_clusters *clusters, pags_tasks *tasks) {
  run(adam, bound_block, &(sweep){.adam = adam, .read = g, .clusters = clusters}, tasks);
}

void pags_adam_forget(pags_adam *adam, int first, int last) {
  for (int plane = first; plane < last; plane++) {
    memset(pags_plane(&adam->first, plane), 0, (size_t)adam->first.count * sizeof(float));
    memset(pags_plane(&adam->second, plane), 0, (size_t)adam->second.count * sizeof(float));
  }
}

/* ---- Six numbers ---- */

bool pags_adam6_step(pags_adam6 *m, const double gradient[6], const pags_train_config *c, double step[6]) {
  const double beta1 = c->optimiser.beta1, beta2 = c->optimiser.beta2;
  for (int i = 0; i < 6; i++)
    if (!(fabs(gradient[i]) < 1e150)) /* below this the square is finite, too; the test is false for NaN */
      return false;
  m->count++;
  const double bias1 = 1.0 - pags_pow(beta1, (double)m->count), bias2 = 1.0 - pags_pow(beta2, (double)m->count);
  for (int i = 0; i < 6; i++) {
    m->first[i] = beta1 * m->first[i] + (1.0 - beta1) * gradient[i];
    m->second[i] = beta2 * m->second[i] + (1.0 - beta2) * gradient[i] * gradient[i];
    step[i] = m->first[i] / bias1 / (sqrt(m->second[i] / bias2) + 1e-15);
  }
  return true;
}
