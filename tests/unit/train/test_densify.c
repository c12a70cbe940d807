/* SPDX-License-Identifier: Apache-2.0 */
/* Tests adaptive density control on hand-made rows: each rule of 3DGS, the limit of the count, and which rows keep
 * optimiser moments. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "train/densify.h"

enum { ROWS = 100, AT = 400 };
static pags_train_config plain_config(void) {
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  return config;
}

static const double extent = 10.0;

typedef struct fixture {
  pags_train_model state;
  pags_tasks *tasks;
} fixture;

/* A model of opaque, small rows (sigma 0.01) along a line, without accumulated gradient, at step `AT` of 30 000. */
static void begin(fixture *f, pags_train_config config) {
  pags_gaussians g;
  f->tasks = pags_tasks_create(2);
  assert_int_equal(pags_gaussians_create(&g, ROWS, 1), PAGS_OK);
  for (int i = 0; i < ROWS; i++) {
    pags_plane(&g, PAGS_MEAN)[i] = (float)i;
    for (int a = 0; a < 3; a++)
      pags_plane(&g, PAGS_SCALE + a)[i] = logf(0.01f);
    pags_plane(&g, PAGS_ROTATION)[i] = 1.0f;
    pags_plane(&g, PAGS_OPACITY)[i] = 1.0f;
    pags_plane(&g, PAGS_SH)[i] = (float)i; /* the constant colour identifies the row */
  }
  config.color.sh_degree = 1;
  pags_schedule schedule = pags_schedule_make(&config, extent, 10);
  assert_int_equal(pags_model_create(&f->state, &schedule, 30000, &g), PAGS_OK);
  f->state.step = AT;
  pags_adam_settle(&f->state.adam, &f->state.gaussians, f->state.step, f->tasks);
  for (int i = 0; i < ROWS; i++) {
    pags_plane(&f->state.adam.first, PAGS_SH)[i] = (float)(i + 1);
    pags_plane(&f->state.adam.second, PAGS_SH)[i] = (float)(i + 1);
  }
}

static void end(fixture *f) {
  pags_model_destroy(&f->state);
  pags_tasks_destroy(f->tasks);
}

static void pull(fixture *f, int row, float gradient) {
  f->state.density.gradient[row] = 4.0f * gradient;
  f->state.density.seen[row] = 4;
}
static void set_sigma(fixture *f, int row, float sigma) {
  pags_plane(&f->state.gaussians, PAGS_SCALE + 1)[row] = logf(sigma);
}

static void each_densification_rule_applies(void **unused) {
  (void)unused;
  fixture f;
  pags_edits e;
  begin(&f, plain_config());
  f.state.step = 3100; /* after the first opacity reset large rows are pruned */
  pull(&f, 1, 3e-4f);  /* a small row, gradient above the threshold */
  /* This row is larger than 1 % of the extent, and its gradient is above the threshold. */
  pull(&f, 2, 3e-4f), set_sigma(&f, 2, 0.2f);
  pull(&f, 3, 1.9e-4f);                                    /* gradient below the threshold */
  pags_plane(&f.state.gaussians, PAGS_OPACITY)[4] = -6.0f; /* an opacity of 0.0025 */
  pull(&f, 5, 3e-4f), pags_plane(&f.state.gaussians, PAGS_OPACITY)[5] = -6.0f;
  set_sigma(&f, 6, 1.1f);                     /* larger than 10 % of the extent */
  pull(&f, 7, 3e-4f), set_sigma(&f, 7, 1.5f); /* larger than 10 %, but its split children would not be */
  pull(&f, 8, 3e-4f), set_sigma(&f, 8, 1.7f); /* larger than 10 %, and its split children would be as well */
  pags_plane(&f.state.gaussians, PAGS_MEAN)[9] = NAN;
  f.state.density.gradient[10] = 1.0f; /* gradient without a view that saw the row */
  assert_int_equal(pags_densify_decide(&f.state, f.tasks, &e), PAGS_OK);
  static const uint8_t wanted[12] = {PAGS_EDIT_KEEP,  PAGS_EDIT_CLONE, PAGS_EDIT_SPLIT, PAGS_EDIT_KEEP,
                                     PAGS_EDIT_PRUNE, PAGS_EDIT_PRUNE, PAGS_EDIT_PRUNE, PAGS_EDIT_SPLIT,
                                     PAGS_EDIT_PRUNE, PAGS_EDIT_PRUNE, PAGS_EDIT_KEEP,  PAGS_EDIT_KEEP};
  assert_memory_equal(e.kind, wanted, sizeof wanted);
  assert_int_equal(e.cloned, 1);
  assert_int_equal(e.split, 2);
  assert_int_equal(e.pruned, 5);
  pags_edits_destroy(&e);
  f.state.step = AT; /* before the first reset large rows stay */
  assert_int_equal(pags_densify_decide(&f.state, f.tasks, &e), PAGS_OK);
  assert_int_equal(e.kind[6], PAGS_EDIT_KEEP);
  assert_int_equal(e.kind[8], PAGS_EDIT_SPLIT);
  pags_edits_destroy(&e);
  end(&f);
}

/* The threshold is 2e-4. Row 1 shows nothing critical (S_sem 0), row 2 only critical things (S_sem 1), row 3 a
 * quarter (0.25). */
static void critical_growth_has_its_weight(void **unused) {
  (void)unused;
  static const struct {
    double weight, growth;
    float least[3]; /* gradients from which on rows 1, 2 and 3 grow */
  } cases[] = {
      {8, -1, {2e-4f, 2e-4f, 2e-4f}}, /* a growth of -1: the gradients count as the loss gives them */
      /* Row 3's gradient holds a mean weight of 1 + 7 / 4 = 2.75, which is divided out. */
      {8, 1, {2e-4f, 16e-4f, 5.5e-4f}},
      {8, 3, {2e-4f, 16e-4f / 3, 5.5e-4f / 1.5f}},
      {1, 3, {2e-4f, 2e-4f / 3, 2e-4f / 1.5f}},
  };
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
    for (int above = 0; above < 2; above++) {
      fixture f;
      pags_edits e;
      pags_train_config config = pags_train_config_default();
      config.schedule.preset = PAGS_PRESET_PLAIN;
      config.priority.critical_weight = cases[i].weight;
      config.priority.critical_growth = cases[i].growth;
      begin(&f, config);
      assert_int_equal(pags_gaussians_add_s_sem(&f.state.gaussians), PAGS_OK);
      f.state.gaussians.s_sem[2] = 1.0f;
      f.state.gaussians.s_sem[3] = 0.25f;
      for (int k = 0; k < 3; k++)
        pull(&f, k + 1, cases[i].least[k] * (above ? 1.001f : 0.999f));
      assert_int_equal(pags_densify_decide(&f.state, f.tasks, &e), PAGS_OK);
      for (int k = 1; k <= 3; k++)
        assert_int_equal(e.kind[k], above ? PAGS_EDIT_CLONE : PAGS_EDIT_KEEP);
      pags_edits_destroy(&e);
      end(&f);
    }
}

static void the_limit_prefers_the_largest_gradients(void **unused) {
  (void)unused;
  fixture f;
  pags_edits e;
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.size_limit.max_gaussians = ROWS + 2;
  begin(&f, config);
  pull(&f, 11, 4e-4f);
  pull(&f, 12, 6e-4f), set_sigma(&f, 12, 0.2f);
  pull(&f, 13, 5e-4f);
  pull(&f, 14, 5e-4f);
  pags_plane(&f.state.gaussians, PAGS_OPACITY)[20] = -9.0f; /* this row is pruned, which makes room for one more */
  assert_int_equal(pags_densify_decide(&f.state, f.tasks, &e), PAGS_OK);
  assert_int_equal(e.wanted, 4);
  assert_int_equal(e.cloned + e.split, 3);
  assert_int_equal(e.kind[11], PAGS_EDIT_KEEP);
  assert_int_equal(pags_densify_apply(&f.state, &e, f.tasks), PAGS_OK);
  assert_int_equal(f.state.gaussians.count, ROWS + 2);
  pags_edits_destroy(&e);
  end(&f);
}

static void a_run_keeps_some_gaussians(void **unused) {
  (void)unused;
  fixture f;
  pags_edits e;
  begin(&f, plain_config());
  for (int i = 0; i < ROWS; i++)
    pags_plane(&f.state.gaussians, PAGS_OPACITY)[i] = -9.0f;
  assert_int_equal(pags_densify_decide(&f.state, f.tasks, &e), PAGS_OK);
  assert_int_equal(e.pruned, 0);
  pags_edits_destroy(&e);
  end(&f);
}

/* Finds the rows whose constant colour is `who`; returns their number, at most 4. */
static int find(const pags_gaussians *g, float who, int64_t rows[4]) {
  int n = 0;
  for (int64_t i = 0; i < g->count; i++)
    if (pags_plane(g, PAGS_SH)[i] == who && n < 4)
      rows[n++] = i;
  return n;
}

/* With long_axis_split the children lie on the longest axis, and only that sigma is divided: together they have the
 * parent's variance. */
static void a_split_follows_the_longest_axis(void **unused) {
  (void)unused;
  fixture f;
  pags_edits e;
  int64_t rows[4];
  pags_train_config config = plain_config();
  config.density.long_axis_split = 1;
  begin(&f, config);
  pull(&f, 2, 3e-4f);
  set_sigma(&f, 2, 0.2f);
  assert_int_equal(pags_densify_decide(&f.state, f.tasks, &e), PAGS_OK);
  assert_int_equal(e.kind[2], PAGS_EDIT_SPLIT);
  assert_int_equal(pags_densify_apply(&f.state, &e, f.tasks), PAGS_OK);
  const pags_gaussians *g = &f.state.gaussians;
  assert_int_equal(find(g, 2.0f, rows), 2);
  double moved = 0.0;
  for (int k = 0; k < 2; k++) {
    const double y = (double)pags_plane(g, PAGS_MEAN + 1)[rows[k]], sigma = 0.2 / 1.6;
    assert_true(fabs((double)pags_plane(g, PAGS_SCALE + 1)[rows[k]] - log(sigma)) < 1e-6);
    assert_true(pags_plane(g, PAGS_SCALE)[rows[k]] == logf(0.01f));
    assert_true(pags_plane(g, PAGS_MEAN)[rows[k]] == 2.0f);
    assert_true(fabs(y * y + sigma * sigma - 0.2 * 0.2) < 1e-6);
    moved += y;
  }
  assert_true(fabs(moved) < 1e-6);
  pags_edits_destroy(&e);
  end(&f);
}

static void apply_moves_rows_moments_and_statistics_together(void **unused) {
  (void)unused;
  fixture f;
  pags_edits e;
  int64_t rows[4];
  begin(&f, plain_config());
  pull(&f, 1, 3e-4f);
  pull(&f, 2, 3e-4f), set_sigma(&f, 2, 0.2f);
  pags_plane(&f.state.gaussians, PAGS_OPACITY)[4] = -9.0f;
  assert_int_equal(pags_densify_decide(&f.state, f.tasks, &e), PAGS_OK);
  assert_int_equal(pags_densify_apply(&f.state, &e, f.tasks), PAGS_OK);
  const pags_gaussians *g = &f.state.gaussians;
  assert_int_equal(g->count, ROWS + 1 + 1 - 1);
  assert_int_equal(f.state.clusters.count, (g->count + 63) / 64);
  assert_int_equal(find(g, 4.0f, rows), 0);
  assert_int_equal(find(g, 50.0f, rows), 1); /* a row that is neither cloned nor split keeps its moments */
  assert_true(pags_plane(&f.state.adam.first, PAGS_SH)[rows[0]] == 51.0f);
  assert_true(pags_plane(&f.state.adam.second, PAGS_SH)[rows[0]] == 51.0f);
  /* Cloned: both copies have the same parameters, only the original keeps its moments. */
  assert_int_equal(find(g, 1.0f, rows), 2);
  assert_true(pags_plane(g, PAGS_MEAN)[rows[0]] == pags_plane(g, PAGS_MEAN)[rows[1]]);
  float moments = pags_plane(&f.state.adam.first, PAGS_SH)[rows[0]] + pags_plane(&f.state.adam.first, PAGS_SH)[rows[1]];
  assert_true(moments == 2.0f);
  assert_int_equal(find(g, 2.0f, rows), 2); /* split: two samples, smaller, with zero moments */
  for (int k = 0; k < 2; k++) {
    assert_true(fabsf(pags_plane(g, PAGS_SCALE + 1)[rows[k]] - logf(0.2f / 1.6f)) < 1e-6f);
    assert_true(pags_plane(&f.state.adam.first, PAGS_SH)[rows[k]] == 0.0f);
    assert_true(fabsf(pags_plane(g, PAGS_MEAN + 1)[rows[k]]) < 1.2f); /* drawn with sigma 0.2 along y */
    assert_true(fabsf(pags_plane(g, PAGS_MEAN)[rows[k]] - 2.0f) < 0.06f);
  }
  assert_true(pags_plane(g, PAGS_MEAN + 1)[rows[0]] != pags_plane(g, PAGS_MEAN + 1)[rows[1]]);
  for (int64_t i = 0; i < f.state.density.capacity; i++)
    assert_true(f.state.density.gradient[i] == 0.0f && f.state.density.seen[i] == 0);
  pags_edits_destroy(&e);
  end(&f);
}

static void reset_lowers_opacity_and_clears_moments(void **unused) {
  (void)unused;
  fixture f;
  begin(&f, plain_config());
  pags_plane(&f.state.gaussians, PAGS_OPACITY)[3] = -5.0f;
  pags_plane(&f.state.adam.first, PAGS_OPACITY)[3] = 1.0f;
  pags_densify_reset(&f.state);
  assert_true(fabsf(pags_plane(&f.state.gaussians, PAGS_OPACITY)[0] - logf(0.01f / 0.99f)) < 1e-5f);
  assert_true(pags_plane(&f.state.gaussians, PAGS_OPACITY)[3] == -5.0f);
  assert_true(pags_plane(&f.state.adam.first, PAGS_OPACITY)[3] == 0.0f);
  assert_true(pags_plane(&f.state.adam.first, PAGS_SH)[3] == 4.0f);
  end(&f);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(each_densification_rule_applies),
      cmocka_unit_test(a_split_follows_the_longest_axis),
      cmocka_unit_test(critical_growth_has_its_weight),
      cmocka_unit_test(the_limit_prefers_the_largest_gradients),
      cmocka_unit_test(a_run_keeps_some_gaussians),
      cmocka_unit_test(apply_moves_rows_moments_and_statistics_together),
      cmocka_unit_test(reset_lowers_opacity_and_clears_moments),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
