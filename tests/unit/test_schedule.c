/* SPDX-License-Identifier: Apache-2.0 */
/* The schedule and the configuration: figures of 3DGS at 30 000 steps, their scaling, and text both ways. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "train/config.h"
#include "train/schedule.h"

static void rates_are_those_of_3dgs(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
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

static void events_of_30000_steps(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  pags_schedule s = pags_schedule_make(&config, 1.0, 10);
  int densify = 0, resets = 0;
  for (int64_t step = 1; step <= 30000; step++) {
    densify += pags_schedule_is_densify(&s, step);
    resets += pags_schedule_is_reset(&s, step);
  }
  assert_int_equal(densify, 144); /* 600, 700, ... 14900 */
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
  config.schedule.iterations = 3000;
  pags_schedule s = pags_schedule_make(&config, 1.0, 43);
  assert_int_equal(s.densify_from, 50);
  assert_int_equal(s.densify_until, 1500);
  assert_int_equal(s.densify_every, 43);
  assert_int_equal(s.reset_every, 301); /* 300 raised to a multiple of 43 */
  assert_true(pags_schedule_is_densify(&s, 301) && pags_schedule_is_reset(&s, 301));
  config.schedule.schedule_iterations = 30000; /* stretched over another length than is run */
  assert_int_equal(pags_schedule_make(&config, 1.0, 43).densify_from, 500);
}

static void resolution_rises_and_small_photographs_stay(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
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
}

static void every_pass_shows_every_view_once(void **unused) {
  (void)unused;
  enum { VIEWS = 43 };
  pags_train_config config = pags_train_config_default();
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

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(rates_are_those_of_3dgs),          cmocka_unit_test(events_of_30000_steps),
      cmocka_unit_test(short_runs_keep_whole_passes),     cmocka_unit_test(resolution_rises_and_small_photographs_stay),
      cmocka_unit_test(every_pass_shows_every_view_once), cmocka_unit_test(configuration_survives_text),
      cmocka_unit_test(configuration_is_checked),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
