/* SPDX-License-Identifier: Apache-2.0 */
/* Compares deferred Adam with dense Adam in double precision. Deferral relies on two tested properties: the step at
 * which a cluster's outstanding updates are applied changes no bit, and the clusters' bounds hold until the next
 * update. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "reference/reference_adam.h"
#include "train/densify.h"
#include "train/model.h"

enum { ROWS = 300, MOST_ROWS = 400, STEPS = 1000, DEGREE = 3, PLANES = 59, SEED = 7 };
enum { DRAW_VALUE = 1 << 20, DRAW_VIEW, DRAW_GRADIENT };

typedef struct run {
  pags_train_model state;
  pags_tasks *tasks;
  reference_adam dense; /* planes is 0 if no dense reference is kept */
  float *gradient;      /* gradient of one cluster */
  double *dense_gradient;
} run;

static float random_value(uint64_t purpose, uint64_t index) {
  return (float)(2.0 * pags_rng_uniform(SEED, purpose, index) - 1.0);
}

static pags_train_config test_config(void) {
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.schedule.iterations = STEPS;
  config.optimiser.position_rate_begin = 1e-2;
  config.optimiser.rate_fall = 0.3; /* within the steps of this test */
  config.optimiser.rate_fall_from = 0.2;
  return config;
}

static void begin(run *r, pags_train_config config, int dense) {
  pags_gaussians g;
  memset(r, 0, sizeof *r);
  r->tasks = pags_tasks_create(2);
  assert_int_equal(pags_gaussians_create(&g, ROWS, DEGREE), PAGS_OK);
  for (int p = 0; p < PLANES; p++)
    for (int i = 0; i < ROWS; i++)
      pags_plane(&g, p)[i] = random_value(DRAW_VALUE, (uint64_t)(p * ROWS + i));
  if (dense) {
    double *value = malloc(ROWS * PLANES * sizeof(double));
    for (int i = 0; i < ROWS; i++)
      for (int p = 0; p < PLANES; p++)
        value[i * PLANES + p] = (double)pags_plane(&g, p)[i];
    r->dense = reference_adam_create(PLANES);
    reference_adam_append(&r->dense, value, ROWS);
    free(value);
  }
  pags_schedule schedule = pags_schedule_make(&config, 2.0, 10);
  assert_int_equal(pags_model_create(&r->state, &schedule, STEPS, &g), PAGS_OK);
  r->gradient = calloc(PLANES * 64, sizeof(float));
  r->dense_gradient = calloc(PLANES * MOST_ROWS, sizeof(double));
}

static void end(run *r) {
  pags_model_destroy(&r->state);
  reference_adam_destroy(&r->dense);
  pags_tasks_destroy(r->tasks);
  free(r->gradient);
  free(r->dense_gradient);
}

/* Returns whether a view at `step` sees the cluster; no view sees the last cluster from step 40 to step 640. */
static int in_view(int64_t step, int64_t cluster, int64_t clusters) {
  if (cluster == clusters - 1)
    return step < 40 || step > 640;
  return pags_rng_uniform(SEED, DRAW_VIEW, (uint64_t)(step * 100 + cluster)) < 0.3;
}

/* Gradient of one row: its magnitude depends on the row and the plane, its sign varies by step, and it is zero for
 * every third row. */
static float row_gradient(int64_t step, int64_t row, int plane) {
  if ((row + step) % 3 == 0)
    return 0.0f;
  float size = powf(10.0f, -2.0f - 6.0f * fabsf(random_value(DRAW_GRADIENT, (uint64_t)(row * PLANES + plane))));
  return size * (0.3f + random_value(DRAW_GRADIENT + 1, (uint64_t)((step * MOST_ROWS + row) * PLANES + plane)));
}

static void sparse_step(run *r, int64_t step, int touch_all) {
  pags_train_model *s = &r->state;
  int planes = pags_plane_count(pags_schedule_sh_degree(&s->schedule, step));
  memset(r->dense_gradient, 0, PLANES * MOST_ROWS * sizeof(double));
  pags_adam_begin(&s->adam, step);
  for (int64_t c = 0; c < s->adam.cluster_count; c++) {
    int seen = in_view(step, c, s->adam.cluster_count);
    if (seen || touch_all)
      pags_adam_touch(&s->adam, &s->gaussians, c, step);
    if (!seen)
      continue;
    for (int p = 0; p < planes; p++)
      for (int64_t row = c * 64; row < (c + 1) * 64 && row < s->gaussians.count; row++) {
        float value = row_gradient(step, row, p);
        r->gradient[p * 64 + row % 64] = value;
        r->dense_gradient[row * PLANES + p] = (double)value;
      }
    pags_adam_update(&s->adam, &s->gaussians, &s->clusters, c, r->gradient, 64, planes, NULL);
  }
  s->step = step;
}

static void dense_step(run *r, int64_t step) {
  double group[PAGS_RATE_GROUPS], rate[PLANES];
  static const int first[PAGS_RATE_FOURIER] = {PAGS_MEAN,    PAGS_SCALE, PAGS_ROTATION,
                                               PAGS_OPACITY, PAGS_SH,    PAGS_SH + 3};
  pags_schedule_rates(&r->state.schedule, step, group);
  for (int g = 0; g < PAGS_RATE_FOURIER; g++)
    for (int p = first[g]; p < PLANES; p++)
      rate[p] = group[g];
  reference_adam_step(&r->dense, r->dense_gradient, rate);
}

/* Edits the rows of the model and of the dense reference as densification does: drops 7 rows, appends 17 copies with
 * zero moments, sorts by Morton order. */
static void edit(run *r) {
  pags_train_model *s = &r->state;
  int64_t count = s->gaussians.count, source[MOST_ROWS], order[MOST_ROWS], kept = 0;
  pags_adam_settle(&s->adam, &s->gaussians, s->step, r->tasks);
  for (int64_t i = 0; i < count; i++)
    if (i % 41 != 3)
      source[kept++] = i;
  for (int64_t i = 0; i < 17; i++)
    source[kept + i] = source[5 * i];
  assert_int_equal(pags_model_gather(s, source, kept + 17, kept, r->tasks), PAGS_OK);
  assert_int_equal(pags_gaussians_morton_order(&s->gaussians, order), PAGS_OK);
  assert_int_equal(pags_model_sort(s, NULL, r->tasks), PAGS_OK);
  if (!r->dense.planes)
    return;
  double copies[17 * PLANES];
  for (int64_t i = 0; i < 17; i++)
    memcpy(copies + i * PLANES, r->dense.value + source[5 * i] * PLANES, PLANES * sizeof(double));
  reference_adam_gather(&r->dense, source, kept);
  reference_adam_append(&r->dense, copies, 17);
  reference_adam_gather(&r->dense, order, kept + 17);
}

static void reset(run *r) {
  pags_adam_settle(&r->state.adam, &r->state.gaussians, r->state.step, r->tasks);
  pags_densify_reset(&r->state);
  if (!r->dense.planes)
    return;
  double most = log(0.01 / 0.99);
  for (int64_t i = 0; i < r->dense.count; i++)
    r->dense.value[i * PLANES + PAGS_OPACITY] = fmin(r->dense.value[i * PLANES + PAGS_OPACITY], most);
  reference_adam_forget(&r->dense, PAGS_OPACITY);
}

/* Runs all steps with five edits and one opacity reset. Applies the outstanding updates of all clusters every
 * `flush_every` steps (0: never before the end), or updates every cluster in every step if touch_all. */
static void train(run *r, int flush_every, int touch_all) {
  for (int64_t step = 1; step <= STEPS; step++) {
    sparse_step(r, step, touch_all);
    if (r->dense.planes)
      dense_step(r, step);
    if (flush_every && step % flush_every == 0)
      pags_adam_flush(&r->state.adam, &r->state.gaussians, step, r->tasks);
    if (step % 150 == 0 && step <= 750)
      edit(r);
    if (step == 500)
      reset(r);
  }
  pags_adam_flush(&r->state.adam, &r->state.gaussians, STEPS, r->tasks);
}

static void equals_dense_after_1000_steps(void **unused) {
  (void)unused;
  run r;
  begin(&r, test_config(), 1);
  train(&r, 0, 0);
  const pags_gaussians *g = &r.state.gaussians;
  assert_int_equal(g->count, r.dense.count);
  double worst = 0.0;
  for (int64_t i = 0; i < g->count; i++)
    for (int p = 0; p < PLANES; p++) {
      double truth = r.dense.value[i * PLANES + p];
      worst = fmax(worst, fabs((double)pags_plane(g, p)[i] - truth) / fmax(1.0, fabs(truth)));
    }
  print_message("largest difference from dense Adam: %.2e\n", worst);
  assert_true(worst < 1e-5);
  end(&r);
}

static void assert_same(const pags_train_model *a, const pags_train_model *b) {
  assert_int_equal(a->gaussians.count, b->gaussians.count);
  for (int p = 0; p < PLANES; p++) {
    size_t bytes = (size_t)a->gaussians.count * sizeof(float);
    assert_memory_equal(pags_plane(&a->gaussians, p), pags_plane(&b->gaussians, p), bytes);
    assert_memory_equal(pags_plane(&a->adam.first, p), pags_plane(&b->adam.first, p), bytes);
    assert_memory_equal(pags_plane(&a->adam.second, p), pags_plane(&b->adam.second, p), bytes);
  }
}

static void flush_changes_no_bit(void **unused) {
  (void)unused;
  run a, b, c;
  begin(&a, test_config(), 0);
  begin(&b, test_config(), 0);
  begin(&c, test_config(), 0);
  train(&a, 0, 0);
  train(&b, 37, 0);
  train(&c, 0, 1);
  assert_same(&a.state, &b.state);
  assert_same(&a.state, &c.state);
  end(&a);
  end(&b);
  end(&c);
}

static void check_bounds(const run *r) {
  const pags_train_model *s = &r->state;
  for (int64_t i = 0; i < s->gaussians.count; i++) {
    for (int axis = 0; axis < 3; axis++) {
      float x = pags_plane(&s->gaussians, PAGS_MEAN + axis)[i];
      assert_true(x >= s->clusters.lo[axis][i / 64] && x <= s->clusters.hi[axis][i / 64]);
      assert_true(exp((double)pags_plane(&s->gaussians, PAGS_SCALE + axis)[i]) <= (double)s->clusters.sigma[i / 64]);
    }
  }
}

static void bounds_hold_until_the_next_update(void **unused) {
  (void)unused;
  run r;
  begin(&r, test_config(), 0);
  for (int64_t step = 1; step <= 400; step++) {
    sparse_step(&r, step, 0);
    pags_adam_flush(&r.state.adam, &r.state.gaussians, step, r.tasks);
    check_bounds(&r);
    if (step == 150)
      edit(&r);
  }
  /* The bounds must not be wasteful either: their slack is less than 9.05 times the rate of one step. */
  float slack = (float)(9.05 * 2.0 * 1e-2) + 1e-4f;
  pags_adam_flush(&r.state.adam, &r.state.gaussians, STEPS, r.tasks);
  for (int64_t c = 0; c < r.state.clusters.count; c++) {
    float lo = INFINITY;
    for (int64_t i = c * 64; i < (c + 1) * 64 && i < r.state.gaussians.count; i++)
      lo = fminf(lo, pags_plane(&r.state.gaussians, PAGS_MEAN)[i]);
    assert_true(lo - r.state.clusters.lo[0][c] < slack);
  }
  end(&r);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(equals_dense_after_1000_steps),
      cmocka_unit_test(flush_changes_no_bit),
      cmocka_unit_test(bounds_hold_until_the_next_update),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
