/* SPDX-License-Identifier: Apache-2.0 */
/* Hard positions and pictures (cases 3, 9, 10, 13, 18 of docs/lab/numerics.md): Gaussians at, next to and behind the
 * camera, cameras inside of objects and far from the world's origin; pictures of one pixel and of 16384 x 16. */
#include "hard/hard.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static int shows_background(const hard_scene *s, const frame_result *result) {
  const int64_t pixels = (int64_t)s->camera.width * s->camera.height;
  for (int64_t k = 0; k < pixels; k++)
    for (int channel = 0; channel < 3; channel++)
      if (result->rgb[channel * pixels + k] != s->options.background[channel])
        return 0;
  return 1;
}

static double *random_weights(hard_scene *s) {
  const int64_t pixels = (int64_t)s->camera.width * s->camera.height;
  double *weights = reference_alloc(5 * pixels, sizeof(double));
  for (int64_t k = 0; k < 5 * pixels; k++)
    weights[k] = reference_uniform(&s->random, -1, 1);
  return weights;
}

/* #3: rows at the camera's centre and in its plane z = 0 aren't drawn and have no gradient. Rows just beyond a near
 * plane of 1e-6 m, where 1/z is 1e6, agree with the oracle like all others. */
static void at_the_camera(void **state) {
  (void)state;
  enum { ROWS = 40, AT = 8 };
  static const double offset[AT][3] = {{0, 0, 0},      {1, 0, 0},     {0, -1, 0},   {1e-20, 0, 1e-20},
                                       {0, 0, -1e-30}, {0, 0, 1e-38}, {0, 0, 2e-6}, {1e-7, 0, 1e-5}};
  hard_scene s = hard_scene_create(11, ROWS);
  s.options.near_plane = 1e-6f;
  for (int i = 0; i < AT; i++)
    hard_put(&s, i, offset[i][0], offset[i][1], offset[i][2], i < 6 ? 1 : 0.1 * offset[i][2], 0);
  hard_expect("at the camera's centre", &s, 1e-5, 1e-3);
  double *weights = random_weights(&s);
  frame_result result = hard_run(&s, weights);
  for (int i = 0; i < 6; i++) {
    assert_int_equal(result.parts[0].drawn[i], 0);
    for (int p = 0; p < PAGS_MAX_PLANES; p++)
      assert_true(result.parts[0].planes[p * ROWS + i] == 0);
  }
  assert_true(result.parts[0].drawn[6] && result.parts[0].drawn[7]);
  frame_result_destroy(&result);
  free(weights);
  hard_scene_destroy(&s);
}

/* #9: long rows next to the frustum that the clamp of the Jacobian keeps from fanning across the picture. */
static void beside_the_picture(void **state) {
  (void)state;
  enum { ROWS = 64 };
  hard_scene s = hard_scene_create(12, ROWS);
  for (int i = 0; i < ROWS / 2; i++) {
    const double angle = 6.283185307179586 * i / (ROWS / 2);
    hard_put(&s, i, 2 * cos(angle), 2 * sin(angle), 0.2 + 0.02 * i, 0.02, 0);
    *hard_at(&s, PAGS_SCALE + i % 3, i) = log(0.9);
  }
  const hard_error e = hard_expect("long, beside the frustum", &s, 1e-5, 1e-3);
  assert_true(e.drawn == ROWS);
  hard_scene_destroy(&s);
}

/* An object's Gaussians lie all around the camera, many wider than their distance, as if a camera drove into a car. */
static void inside_of_an_object(void **state) {
  (void)state;
  enum { ROWS = 200 };
  hard_scene s = hard_scene_create(13, ROWS);
  for (int i = 0; i < ROWS; i++) {
    double p[3], square = 0;
    for (int k = 0; k < 3; k++) {
      p[k] = reference_normal(&s.random);
      square += p[k] * p[k];
    }
    const double distance = 0.5 * pow((i + 1.0) / ROWS, 2) / sqrt(square);
    hard_put(&s, i, distance * p[0], distance * p[1], distance * p[2],
             exp(reference_uniform(&s.random, log(0.003), log(1.5))), -2);
    *hard_at(&s, PAGS_SCALE + i % 3, i) -= 2;
  }
  const hard_error e = hard_expect("the camera inside of an object", &s, 1e-5, 1e-3);
  assert_true(e.drawn > ROWS / 4 && e.drawn < ROWS * 3 / 4);
  hard_scene_destroy(&s);
}

/* #10: scenes of millimetres and larger, with three near planes each: only Gaussians beyond the near plane are
 * drawn. */
static void small_scenes(void **state) {
  (void)state;
  static const float planes[] = {0.001f, 0.01f, 0.2f};
  static const double scales[] = {2e-3, 2e-2, 0.3};
  for (int k = 0; k < 3; k++)
    for (int j = 0; j < 3; j++) {
      hard_scene s = hard_scene_create(14, 40); /* depths 1 to 6 */
      for (int64_t i = 0; i < 40; i++)
        for (int axis = 0; axis < 3; axis++) {
          *hard_at(&s, PAGS_MEAN + axis, i) *= scales[j];
          *hard_at(&s, PAGS_SCALE + axis, i) += log(scales[j]);
        }
      s.options.near_plane = planes[k];
      int64_t beyond = 0;
      for (int64_t i = 0; i < 40; i++)
        beyond += *hard_at(&s, PAGS_MEAN + 2, i) > (double)planes[k];
      const hard_error e = hard_compare(&s);
      assert_int_equal(e.drawn, beyond);
      assert_int_equal(e.disagreed, 0);
      assert_true(e.colour < 1e-5 && e.gradient < 1e-3);
      if (k == 0 && j == 0)
        print_message("  %-40s colour %.1e, gradient %.1e\n", "a scene of millimetres, near 1 mm", e.colour,
                      e.gradient);
      hard_scene_destroy(&s);
    }
}

/* #18 and beyond: 1e7 m away the same scene gives the same picture within 1e-3, and the same gradients. */
static void far_from_the_origin(void **state) {
  (void)state;
  enum { ROWS = 300 };
  static const double far[] = {1e6, 6.4e6, 1e7};
  hard_scene s = hard_scene_create(15, ROWS);
  double *weights = random_weights(&s);
  frame_scene_round(&s.part);
  frame_result here = hard_run(&s, weights);
  for (int n = 0; n < 3; n++) {
    double colour = 0, gradient = 0, largest = 0;
    for (int k = 0; k < 3; k++) {
      s.options.origin[k] = far[n] * (k == 1 ? -1 : 1) + 0.123456789 * k;
      s.camera.world_from_camera[4 * k + 3] = s.options.origin[k];
    }
    frame_result there = hard_run(&s, weights);
    for (int k = 0; k < 3 * HARD_PIXELS; k++)
      colour = fmax(colour, fabs((double)here.rgb[k] - (double)there.rgb[k]));
    for (int64_t k = 0; k < ROWS * PAGS_MAX_PLANES; k++) {
      gradient = fmax(gradient, fabs((double)here.parts[0].planes[k] - (double)there.parts[0].planes[k]));
      largest = fmax(largest, fabs((double)here.parts[0].planes[k]));
    }
    print_message("  %.1e m from the origin                colour %.1e, gradient %.1e of the largest\n", far[n], colour,
                  gradient / largest);
    assert_true(colour <= 1e-3 && gradient <= 1e-3 * largest);
    frame_result_destroy(&there);
  }
  frame_result_destroy(&here);
  free(weights);
  hard_scene_destroy(&s);
}

/* Camera motions of fractions of a millimetre are exact far from the origin, as the camera's position is a double
 * until the scene's origin is subtracted. */
static void small_steps_far_away(void **state) {
  (void)state;
  hard_scene s = hard_scene_create(16, 100), moved = hard_scene_create(16, 100);
  frame_result near_by[2], far_away[2];
  for (int step = 0; step < 2; step++) {
    s.camera.world_from_camera[3] = 1e-3 * step;
    near_by[step] = hard_run(&s, NULL);
    for (int k = 0; k < 3; k++) {
      moved.options.origin[k] = 1e7;
      moved.camera.world_from_camera[4 * k + 3] = 1e7 + (k == 0 ? 1e-3 * step : 0);
    }
    far_away[step] = hard_run(&moved, NULL);
  }
  double moves = 0, differs = 0;
  for (int k = 0; k < 3 * HARD_PIXELS; k++) {
    moves = fmax(moves, fabs((double)near_by[1].rgb[k] - (double)near_by[0].rgb[k]));
    for (int step = 0; step < 2; step++)
      differs = fmax(differs, fabs((double)near_by[step].rgb[k] - (double)far_away[step].rgb[k]));
  }
  print_message("  a step of 1 mm at 1e7 m                  moves colours by %.1e, off by %.1e\n", moves, differs);
  assert_true(moves > 100 * differs);
  for (int step = 0; step < 2; step++) {
    frame_result_destroy(&near_by[step]);
    frame_result_destroy(&far_away[step]);
  }
  hard_scene_destroy(&s);
  hard_scene_destroy(&moved);
}

/* Rows at distances of a kilometre to 1e15 m, with sizes in proportion to the distance, like a sky made of
 * Gaussians. */
static void far_rows(void **state) {
  (void)state;
  enum { ROWS = 60 };
  hard_scene s = hard_scene_create(21, ROWS);
  for (int i = 0; i < 26; i++) {
    const double scale = pow(10, 2.5 + 0.5 * i);
    for (int k = 0; k < 3; k++) {
      *hard_at(&s, PAGS_MEAN + k, i) *= scale;
      *hard_at(&s, PAGS_SCALE + k, i) += log(scale);
    }
  }
  hard_expect("a kilometre to 1e15 m away", &s, 1e-5, 1e-3);
  hard_scene_destroy(&s);
}

/* Tests needles thousands of pixels long in a picture of 16384 x 16, almost horizontal. */
static void long_needles(void **state) {
  (void)state;
  enum { ROWS = 200 };
  hard_scene s = hard_scene_create(22, ROWS);
  s.camera.width = 16384, s.camera.height = 16, s.camera.fx = s.camera.fy = 8192, s.camera.cx = 8192, s.camera.cy = 8;
  for (int i = 0; i < ROWS; i++) {
    const double z = 1 + i * 0.01, length = 300 * pow(20, i / (ROWS - 1.0)) * z / 8192,
                 angle = 1e-3 * reference_normal(&s.random);
    hard_put(&s, i, z * reference_uniform(&s.random, -0.5, 0.5), z * reference_uniform(&s.random, -8, 8) / 8192, z,
             1e-6, -1);
    *hard_at(&s, PAGS_SCALE, i) = log(length);
    *hard_at(&s, PAGS_ROTATION, i) = cos(angle / 2), *hard_at(&s, PAGS_ROTATION + 3, i) = sin(angle / 2);
  }
  hard_expect("needles of 300 to 6000 px in 16384 x 16", &s, 1e-2, 0.1);
  hard_scene_destroy(&s);
}

static void resize(hard_scene *s, int width, int height, double focal) {
  const reference_recipe recipe = reference_recipe_default();
  s->camera.width = width, s->camera.height = height;
  s->camera.fx = s->camera.fy = focal;
  s->camera.cx = 0.5 * width, s->camera.cy = 0.5 * height;
  for (int64_t i = 0; i < s->part.count; i++)
    reference_random_gaussian(&s->random, &recipe, &s->camera, &s->options, &s->part, i);
}

/* Pictures of 1 x 1, and of 16384 pixels in either direction with a field of view of 90 degrees and a single row of
 * tiles. Floats beyond 8192 are 1/1024 px apart, which causes the error of the long pictures. */
static void odd_pictures(void **state) {
  (void)state;
  static const struct {
    const char *what;
    int width, height;
    double focal;
    int64_t rows;
    double colour, gradient;
  } sizes[] = {{"1 x 1", 1, 1, 1, 30, 1e-5, 1e-3},
               {"16384 x 16", 16384, 16, 8192, 500, 1e-2, 0.1},
               {"16 x 16384", 16, 16384, 8192, 500, 1e-2, 0.1}};
  for (int k = 0; k < 3; k++) {
    hard_scene s = hard_scene_create(17 + (uint64_t)k, sizes[k].rows);
    resize(&s, sizes[k].width, sizes[k].height, sizes[k].focal);
    hard_expect(sizes[k].what, &s, sizes[k].colour, sizes[k].gradient);
    hard_scene_destroy(&s);
  }
}

/* #13: no row is in view, because all are behind the camera, next to it, below 1/255, or a mix of these. The picture
 * is the background and the gradients are 0. */
static void nothing_in_view(void **state) {
  (void)state;
  enum { ROWS = 200 };
  hard_scene s = hard_scene_create(20, ROWS);
  for (int i = 0; i < ROWS; i++)
    hard_put(&s, i, i % 3 == 1 ? 100 : 0.01 * i, 0, i % 3 == 0 ? -3 : 3, 0.01, i % 3 == 2 ? -6 : 1);
  double *weights = random_weights(&s);
  frame_result result = hard_run(&s, weights);
  assert_int_equal(s.stats.pairs_binned, 0);
  assert_true(shows_background(&s, &result));
  for (int64_t k = 0; k < ROWS * PAGS_MAX_PLANES; k++)
    assert_true(result.parts[0].planes[k] == 0);
  frame_result_destroy(&result);
  free(weights);
  hard_scene_destroy(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(at_the_camera), cmocka_unit_test(beside_the_picture),  cmocka_unit_test(inside_of_an_object),
      cmocka_unit_test(small_scenes),  cmocka_unit_test(far_from_the_origin), cmocka_unit_test(small_steps_far_away),
      cmocka_unit_test(odd_pictures),  cmocka_unit_test(nothing_in_view),     cmocka_unit_test(far_rows),
      cmocka_unit_test(long_needles),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
