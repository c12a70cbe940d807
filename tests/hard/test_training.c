/* SPDX-License-Identifier: Apache-2.0 */
/* Hard initial points, positions and learning rates (cases 1, 3, 4, 10, 14, 17, 18, 24, 25, 27 of
 * docs/lab/numerics.md): 200 steps stay finite and reach a minimum PSNR, or stop with an error message. */
#include "hard/hard.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pags/image.h>

/* Returns the number of steps with the absurd rates: the environment variable HARD_STEPS sets a longer run. */
static int64_t absurd_steps(void) {
  const char *text = getenv("HARD_STEPS");
  return text ? atoll(text) : getenv("HARD_SHORT") ? 40 : 300;
}

/* Writes a data set, trains on it and closes it. */
static pags_train_result train_on(const char *what, const char *name, const hard_data_options *data,
                                  const pags_train_config *config) {
  char run[64];
  pags_dataset *dataset = hard_data(name, data);
  snprintf(run, sizeof run, "%s_run", name);
  const pags_train_result r = hard_train(dataset, run, config, NULL);
  print_message("  %-40s %.1f dB, %d Gaussians, %d rows skipped\n", what, r.psnr, (int)r.gaussians, (int)r.bad_rows);
  assert_int_equal(r.bad_rows, 0);
  pags_dataset_close(dataset);
  return r;
}

static double plain_psnr;

static void an_easy_start(void **state) {
  (void)state;
  const pags_train_config config = hard_config(HARD_STEPS);
  plain_psnr = train_on("nothing hard", "plain", &HARD_DATA_DEFAULT, &config).psnr;
  assert_true(plain_psnr > 18);
}

/* #4: every point twice, a third of them a hundred times, so that the nearest neighbours are at distance 0. */
static void duplicate_points(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  enum { COPIES = 40 };
  float xyz[3 * HARD_TRUTH * COPIES];
  pags_gaussians truth;
  int64_t count = 0;
  hard_truth(&truth);
  for (int i = 0; i < HARD_TRUTH; i++)
    for (int copy = 0; copy < (i % 3 ? 2 : COPIES); copy++, count++)
      for (int k = 0; k < 3; k++)
        xyz[3 * count + k] = pags_plane(&truth, PAGS_MEAN + k)[i];
  pags_gaussians_destroy(&truth);
  pags_train_config config = hard_config(HARD_STEPS);
  config.size_limit.max_gaussians = 0;
  const hard_data_options data = {.level = -1, .points = {count, xyz, NULL}};
  assert_true(train_on("duplicate points", "twice", &data, &config).psnr > 15);
}

/* #3: points at the camera centres, where the viewing direction is 0 / 0. */
static void points_on_cameras(void **state) {
  (void)state;
  float xyz[3 * (HARD_TRUTH + HARD_VIEWS)];
  pags_gaussians truth;
  hard_truth(&truth);
  for (int i = 0; i < HARD_TRUTH; i++)
    for (int k = 0; k < 3; k++)
      xyz[3 * i + k] = pags_plane(&truth, PAGS_MEAN + k)[i];
  pags_gaussians_destroy(&truth);
  for (int v = 0; v < HARD_VIEWS; v++) {
    const double angle = 6.283185307179586 * v / HARD_VIEWS;
    float *at = xyz + 3 * (HARD_TRUTH + v);
    at[0] = (float)(4 * cos(angle)), at[1] = (float)(4 * sin(angle)), at[2] = 0.5f;
  }
  const pags_train_config config = hard_config(HARD_STEPS);
  const hard_data_options data = {.level = -1, .points = {HARD_TRUTH + HARD_VIEWS, xyz, NULL}};
  assert_true(train_on("points on the cameras' centres", "eyes", &data, &config).psnr > plain_psnr - 4);
}

/* #24: one point, two points, all points in one place. */
static void few_points(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  static const float xyz[30] = {0.1f, 0.2f, 0.3f, 0.1f, 0.2f, 0.3f};
  static const int64_t counts[] = {1, 2, 10};
  const pags_train_config config = hard_config(HARD_STEPS);
  for (int k = 0; k < 3; k++) {
    char name[32], what[32];
    const hard_data_options data = {.level = -1, .points = {counts[k], xyz, NULL}};
    snprintf(name, sizeof name, "few%d", k);
    snprintf(what, sizeof what, "%d points", (int)counts[k]);
    assert_true(train_on(what, name, &data, &config).psnr > 5);
  }
}

/* #27: a cloud of black points, and of white ones. Clamped colours have no gradient, so that black points are
 * initialised half a level above the clamp; they reach the photographs' colours like all others, at a rate of 0.0007
 * a step. */
static void black_points(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  float xyz[3 * HARD_TRUTH];
  uint8_t rgb[3 * HARD_TRUTH];
  pags_gaussians truth;
  hard_truth(&truth);
  for (int i = 0; i < 3 * HARD_TRUTH; i++)
    xyz[i] = pags_plane(&truth, PAGS_MEAN + i % 3)[i / 3];
  pags_gaussians_destroy(&truth);
  pags_train_config config = hard_config(HARD_STEPS);
  config.optimiser.sh_dc_rate = 0.01;
  for (int white = 0; white < 2; white++) {
    memset(rgb, white ? 255 : 0, sizeof rgb);
    const hard_data_options data = {.level = -1, .points = {HARD_TRUTH, xyz, rgb}};
    const pags_train_result r =
        train_on(white ? "white points" : "black points", white ? "white" : "black", &data, &config);
    assert_true(r.psnr > plain_psnr - 3);
  }
}

/* #10, #14, #25: the world scaled down and up by a factor of a thousand (cameras 4 mm and 4 km from its centre), with
 * the near plane scaled alike. Training is the same up to rounding. */
static void any_extent(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  static const double scales[] = {1e-3, 0.1, 30, 1e3};
  for (int k = 0; k < 4; k++) {
    char name[32], what[48];
    pags_train_config config = hard_config(HARD_STEPS);
    const hard_data_options data = {.level = -1, .scale = scales[k]};
    config.picture.near_plane *= scales[k];
    snprintf(name, sizeof name, "extent%d", k);
    snprintf(what, sizeof what, "%g times as large", scales[k]);
    const pags_train_result r = train_on(what, name, &data, &config);
    assert_true(r.psnr > plain_psnr - 2 && r.gaussians > 100);
  }
}

/* #25: MCMC's noise is the covariance times a rate in proportion to the extent; an extent of 2009 metres broke it in
 * other programs. */
static void mcmc_of_any_extent(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  static const double scales[] = {1e-3, 1, 500};
  for (int k = 0; k < 3; k++) {
    char name[32], what[48];
    pags_train_config config = hard_config(HARD_STEPS);
    const hard_data_options data = {.level = -1, .scale = scales[k]};
    config.picture.near_plane *= scales[k];
    config.density.strategy = PAGS_STRATEGY_MCMC;
    config.size_limit.max_gaussians = 300;
    snprintf(name, sizeof name, "mcmc%d", k);
    snprintf(what, sizeof what, "MCMC, %g times as large", scales[k]);
    assert_true(train_on(what, name, &data, &config).psnr > 12);
  }
}

/* #18: coordinates of 1e7 m. Initial Gaussians and cameras are the same up to the rounding of the doubles in the
 * file, and so is the training up to the effect of that rounding. */
static void far_from_the_origin(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  const pags_train_config config = hard_config(HARD_STEPS);
  const hard_data_options data = {.level = -1, .offset = {1e7, -1e7, 1e7}};
  const pags_train_result r = train_on("1e7 m from the origin", "far", &data, &config);
  assert_true(fabs(r.psnr - plain_psnr) < 1);
}

/* #14: resets to 0.01 and pruning at 0.9 would remove every row: a few rows are kept, and the run ends without an
 * error. */
static void everything_pruned(void **state) {
  (void)state;
  pags_train_config config = hard_config(HARD_STEPS);
  config.density.prune_opacity = 0.95;
  config.density.reset_every = 1;
  const pags_train_result r = train_on("everything is to be pruned", "pruned", &HARD_DATA_DEFAULT, &config);
  assert_true(r.gaussians >= 16);
}

/* #17: a reset to opacity 0.01 shrinks the reach of a Gaussian to 1.37 sigma, one to 0.004 to 0.2 sigma. A reset or
 * an initial opacity below 1/255, at which nothing would be drawn and no row would ever have a gradient, is refused. */
static void resets(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  static const double levels[] = {0.01, 0.004};
  for (int k = 0; k < 2; k++) {
    char name[32], what[48];
    pags_train_config config = hard_config(HARD_STEPS);
    config.density.reset_every = 3000; /* for a schedule of 30 000 steps: every 24 steps here */
    config.density.reset_opacity = levels[k];
    snprintf(name, sizeof name, "reset%d", k);
    snprintf(what, sizeof what, "opacities reset to %g", levels[k]);
    const pags_train_result r = train_on(what, name, &HARD_DATA_DEFAULT, &config);
    assert_true(r.psnr > 12);
  }
  for (int k = 0; k < 2; k++) {
    pags_train_config config = hard_config(HARD_STEPS);
    *(k ? &config.start.init_opacity : &config.density.reset_opacity) = 0.0039;
    assert_int_equal(pags_train_config_check(&config), PAGS_ERROR_ARGUMENT);
    assert_non_null(strstr(pags_error_message(), k ? "init_opacity" : "reset_opacity"));
  }
  static const double cuts[] = {0.002, 0.1}; /* a cut below 1/255, and one equal to the first Gaussians' opacity */
  for (int k = 0; k < 2; k++) {
    pags_train_config config = hard_config(HARD_STEPS);
    config.picture.alpha_min = cuts[k];
    assert_int_equal(pags_train_config_check(&config), PAGS_ERROR_ARGUMENT);
    assert_non_null(strstr(pags_error_message(), k ? "init_opacity" : "alpha_min"));
  }
}

/* Photographs of 16 bits that are all black or all white. */
static void flat_photographs(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  static const int levels[] = {0, 65535};
  for (int k = 0; k < 2; k++) {
    char name[32], what[48];
    const pags_train_config config = hard_config(HARD_STEPS);
    const hard_data_options data = {.level = levels[k]};
    snprintf(name, sizeof name, "flat%d", k);
    snprintf(what, sizeof what, "photographs of level %d", levels[k]);
    const pags_train_result r = train_on(what, name, &data, &config);
    assert_true(r.psnr > (levels[k] ? 5 : 20));
  }
}

static void one_view(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  const pags_train_config config = hard_config(HARD_STEPS);
  const hard_data_options data = {.level = -1, .views = 1};
  assert_true(train_on("one photograph", "single", &data, &config).psnr > 15);
}

typedef struct absurd {
  const char *name;
  double rate; /* learning rate of all parameters */
  double beta2, epsilon;
  pags_strategy strategy;
  int densify;
} absurd;

/* The largest allowed learning rates, 1 a step: ln sigma and logits change by hundreds, positions by the scene's
 * size, under both strategies. The run stays finite or stops with an error message, and the number of Gaussians stays
 * within its bound. */
static void absurd_rates(void **state) {
  (void)state;
  static const absurd cases[] = {
      {"all rates 1", 1, 0.999, 1e-15, PAGS_STRATEGY_DEFAULT, 1},
      {"all rates 1, beta2 0.95, epsilon 1e-20", 1, 0.95, 1e-20, PAGS_STRATEGY_DEFAULT, 1},
      {"all rates 1, no density control", 1, 0.99999, 1e-15, PAGS_STRATEGY_DEFAULT, 0},
      {"all rates 1, MCMC, noise 1e9", 1, 0.999, 1e-15, PAGS_STRATEGY_MCMC, 1},
      {"all rates 0", 0, 0.999, 1e-15, PAGS_STRATEGY_DEFAULT, 1},
  };
  pags_dataset *dataset = hard_data("absurd", &HARD_DATA_DEFAULT);
  for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
    const absurd *c = &cases[k];
    char name[32];
    pags_train_config config = hard_config(absurd_steps());
    pags_train_result r;
    config.optimiser.position_rate_begin = config.optimiser.position_rate_end = c->rate;
    config.optimiser.scale_rate = config.optimiser.rotation_rate = config.optimiser.opacity_rate =
        config.optimiser.sh_dc_rate = config.optimiser.sh_rest_rate = c->rate;
    config.optimiser.beta2 = c->beta2, config.optimiser.epsilon = c->epsilon, config.density.strategy = c->strategy;
    config.density.reset_every = 3000;
    config.size_limit.max_gaussians = 300;
    if (c->strategy == PAGS_STRATEGY_MCMC)
      config.mcmc.mcmc_noise = 1e9, config.mcmc.mcmc_opacity_reg = config.mcmc.mcmc_scale_reg = 1e3;
    if (!c->densify)
      config.density.densify_until = 0;
    snprintf(name, sizeof name, "absurd%d", (int)k);
    const pags_result code = hard_try(dataset, name, &config, NULL, 2, pags_train_options_default(), &r);
    print_message("  %-40s %s after %d steps: loss %.3g, %d rows skipped, %d Gaussians\n", c->name,
                  pags_result_name(code), (int)r.iterations, r.loss, (int)r.bad_rows, (int)r.gaussians);
    if (code == PAGS_OK) {
      assert_true(isfinite(r.loss) && r.gaussians <= 300);
      hard_check_scene(name);
    } else {
      print_message("    %s\n", pags_error_message());
      assert_non_null(strstr(pags_error_message(), "step"));
    }
  }
  pags_dataset_close(dataset);
}

/* Rates above the allowed range are refused by name. */
static void rates_out_of_range(void **state) {
  (void)state;
  pags_train_config config = hard_config(10);
  config.optimiser.scale_rate = 1e30;
  assert_int_equal(pags_train_config_check(&config), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "scale_rate"));
  config.optimiser.scale_rate = NAN;
  assert_int_equal(pags_train_config_check(&config), PAGS_ERROR_ARGUMENT);
}

/* #26: invalid colour values become valid when pictures are converted to integers. */
static void pictures_of_no_colours(void **state) {
  (void)state;
  static const float values[6] = {NAN, INFINITY, -INFINITY, -1.0f, 2.0f, 1e30f};
  static const uint8_t wanted[6] = {0, 255, 0, 0, 255, 255};
  pags_image out, in;
  assert_int_equal(pags_image_create(&out, 2, 1, 3, PAGS_F32), PAGS_OK);
  memcpy(out.data, values, sizeof values);
  assert_int_equal(pags_image_save(hard_path("no_colours.png"), &out), PAGS_OK);
  assert_int_equal(pags_image_load(hard_path("no_colours.png"), PAGS_U8, 3, &in), PAGS_OK);
  assert_memory_equal(in.data, wanted, sizeof wanted);
  pags_image_destroy(&out);
  pags_image_destroy(&in);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(an_easy_start),          cmocka_unit_test(duplicate_points),
      cmocka_unit_test(points_on_cameras),      cmocka_unit_test(few_points),
      cmocka_unit_test(black_points),           cmocka_unit_test(any_extent),
      cmocka_unit_test(mcmc_of_any_extent),     cmocka_unit_test(far_from_the_origin),
      cmocka_unit_test(everything_pruned),      cmocka_unit_test(resets),
      cmocka_unit_test(flat_photographs),       cmocka_unit_test(one_view),
      cmocka_unit_test(absurd_rates),           cmocka_unit_test(rates_out_of_range),
      cmocka_unit_test(pictures_of_no_colours),
  };
  return cmocka_run_group_tests(tests, hard_begin, hard_end);
}
