/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the lowering of a Gaussian's SH degree: colours change by what was foretold, over the views that may show it.
 */
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "train/sh_trim.h"

enum { COUNT = 300, VIEWS = 7 };
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

/* Mean square of `after` - `before` over all views, which count by the solid angle of the Gaussian
 * in them, summed over the channels. */
static double mean_change(const fixture *f, int64_t i) {
  double sum = 0, all = 0;
  for (int v = 0; v < VIEWS; v++) {
    double direction[3], square = 0;
    direction_from(&f->cameras[v], &f->before, i, direction);
    for (int k = 0; k < 3; k++) {
      const double away = (double)pags_plane(&f->before, k)[i] + origin[k] - f->cameras[v].world_from_camera[4 * k + 3];
      square += away * away;
    }
    all += 1 / square;
    for (int c = 0; c < 3; c++) {
      const double change = colour_of(&f->after, i, c, direction) - colour_of(&f->before, i, c, direction);
      sum += change * change / square;
    }
  }
  return sum / all;
}

/* Lowering a row to each degree changes its colours by the mean square that was foretold, which is less than with any
 * other constant term, and nothing else. */
static void check_degree(int degree) {
  for (int lower = 0; lower < degree; lower++) {
    fixture f = make_fixture(degree);
    double largest = 0;
    for (int v = 0; v < VIEWS; v++)
      f.views[v].bends = true; /* every view may show every row */
    for (int64_t i = 0; i < COUNT; i++) {
      double changes[PAGS_SH_CUTS];
      pags_sh_changes(&f.before, f.views, VIEWS, i, changes);
      pags_sh_lower(&f.after, f.views, VIEWS, i, lower);
      const double change = mean_change(&f, i);
      largest = fmax(largest, change);
      assert_true(fabs(changes[lower] - change) <= 1e-3 * change + 1e-9);
      assert_true(pags_gaussians_row_degree(&f.after, i) <= lower);
      for (int k = 0; k < pags_plane_count(degree); k++)
        if (k < PAGS_SH || (k >= PAGS_SH + 3 && k < PAGS_SH + 3 * pags_sh_coefficients(lower)))
          assert_true(pags_plane(&f.after, k)[i] == pags_plane(&f.before, k)[i]);
      for (int away = -1; away <= 1 && change > 1e-6; away += 2) {
        pags_plane(&f.after, PAGS_SH)[i] += (float)(0.1 * away * sqrt(change));
        assert_true(mean_change(&f, i) > change);
        pags_plane(&f.after, PAGS_SH)[i] -= (float)(0.1 * away * sqrt(change));
      }
    }
    assert_true(largest > 1e-3);
    destroy_fixture(&f);
  }
}

static void changes_are_as_foretold(void **unused) {
  (void)unused;
  for (int degree = 1; degree <= 3; degree++)
    check_degree(degree);
}

/* Views that don't show a row don't count: rows that no view sees lose nothing and keep their constant term. A row
 * whose mean one view alone shows loses nothing either. */
static void only_views_that_show_a_row_count(void **unused) {
  (void)unused;
  fixture f = make_fixture(3);
  double changes[PAGS_SH_CUTS];
  for (int64_t i = 0; i < 5; i++) {
    pags_sh_changes(&f.before, f.views, VIEWS, i, changes);
    pags_sh_lower(&f.after, f.views, VIEWS, i, 0);
    assert_true(changes[0] == 0 && changes[2] == 0 && pags_gaussians_row_degree(&f.after, i) == 0);
    assert_true(pags_plane(&f.after, PAGS_SH)[i] == pags_plane(&f.before, PAGS_SH)[i]);
  }
  for (int64_t i = 5; i < COUNT; i++) {
    double direction[3];
    pags_sh_lower(&f.after, f.views, 1, i, 0);
    if (direction_from(&f.cameras[0], &f.before, i, direction))
      for (int c = 0; c < 3; c++)
        assert_true(fabs(colour_of(&f.after, i, c, direction) - colour_of(&f.before, i, c, direction)) < 1e-5);
  }
  destroy_fixture(&f);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(changes_are_as_foretold),
      cmocka_unit_test(only_views_that_show_a_row_count),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
