/* SPDX-License-Identifier: Apache-2.0 */
/* Rows that aren't finite are left out, counted and named, and never spread (docs/numerics.md, "finite by
 * construction"). Tested in the optimiser, in runs that start from damaged Gaussians, for any number of threads and
 * after resuming, and in the error message of a run with too many of them. */
#include "hard/hard.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "train/model.h"
#include "train/track_poses.h"

enum { ROWS = 100, PLANES = PAGS_MAX_PLANES };

/* ---- The optimiser alone: a model of 100 rows in clusters of 64, with colour over time ---- */

static void begin(pags_train_model *m) {
  pags_gaussians g;
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.color.sh_degree = 3;
  pags_schedule schedule = pags_schedule_make(&config, 2.0, 10);
  assert_int_equal(pags_gaussians_create(&g, ROWS, 3), PAGS_OK);
  for (int p = 0; p < PLANES; p++)
    for (int i = 0; i < ROWS; i++)
      pags_plane(&g, p)[i] = 0.01f * (float)(p + 1) - 0.1f * (float)i;
  assert_int_equal(pags_model_create(m, &schedule, 100, &g), PAGS_OK);
  assert_int_equal(pags_model_add_fourier(m, 3), PAGS_OK);
}

/* Takes step `step` of cluster 0 with gradients of 1e-3, except that `plane` of `row` is set to `value` in the
 * gradients or in the parameters. */
static int take(pags_train_model *m, int64_t step, int row, int plane, float value, int in_gradient,
                pags_nonfinite_row *first) {
  enum { ALL = PLANES + PAGS_MAX_FOURIER };
  float *gradient = reference_alloc(ALL * 64 + 16, sizeof(float));
  float *const aligned = gradient + (16 - ((uintptr_t)gradient / 4) % 16) % 16;
  for (int k = 0; k < ALL * 64; k++)
    aligned[k] = 1e-3f;
  if (row >= 0 && in_gradient)
    aligned[plane * 64 + row] = value;
  else if (row >= 0)
    *(plane < PLANES ? &pags_plane(&m->gaussians, plane)[row]
                     : &m->gaussians.fourier[(plane - PLANES) * m->gaussians.stride + row]) = value;
  pags_adam_begin(&m->adam, step);
  const int left_out = pags_adam_update(&m->adam, &m->gaussians, &m->clusters, 0, aligned, 64, PLANES, first);
  free(gradient);
  return left_out;
}

static void assert_row(const pags_train_model *a, const pags_train_model *b, int row, int except, int same) {
  const pags_gaussians *const x[3] = {&a->gaussians, &a->adam.first, &a->adam.second};
  const pags_gaussians *const y[3] = {&b->gaussians, &b->adam.first, &b->adam.second};
  for (int k = 0; k < 3; k++)
    for (int p = 0; p < PLANES; p++)
      if (p != except)
        assert_int_equal(pags_plane(x[k], p)[row] == pags_plane(y[k], p)[row], same);
}

/* For every plane and every kind of non-finite or too large number, in gradient and parameter: that row keeps its
 * bits, the others move as they would have without it. */
static void a_bad_row_stays_and_others_move(void **state) {
  (void)state;
  static const float values[] = {NAN, INFINITY, -INFINITY, 1e18f, 3.1e38f};
  for (int plane = 0; plane < PLANES + PAGS_MAX_FOURIER; plane += plane < 12 ? 1 : 11)
    for (int k = 0; k < 5; k++)
      for (int in_gradient = 0; in_gradient < 2; in_gradient++) {
        pags_train_model before, good, bad;
        pags_nonfinite_row first = {0};
        const int row = (7 * plane + k) % 64;
        if (!in_gradient && k == 3) /* a parameter may be 1e18 */
          continue;
        begin(&before), begin(&good), begin(&bad);
        assert_int_equal(take(&before, 1, -1, 0, 0, 0, NULL), 0);
        assert_int_equal(take(&good, 1, -1, 0, 0, 0, NULL), 0);
        assert_int_equal(take(&bad, 1, -1, 0, 0, 0, NULL), 0);
        assert_int_equal(take(&good, 2, -1, 0, 0, 0, NULL), 0);
        assert_int_equal(take(&bad, 2, row, plane, values[k], in_gradient, &first), 1);
        assert_int_equal(first.row, row);
        assert_int_equal(first.plane, plane);
        assert_int_equal(first.step, 2);
        assert_int_equal(first.kind, in_gradient ? PAGS_NONFINITE_GRADIENT : PAGS_NONFINITE_PARAMETER);
        for (int i = 0; i < 64; i++)
          assert_row(i == row ? &before : &good, &bad, i, in_gradient || i != row ? -1 : plane, 1);
        assert_row(&before, &good, (row + 1) % 64, -1, 0);
        assert_true(!in_gradient || (isfinite(bad.clusters.lo[0][0]) && isfinite(bad.clusters.hi[2][0]) &&
                                     bad.clusters.hi[2][0] < 1e30f));
        pags_model_destroy(&before), pags_model_destroy(&good), pags_model_destroy(&bad);
      }
}

/* A row that isn't finite adds nothing to the gradient of its object's pose; the sum over the other rows stays
 * finite. */
static void a_bad_row_moves_no_pose(void **state) {
  (void)state;
  pags_gaussians g;
  float data[PLANES * 16] = {0.0f};
  double with[6] = {0}, without[6] = {0};
  const pags_part part = {.gaussians = &g};
  assert_int_equal(pags_gaussians_create(&g, 16, 3), PAGS_OK);
  for (int p = 0; p < PLANES; p++)
    for (int i = 0; i < 16; i++) {
      pags_plane(&g, p)[i] = 0.1f * (float)(p + i);
      data[p * 16 + i] = i == 5 ? 0.0f : 1e-2f * (float)(i - p % 7);
    }
  pags_pose_gradient(data, 16, PLANES, &part, 0, 16, without);
  for (int p = 0; p < PLANES; p += 4)
    pags_plane(&g, p)[5] = p % 8 ? NAN : INFINITY;
  pags_pose_gradient(data, 16, PLANES, &part, 0, 16, with);
  for (int k = 0; k < 6; k++)
    assert_true(with[k] == without[k] && with[k] != 0);
  pags_gaussians_destroy(&g);
}

/* ---- Whole runs ---- */

static pags_dataset *dataset;

static int make_data(void **state) {
  if (hard_begin(state) != 0)
    return -1;
  dataset = hard_data("data", &HARD_DATA_DEFAULT);
  return 0;
}

static int remove_data(void **state) {
  pags_dataset_close(dataset);
  return hard_end(state);
}

static int is_same_file(const char *a, const char *b, const char *file) {
  char path[2][64];
  uint8_t *bytes[2];
  size_t size[2];
  const char *const folder[2] = {a, b};
  for (int i = 0; i < 2; i++) {
    snprintf(path[i], sizeof path[i], "%s/%s", folder[i], file);
    assert_int_equal(pags_file_read(hard_path(path[i]), &bytes[i], &size[i]), PAGS_OK);
  }
  const int same = size[0] == size[1] && memcmp(bytes[0], bytes[1], size[0]) == 0;
  free(bytes[0]);
  free(bytes[1]);
  return same;
}

/* The true Gaussians, three of which have a parameter that isn't finite, so that their updates are left out. */
static void spoil(pags_gaussians *g) {
  hard_truth(g);
  pags_plane(g, PAGS_MEAN)[30] = NAN;
  pags_plane(g, PAGS_SCALE + 1)[31] = INFINITY;
  pags_plane(g, PAGS_SH + 4)[70] = NAN;
}

static int stop_at(void *user, const pags_train_progress *progress) {
  return progress->step < *(const int64_t *)user;
}

/* The count of left-out updates is the same for any number of threads and after two interruptions. Density control is
 * off, as it would remove the rows. */
static void the_count_is_the_run_s(void **state) {
  (void)state;
  static const int64_t stops[] = {9, 41, 60};
  pags_train_config config = hard_config(60);
  pags_train_options options = pags_train_options_default();
  pags_train_result one, five, resumed;
  pags_gaussians g;
  config.density.densify_until = 0;
  spoil(&g);
  assert_int_equal(hard_try(dataset, "one", &config, &g, 1, options, &one), PAGS_OK);
  assert_int_equal(hard_try(dataset, "five", &config, &g, 5, options, &five), PAGS_OK);
  print_message("  %s: %d updates left out, first %s\n", "three spoiled rows, 60 steps", (int)one.bad_rows,
                one.first_bad_row);
  assert_true(one.bad_rows > 60 && one.bad_rows <= 180);
  assert_int_equal(one.bad_rows, five.bad_rows);
  assert_string_equal(one.first_bad_row, five.first_bad_row);
  assert_non_null(strstr(one.first_bad_row, "of the background at step 1"));
  assert_int_equal(hard_check_scene("one"), HARD_TRUTH - 3);
  options.progress = stop_at;
  for (int i = 0; i < 3; i++) {
    options.progress_user = (void *)(uintptr_t)&stops[i];
    options.resume = i > 0;
    assert_int_equal(hard_try(dataset, "resumed", &config, i ? NULL : &g, 1 + i, options, &resumed), PAGS_OK);
    assert_int_equal(resumed.iterations, stops[i]);
  }
  assert_int_equal(one.bad_rows, resumed.bad_rows);
  assert_string_equal(one.first_bad_row, resumed.first_bad_row);
  assert_true(is_same_file("one", "five", "checkpoint.pags") && is_same_file("one", "five", "log.jsonl"));
  assert_true(is_same_file("one", "resumed", "checkpoint.pags"));
  pags_gaussians_destroy(&g);
}

/* The spoiled rows don't affect the others: the picture is that of a run in which those rows are transparent. Density
 * control removes them. */
static void nothing_spreads(void **state) {
  (void)state;
  pags_train_config config = hard_config(HARD_STEPS);
  pags_train_options options = pags_train_options_default();
  pags_train_result with, without;
  pags_gaussians g;
  options.bad_rows_most = 1000000;
  spoil(&g);
  assert_int_equal(hard_try(dataset, "with", &config, &g, 2, options, &with), PAGS_OK);
  pags_gaussians_destroy(&g);
  hard_truth(&g);
  for (int row = 30; row <= 70; row += row == 30 ? 1 : 39)
    pags_plane(&g, PAGS_OPACITY)[row] = -20.0f;
  assert_int_equal(hard_try(dataset, "without", &config, &g, 2, options, &without), PAGS_OK);
  pags_gaussians_destroy(&g);
  print_message("  %.2f dB with three spoiled rows (%d updates left out), %.2f dB without them\n", with.psnr,
                (int)with.bad_rows, without.psnr);
  assert_true(with.bad_rows > 0 && with.bad_rows < 60 && without.bad_rows == 0);
  assert_true(fabs(with.psnr - without.psnr) < 1);
  hard_check_scene("with");
}

/* Above the allowed number the run fails with a message that names the first left-out update. Its last checkpoint
 * stays valid, and a run with a higher limit resumes from it. */
static void too_much_fails(void **state) {
  (void)state;
  pags_train_config config = hard_config(60);
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  pags_gaussians g;
  config.density.densify_until = 0;
  options.bad_rows_most = 50;
  options.checkpoint_every = 5;
  spoil(&g);
  assert_int_equal(hard_try(dataset, "fails", &config, &g, 2, options, &result), PAGS_ERROR_LIMIT);
  print_message("  %s\n", pags_error_message());
  assert_non_null(strstr(pags_error_message(), "50 are allowed"));
  assert_non_null(strstr(pags_error_message(), "of row "));
  assert_non_null(strstr(pags_error_message(), " of the background at step 1"));
  assert_true(result.bad_rows == 51 || result.bad_rows == 52 || result.bad_rows == 53);
  pags_gaussians_destroy(&g);
  options.resume = 1;
  options.bad_rows_most = 1000;
  assert_int_equal(hard_try(dataset, "fails", &config, NULL, 2, options, &result), PAGS_OK);
  assert_true(result.resumed && result.finished && result.bad_rows > 51);
}

/* Colours of 1e20 and 2e38 are finite, but the loss multiplies four of them, and the gradients of Gaussians in front
 * grow as much. Such colours are shaded as 1e6, so that every gradient stays finite and no row is left out. */
static void a_blinding_row(void **state) {
  (void)state;
  const pags_train_config config = hard_config(HARD_STEPS);
  pags_train_result result;
  pags_gaussians g;
  hard_truth(&g);
  pags_plane(&g, PAGS_SH)[3] = 1e20f;
  pags_plane(&g, PAGS_SH + 1)[40] = 2e38f;
  assert_int_equal(hard_try(dataset, "blinding", &config, &g, 2, pags_train_options_default(), &result), PAGS_OK);
  print_message("  colours of 1e20: %d updates left out, loss %.3g, %.1f dB\n", (int)result.bad_rows, result.loss,
                result.psnr);
  assert_true(isfinite(result.loss) && isfinite(result.psnr) && result.bad_rows == 0);
  hard_check_scene("blinding");
  pags_gaussians_destroy(&g);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_bad_row_stays_and_others_move),
      cmocka_unit_test(a_bad_row_moves_no_pose),
      cmocka_unit_test(the_count_is_the_run_s),
      cmocka_unit_test(nothing_spreads),
      cmocka_unit_test(too_much_fails),
      cmocka_unit_test(a_blinding_row),
  };
  return cmocka_run_group_tests(tests, make_data, remove_data);
}
