/* Completing vehicles: what well-seen ones of their size are like, and no pits. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "exporters/form.h"

static const double size[3] = {4, 2, 1.5}, step = 0.1;

static pags_grid empty_grid(void) {
  pags_grid grid;
  double lo[3], hi[3];
  for (int k = 0; k < 3; ++k) { /* even about the middle, 0.2 m beyond the box */
    hi[k] = 0.5 * size[k] + 0.2;
    lo[k] = -hi[k];
  }
  assert_int_equal(pags_grid_create(&grid, lo, hi, step, 0), PAGS_OK);
  return grid;
}

static int64_t index_of(const pags_grid *g, double x, double y, double z) {
  const double p[3] = {x, y, z};
  int64_t at[3];
  for (int k = 0; k < 3; ++k)
    at[k] = (int64_t)floor((p[k] - g->origin[k]) / g->step + 0.5);
  return (at[2] * g->n[1] + at[1]) * g->n[0] + at[0];
}

/* Every point within lo..hi. */
static void say(pags_grid *g, const double lo[3], const double hi[3], float distance, float weight) {
  for (int64_t i = 0; i < (int64_t)g->n[0] * g->n[1] * g->n[2]; ++i) {
    const int64_t at[3] = {i % g->n[0], i / g->n[0] % g->n[1], i / g->n[0] / g->n[1]};
    int within = 1;
    for (int k = 0; k < 3; ++k) {
      double p = g->origin[k] + (double)at[k] * g->step;
      within &= p > lo[k] - 1e-9 && p < hi[k] + 1e-9;
    }
    if (within) {
      g->distance[i] = distance;
      g->weight[i] = weight;
    }
  }
}

static const double all_lo[3] = {-9, -9, -9}, all_hi[3] = {9, 9, 9};

static pags_form form_of(float distance, float weight, int64_t object) {
  pags_form form;
  pags_grid grid = empty_grid();
  say(&grid, all_lo, all_hi, distance, weight);
  assert_int_equal(pags_form_take(&grid, size, object, &form), PAGS_OK);
  pags_grid_destroy(&grid);
  return form;
}

static double middle_of(const pags_form *form, double *known) {
  pags_grid grid = empty_grid();
  say(&grid, all_lo, all_hi, 0, 1e-6f); /* next to nothing, as of a view far off */
  assert_int_equal(pags_form_complete(&grid, size, 0, form, NULL), PAGS_OK);
  double distance = (double)grid.distance[index_of(&grid, 0, 0, 0)];
  pags_grid_destroy(&grid);
  *known = 0;
  for (int i = 0; i < 1000; ++i)
    *known = fmax(*known, (double)form->known[i]);
  return distance;
}

/* What was seen twenty times as well counts twenty times. */
static void test_the_well_seen_count(void **state) {
  (void)state;
  pags_form forms[2] = {form_of(0.2f, 4, 1), form_of(-0.2f, 0.2f, 2)}, blended;
  double known, expected = 0.2 * (1 - 0.05) / (1 + 0.05);
  assert_int_equal(pags_form_blend(forms, 2, size, 3, NULL, &blended), PAGS_OK);
  assert_true(fabs(middle_of(&blended, &known) - expected) < 0.002);
  assert_true(known == 1);
  pags_form_destroy(&blended);
  assert_int_equal(pags_form_blend(forms, 2, size, 1, NULL, &blended), PAGS_OK); /* its own doesn't count */
  middle_of(&blended, &known);
  assert_true(known == 0);
  pags_form_destroy(&blended);
  pags_form_destroy(&forms[0]);
  pags_form_destroy(&forms[1]);
}

/* A form on whose surface the points lie, one that is 0.2 m off, and one that fits, too, but knows next to nothing. */
static void test_the_laser_chooses(void **state) {
  (void)state;
  pags_form forms[3] = {form_of(0, 4, 1), form_of(0.2f, 4, 2), form_of(0, 0.02f, 4)}, blended;
  pags_cloud cloud = {0};
  double known;
  for (int i = 0; i < 40; ++i) {
    const double p[3] = {-1.5 + 0.075 * i, 0.9, 0.2};
    assert_int_equal(pags_cloud_add(&cloud, p), PAGS_OK);
  }
  assert_int_equal(pags_form_blend(forms, 2, size, 3, NULL, &blended), PAGS_OK);
  assert_true(fabs((double)blended.distance[0] - 0.1) < 1e-6);
  pags_form_destroy(&blended);
  assert_int_equal(pags_form_blend(forms, 2, size, 3, &cloud, &blended), PAGS_OK);
  assert_true(blended.distance[0] > 0 && (double)blended.distance[0] < 0.2 * 0.04); /* the other keeps 0.03 of its weight */
  middle_of(&blended, &known);
  assert_true(known == 1);
  pags_form_destroy(&blended);
  assert_int_equal(pags_form_blend(forms + 1, 2, size, 3, &cloud, &blended), PAGS_OK);
  assert_true((double)blended.distance[0] > 0.15); /* what the worse one knows better stays known */
  middle_of(&blended, &known);
  assert_true(known == 1);
  pags_form_destroy(&blended);
  for (int k = 0; k < 3; ++k) /* as a smaller car's the form is stretched: the points are in it, just */
    forms[0].size[k] *= 0.95;
  for (int64_t i = 0; i < cloud.count; ++i)
    cloud.points[3 * i] = (float)(0.53 * size[0]);
  assert_int_equal(pags_form_blend(forms, 2, size, 3, &cloud, &blended), PAGS_OK);
  assert_true((double)blended.distance[0] < 0.02);
  pags_form_destroy(&blended);
  for (int i = 0; i < 3; ++i)
    pags_form_destroy(&forms[i]);
  pags_cloud_destroy(&cloud);
}

/* A level surface at z = 0 that many views saw, and points that say 0.06 m. */
static void test_the_laser_is_held_to(void **state) {
  (void)state;
  pags_cloud cloud = {0};
  pags_grid grid = empty_grid();
  for (int i = -4; i <= 4; ++i)
    for (int j = -4; j <= 4; ++j) {
      const double p[3] = {0.1 * i, 0.1 * j, 0.06};
      assert_int_equal(pags_cloud_add(&cloud, p), PAGS_OK);
    }
  for (int held = 0; held < 2; ++held) {
    for (int z = 0; z < grid.n[2]; ++z) {
      double height = grid.origin[2] + z * step;
      const double lo[3] = {-9, -9, height}, hi[3] = {9, 9, height};
      say(&grid, lo, hi, (float)height, 20);
    }
    assert_int_equal(pags_form_complete(&grid, size, 0, NULL, held ? &cloud : NULL), PAGS_OK);
    assert_true(fabs((double)grid.distance[index_of(&grid, 0, 0, 0.05)] - (held ? -0.01 : 0.05)) < 0.002);
    assert_true(grid.distance[index_of(&grid, 0, 0, -0.95)] > 0); /* the border stays outside */
  }
  pags_grid_destroy(&grid);
  pags_cloud_destroy(&cloud);
}

/* Sides up to a roof, seen; between them what a form says is free, `weight` views having looked. Distance in the middle. */
static double between_sides(int vehicle, float weight) {
  static const double left_lo[3] = {-1, 0.6, -0.8}, left_hi[3] = {1, 0.8, 0.5}, right_lo[3] = {-1, -0.8, -0.8}, right_hi[3] = {1, -0.6, 0.5};
  pags_form form = form_of(0.3f, 8, 1);
  pags_grid grid = empty_grid();
  say(&grid, all_lo, all_hi, 0.3f, weight);
  say(&grid, left_lo, left_hi, -0.1f, 12);
  say(&grid, right_lo, right_hi, -0.1f, 12);
  assert_int_equal(pags_form_complete(&grid, size, vehicle, &form, NULL), PAGS_OK);
  double distance = (double)grid.distance[index_of(&grid, 0, 0, 0.1)];
  assert_true(grid.distance[index_of(&grid, 0, 0, 0.7)] > 0); /* over the roof */
  assert_true(grid.distance[index_of(&grid, 1.5, 0, 0.1)] > 0); /* where there are no sides */
  assert_true(grid.distance[index_of(&grid, 0, 0, -0.6)] > 0); /* under it */
  pags_grid_destroy(&grid);
  pags_form_destroy(&form);
  return distance;
}

static void test_vehicles_have_no_pits(void **state) {
  (void)state;
  assert_true(between_sides(1, 0.1f) < 0);
  assert_true(between_sides(1, 4) > 0); /* that was seen */
  assert_true(between_sides(0, 0.1f) > 0); /* no vehicle */
}

/* What lies beyond the vehicle on both sides, between it and the box as wide as its mirrors, makes no body. */
static void test_sides_are_within_the_mirrors(void **state) {
  (void)state;
  static const double left_lo[3] = {-1, 0.9, -0.3}, left_hi[3] = {1, 1.1, 0.5}, right_lo[3] = {-1, -1.1, -0.3}, right_hi[3] = {1, -0.9, 0.5};
  pags_grid grid = empty_grid();
  say(&grid, all_lo, all_hi, 0.3f, 0.1f);
  say(&grid, left_lo, left_hi, -0.1f, 12);
  say(&grid, right_lo, right_hi, -0.1f, 12);
  assert_int_equal(pags_form_complete(&grid, size, 1, NULL, NULL), PAGS_OK);
  assert_true(grid.distance[index_of(&grid, 0, 0, 0.1)] > 0);
  assert_true(grid.distance[index_of(&grid, 0, 1, 0.1)] < 0);
  pags_grid_destroy(&grid);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_the_well_seen_count), cmocka_unit_test(test_the_laser_chooses),
                                     cmocka_unit_test(test_the_laser_is_held_to),
                                     cmocka_unit_test(test_vehicles_have_no_pits),
                                     cmocka_unit_test(test_sides_are_within_the_mirrors)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
