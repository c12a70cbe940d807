/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the MCMC densification policy: relocation preserves the opacity along a ray, the regularisers' gradients
 * match finite differences, and the noise has the Gaussian's covariance. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "train/mcmc.h"

enum { ROWS = 200 };

typedef struct fixture {
  pags_train_model state;
  pags_tasks *tasks;
} fixture;

static void begin(fixture *f, int64_t cap) {
  pags_gaussians g;
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.density.strategy = PAGS_STRATEGY_MCMC;
  config.size_limit.max_gaussians = cap;
  config.color.sh_degree = 0;
  f->tasks = pags_tasks_create(2);
  assert_int_equal(pags_gaussians_create(&g, ROWS, 0), PAGS_OK);
  for (int i = 0; i < ROWS; i++) {
    pags_plane(&g, PAGS_MEAN)[i] = (float)i;
    for (int k = 0; k < 3; k++)
      pags_plane(&g, PAGS_SCALE + k)[i] = logf(0.1f * (float)(k + 1));
    pags_plane(&g, PAGS_ROTATION)[i] = 1.0f;
    pags_plane(&g, PAGS_OPACITY)[i] = i % 4 ? 1.0f : -7.0f; /* every fourth Gaussian is dead */
  }
  pags_schedule schedule = pags_schedule_make(&config, 1.0, 10);
  assert_int_equal(pags_model_create(&f->state, &schedule, 30000, &g), PAGS_OK);
  f->state.step = 600;
  pags_adam_settle(&f->state.adam, &f->state.gaussians, f->state.step, f->tasks);
}

static void end(fixture *f) {
  pags_model_destroy(&f->state);
  pags_tasks_destroy(f->tasks);
}

static void relocation_keeps_what_a_ray_sees(void **unused) {
  (void)unused;
  double opacity, factor;
  pags_mcmc_relocation(0.7, 1, &opacity, &factor);
  assert_true(fabs(opacity - 0.7) < 1e-12 && fabs(factor - 1.0) < 1e-12);
  for (int n = 2; n <= 20; n++) {
    pags_mcmc_relocation(0.7, n, &opacity, &factor);
    assert_true(fabs(1.0 - pow(1.0 - opacity, n) - 0.7) < 1e-9); /* opacity along the ray through the centre */
    /* The opacity integrated along the axis agrees too: n copies composited, compared with one Gaussian. */
    double one = 0.0, many = 0.0;
    for (int i = -4000; i <= 4000; i++) {
      double x = i * 0.002;
      one += 0.7 * exp(-0.5 * x * x);
      many += 1.0 - pow(1.0 - opacity * exp(-0.5 * x * x / (factor * factor)), n);
    }
    assert_true(fabs(many / one - 1.0) < 1e-6);
  }
}

/* A dead Gaussian that is moved onto another takes all of its values, including colour over time, object and
 * priority. */
static void relocated_gaussians_copy_all_values(void **unused) {
  (void)unused;
  fixture f;
  begin(&f, ROWS);
  pags_gaussians *g = &f.state.gaussians;
  assert_int_equal(pags_model_add_fourier(&f.state, 0), PAGS_OK);
  assert_int_equal(pags_gaussians_add_s_sem(g), PAGS_OK);
  assert_int_equal(pags_gaussians_add_object_id(g), PAGS_OK);
  for (int64_t i = 0; i < ROWS; i++) {
    g->object_id[i] = (int32_t)lrintf(pags_plane(g, PAGS_MEAN)[i]);
    g->s_sem[i] = 0.001f * (float)g->object_id[i];
    for (int p = 0; p < PAGS_FOURIER_PLANES; p++)
      g->fourier[p * g->stride + i] = (float)(g->object_id[i] + p);
  }
  assert_int_equal(pags_mcmc_refine(&f.state, f.tasks), PAGS_OK);
  g = &f.state.gaussians;
  for (int64_t i = 0; i < g->count; i++) {
    const int32_t was = (int32_t)lrintf(pags_plane(g, PAGS_MEAN)[i]);
    assert_int_equal(g->object_id[i], was);
    assert_true(g->s_sem[i] == 0.001f * (float)was);
    for (int p = 0; p < PAGS_FOURIER_PLANES; p++)
      assert_true(g->fourier[p * g->stride + i] == (float)(was + p));
  }
  end(&f);
}

static void dead_gaussians_move_and_the_count_grows(void **unused) {
  (void)unused;
  fixture f;
  begin(&f, 205);
  assert_int_equal(pags_mcmc_refine(&f.state, f.tasks), PAGS_OK);
  assert_int_equal(f.state.gaussians.count, 205); /* the cap, where growth by 5 % would give 210 */
  for (int64_t i = 0; i < f.state.gaussians.count; i++) {
    int64_t was = lrintf(pags_plane(&f.state.gaussians, PAGS_MEAN)[i]);
    assert_true(was % 4 != 0);
    assert_true(pags_plane(&f.state.gaussians, PAGS_OPACITY)[i] > -5.4f);
  }
  end(&f);
}

static double regulariser(const pags_train_model *s) {
  const pags_gaussians *g = &s->gaussians;
  double opacity = 0.0, sigma = 0.0;
  for (int64_t i = 0; i < g->count; i++) {
    opacity += 1.0 / (1.0 + exp(-(double)pags_plane(g, PAGS_OPACITY)[i])) / (double)g->count;
    for (int k = 0; k < 3; k++)
      sigma += exp((double)pags_plane(g, PAGS_SCALE + k)[i]) / (3.0 * (double)g->count);
  }
  return s->schedule.config.mcmc.mcmc_opacity_reg * opacity + s->schedule.config.mcmc.mcmc_scale_reg * sigma;
}

static void regularisers_match_finite_differences(void **unused) {
  (void)unused;
  fixture f;
  float gradient[14 * 64];
  begin(&f, 0);
  memset(gradient, 0, sizeof gradient);
  pags_mcmc_regularise(&f.state, 64, 64, gradient, 64);
  static const int planes[] = {PAGS_SCALE, PAGS_SCALE + 2, PAGS_OPACITY};
  for (int p = 0; p < 3; p++)
    for (int row = 64; row < 68; row++) {
      float *x = &pags_plane(&f.state.gaussians, planes[p])[row], at = *x;
      *x = at + 0.01f;
      double up = regulariser(&f.state), high = (double)*x;
      *x = at - 0.01f;
      double slope = (up - regulariser(&f.state)) / (high - (double)*x);
      *x = at;
      assert_true(fabs((double)gradient[planes[p] * 64 + row - 64] - slope) < 1e-3 * fabs(slope) + 1e-12);
    }
  end(&f);
}

static void noise_has_the_covariance_and_stays_in_bounds(void **unused) {
  (void)unused;
  fixture f;
  double square[3] = {0.0, 0.0, 0.0};
  begin(&f, 0);
  assert_int_equal(pags_mcmc_noise(&f.state, 600, f.tasks), PAGS_OK);
  const pags_gaussians *g = &f.state.gaussians;
  for (int i = 0; i < ROWS; i++) {
    double moved = fabs((double)pags_plane(g, PAGS_MEAN)[i] - i);
    assert_true(i % 4 == 0 || moved == 0.0); /* opaque Gaussians aren't moved */
    for (int k = 0; k < 3; k++) {
      float x = pags_plane(g, PAGS_MEAN + k)[i];
      square[k] += i % 4 ? 0.0 : pow((double)x - (k == 0 ? i : 0), 2);
      assert_true(x >= f.state.clusters.lo[k][i / 64] && x <= f.state.clusters.hi[k][i / 64]);
    }
  }
  double y = sqrt(square[1] / square[0]), z = sqrt(square[2] / square[0]); /* in proportion to sigma^2: 4 and 9 */
  assert_true(y > 2.5 && y < 6.0 && z > 6.0 && z < 13.0);
  end(&f);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(relocation_keeps_what_a_ray_sees),
      cmocka_unit_test(relocated_gaussians_copy_all_values),
      cmocka_unit_test(dead_gaussians_move_and_the_count_grows),
      cmocka_unit_test(regularisers_match_finite_differences),
      cmocka_unit_test(noise_has_the_covariance_and_stays_in_bounds),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
