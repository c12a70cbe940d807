/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the training schedule and configuration: the values of 3DGS at 30 000 steps, their scaling to other lengths,
 * and reading and writing the configuration as text. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "train/config.h"
#include "train/schedule.h"

static void rates_match_3dgs(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  pags_schedule s = pags_schedule_make(&config, 3.0, 10);
  double r[PAGS_RATE_GROUPS];
  pags_schedule_rates(&s, 0, r);
  assert_true(fabs(r[PAGS_RATE_POSITION] - 3.0 * 1.6e-4) < 1e-12);
  pags_schedule_rates(&s, 15000, r);
  assert_true(fabs(r[PAGS_RATE_POSITION] - 3.0 * 1.6e-5) < 1e-12);
  pags_schedule_rates(&s, 30000, r);
  assert_true(fabs(r[PAGS_RATE_POSITION] - 3.0 * 1.6e-6) < 1e-12);
  pags_schedule_rates(&s, 90000, r);
  assert_true(fabs(r[PAGS_RATE_POSITION] - 3.0 * 1.6e-6) < 1e-12);
  assert_true(fabs(r[PAGS_RATE_SH_REST] - 1.25e-4) < 1e-12);
}

static void densify_steps_are_spaced(void **unused) {
  (void)unused;
  static const struct {
    int64_t iterations, views, every;
  } expected[] = {{4000, 10, 100}, {7000, 43, 125}, {7000, 180, 180}, {400, 5, 10}, {400, 43, 43}, {60000, 10, 200}};
  for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
    pags_train_config config = pags_train_config_default();
    config.schedule.iterations = expected[i].iterations;
    assert_int_equal(pags_schedule_make(&config, 1.0, expected[i].views).densify_every, expected[i].every);
  }
}

static void rates_fall_in_the_last_third(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  pags_schedule s = pags_schedule_make(&config, 3.0, 10);
  static const struct {
    int64_t step;
    double share;
  } expected[] = {{0, 1}, {21000, 1}, {25500, 0.316227766}, {30000, 0.1}, {90000, 0.1}};
  double begin[PAGS_RATE_GROUPS], now[PAGS_RATE_GROUPS];
  pags_schedule_rates(&s, 0, begin);
  for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
    pags_schedule_rates(&s, expected[i].step, now);
    for (int group = PAGS_RATE_POSITION + 1; group < PAGS_RATE_GROUPS; group++)
      assert_true(fabs(now[group] / begin[group] - expected[i].share) < 1e-8);
  }
}

static void events_of_30000_steps(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  pags_schedule s = pags_schedule_make(&config, 1.0, 10);
  int densify = 0, resets = 0, lays = 0;
  for (int64_t step = 1; step <= 30000; step++) {
    densify += pags_schedule_is_densify(&s, step);
    resets += pags_schedule_is_reset(&s, step);
    lays += pags_schedule_is_lay(&s, step);
  }
  config.density.scale_reset = 0.6;
  s = pags_schedule_make(&config, 1.0, 10);
  int64_t resets_of_scales = 0, last = 0;
  for (int64_t step = 1; step <= 30000; step++)
    if (pags_schedule_is_scale_reset(&s, step)) {
      resets_of_scales++;
      last = step;
    }
  assert_true(resets_of_scales == 6 && last == 21000); /* at the steps 6000, 9000, ... */
  assert_int_equal(densify, 144);                      /* at the steps 600, 700, ... 14900 */
  assert_int_equal(lays, 5899);                        /* at the steps 505, 510, ... 29995 */
  assert_int_equal(resets, 4);
  assert_int_equal(pags_schedule_sh_degree(&s, 999), 0);
  assert_int_equal(pags_schedule_sh_degree(&s, 2000), 2);
  assert_int_equal(pags_schedule_sh_degree(&s, 30000), 3);
  assert_false(pags_schedule_prunes_large(&s, 3000));
  assert_true(pags_schedule_prunes_large(&s, 3100));
}

static void short_runs_keep_whole_passes(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.schedule.iterations = 3000;
  pags_schedule s = pags_schedule_make(&config, 1.0, 43);
  assert_int_equal(s.densify_from, 50);
  assert_int_equal(s.densify_until, 1500);
  assert_int_equal(s.densify_every, 43);
  assert_int_equal(s.reset_every, 301); /* 300 rounded up to a multiple of the 43 steps between densifications */
  assert_true(pags_schedule_is_densify(&s, 301) && pags_schedule_is_reset(&s, 301));
  config.schedule.schedule_iterations = 30000; /* the schedule is stretched over another length than the run has */
  assert_int_equal(pags_schedule_make(&config, 1.0, 43).densify_from, 500);
}

static void resolution_rises_except_for_small_photographs(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.schedule.iterations = 1000;
  config.schedule.quarter_until = 0.1;
  config.schedule.half_until = 0.5;
  pags_schedule s = pags_schedule_make(&config, 1.0, 1);
  assert_int_equal(pags_schedule_level(&s, 1, 540, 960), 4);
  assert_int_equal(pags_schedule_level(&s, 100, 540, 960), 4);
  assert_int_equal(pags_schedule_level(&s, 101, 540, 960), 2);
  assert_int_equal(pags_schedule_level(&s, 501, 540, 960), 1);
  assert_int_equal(pags_schedule_level(&s, 1, 200, 960), 2);
  assert_int_equal(pags_schedule_level(&s, 1, 100, 960), 1);
  /* By default, the step at which half size ends follows from the pixels per Gaussian. */
  assert_true(pags_schedule_half_until(0.1) == 0.2 && fabs(pags_schedule_half_until(2) - 0.4) < 1e-12);
  assert_true(fabs(pags_schedule_half_until(1e9) - 0.6) < 1e-12);
  config = pags_train_config_default();
  config.schedule.iterations = 1000;
  s = pags_schedule_make(&config, 1.0, 1);
  assert_true(pags_schedule_is_half_decision(&s, 200) && !pags_schedule_is_half_decision(&s, 201));
  pags_schedule_set_half_until(&s, 0.4);
  assert_int_equal(pags_schedule_level(&s, 400, 540, 960), 2);
  assert_int_equal(pags_schedule_level(&s, 401, 540, 960), 1);
  assert_false(pags_schedule_is_half_decision(&s, 400));
}

static void every_pass_shows_every_view_once(void **unused) {
  (void)unused;
  enum { VIEWS = 43 };
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  pags_schedule s = pags_schedule_make(&config, 1.0, VIEWS);
  int64_t first[VIEWS], second[VIEWS];
  int seen[VIEWS] = {0};
  pags_schedule_order(&s, 0, first);
  pags_schedule_order(&s, 1, second);
  for (int i = 0; i < VIEWS; i++)
    seen[first[i]]++;
  for (int i = 0; i < VIEWS; i++)
    assert_int_equal(seen[i], 1);
  assert_memory_not_equal(first, second, sizeof first);
}

static void configuration_survives_text(void **unused) {
  (void)unused;
  pags_train_config a = pags_train_config_default(), b = pags_train_config_default();
  char text[PAGS_CONFIG_TEXT];
  assert_int_equal(pags_train_config_set(&a, "position_rate_begin", "0.1234567890123456"), PAGS_OK);
  assert_int_equal(pags_train_config_set(&a, "seed", "18446744073709551615"), PAGS_OK);
  assert_int_equal(pags_train_config_set(&a, "strategy", "mcmc"), PAGS_OK);
  assert_int_equal(pags_train_config_set(&a, "background_b", "0.5"), PAGS_OK);
  assert_string_equal(pags_config_difference(&a, &b), "seed");
  pags_config_write(&a, text);
  assert_int_equal(pags_config_read(&b, text, strlen(text), "test"), PAGS_OK);
  assert_null(pags_config_difference(&a, &b));
  assert_int_equal(b.density.strategy, PAGS_STRATEGY_MCMC);
  assert_true(b.optimiser.position_rate_begin == 0.1234567890123456 && b.picture.background[2] == 0.5);
  assert_int_equal(pags_config_read(&b, text, strlen(text) - 1, "test"), PAGS_ERROR_FORMAT);
  pags_config_write_json(&a, text);
  assert_non_null(strstr(text, "\"strategy\": \"mcmc\""));
}

static void configuration_is_checked(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  assert_int_equal(pags_train_config_check(&config), PAGS_OK);
  assert_int_equal(pags_train_config_set(&config, "iterations", "many"), PAGS_ERROR_ARGUMENT);
  assert_int_equal(pags_train_config_set(&config, "no_such_field", "1"), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "no_such_field"));
  config.losses.ssim_weight = 1.5;
  assert_int_equal(pags_train_config_check(&config), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "ssim_weight"));
  pags_train_config raw;
  memset(&raw, 0, sizeof raw);
  assert_int_equal(pags_train_config_check(&raw), PAGS_ERROR_ARGUMENT);
}

/* Every field has a description, and its default passes the check by the field's own range or rule. */
static void every_field_is_described(void **unused) {
  (void)unused;
  const pags_train_config config = pags_train_config_default();
  const pags_train_field *f;
  int count = 0;
  for (; (f = pags_train_field_at(count)); count++) {
    char text[64];
    pags_train_config again = config;
    assert_ptr_equal(pags_train_field_find(f->name), f);
    assert_true(f->least < f->most && strlen(f->unit) > 0 && strlen(f->text) > 0);
    assert_true(f->rule ? f->standard == PAGS_FIELD_AUTO : f->standard >= f->least && f->standard <= f->most);
    assert_true((f->type == PAGS_FIELD_CHOICE) == (f->choices != NULL));
    snprintf(text, sizeof text, "%.17g", f->standard);
    assert_int_equal(f->type == PAGS_FIELD_CHOICE || pags_train_config_set(&again, f->name, text) == PAGS_OK, 1);
    assert_null(pags_config_difference(&config, &again));
    /* Values beyond the field's range are refused; "auto" selects the field's rule. */
    if (f->type == PAGS_FIELD_DOUBLE) {
      snprintf(text, sizeof text, "%.17g", 2 * f->most + 1);
      assert_int_equal(pags_train_config_set(&again, f->name, text), PAGS_OK);
      assert_int_equal(pags_train_config_check(&again), PAGS_ERROR_ARGUMENT);
      assert_non_null(strstr(pags_error_message(), f->name));
    }
    if (f->type != PAGS_FIELD_CHOICE)
      assert_int_equal(pags_train_config_set(&again, f->name, "auto"), f->rule ? PAGS_OK : PAGS_ERROR_ARGUMENT);
  }
  assert_true(count > 80);
  assert_null(pags_train_field_at(-1));
  assert_null(pags_train_field_find("densify"));
  assert_true(config.optimiser.sh_rest_rate == -1 && config.density.densify_until == -1);
}

/* A configuration from a checkpoint of an older format: the same field names in another order. */
static void an_old_configuration_is_read(void **unused) {
  (void)unused;
  static const char old[] =
      "iterations=300\nschedule_iterations=0\nseed=7\nposition_rate_begin=0.00016\nposition_rate_end=1.6e-06\n"
      "scale_rate=0.005\nrotation_rate=0.001\nopacity_rate=0.05\nsh_dc_rate=0.0025\nsh_rest_rate=0.000125\n"
      "beta1=0.9\nbeta2=0.999\nepsilon=1e-15\nssim_weight=0.2\nrandom_start=0\ninit_opacity=0.1\ninit_scale=1\n"
      "init_scale_max=0.1\nsh_degree=3\nsh_interval=1000\nquarter_until=0.05\nhalf_until=0.2\n"
      "resolution_floor=64\nstrategy=default\ndensify_from=500\ndensify_until=12000\ndensify_every=100\n"
      "densify_gradient=0.0002\nabsgrad=0\nabsgrad_gradient=0.0008\ndense_percent=0.01\nsplit_divisor=1.6\n"
      "revised_opacity=0\nprune_opacity=0.005\nprune_scale=0.1\nreset_every=3000\nreset_opacity=0.01\n"
      "max_gaussians=0\ntarget_size=0\nsh_error=0\ndropout=0\ndropout_beta=0.5\ndropout_gamma=0.25\n"
      "preset=none\nalpha=0.4\nhybrid=product\ncritical_weight=3\ncritical_growth=3\nprune_early=0.5\n"
      "prune_late=0.2\nprune_floor=500\ns_sem=pass\ns_grad=rank\ns_grad_from=pass\nmcmc_growth=0.05\n"
      "mcmc_noise=500000\nmcmc_opacity_reg=0.01\nmcmc_scale_reg=0.01\nnear_plane=0.01\nlow_pass=0.3\n"
      "antialiased=0\nbackground_r=0\nbackground_g=0\nbackground_b=0\ncluster_size=64\nextent_most=20\n"
      "objects=1\nbox_prune=1\ntracks=1\ntracks_from=3000\ntrack_translation_rate=0.003\n"
      "track_rotation_rate=0.0003\nfourier=1\nfourier_from=15000\nfourier_gain=0\nsky=1\nsky_rate=0.01\n"
      "sky_weight=0.05\nlidar_start=1\ndepth_weight=0.01\ndepth_share=0.95\nlidar_pull=0\nobject_weight=0.1\n"
      "exposure=1\nexposure_rate=0.003\n";
  pags_train_config config = pags_train_config_default(), expected = pags_train_config_default();
  expected.schedule.iterations = 300;
  expected.schedule.seed = 7;
  expected.schedule.preset = PAGS_PRESET_PLAIN; /* the preset was named none */
  expected.objects.fourier_gain = 0.0;
  expected.color.sh_degree = 3;
  /* Values that the older version had already resolved when it wrote the file. */
  expected.objects.fourier = PAGS_FOURIER_BY_GAIN;
  expected.density.densify_until = 12000;
  expected.priority.score = PAGS_SCORE_DEFAULT;
  expected.priority.critical_weight = expected.priority.critical_growth = 3.0;
  expected.priority.prune_early = 0.5;
  expected.priority.prune_late = 0.2;
  expected.priority.prune_floor = 500;
  expected.priority.dropout = 0;
  expected.schedule.half_until = 0.2;
  expected.losses.ssim_weight = 0.2;
  expected.density.densify_gradient = 0.0002;
  expected.optimiser.position_rate_begin = 1.6e-4;
  expected.optimiser.position_rate_end = 1.6e-6;
  expected.optimiser.scale_rate = 0.005;
  expected.optimiser.sh_dc_rate = 0.0025;
  expected.optimiser.sh_rest_rate = 0.000125;
  expected.exposure.exposure = 1;
  assert_int_equal(pags_config_read(&config, old, strlen(old), "old"), PAGS_OK);
  assert_null(pags_config_difference(&config, &expected));
  assert_int_equal(config.schedule.iterations, 300);
  assert_int_equal(pags_config_read(&config, "sky_rate=0.02\n", 14, "old"), PAGS_ERROR_UNSUPPORTED);
  assert_non_null(strstr(pags_error_message(), "sky_rate: always 0.01"));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(rates_match_3dgs),
      cmocka_unit_test(rates_fall_in_the_last_third),
      cmocka_unit_test(densify_steps_are_spaced),
      cmocka_unit_test(events_of_30000_steps),
      cmocka_unit_test(short_runs_keep_whole_passes),
      cmocka_unit_test(resolution_rises_except_for_small_photographs),
      cmocka_unit_test(every_pass_shows_every_view_once),
      cmocka_unit_test(configuration_survives_text),
      cmocka_unit_test(configuration_is_checked),
      cmocka_unit_test(every_field_is_described),
      cmocka_unit_test(an_old_configuration_is_read),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
