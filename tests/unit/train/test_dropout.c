/* SPDX-License-Identifier: Apache-2.0 */
/* Tests adaptive stochastic dropout: the distribution of its draws, and the mean picture over draws. The mean is the
 * full picture if blending has no limits (alpha cap and threshold, early stop). The bias caused by the limits is
 * printed; docs/lab/dropout.md quotes it. */
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "train/dropout.h"

enum { WIDTH = 40, HEIGHT = 26, PIXELS = WIDTH * HEIGHT, COUNT = 28, DRAWS = 4096 };

/* The dropout at the end of a schedule, when its rate is D = gamma (1 - beta S_sem). */
static pags_dropout last_step(int64_t step, int64_t object) {
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.priority.dropout = 1;
  config.schedule.seed = 5;
  pags_schedule schedule = pags_schedule_make(&config, 1.0, 10);
  pags_dropout d = pags_dropout_at(&schedule, schedule.length, object);
  d.photograph = step;
  return d;
}

static void rates_follow_step_and_priority(void **unused) {
  (void)unused;
  enum { ROWS = 1 << 16 };
  static float s_sem[ROWS], factor[ROWS];
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.schedule.iterations = 1000;
  pags_schedule schedule = pags_schedule_make(&config, 1.0, 10);
  assert_true(pags_dropout_at(&schedule, 1000, -1).most == 0.0); /* dropout is off by default */
  config.priority.dropout = 1;
  schedule = pags_schedule_make(&config, 1.0, 10);
  assert_true(fabs(pags_dropout_at(&schedule, 400, -1).most - 0.1) < 1e-15);
  /* A run resumed beyond the schedule's end keeps the final rate. */
  assert_true(fabs(pags_dropout_at(&schedule, 1700, -1).most - 0.25) < 1e-15);
  for (int i = 0; i < ROWS; i++)
    s_sem[i] = i < ROWS / 2 ? 0.0f : 0.8f;
  const pags_dropout d = last_step(77, 3);
  pags_dropout_draw(&d, s_sem, 0, ROWS, factor);
  int out[2] = {0, 0};
  for (int i = 0; i < ROWS; i++) {
    const double rate = i < ROWS / 2 ? 0.25 : 0.25 * (1.0 - 0.5 * 0.8);
    out[i >= ROWS / 2] += factor[i] == 0.0f;
    assert_true(factor[i] == 0.0f || fabs((double)factor[i] - 1.0 / (1.0 - rate)) < 1e-6);
    assert_true(factor[i] <= pags_dropout_boost(&d));
  }
  print_message("left out: %.4f of no priority (0.25), %.4f of priority 0.8 (0.15)\n", out[0] / (ROWS / 2.0),
                out[1] / (ROWS / 2.0));
  assert_true(abs(out[0] - ROWS / 8) < 4 * 79); /* within 4 standard deviations sqrt(n D (1 - D)) = 79 */
  assert_true(fabs(out[1] - 0.15 * ROWS / 2) < 4 * 64.7);
}

static void draws_depend_on_step_model_and_row(void **unused) {
  (void)unused;
  enum { ROWS = 512 };
  float whole[ROWS], pieces[ROWS], other[ROWS];
  const pags_dropout d = last_step(12, 0);
  pags_dropout_draw(&d, NULL, 0, ROWS, whole);
  for (int first = ROWS - 16; first >= 0; first -= 16)
    pags_dropout_draw(&d, NULL, first, 16, pieces);
  assert_memory_equal(whole, pieces, sizeof whole);
  const pags_dropout others[] = {last_step(13, 0), last_step(12, 1), last_step(12, -1)};
  /* Two independent draws agree in a share 1 - 2 D (1 - D) = 0.625 of the rows. */
  for (int k = 0; k < 3; k++) {
    int same = 0;
    pags_dropout_draw(&others[k], NULL, 0, ROWS, other);
    for (int i = 0; i < ROWS; i++)
      same += (whole[i] == 0.0f) == (other[i] == 0.0f);
    assert_true(same > 0.5 * ROWS && same < 0.75 * ROWS);
  }
}

typedef struct moments {
  double sum[3 * PIXELS], squares[3 * PIXELS];
} moments;

typedef struct world {
  pags_camera camera;
  pags_frame_options options;
  reference_part part;
} world;

static world make_world(const double logit[2]) {
  reference_random random = {4};
  reference_recipe recipe = reference_recipe_default();
  world w = {.camera = reference_random_camera(&random, WIDTH, HEIGHT), .options = reference_options()};
  recipe.logit[0] = logit[0], recipe.logit[1] = logit[1];
  recipe.sigma[0] = 2, recipe.sigma[1] = 8;
  w.options.background[1] = 0.4f;
  w.part = reference_part_create(COUNT, 1);
  for (int64_t i = 0; i < COUNT; i++)
    reference_random_gaussian(&random, &recipe, &w.camera, &w.options, &w.part, i);
  w.part.factor = reference_alloc(COUNT, sizeof(double));
  return w;
}

/* Renders `draws` pictures, each with the dropout factors of another step, some rows being critical; returns the
 * moments of the pixels. */
static moments *draw_pictures(world *w, reference_limits limits, int draws) {
  moments *m = reference_alloc(1, sizeof *m);
  float factor[COUNT], s_sem[COUNT];
  for (int i = 0; i < COUNT; i++)
    s_sem[i] = i % 4 == 0 ? 0.9f : 0.05f;
  for (int step = 1; step <= draws; step++) {
    const pags_dropout d = last_step(step, -1);
    pags_dropout_draw(&d, s_sem, 0, COUNT, factor);
    for (int i = 0; i < COUNT; i++)
      w->part.factor[i] = (double)factor[i];
    reference_picture picture = reference_render_within(limits, &w->part, 1, &w->camera, &w->options);
    for (int k = 0; k < 3 * PIXELS; k++) {
      m->sum[k] += picture.rgb[k];
      m->squares[k] += picture.rgb[k] * picture.rgb[k];
    }
    reference_picture_destroy(&picture);
  }
  return m;
}

static reference_picture full_picture(world *w, reference_limits limits) {
  for (int i = 0; i < COUNT; i++)
    w->part.factor[i] = 1.0;
  return reference_render_within(limits, &w->part, 1, &w->camera, &w->options);
}

static void destroy_world(world *w, reference_picture *picture, moments *m) {
  reference_picture_destroy(picture);
  reference_part_destroy(&w->part);
  free(m);
}

/* The largest factor is 4/3, so an opacity of 0.6 stays below the alpha cap. Without limits the picture is
 * multilinear in the alphas, so that the mean over draws is exact. */
static void the_mean_of_many_draws_is_the_full_picture(void **unused) {
  (void)unused;
  world w = make_world((double[]){-3.0, log(0.6 / 0.4)});
  moments *m = draw_pictures(&w, REFERENCE_NO_LIMITS, DRAWS);
  reference_picture full = full_picture(&w, REFERENCE_NO_LIMITS);
  int out = 0, shown = 0;
  double worst = 0;
  for (int i = 0; i < PIXELS; i++) {
    int far = 0;
    for (int c = 0; c < 3; c++) {
      const int k = c * PIXELS + i;
      const double mean = m->sum[k] / DRAWS, variance = fmax(m->squares[k] / DRAWS - mean * mean, 0) / (DRAWS - 1);
      const double error = fabs(mean - full.rgb[k]), allowed = 4 * sqrt(variance) + 1e-9;
      far |= error > allowed;
      worst = fmax(worst, error / (allowed / 4));
    }
    out += far;
    shown += full.transmittance[i] < 0.9;
  }
  print_message("%d of %d pixels show something; %d are off by more than 4 standard errors, the worst by %.1f\n", shown,
                PIXELS, out, worst);
  assert_true(shown > PIXELS / 2);
  assert_true(out * 1000 <= PIXELS);
  destroy_world(&w, &full, m);
}

/* Prints mean and root mean square of (mean of draws - full picture) over pixels and channels, in 1/255, without the
 * share of the draws' variance. */
static void print_bias(const char *what, const double logit[2], reference_limits limits, double most) {
  enum { FEW = 512 };
  world w = make_world(logit);
  moments *m = draw_pictures(&w, limits, FEW);
  reference_picture full = full_picture(&w, limits);
  double mean = 0, square = 0, noise = 0;
  for (int k = 0; k < 3 * PIXELS; k++) {
    const double value = m->sum[k] / FEW, error = value - full.rgb[k];
    mean += error / (3 * PIXELS);
    square += error * error / (3 * PIXELS);
    noise += (m->squares[k] / FEW - value * value) / (FEW - 1) / (3 * PIXELS);
  }
  const double rms = 255 * sqrt(fmax(square - noise, 0));
  print_message("  %-52s mean %+6.3f, root mean square %6.3f (of 255; draws' own error %.3f)\n", what, 255 * mean, rms,
                255 * sqrt(noise));
  assert_true(rms < most);
  destroy_world(&w, &full, m);
}

static void the_limits_bias_is_known(void **unused) {
  (void)unused;
  const double faint[2] = {-3.0, log(0.6 / 0.4)}, any[2] = {-2.0, 6.0}, opaque[2] = {3.0, 6.0};
  print_message("bias of dropout at D = 0.25 (0.14 for a quarter of the rows):\n");
  print_bias("opacity up to 0.6, all limits", faint, REFERENCE_LIMITS, 1.0);
  print_bias("opacity 0.12 to 0.998, all limits", any, REFERENCE_LIMITS, 6.0);
  print_bias("opacity 0.12 to 0.998, cap only", any,
             (reference_limits){0, REFERENCE_ALPHA_CAP, 0, REFERENCE_WIDENED, 0}, 6.0);
  print_bias("opacity 0.95 to 0.998, all limits", opaque, REFERENCE_LIMITS, 8.0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(rates_follow_step_and_priority),
      cmocka_unit_test(draws_depend_on_step_model_and_row),
      cmocka_unit_test(the_mean_of_many_draws_is_the_full_picture),
      cmocka_unit_test(the_limits_bias_is_known),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
