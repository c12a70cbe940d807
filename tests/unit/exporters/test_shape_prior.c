/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the completion of vehicle meshes by shape priors, which are blended from well-observed vehicles of similar
 * size. The completed meshes have no pits. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "exporters/proxy/shape_prior.h"

static const double size[3] = {4, 2, 1.5}, step = 0.1;

static pags_tsdf grid_of(double spacing) {
  pags_tsdf grid;
  double lo[3], hi[3];
  for (int k = 0; k < 3; k++) { /* symmetric about the centre, 0.2 m beyond the box */
    hi[k] = 0.5 * size[k] + 0.2;
    lo[k] = -hi[k];
  }
  assert_int_equal(pags_tsdf_create(&grid, lo, hi, spacing, 0), PAGS_OK);
  return grid;
}

static pags_tsdf empty_grid(void) {
  return grid_of(step);
}

static int64_t index_of(const pags_tsdf *g, double x, double y, double z) {
  const double p[3] = {x, y, z};
  int64_t at[3];
  for (int k = 0; k < 3; k++)
    at[k] = (int64_t)floor((p[k] - g->origin[k]) / g->step + 0.5);
  return (at[2] * g->n[1] + at[1]) * g->n[0] + at[0];
}

/* Sets distance and weight of every lattice point between lo and hi. */
static void say(pags_tsdf *g, const double lo[3], const double hi[3], float distance, float weight) {
  for (int64_t i = 0; i < (int64_t)g->n[0] * g->n[1] * g->n[2]; i++) {
    const int64_t at[3] = {i % g->n[0], i / g->n[0] % g->n[1], i / g->n[0] / g->n[1]};
    int within = 1;
    for (int k = 0; k < 3; k++) {
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

static pags_shape_prior prior_of(float distance, float weight, int64_t object) {
  pags_shape_prior prior;
  pags_tsdf grid = empty_grid();
  say(&grid, all_lo, all_hi, distance, weight);
  assert_int_equal(pags_shape_prior_take(&grid, size, object, &prior), PAGS_OK);
  pags_tsdf_destroy(&grid);
  return prior;
}

static double middle_of(const pags_shape_prior *prior, double *known) {
  pags_tsdf grid = empty_grid();
  say(&grid, all_lo, all_hi, 0, 1e-6f); /* an observation of almost no weight, as of a vehicle seen from far away */
  assert_int_equal(pags_shape_prior_complete(&grid, size, 0, prior, NULL), PAGS_OK);
  double distance = (double)grid.distance[index_of(&grid, 0, 0, 0)];
  pags_tsdf_destroy(&grid);
  *known = 0;
  for (int i = 0; i < 1000; i++)
    *known = fmax(*known, (double)prior->known[i]);
  return distance;
}

/* An observation with twenty times the weight counts twenty times as much. */
static void test_the_well_seen_count(void **state) {
  (void)state;
  pags_shape_prior priors[2] = {prior_of(0.2f, 4, 1), prior_of(-0.2f, 0.2f, 2)}, blended;
  double known, expected = 0.2 * (1 - 0.05) / (1 + 0.05);
  assert_int_equal(pags_shape_prior_blend(priors, 2, size, 3, NULL, &blended), PAGS_OK);
  assert_true(fabs(middle_of(&blended, &known) - expected) < 0.002);
  assert_true(known == 1);
  pags_shape_prior_destroy(&blended);
  /* An object's own shape isn't used as its prior. */
  assert_int_equal(pags_shape_prior_blend(priors, 2, size, 1, NULL, &blended), PAGS_OK);
  middle_of(&blended, &known);
  assert_true(known == 0);
  pags_shape_prior_destroy(&blended);
  pags_shape_prior_destroy(&priors[0]);
  pags_shape_prior_destroy(&priors[1]);
}

/* LiDAR points along one side of the vehicle. */
static pags_lidar_fit side_cloud(void) {
  pags_lidar_fit cloud = {0};
  for (int i = 0; i < 40; i++) {
    const double p[3] = {-1.5 + 0.075 * i, 0.9, 0.2};
    assert_int_equal(pags_lidar_fit_add(&cloud, p), PAGS_OK);
  }
  return cloud;
}

/* LiDAR selects among three shapes: one contains the points, one is 0.2 m off, and one fits too but has almost no
 * weight. */
static void test_lidar_chooses(void **state) {
  (void)state;
  pags_shape_prior priors[3] = {prior_of(0, 4, 1), prior_of(0.2f, 4, 2), prior_of(0, 0.02f, 4)}, blended;
  pags_lidar_fit cloud = side_cloud();
  double known;
  assert_int_equal(pags_shape_prior_blend(priors, 2, size, 3, NULL, &blended), PAGS_OK);
  assert_true(fabs((double)blended.distance[0] - 0.1) < 1e-6);
  pags_shape_prior_destroy(&blended);
  assert_int_equal(pags_shape_prior_blend(priors, 2, size, 3, &cloud, &blended), PAGS_OK);
  /* The shape that fits worse keeps 0.03 of its weight. */
  assert_true(blended.distance[0] > 0 && (double)blended.distance[0] < 0.2 * 0.04);
  middle_of(&blended, &known);
  assert_true(known == 1);
  pags_shape_prior_destroy(&blended);
  assert_int_equal(pags_shape_prior_blend(priors + 1, 2, size, 3, &cloud, &blended), PAGS_OK);
  /* Where the badly fitting shape has the greater weight, it still decides. */
  assert_true((double)blended.distance[0] > 0.15);
  middle_of(&blended, &known);
  assert_true(known == 1);
  pags_shape_prior_destroy(&blended);
  /* The shape of a smaller car is stretched to the box: the points are just inside it. */
  for (int k = 0; k < 3; k++)
    priors[0].size[k] *= 0.95;
  for (int64_t i = 0; i < cloud.count; i++)
    cloud.points[3 * i] = (float)(0.53 * size[0]);
  assert_int_equal(pags_shape_prior_blend(priors, 2, size, 3, &cloud, &blended), PAGS_OK);
  assert_true((double)blended.distance[0] < 0.02);
  pags_shape_prior_destroy(&blended);
  for (int i = 0; i < 3; i++)
    pags_shape_prior_destroy(&priors[i]);
  pags_lidar_fit_destroy(&cloud);
}

/* A shape that fits only the fifth of the points that it covers doesn't win against one that is 0.04 m off all of
 * them. Where both cover, the latter counts more than half as much. A third, badly fitting shape doesn't reduce the
 * weight of the first. */
static void test_knowing_little_does_not_win(void **state) {
  (void)state;
  static const double lo[3] = {1, -9, -9};
  pags_shape_prior priors[3] = {prior_of(0.04f, 4, 1)}, blended;
  pags_tsdf grid = empty_grid();
  pags_lidar_fit cloud = side_cloud();
  say(&grid, lo, all_hi, 0, 4);
  assert_int_equal(pags_shape_prior_take(&grid, size, 2, &priors[1]), PAGS_OK);
  assert_int_equal(pags_shape_prior_blend(priors, 2, size, 3, &cloud, &blended), PAGS_OK);
  int both = 0;
  while (both < 1000 && !(priors[1].known[both] > 0))
    both++;
  assert_true((double)blended.distance[both] > 0.04 / 3 && (double)blended.distance[both] < 0.02);
  pags_shape_prior_destroy(&blended);
  priors[2] = prior_of(-0.2f, 4, 4);
  assert_int_equal(pags_shape_prior_blend(priors, 3, size, 3, &cloud, &blended), PAGS_OK);
  /* The distance would be 0.032 if the shape that covers few points had a weight of only 0.03. */
  assert_true((double)blended.distance[both] < 0.028);
  pags_shape_prior_destroy(&blended);
  for (int i = 0; i < 3; i++)
    pags_shape_prior_destroy(&priors[i]);
  pags_tsdf_destroy(&grid);
  pags_lidar_fit_destroy(&cloud);
}

/* The surface z = 0, which many views observed, is pulled to LiDAR points at z = 0.06 m. */
static void test_the_mesh_is_pulled_to_lidar(void **state) {
  (void)state;
  pags_lidar_fit cloud = {0};
  pags_tsdf grid = empty_grid();
  for (int i = -4; i <= 4; i++)
    for (int j = -4; j <= 4; j++) {
      const double p[3] = {0.1 * i, 0.1 * j, 0.06};
      assert_int_equal(pags_lidar_fit_add(&cloud, p), PAGS_OK);
    }
  for (int held = 0; held < 2; held++) {
    for (int z = 0; z < grid.n[2]; z++) {
      double height = grid.origin[2] + z * step;
      const double lo[3] = {-9, -9, height}, hi[3] = {9, 9, height};
      say(&grid, lo, hi, (float)height, 20);
    }
    assert_int_equal(pags_shape_prior_complete(&grid, size, 0, NULL, held ? &cloud : NULL), PAGS_OK);
    assert_true(fabs((double)grid.distance[index_of(&grid, 0, 0, 0.05)] - (held ? -0.01 : 0.05)) < 0.002);
    /* The lattice's border stays outside of the mesh. */
    assert_true(grid.distance[index_of(&grid, 0, 0, -0.95)] > 0);
  }
  pags_tsdf_destroy(&grid);
  pags_lidar_fit_destroy(&cloud);
}

/* Completes a grid with two observed sides of a vehicle up to the roof and with free space between them by the prior,
 * observed with `weight`; returns the distance at the centre, which is negative if the space is filled. */
static double between_sides(int vehicle, float weight) {
  static const double left_lo[3] = {-1, 0.6, -0.8}, left_hi[3] = {1, 0.8, 0.5}, right_lo[3] = {-1, -0.8, -0.8},
                      right_hi[3] = {1, -0.6, 0.5};
  pags_shape_prior prior = prior_of(0.3f, 8, 1);
  pags_tsdf grid = empty_grid();
  say(&grid, all_lo, all_hi, 0.3f, weight);
  say(&grid, left_lo, left_hi, -0.1f, 12);
  say(&grid, right_lo, right_hi, -0.1f, 12);
  assert_int_equal(pags_shape_prior_complete(&grid, size, vehicle, &prior, NULL), PAGS_OK);
  double distance = (double)grid.distance[index_of(&grid, 0, 0, 0.1)];
  assert_true(grid.distance[index_of(&grid, 0, 0, 0.7)] > 0);   /* above the roof */
  assert_true(grid.distance[index_of(&grid, 1.5, 0, 0.1)] > 0); /* beyond the ends of the sides */
  assert_true(grid.distance[index_of(&grid, 0, 0, -0.6)] > 0);  /* below the sides */
  pags_tsdf_destroy(&grid);
  pags_shape_prior_destroy(&prior);
  return distance;
}

static void test_vehicles_have_no_pits(void **state) {
  (void)state;
  assert_true(between_sides(1, 0.1f) < 0);
  assert_true(between_sides(1, 4) > 0);    /* free space that was really observed stays free */
  assert_true(between_sides(0, 0.1f) > 0); /* objects other than vehicles aren't filled */
}

/* Surfaces on both sides of the vehicle, in the box's margin for mirrors, don't turn the space between them into a
 * body. */
static void test_sides_are_within_the_mirrors(void **state) {
  (void)state;
  static const double left_lo[3] = {-1, 0.9, -0.3}, left_hi[3] = {1, 1.1, 0.5}, right_lo[3] = {-1, -1.1, -0.3},
                      right_hi[3] = {1, -0.9, 0.5};
  pags_tsdf grid = empty_grid();
  say(&grid, all_lo, all_hi, 0.3f, 0.1f);
  say(&grid, left_lo, left_hi, -0.1f, 12);
  say(&grid, right_lo, right_hi, -0.1f, 12);
  assert_int_equal(pags_shape_prior_complete(&grid, size, 1, NULL, NULL), PAGS_OK);
  assert_true(grid.distance[index_of(&grid, 0, 0, 0.1)] > 0);
  assert_true(grid.distance[index_of(&grid, 0, 1, 0.1)] < 0);
  pags_tsdf_destroy(&grid);
}

/* Completes a vehicle that was observed as free below its body except for a solid piece on the left side, `length`
 * metres long about x, down to 0.1 m above the ground. Returns the distance at a point given relative to the piece's
 * centre along x, to the vehicle's side inwards, and to the box's lower face. */
static double below_wheel_at(double x, double length, int vehicle, double along, double inwards, double height) {
  const double lo[3] = {x - 0.5 * length, 0.9, -0.65}, hi[3] = {x + 0.5 * length, 0.98, -0.5};
  const double body_lo[3] = {-1.9, -0.98, -0.5}, body_hi[3] = {1.9, 0.98, 0.6};
  pags_tsdf grid = grid_of(0.04);
  say(&grid, all_lo, all_hi, 0.12f, 20);
  say(&grid, body_lo, body_hi, -0.12f, 20);
  say(&grid, lo, hi, -0.12f, 20);
  assert_int_equal(pags_shape_prior_complete(&grid, size, vehicle, NULL, NULL), PAGS_OK);
  double distance = (double)grid.distance[index_of(&grid, x + along, 0.98 - inwards, height - 0.75)];
  pags_tsdf_destroy(&grid);
  return distance;
}

static double below_wheel(double length, int vehicle, double along, double inwards, double height) {
  return below_wheel_at(-1, length, vehicle, along, inwards, height);
}

/* A wheel is completed by a circle: it passes through both ends of the piece, 0.64 m long, at 0.16 m height and would
 * reach 0.02 m below the box; its radius is 0.37 m. */
static void test_wheels_stand_on_the_ground(void **state) {
  (void)state;
  assert_true(below_wheel(0.6, 1, 0, 0.06, 0.02) < 0);
  assert_true(below_wheel(0.6, 1, 0.28, 0.06, 0.02) > 0); /* the wheel's circle is above the ground here */
  /* The distance would be -0.006 if the circle ended at the box, and -0.05 if it ended 0.06 m lower. */
  assert_true(fabs(below_wheel(0.6, 1, 0.16, 0.06, 0.04) + 0.022) < 0.01);
  /* Filled to a wheel's width, although the space was observed as free. */
  assert_true(below_wheel(0.6, 1, 0, 0.12, 0.06) < 0);
  assert_true(below_wheel(0.6, 1, 0, 0.2, 0.06) > 0);
  assert_true(below_wheel(0.6, 0, 0, 0.06, 0.02) > 0); /* other objects get no wheels */
  assert_true(below_wheel(0.2, 1, 0, 0.06, 0.02) > 0);
  assert_true(below_wheel(1, 1, 0, 0.06, 0.02) > 0); /* too long for a wheel: a side skirt */
  /* In the middle of the vehicle, where no wheels are. */
  assert_true(below_wheel_at(0.3, 0.6, 1, 0, 0.06, 0.02) > 0);
}

/* A vehicle has no surface below its box's lower face, even if one was observed there; other objects may have one. */
static void test_vehicles_end_at_the_ground(void **state) {
  (void)state;
  for (int vehicle = 0; vehicle < 2; vehicle++) {
    pags_tsdf grid = grid_of(0.04);
    say(&grid, all_lo, all_hi, -0.12f, 20);
    assert_int_equal(pags_shape_prior_complete(&grid, size, vehicle, NULL, NULL), PAGS_OK);
    int64_t below = index_of(&grid, 0, 0, -0.78);
    double z = grid.origin[2] + (double)(below / grid.n[0] / grid.n[1]) * grid.step,
           expected = vehicle ? -0.75 - z : -0.12;
    assert_true(fabs((double)grid.distance[below] - expected) < 1e-6);
    pags_tsdf_destroy(&grid);
  }
}

/* Height of the roof of an unobserved vehicle completed by a prior that is free from `free_from` upwards and unknown
 * below. */
static double roof_below(double free_from) {
  const double lo[3] = {-9, -9, free_from}, hi[3] = {9, 9, 9};
  pags_tsdf seen = empty_grid(), grid = grid_of(0.04);
  pags_shape_prior prior;
  say(&seen, lo, hi, 0.4f, 20); /* four steps: the truncation distance */
  assert_int_equal(pags_shape_prior_take(&seen, size, 1, &prior), PAGS_OK);
  assert_int_equal(pags_shape_prior_complete(&grid, size, 1, &prior, NULL), PAGS_OK);
  int64_t layer = (int64_t)grid.n[0] * grid.n[1], at = index_of(&grid, 0, 0, 0);
  double height = grid.origin[2] + (double)(at / layer) * 0.04;
  for (; grid.distance[at + layer] < 0; at += layer)
    height += 0.04;
  double below = (double)grid.distance[at], above = (double)grid.distance[at + layer];
  pags_shape_prior_destroy(&prior);
  pags_tsdf_destroy(&seen);
  pags_tsdf_destroy(&grid);
  return height + 0.04 * below / (below - above);
}

/* The roof lies halfway between the lowest lattice point known to be free and the highest unknown one. The tolerance
 * is half a lattice step of the prior, 0.0175 m, and the effect of smoothing. */
static void test_roofs_are_half_way(void **state) {
  (void)state;
  for (int i = 0; i < 5; i++)
    assert_true(fabs(roof_below(0.25 + 0.1 * i) - (0.2 + 0.1 * i)) < 0.022);
}

/* The body of an unobserved vehicle begins 0.2 m above its box's lower face. */
static void test_air_under_vehicles(void **state) {
  (void)state;
  pags_tsdf grid = grid_of(0.04);
  assert_int_equal(pags_shape_prior_complete(&grid, size, 1, NULL, NULL), PAGS_OK);
  assert_true(grid.distance[index_of(&grid, 0, 0, 0.24 - 0.75)] < 0);
  assert_true(grid.distance[index_of(&grid, 0, 0, 0.16 - 0.75)] > 0);
  pags_tsdf_destroy(&grid);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_the_well_seen_count),         cmocka_unit_test(test_lidar_chooses),
      cmocka_unit_test(test_knowing_little_does_not_win), cmocka_unit_test(test_the_mesh_is_pulled_to_lidar),
      cmocka_unit_test(test_vehicles_have_no_pits),       cmocka_unit_test(test_sides_are_within_the_mirrors),
      cmocka_unit_test(test_wheels_stand_on_the_ground),  cmocka_unit_test(test_vehicles_end_at_the_ground),
      cmocka_unit_test(test_roofs_are_half_way),          cmocka_unit_test(test_air_under_vehicles)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
