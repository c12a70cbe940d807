/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the lowering of SH degrees per Gaussian: colours stay within the stated error in every direction from which
 * a view sees the Gaussian, and no degree is higher than needed. */
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "train/sh_trim.h"

enum { COUNT = 300, VIEWS = 7 };
static const double error = 3.0 / 255;
static const double still[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, origin[3] = {10, -20, 3};

typedef struct fixture {
  pags_camera cameras[VIEWS];
  pags_sh_view views[VIEWS];
  pags_gaussians before, after;
} fixture;

/* Gaussians in front of one of several cameras, with view dependence from almost none to strong. */
static fixture make_fixture(int degree) {
  fixture f;
  reference_random random = {(uint64_t)degree + 8};
  reference_recipe recipe = reference_recipe_default();
  pags_frame_options options = reference_options();
  /* Small Gaussians: a view counts almost only if the mean projects into its picture. */
  recipe.sigma[0] = 0.2, recipe.sigma[1] = 0.5;
  reference_part part = reference_part_create(COUNT, degree);
  memcpy(options.origin, origin, sizeof origin);
  for (int v = 0; v < VIEWS; v++) {
    f.cameras[v] = v < VIEWS - 1 && v > 0 ? f.cameras[0] : reference_random_camera(&random, 256, 192);
    /* Most cameras look the same way from places up to 2 m apart; the last one is placed at random. */
    for (int k = 0; k < 3; k++)
      f.cameras[v].world_from_camera[4 * k + 3] +=
          v == 0 || v == VIEWS - 1 ? origin[k] : reference_uniform(&random, -1, 1);
    f.views[v] = pags_sh_view_make(&f.cameras[v], still, origin, 0.01, 0.3);
  }
  for (int64_t i = 0; i < COUNT; i++) {
    recipe.colour = 0.25 * pow(10, -3.0 * (double)(i % 10) / 9);
    reference_random_gaussian(&random, &recipe, &f.cameras[i % (VIEWS - 1)], &options, &part, i);
  }
  for (int64_t i = 0; i < 5; i++) { /* five Gaussians that no view sees */
    part.planes[i] = 1e4;
    part.planes[COUNT + i] = 1e4;
  }
  assert_int_equal(pags_gaussians_create(&f.before, COUNT, degree), PAGS_OK);
  assert_int_equal(pags_gaussians_create(&f.after, COUNT, degree), PAGS_OK);
  for (int plane = 0; plane < pags_plane_count(degree); plane++)
    for (int64_t i = 0; i < COUNT; i++)
      pags_plane(&f.before, plane)[i] = pags_plane(&f.after, plane)[i] = (float)part.planes[plane * COUNT + i];
  reference_part_destroy(&part);
  return f;
}

static void destroy_fixture(fixture *f) {
  pags_gaussians_destroy(&f->before);
  pags_gaussians_destroy(&f->after);
}

/* Computes the viewing direction; returns whether the mean projects into the picture, in which case the view must
 * count. */
static int direction_from(const pags_camera *camera, const pags_gaussians *g, int64_t i, double direction[3]) {
  const double *m = camera->world_from_camera;
  double offset[3], at[3] = {0, 0, 0}, length = 0;
  for (int k = 0; k < 3; k++) {
    offset[k] = (double)pags_plane(g, k)[i] + origin[k] - m[4 * k + 3];
    length += offset[k] * offset[k];
    for (int j = 0; j < 3; j++)
      at[j] += m[4 * k + j] * offset[k];
  }
  for (int k = 0; k < 3; k++)
    direction[k] = offset[k] / sqrt(length);
  const double u = camera->fx * at[0] / at[2] + camera->cx, v = camera->fy * at[1] / at[2] + camera->cy;
  return at[2] > 0.01 && u > 0 && u < camera->width && v > 0 && v < camera->height;
}

static double colour_of(const pags_gaussians *g, int64_t i, int channel, const double direction[3]) {
  double basis[16], slope[16][3], sum = 0.5;
  reference_sh(direction, basis, slope);
  for (int k = 0; k < pags_sh_coefficients(g->sh_degree); k++)
    sum += basis[k] * (double)pags_plane(g, PAGS_SH + 3 * k + channel)[i];
  return sum;
}

/* Returns half the largest range, over channels, of the colour terms above `degree`, over the directions of the
 * views that must count. */
static double beyond(const fixture *f, int64_t i, int degree) {
  double worst = 0;
  for (int c = 0; c < 3; c++) {
    double lo = INFINITY, hi = -INFINITY;
    for (int v = 0; v < VIEWS; v++) {
      double direction[3];
      pags_gaussians low = f->before;
      if (!direction_from(&f->cameras[v], &f->before, i, direction))
        continue;
      low.sh_degree = degree;
      const double rest = colour_of(&f->before, i, c, direction) - colour_of(&low, i, c, direction);
      lo = fmin(lo, rest), hi = fmax(hi, rest);
    }
    worst = lo <= hi ? fmax(worst, 0.5 * (hi - lo)) : worst;
  }
  return worst;
}

static void check_degree(int degree) {
  fixture f = make_fixture(degree);
  int kept[4] = {0}, seen = 0, needed = 0;
  pags_sh_trim_rows(&f.after, f.views, VIEWS, error, 0, COUNT);
  for (int64_t i = 0; i < COUNT; i++) {
    const int now = pags_gaussians_row_degree(&f.after, i);
    kept[now]++;
    for (int v = 0; v < VIEWS; v++)
      for (int c = 0; c < 3; c++) {
        double direction[3];
        if (!direction_from(&f.cameras[v], &f.before, i, direction))
          continue;
        seen += c == 0;
        const double change = colour_of(&f.after, i, c, direction) - colour_of(&f.before, i, c, direction);
        assert_true(fabs(change) <= error + 1e-5);
        assert_true(now < degree || change == 0);
      }
    assert_true(beyond(&f, i, now) <= error + 1e-5);
    /* The degree may also be needed because of views that count though the mean isn't in their picture. */
    needed += now > 0 && beyond(&f, i, now - 1) > error;
    for (int plane = 0; plane < PAGS_SH; plane++)
      assert_true(pags_plane(&f.after, plane)[i] == pags_plane(&f.before, plane)[i]);
    if (i < 5)
      assert_true(now == 0 && pags_plane(&f.after, PAGS_SH)[i] == pags_plane(&f.before, PAGS_SH)[i]);
  }
  print_message("degree %d: %d keep 0, %d 1, %d 2, %d 3; %d directions\n", degree, kept[0], kept[1], kept[2], kept[3],
                seen);
  assert_true(kept[0] > 20 && kept[degree] > 20 && seen > COUNT);
  assert_true(needed * 10 >= 9 * (COUNT - kept[0]));
  destroy_fixture(&f);
}

static void colours_stay_within_the_error(void **unused) {
  (void)unused;
  for (int degree = 1; degree <= 3; degree++)
    check_degree(degree);
}

/* With one view the colour terms of all degrees can be folded into the constant term. With an error of 0 only
 * Gaussians that no view sees are trimmed. */
static void one_direction_needs_no_degree(void **unused) {
  (void)unused;
  fixture f = make_fixture(3);
  pags_sh_trim_rows(&f.after, f.views, 1, 1e-6, 0, COUNT);
  for (int64_t i = 0; i < COUNT; i++) {
    double direction[3];
    assert_int_equal(pags_gaussians_row_degree(&f.after, i), 0);
    if (direction_from(&f.cameras[0], &f.before, i, direction))
      for (int c = 0; c < 3; c++)
        assert_true(fabs(colour_of(&f.after, i, c, direction) - colour_of(&f.before, i, c, direction)) < 1e-5);
  }
  destroy_fixture(&f);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(colours_stay_within_the_error),
      cmocka_unit_test(one_direction_needs_no_degree),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
