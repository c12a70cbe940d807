/* SPDX-License-Identifier: Apache-2.0 */
/* Tests pruning by score: steps, number and choice of rows, and the moments and priorities of the remaining rows. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/file.h"
#include "system.h"
#include "train/checkpoint.h"
#include "train/config.h"
#include "train/densify.h"
#include "train/prune.h"

static pags_schedule schedule_of(pags_preset preset, int64_t iterations, int64_t views) {
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = preset;
  config.schedule.iterations = iterations;
  return pags_schedule_make(&config, 1.0, views);
}

/* Four prunes of the paper's rates in a run of 30 000 steps, after steps 10 000 to 25 000. */
static pags_schedule four_prunes(pags_preset preset, int64_t iterations, int64_t views) {
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = preset;
  config.schedule.iterations = iterations;
  config.density.densify_until = 25000;
  config.priority.prune_early = 0.6;
  config.priority.prune_late = 0.3;
  config.priority.prunes = 4;
  config.priority.prune_from = 10000;
  config.priority.prune_every = 5000;
  return pags_schedule_make(&config, 1.0, views);
}

static void prune_steps_match_the_paper(void **unused) {
  (void)unused;
  static const int64_t at[] = {10000, 15000, 20000, 25000, 30000, 35000, 40000, 45000};
  pags_schedule s = schedule_of(PAGS_PRESET_PLAIN, 30000, 10);
  assert_int_equal(s.prunes, 0);
  assert_int_equal(s.densify_until, 15000);
  for (int64_t views = 10; views < 4000; views *= 3) {
    s = schedule_of(PAGS_PRESET_PAPER, 50000, views);
    assert_int_equal(s.prunes, 8);
    assert_int_equal(s.densify_until, 25000);
    assert_memory_equal(s.prune_step, at, sizeof at);
    for (int i = 0; i < 8; i++)
      assert_true(s.prune_rate[i] == (i < 3 ? 0.6 : 0.3));
  }
  assert_int_equal(pags_schedule_prune(&s, 45000), 7);
  assert_int_equal(pags_schedule_prune(&s, 45001), -1);
  assert_int_equal(s.config.priority.prune_floor, 0);
  assert_true(s.config.priority.critical_weight == 1.0 && s.config.priority.score == PAGS_SCORE_PAPER);
  assert_true(s.config.priority.dropout == 1 && s.config.picture.alpha_min == 0 && s.config.density.scale_reset == 1);
}

static void default_prunes_begin_earlier_and_remove_less(void **unused) {
  (void)unused;
  pags_schedule s = schedule_of(PAGS_PRESET_DEFAULT, 30000, 10), plain = schedule_of(PAGS_PRESET_PLAIN, 30000, 10);
  assert_true(s.prunes > 0 && s.prune_step[0] < 10000);
  assert_true(s.densify_until < plain.densify_until);
  assert_true(s.prune_rate[0] < 0.6);
  assert_true(s.config.priority.critical_weight == 2.0 && s.config.priority.score == PAGS_SCORE_DEFAULT);
  assert_true(plain.config.priority.critical_weight == 1.0);
}

/* A preset's automatic choices follow the data set and other fields; a value that is set stays. */
static void automatic_choices_follow_the_data(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default(), c;
  c = pags_config_resolve(&config, false);
  assert_true(c.density.scale_reset < 1 && c.picture.alpha_min > 0 && c.color.sh_degree == 3 &&
              c.exposure.exposure == PAGS_FIELD_AUTO);
  c = pags_config_resolve(&config, true);
  assert_true(c.density.scale_reset < 1 && c.color.sh_degree == 1);
  config.density.strategy = PAGS_STRATEGY_MCMC;
  c = pags_config_resolve(&config, true);
  assert_true(c.priority.prunes == 0 && c.picture.alpha_min == 0 && c.density.scale_reset == 1);
  assert_int_equal(pags_train_config_check(&c), PAGS_OK);
  config = pags_train_config_default();
  config.picture.antialiased = 1;
  assert_true(pags_config_resolve(&config, true).picture.alpha_min == 0);
  config.schedule.preset = PAGS_PRESET_PLAIN;
  assert_true(pags_config_resolve(&config, true).exposure.exposure == 1);
  assert_true(pags_config_resolve(&config, false).exposure.exposure == 0);
  config.exposure.exposure = 1;
  config.priority.prunes = 2;
  c = pags_config_resolve(&config, false);
  assert_true(c.exposure.exposure == 1 && c.priority.prunes == 2);
}

/* The weight of critical pixels in the loss follows alpha: at alpha 0 it is 1, so that critical pixels don't
 * influence the training. */
static void the_critical_weight_follows_alpha(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  config.priority.alpha = 0.0;
  assert_true(pags_config_resolve(&config, true).priority.critical_weight == 1.0);
  config.priority.alpha = 1.0;
  assert_true(pags_config_resolve(&config, true).priority.critical_weight == 3.5);
  config.priority.critical_weight = 2.0;
  assert_true(pags_config_resolve(&config, true).priority.critical_weight == 2.0);
  assert_true(pags_config_resolve(&config, true).priority.critical_growth == 2.0);
  config.priority.critical_growth = 1.0;
  assert_true(pags_config_resolve(&config, true).priority.critical_growth == 1.0);
}

/* Values between -1 (the preset's choice) and the range of the parameter are refused. */
static void values_below_the_range_are_refused(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  assert_int_equal(pags_train_config_check(&config), PAGS_OK);
  assert_int_equal(pags_train_config_set(&config, "critical_weight", "0.5"), PAGS_OK);
  assert_int_equal(pags_train_config_check(&config), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "critical_weight: 0.5"));
  config = pags_train_config_default();
  assert_int_equal(pags_train_config_set(&config, "prune_late", "-0.5"), PAGS_OK);
  assert_int_equal(pags_train_config_check(&config), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "prune_late: -0.5"));
  config = pags_train_config_default();
  assert_int_equal(pags_train_config_set(&config, "critical_growth", "0"), PAGS_OK);
  assert_int_equal(pags_train_config_check(&config), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "critical_growth: 0"));
}

static void prune_steps_scale_and_avoid_the_last_step(void **unused) {
  (void)unused;
  for (int64_t n = 1; n < 200; n++)
    for (int preset = PAGS_PRESET_DEFAULT; preset <= PAGS_PRESET_PAPER; preset++) {
      pags_schedule s = schedule_of((pags_preset)preset, n, 3);
      for (int i = 0; i < s.prunes; i++) {
        assert_true(s.prune_step[i] > 0 && s.prune_step[i] < n);
        assert_true(i == 0 || s.prune_step[i] > s.prune_step[i - 1]);
      }
    }
  /* The numbers of PandaSet's scene 002 with three cameras. */
  pags_schedule s = four_prunes(PAGS_PRESET_PLAIN, 7000, 180);
  static const int64_t want[] = {2340, 3600, 4680, 5833};
  assert_int_equal(s.prunes, 4);
  assert_memory_equal(s.prune_step, want, sizeof want);
  assert_true(s.prune_rate[2] == 0.6 && s.prune_rate[3] == 0.3);
}

/* Opacity resets before a prune are put off until the prune. In 7000 steps they would come at 720, 1440, 2160, 2880
 * ...: 2160 is 180 steps before a prune, 3600 is one, and 5760 is 73 steps before the last prune, when densification
 * is over. */
static void resets_wait_for_a_near_prune(void **unused) {
  (void)unused;
  pags_schedule s = four_prunes(PAGS_PRESET_PLAIN, 7000, 180);
  static const int64_t want[] = {720, 1440, 2340, 2880, 3600, 4320, 5040};
  int count = 0;
  assert_int_equal(s.reset_every, 720);
  for (int64_t step = 1; step <= 7000; step++)
    if (pags_schedule_is_reset(&s, step)) {
      assert_true(count < 7);
      assert_int_equal(step, want[count++]);
    }
  assert_int_equal(count, 7);
  s = four_prunes(PAGS_PRESET_PLAIN, 30000, 10); /* at full length no reset is put off */
  for (int64_t step = 1; step <= 30000; step++)
    assert_int_equal(pags_schedule_is_reset(&s, step), step % 3000 == 0 && step < 25000);
}

static void scores_become_percentile_ranks(void **unused) {
  (void)unused;
  const double raw[6] = {0, 4, 0, 1e6, 4, 1};
  float out[6];
  assert_int_equal(pags_prune_rank(NULL, NULL, raw, 6, out), PAGS_OK);
  const float ranks[6] = {0, 0.6f, 0, 1, 0.6f, 0.4f};
  for (int i = 0; i < 6; i++)
    assert_true(fabsf(out[i] - ranks[i]) < 1e-6f);
  const double odd[2] = {(double)NAN, -1}; /* values that aren't valid count as 0 */
  assert_int_equal(pags_prune_rank(NULL, NULL, odd, 2, out), PAGS_OK);
  assert_true(out[0] == 0 && out[1] == 0);
  assert_int_equal(pags_prune_rank(NULL, NULL, odd, 0, out), PAGS_OK);
}

/* With an alpha of 0.4 for the semantic score: in the sum a critical Gaussian keeps 0.4 even with a gradient score of
 * 0; in the product it needs a gradient score as well. */
static void scores_combine_by_product_or_sum(void **unused) {
  (void)unused;
  pags_train_config c = pags_train_config_default();
  c.priority.score = PAGS_SCORE_PAPER;
  assert_true(fabs(pags_prune_hybrid(&c, 1.0, 0.0) - 0.4) < 1e-15);
  assert_true(fabs(pags_prune_hybrid(&c, 0.25, 0.5) - 0.4) < 1e-15);
  c.priority.score = PAGS_SCORE_DEFAULT;
  assert_true(pags_prune_hybrid(&c, 1.0, 0.0) == 0.0);
  assert_true(fabs(pags_prune_hybrid(&c, 1.0, 0.6) - pags_prune_hybrid(&c, 0.0, 1.0)) < 1e-15);
  assert_true(fabs(pags_prune_hybrid(&c, 0.5, 0.5) - 0.4) < 1e-15);
  c.priority.alpha = 0.0;
  for (int kind = PAGS_SCORE_DEFAULT; kind <= PAGS_SCORE_PAPER; kind++) {
    c.priority.score = (pags_score)kind;
    assert_true(pags_prune_hybrid(&c, 1.0, 0.3) == 0.3 && pags_prune_hybrid(&c, 0.0, 0.3) == 0.3);
  }
}

enum { ROWS = 1000 };

static void lowest_scores_are_pruned_above_the_floors(void **unused) {
  (void)unused;
  static float score[ROWS];
  static int32_t group[ROWS];
  static uint8_t drop[ROWS];
  int64_t dropped, left[3] = {0};
  for (int i = 0; i < ROWS; i++) { /* the 100 rows of object 1 and 40 rows of object 2 have the lowest scores */
    group[i] = i < 100 ? 1 : i < 140 ? 2 : 0;
    score[i] = (float)i;
  }
  pags_prune_request r = {ROWS, score, group, 3, 400, 60, 1, 2, NULL, NULL};
  assert_int_equal(pags_prune_choose(&r, drop, &dropped), PAGS_OK);
  assert_int_equal(dropped, 600);
  for (int i = 0; i < ROWS; i++) {
    left[group[i]] += !drop[i];
    assert_int_equal(drop[i], i < 40 || (i >= 140 && i < 140 + 560));
  }
  assert_int_equal(left[1], 60);
  assert_int_equal(left[2], 40);
  r.target = 100; /* the objects' floors may take up half of the target: 25 rows each */
  assert_int_equal(pags_prune_choose(&r, drop, &dropped), PAGS_OK);
  assert_int_equal(dropped, 900);
  left[0] = left[1] = left[2] = 0;
  for (int i = 0; i < ROWS; i++)
    left[group[i]] += !drop[i];
  assert_int_equal(left[1], 25);
  assert_int_equal(left[2], 25);
  assert_int_equal(left[0], 50);
}

/* Among rows of equal score the dropped ones are chosen at random by the seed and spread evenly. */
static void ties_are_broken_at_random(void **unused) {
  (void)unused;
  static const float score[ROWS];
  static const int32_t group[ROWS];
  static uint8_t drop[ROWS], again[ROWS];
  int64_t dropped, early = 0;
  pags_prune_request r = {ROWS, score, group, 1, 500, 0, 1, 2, NULL, NULL};
  assert_int_equal(pags_prune_choose(&r, drop, &dropped), PAGS_OK);
  assert_int_equal(dropped, 500);
  for (int i = 0; i < ROWS / 2; i++)
    early += drop[i];
  assert_true(early > 200 && early < 300);
  assert_int_equal(pags_prune_choose(&r, again, &dropped), PAGS_OK);
  assert_memory_equal(drop, again, sizeof drop);
  r.draw = 3;
  assert_int_equal(pags_prune_choose(&r, again, &dropped), PAGS_OK);
  assert_memory_not_equal(drop, again, sizeof drop);
}

static void the_bound_holds_at_the_last_prune(void **unused) {
  (void)unused;
  pags_schedule s = four_prunes(PAGS_PRESET_PAPER, 30000, 10);
  assert_int_equal(pags_prune_target(&s, 0, 1000), 400);
  assert_int_equal(pags_prune_target(&s, 3, 1000), 700);
  s.config.size_limit.max_gaussians = 300;
  assert_int_equal(pags_prune_target(&s, 0, 1000), 400);
  assert_int_equal(pags_prune_target(&s, 3, 1000), 300);
  s.config.size_limit.max_gaussians = 800;
  assert_int_equal(pags_prune_target(&s, 3, 1000), 700);
  assert_int_equal(pags_prune_target(&s, 3, 3), 16); /* more than there are rows: none is dropped */
}

/* By default growth keeps to the limit, and prunes after the end of growth leave exactly as many Gaussians. */
static void a_limit_is_kept_full(void **unused) {
  (void)unused;
  pags_schedule s = schedule_of(PAGS_PRESET_DEFAULT, 30000, 10);
  const int last = s.prunes - 1;
  s.config.size_limit.max_gaussians = 1000;
  assert_true(pags_prune_target(&s, 0, 1000) < 1000);
  assert_int_equal(pags_prune_target(&s, last, 1000), 1000);
  assert_int_equal(pags_prune_target(&s, last, 900), 900);
}

/* Rows made by splitting and cloning inherit their parent's priorities and the sums collected since the last prune,
 * and a checkpoint keeps both. */
static void rows_keep_their_scores(void **unused) {
  (void)unused;
  pags_gaussians g;
  pags_train_state s, back;
  pags_edits edits;
  uint64_t fingerprint;
  pags_tasks *tasks = pags_tasks_create(1);
  pags_train_config config = pags_train_config_default();
  config.color.sh_degree = 0;
  config.priority.score = PAGS_SCORE_PAPER;
  pags_schedule schedule = pags_schedule_make(&config, 10.0, 4);
  assert_int_equal(pags_state_create(&s, &schedule, 30000, 1), PAGS_OK);
  assert_int_equal(pags_gaussians_create(&g, 40, 0), PAGS_OK);
  assert_int_equal(pags_gaussians_add_s_sem(&g), PAGS_OK);
  for (int i = 0; i < 40; i++) {
    pags_plane(&g, PAGS_MEAN)[i] = (float)i;
    pags_plane(&g, PAGS_ROTATION)[i] = 1.0f;
    g.s_sem[i] = (float)i / 40.0f;
    for (int k = 0; k < 3; k++)
      pags_plane(&g, PAGS_SCALE + k)[i] = i == 7 ? -0.5f : -6.0f;
  }
  assert_int_equal(pags_state_add_model(&s, -1, 10.0, &g), PAGS_OK);
  pags_train_model *m = &s.models[0];
  pags_state_set_step(&s, 600);
  pags_state_settle(&s, tasks);
  for (int i = 0; i < 40; i++) {
    m->density.squared[i] = (float)(100 + i);
    m->density.gradient[i] = i == 7 || i == 9 ? 1.0f : 0.0f; /* row 7 will be split, row 9 cloned */
    m->density.seen[i] = 1;
  }
  assert_int_equal(pags_densify_decide(m, tasks, &edits), PAGS_OK);
  assert_true(edits.cloned == 1 && edits.split == 1);
  assert_int_equal(pags_densify_apply(m, &edits, tasks), PAGS_OK);
  pags_edits_destroy(&edits);
  assert_int_equal(m->gaussians.count, 42);
  int like7 = 0, like9 = 0;
  for (int i = 0; i < 42; i++) {
    like7 += m->gaussians.s_sem[i] == 7.0f / 40.0f && m->density.squared[i] == 107.0f;
    like9 += m->gaussians.s_sem[i] == 9.0f / 40.0f && m->density.squared[i] == 109.0f;
  }
  assert_true(like7 == 2 && like9 == 2);
  char folder[200], path[256];
  assert_true(system_make_scratch(folder, sizeof folder));
  snprintf(path, sizeof path, "%s/checkpoint", folder);
  assert_int_equal(pags_checkpoint_save(path, NULL, false, &s, 5), PAGS_OK);
  assert_int_equal(pags_checkpoint_load(path, NULL, &back, &fingerprint), PAGS_OK);
  assert_memory_equal(back.models[0].gaussians.s_sem, m->gaussians.s_sem, 42 * sizeof(float));
  assert_memory_equal(back.models[0].density.squared, m->density.squared, 42 * sizeof(float));
  assert_int_equal(pags_remove_tree(folder), PAGS_OK);
  pags_state_destroy(&back);
  pags_state_destroy(&s);
  pags_tasks_destroy(tasks);
}

static void mcmc_keeps_its_count(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  assert_int_equal(pags_train_config_set(&config, "strategy", "mcmc"), PAGS_OK);
  assert_int_equal(pags_train_config_check(&config), PAGS_OK);
  assert_int_equal(pags_train_config_set(&config, "prunes", "2"), PAGS_OK);
  assert_int_not_equal(pags_train_config_check(&config), PAGS_OK);
  assert_int_equal(pags_train_config_set(&config, "prunes", "auto"), PAGS_OK);
  assert_int_equal(pags_train_config_set(&config, "preset", "paper"), PAGS_OK);
  assert_int_not_equal(pags_train_config_check(&config), PAGS_OK);
  assert_int_not_equal(pags_train_config_set(&config, "score", "median"), PAGS_OK);
  assert_non_null(strstr(pags_error_message(), "score: expected one of auto|default|paper, got 'median'"));
}

/* The four fields that `score` has replaced choose the default's score by its values; others are refused. */
static void former_fields_of_the_score_name_it(void **unused) {
  (void)unused;
  static const char *const others[][2] = {
      {"hybrid", "sum"}, {"s_sem", "init"}, {"s_grad", "log"}, {"s_grad_from", "training"}};
  static const char *const same[][2] = {{"hybrid", "product"}, {"s_sem", "pass"}, {"s_grad_from", "pass"}};
  for (size_t i = 0; i < 4; i++) {
    pags_train_config config = pags_train_config_default();
    assert_int_equal(pags_train_config_set(&config, others[i][0], others[i][1]), PAGS_ERROR_UNSUPPORTED);
    assert_non_null(strstr(pags_error_message(), "score=auto|default|paper"));
    assert_int_equal(config.priority.score, PAGS_SCORE_AUTO);
  }
  for (size_t i = 0; i < 3; i++) {
    pags_train_config config = pags_train_config_default();
    config.schedule.preset = PAGS_PRESET_PAPER;
    assert_int_equal(pags_train_config_set(&config, same[i][0], same[i][1]), PAGS_OK);
    assert_int_equal(pags_config_resolve(&config, true).priority.score, PAGS_SCORE_DEFAULT);
  }
  pags_train_config config = pags_train_config_default();
  assert_int_equal(pags_train_config_set(&config, "s_grad", "rank"), PAGS_OK);
  assert_int_equal(config.priority.score, PAGS_SCORE_AUTO);
}

/* The names of removed presets are refused with the options that replace them. */
static void removed_presets_name_replacements(void **unused) {
  (void)unused;
  pags_train_config config = pags_train_config_default();
  assert_int_equal(pags_train_config_set(&config, "preset", "lean"), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "leave --preset out"));
  assert_int_equal(pags_train_config_set(&config, "preset", "short"), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "use paper"));
  assert_int_equal(pags_train_config_set(&config, "preset", "fast"), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "train for fewer steps"));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(prune_steps_match_the_paper),
      cmocka_unit_test(default_prunes_begin_earlier_and_remove_less),
      cmocka_unit_test(automatic_choices_follow_the_data),
      cmocka_unit_test(the_critical_weight_follows_alpha),
      cmocka_unit_test(values_below_the_range_are_refused),
      cmocka_unit_test(scores_combine_by_product_or_sum),
      cmocka_unit_test(prune_steps_scale_and_avoid_the_last_step),
      cmocka_unit_test(resets_wait_for_a_near_prune),
      cmocka_unit_test(scores_become_percentile_ranks),
      cmocka_unit_test(lowest_scores_are_pruned_above_the_floors),
      cmocka_unit_test(ties_are_broken_at_random),
      cmocka_unit_test(the_bound_holds_at_the_last_prune),
      cmocka_unit_test(rows_keep_their_scores),
      cmocka_unit_test(a_limit_is_kept_full),
      cmocka_unit_test(mcmc_keeps_its_count),
      cmocka_unit_test(former_fields_of_the_score_name_it),
      cmocka_unit_test(removed_presets_name_replacements),
  };
  return cmocka_run_group_tests_name("prune", tests, NULL, NULL);
}
