/* SPDX-License-Identifier: Apache-2.0 */
/* Hard shapes (cases 2, 5-9, 12, 16, 19, 22, 23 of docs/lab/numerics.md): rows of hard Gaussians among ordinary
 * ones. Picture and gradients are compared with the oracle, and a third of a scene is made hard and trained for 200
 * steps. */
#include "hard/hard.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ORDINARY = 40, HARD_ROWS = 16 };

/* A hard row's place: its mean is already set, `pixel` is the size in metres of a pixel at its depth. */
typedef struct spot {
  reference_random *random;
  double pixel;
  int index; /* index among the hard rows */
} spot;

/* Writes a row's parameters from mean to opacity; on entry the row holds those of an ordinary round Gaussian. */
typedef void shape_fn(const spot *at, double *row);

static void set_scales(double *row, double a, double b, double c) {
  row[PAGS_SCALE] = log(a), row[PAGS_SCALE + 1] = log(b), row[PAGS_SCALE + 2] = log(c);
}

static void turn_at_random(const spot *at, double *row, double length) {
  double q[4], square = 0;
  for (int k = 0; k < 4; k++) {
    q[k] = reference_normal(at->random);
    square += q[k] * q[k];
  }
  for (int k = 0; k < 4; k++)
    row[PAGS_ROTATION + k] = length * q[k] / sqrt(square);
}

/* #5: the zero quaternion. */
static void zero_quaternion(const spot *at, double *row) {
  set_scales(row, 4 * at->pixel, 2 * at->pixel, at->pixel);
  for (int k = 0; k < 4; k++)
    row[PAGS_ROTATION + k] = 0;
}

/* #6: quaternions of lengths from 1e-14 to 1e34. */
static void any_length(const spot *at, double *row) {
  set_scales(row, 5 * at->pixel, 2 * at->pixel, at->pixel);
  turn_at_random(at, row, pow(10, -14 + 3.2 * at->index));
}

/* #7: needles of 1:1e4 that lie parallel to the picture at 45 degrees, in both diagonals. */
static void needle(const spot *at, double *row) {
  const double half = 0.39269908169872414;
  set_scales(row, (4 + at->index) * at->pixel, 4e-4 * at->pixel, 4e-4 * at->pixel);
  row[PAGS_ROTATION] = cos(half), row[PAGS_ROTATION + 3] = at->index % 2 ? sin(half) : -sin(half);
}

/* Condition numbers of the covariance (the squared ratio of sigmas) up to 1e12, alternately flat and long. */
static void condition(const spot *at, double *row) {
  const double large = 6 * at->pixel, small = large * pow(10, -6.0 * (at->index + 1) / HARD_ROWS);
  set_scales(row, large, at->index % 2 ? large : small, small);
  turn_at_random(at, row, 1);
}

/* #8: up to 3,857 pictures wide, the largest that users of other programs report. */
static void giant(const spot *at, double *row) {
  const double sigma = 10 * pow(3857 * HARD_WIDTH / 10.0, at->index / (HARD_ROWS - 1.0)) * at->pixel;
  set_scales(row, sigma, sigma, 0.1 * sigma);
  row[PAGS_OPACITY] = -3;
}

/* #2: finite ln sigma whose exponentials, or the squares of those, aren't finite. By the engine's definition a
 * Gaussian wider than 1e9 px isn't drawn. */
static void overflowing_scale(const spot *at, double *row) {
  const double large[] = {25, 30, 44.5, 88.7, 89, 100, 1e30, 2e38};
  row[PAGS_SCALE + at->index % 3] = large[at->index % 8];
}

static void vanishing_scale(const spot *at, double *row) {
  const double small[] = {-20, -50, -87, -104, -1000, -1e30};
  for (int k = 0; k <= at->index % 3; k++)
    row[PAGS_SCALE + k] = small[at->index % 6];
}

/* #12: opacities around and below 1/255, whose logit is -5.537. */
static void faint(const spot *at, double *row) {
  set_scales(row, 3 * at->pixel, 3 * at->pixel, 3 * at->pixel);
  row[PAGS_OPACITY] = at->index < 8 ? -5.5 + 0.1 * at->index : -6.0 * at->index;
}

/* #16: the logit of 1 - 1e-7 is 16.1; beyond about 17 the opacity rounds to 1 in float. */
static void opaque(const spot *at, double *row) {
  const double logits[] = {9, 13, 16.118095550958319, 16.7, 17, 20, 88, 1e5};
  set_scales(row, 2 * at->pixel, 2 * at->pixel, 2 * at->pixel);
  row[PAGS_OPACITY] = logits[at->index % 8];
}

/* #19: a plate of 100 m by 1 mm, which loses an axis in half precision: its variances are 1e4 and 1e-6 m^2. */
static void plate(const spot *at, double *row) {
  set_scales(row, 1e5 * 2e-3 * at->pixel, 2e-3 * at->pixel, 1e5 * 2e-3 * at->pixel);
  turn_at_random(at, row, 1);
  row[PAGS_OPACITY] = -1.5;
}

typedef struct shape {
  const char *name;
  shape_fn *write;
  double colour, gradient; /* bounds on the errors of the picture and of its gradients */
  double left_out;         /* bound on the share of pixels where float may decide otherwise */
  double lost;             /* dB by which 200 steps may fall short of training from the true Gaussians */
  int hidden;              /* 1: no row of this shape may be drawn */
} shape;

static const shape shapes[] = {
    {"zero quaternions", zero_quaternion, 1e-5, 1e-3, 0.1, 3, 0},
    {"quaternions 1e-12 to 1e18 long", any_length, 1e-5, 1e-3, 0.1, 1, 0},
    {"needles of 1:1e4 at 45 degrees", needle, 1e-5, 1e-3, 0.1, 3, 0},
    {"condition numbers to 1e12", condition, 1e-5, 1e-3, 0.1, 3, 0},
    {"giants to 3,857 pictures", giant, 1e-5, 1e-3, 0.1, 4, 0},
    {"scales that overflow", overflowing_scale, 1e-5, 1e-3, 0.1, 6, 1},
    {"scales that vanish", vanishing_scale, 1e-5, 1e-3, 0.1, 4, 0},
    {"opacities about and under 1/255", faint, 1e-5, 1e-3, 0.2, 3, 0},
    {"opacities to 1 - 1e-7 and 1", opaque, 1e-5, 1e-3, 0.1, 3, 0},
    {"plates that half precision loses", plate, 1e-5, 1e-3, 0.1, 7, 0},
};
enum { SHAPES = sizeof shapes / sizeof *shapes };

/* Compares a scene whose first rows have the hard shape and whose other rows are ordinary. */
static void pictures_and_gradients(int antialiased) {
  for (int k = 0; k < SHAPES; k++) {
    hard_scene s = hard_scene_create(100 + (uint64_t)k, ORDINARY + HARD_ROWS);
    s.options.antialiased = antialiased;
    for (int i = 0; i < HARD_ROWS; i++) {
      double row[PAGS_SH];
      const spot at = {&s.random, *hard_at(&s, PAGS_MEAN + 2, i) / HARD_FOCAL, i};
      hard_put(&s, i, *hard_at(&s, PAGS_MEAN, i), *hard_at(&s, PAGS_MEAN + 1, i), *hard_at(&s, PAGS_MEAN + 2, i),
               3 * at.pixel, 0);
      for (int p = 0; p < PAGS_SH; p++)
        row[p] = *hard_at(&s, p, i);
      shapes[k].write(&at, row);
      for (int p = 0; p < PAGS_SH; p++)
        *hard_at(&s, p, i) = row[p];
      s.hidden[i] = (uint8_t)shapes[k].hidden;
    }
    const hard_error e = hard_expect(shapes[k].name, &s, shapes[k].colour, shapes[k].gradient);
    assert_true(e.left_out < shapes[k].left_out);
    hard_scene_destroy(&s);
  }
}

static void plain_pictures(void **state) {
  (void)state;
  pictures_and_gradients(0);
}

static void antialiased_pictures(void **state) {
  (void)state;
  pictures_and_gradients(1);
}

/* Makes a third of the true Gaussians hard and trains against the true photographs. All results stay finite, and
 * training recovers the picture as far as visible rows allow. */
static void two_hundred_steps(void **state) {
  (void)state;
  pags_dataset *dataset = hard_data("data", &HARD_DATA_DEFAULT);
  const pags_train_config config = hard_config(HARD_STEPS);
  pags_gaussians truth;
  hard_truth(&truth);
  const double start = hard_train(dataset, "truth", &config, &truth).psnr;
  pags_gaussians_destroy(&truth);
  for (int k = 0; k < SHAPES; k++) {
    reference_random random = {200 + (uint64_t)k};
    char name[32];
    hard_truth(&truth);
    for (int i = 0; i < HARD_TRUTH / 3; i++) {
      double row[PAGS_SH];
      const spot at = {&random, 4 / HARD_VIEW_FOCAL, i % HARD_ROWS};
      for (int p = 0; p < PAGS_SH; p++)
        row[p] = (double)pags_plane(&truth, p)[3 * i];
      shapes[k].write(&at, row);
      for (int p = 0; p < PAGS_SH; p++)
        pags_plane(&truth, p)[3 * i] = (float)row[p];
    }
    snprintf(name, sizeof name, "shape%d", k);
    const pags_train_result result = hard_train(dataset, name, &config, &truth);
    print_message("  %-40s %.1f dB after %d steps (%.1f dB without), %d rows skipped, %d Gaussians\n", shapes[k].name,
                  result.psnr, HARD_STEPS, start, (int)result.bad_rows, (int)result.gaussians);
    assert_int_equal(result.bad_rows, 0);
    assert_true(result.psnr > start - shapes[k].lost);
    pags_gaussians_destroy(&truth);
  }
  pags_dataset_close(dataset);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(plain_pictures),
      cmocka_unit_test(antialiased_pictures),
      cmocka_unit_test(two_hundred_steps),
  };
  return cmocka_run_group_tests(tests, hard_begin, hard_end);
}
