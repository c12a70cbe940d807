/* SPDX-License-Identifier: Apache-2.0 */
/* Tests planes fitted to LiDAR points, and Gaussians that are pulled onto the planes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "init/lidar_planes.h"

enum { SIDE = 120, PLANE = SIDE * SIDE, CLOUD = 4000, COUNT = PLANE + CLOUD };

static double noise(int64_t i, int draw) {
  double n[2];
  pags_rng_normal2(7, (uint64_t)draw, (uint64_t)i, n);
  return n[0];
}

/* Height of the road plane z = 0.05 x - 0.02 y + 3. */
static double height(double x, double y) {
  return 0.05 * x - 0.02 * y + 3.0;
}

/* LiDAR points every 5 cm of a road of 6 m by 6 m with noise of 2 cm, and at the road's edge a bush 2 m high. */
static pags_lidar_points make_points(void) {
  pags_lidar_points points = {0};
  assert_int_equal(pags_lidar_points_reserve(&points, COUNT), PAGS_OK);
  for (int i = 0; i < PLANE; i++) {
    double x = 0.05 * (i % SIDE), y = 0.05 * (double)(i / SIDE);
    points.rows[i] = (pags_lidar_point){.p = {(float)x, (float)y, (float)(height(x, y) + 0.02 * noise(i, 1))},
                                        .owner = -1,
                                        .parked = -1,
                                        .source = -1,
                                        .merged = 1};
  }
  for (int i = PLANE; i < COUNT; i++) {
    points.rows[i] = points.rows[0];
    for (int k = 0; k < 3; k++)
      points.rows[i].p[k] = (float)((k == 0   ? 6.0
                                     : k == 2 ? 2.4
                                              : 0.0) +
                                    2.0 * pags_rng_uniform(9, (uint64_t)k, (uint64_t)i));
  }
  points.count = COUNT;
  return points;
}

static pags_gaussians make_gaussians(int count, const float (*means)[3]) {
  pags_gaussians g;
  assert_int_equal(pags_gaussians_create(&g, count, 0), PAGS_OK);
  for (int i = 0; i < count; i++)
    for (int k = 0; k < 3; k++)
      pags_plane(&g, PAGS_MEAN + k)[i] = means[i][k];
  return g;
}

static double above(const pags_gaussians *g, int64_t i) {
  double x = (double)pags_plane(g, PAGS_MEAN)[i], y = (double)pags_plane(g, PAGS_MEAN + 1)[i];
  return (double)pags_plane(g, PAGS_MEAN + 2)[i] - height(x, y);
}

/* With a strength of 0.5, Gaussians above and below the road move half of the way towards it. Those more than 30 cm
 * away, in the bush and beyond the road's edge don't move. */
static void gaussians_move_halfway_to_the_road(void **unused) {
  (void)unused;
  /* 10 cm above the plane of the road, within reach of the outermost fitted plane. */
  static const float bush[3] = {6.05f, 1.0f, 3.4f};
  float means[6][3] = {{3, 3, 0}, {2, 4.4f, 0}, {4, 1, 0}, {3.1f, 2.5f, 0}, {6.05f, 1, 3.4f}, {-2, 3, 0}};
  static const double off[6] = {0.2, -0.2, 0.01, 0.5, 0, 0.1}, halfway[3] = {0.115, -0.115, 0.01};
  for (int i = 0; i < 6; i++)
    if (i != 4)
      means[i][2] = (float)(height((double)means[i][0], (double)means[i][1]) + off[i]);
  pags_lidar_points points = make_points();
  pags_lidar_planes planes;
  pags_tasks *tasks = pags_tasks_create(2);
  assert_int_equal(pags_lidar_planes_fit(&points, &planes), PAGS_OK);
  pags_gaussians g = make_gaussians(6, (const float(*)[3])means);
  assert_true(pags_lidar_planes_pull(&planes, &g, 0.5, tasks));
  /* Only the distance in excess of 3 cm is halved; 2 cm of noise over some 60 points leave the plane off by less than
   * 1 cm. */
  for (int i = 0; i < 3; i++)
    assert_true(fabs(above(&g, i) - halfway[i]) < 0.01);
  for (int i = 3; i < 6; i += 2)
    assert_true(fabs(above(&g, i) - off[i]) < 1e-5);
  for (int k = 0; k < 3; k++)
    assert_true(pags_plane(&g, PAGS_MEAN + k)[4] == bush[k]);
  pags_gaussians_destroy(&g);
  pags_lidar_planes_destroy(&planes);
  pags_lidar_points_destroy(&points);
  pags_tasks_destroy(tasks);
}

/* The unit normal of the road, and its dot product with the shortest axis of a Gaussian. */
static double along_normal(const pags_gaussians *g, int64_t row) {
  const double length = sqrt(0.05 * 0.05 + 0.02 * 0.02 + 1.0), road[3] = {-0.05 / length, 0.02 / length, 1 / length};
  double normal[3];
  pags_gaussian_normal(g->data, g->stride, row, normal);
  return fabs(normal[0] * road[0] + normal[1] * road[1] + normal[2] * road[2]);
}

/* Gaussians of sigmas from 3 to 22 cm, with random rotations and quaternion lengths, at the given places. */
static pags_gaussians make_shapes(int count, const float (*means)[3]) {
  pags_gaussians g = make_gaussians(count, means);
  for (int i = 0; i < count; i++) {
    for (int k = 0; k < 3; k++)
      pags_plane(&g, PAGS_SCALE + k)[i] = (float)(log(0.03) + 2.0 * pags_rng_uniform(11, (uint64_t)k, (uint64_t)i));
    for (int k = 0; k < 4; k++)
      pags_plane(&g, PAGS_ROTATION + k)[i] = (float)(4.0 * pags_rng_uniform(12, (uint64_t)k, (uint64_t)i) - 2.0);
  }
  return g;
}

/* With a strength of 1 nearly all Gaussians near the road lie in it and become flat; their other two sigmas stay.
 * Those in the bush, beyond the road's edge, 12 cm above it, of a parked object, and with a zero quaternion keep every
 * bit. Half the strength changes half as much. */
static void gaussians_become_flat_in_the_road(void **unused) {
  (void)unused;
  enum { LAID = 200, OTHERS = 5, ALL = LAID + OTHERS };
  const double steady = cos(0.3 * 3.14159 / 180.0);
  float means[ALL][3] = {{0}};
  for (int i = 0; i < ALL; i++) {
    means[i][0] = (float)(1 + 4 * pags_rng_uniform(5, 0, (uint64_t)i));
    means[i][1] = (float)(1 + 4 * pags_rng_uniform(5, 1, (uint64_t)i));
    means[i][2] =
        (float)(height((double)means[i][0], (double)means[i][1]) + 0.16 * pags_rng_uniform(5, 2, (uint64_t)i) - 0.08);
  }
  memcpy(means[LAID], (const float[3]){6.05f, 1.0f, 3.4f}, sizeof means[0]);
  memcpy(means[LAID + 1], (const float[3]){-2.0f, 3.0f, 2.9f}, sizeof means[0]);
  memcpy(means[LAID + 4], (const float[3]){3.0f, 3.0f, (float)(height(3.0, 3.0) + 0.12)}, sizeof means[0]);
  pags_lidar_points points = make_points();
  pags_lidar_planes planes;
  pags_tasks *tasks = pags_tasks_create(2);
  assert_int_equal(pags_lidar_planes_fit(&points, &planes), PAGS_OK);
  for (int half = 0; half < 2; half++) {
    pags_gaussians g = make_shapes(ALL, (const float(*)[3])means), before = make_shapes(ALL, (const float(*)[3])means);
    assert_int_equal(pags_gaussians_add_object_id(&g), PAGS_OK);
    g.object_id[LAID + 2] = 0;
    for (int k = 0; k < 4; k++)
      pags_plane(&g, PAGS_ROTATION + k)[LAID + 3] = pags_plane(&before, PAGS_ROTATION + k)[LAID + 3] = 0;
    assert_true(pags_lidar_planes_lay(&planes, &g, half ? 0.5 : 1.0, tasks));
    int laid = 0;
    for (int i = 0; i < LAID; i++) {
      int changed = 0;
      if (pags_plane(&g, PAGS_MEAN + 2)[i] == pags_plane(&before, PAGS_MEAN + 2)[i])
        continue; /* a cell at the road's edge has too few points for a plane */
      for (int k = 0; k < 3; k++) {
        const float was = pags_plane(&before, PAGS_SCALE + k)[i], is = pags_plane(&g, PAGS_SCALE + k)[i];
        const double expected = half ? 0.5 * ((double)was + log(0.005)) : log(0.005);
        changed += is != was;
        assert_true(is == was || fabs((double)is - expected) < 1e-5);
      }
      assert_int_equal(changed, 1);
      /* A plane fitted to 64 points over 0.4 m with 2 cm of noise is tilted by one degree; one over 3.2 m isn't. */
      laid +=
          fabs(above(&g, i) - (half ? 0.5 * above(&before, i) : 0.0)) < 0.02 && (half || along_normal(&g, i) > steady);
    }
    assert_true(laid > LAID * 3 / 4);
    for (int i = LAID; i < ALL; i++)
      for (int plane = 0; plane < PAGS_OPACITY; plane++)
        assert_true(pags_plane(&g, plane)[i] == pags_plane(&before, plane)[i]);
    pags_gaussians_destroy(&g);
    pags_gaussians_destroy(&before);
  }
  pags_lidar_planes_destroy(&planes);
  pags_lidar_points_destroy(&points);
  pags_tasks_destroy(tasks);
}

/* If the same surface is a wall, Gaussians are pulled to it, but don't become flat. */
static void gaussians_on_walls_do_not_become_flat(void **unused) {
  (void)unused;
  float means[1][3] = {{(float)(height(3.0, 3.0) + 0.08), 3.0f, 3.0f}};
  pags_lidar_points points = make_points();
  for (int i = 0; i < COUNT; i++) {
    float *const p = points.rows[i].p, x = p[0];
    p[0] = p[2];
    p[2] = x;
  }
  pags_lidar_planes planes;
  pags_tasks *tasks = pags_tasks_create(2);
  assert_int_equal(pags_lidar_planes_fit(&points, &planes), PAGS_OK);
  pags_gaussians g = make_shapes(1, (const float(*)[3])means), before = make_shapes(1, (const float(*)[3])means);
  assert_true(pags_lidar_planes_lay(&planes, &g, 1.0, tasks));
  for (int plane = 0; plane < PAGS_OPACITY; plane++)
    assert_true(pags_plane(&g, plane)[0] == pags_plane(&before, plane)[0]);
  assert_true(pags_lidar_planes_pull(&planes, &g, 1.0, tasks));
  assert_true(fabs((double)pags_plane(&g, PAGS_MEAN)[0] - (double)means[0][0] + 0.05) < 0.01);
  pags_gaussians_destroy(&g);
  pags_gaussians_destroy(&before);
  pags_lidar_planes_destroy(&planes);
  pags_lidar_points_destroy(&points);
  pags_tasks_destroy(tasks);
}

/* Points on moving and on parked objects aren't used for the planes of the background. */
static void objects_do_not_shape_background_planes(void **unused) {
  (void)unused;
  pags_lidar_points points = make_points();
  pags_lidar_planes planes;
  for (int parked = 0; parked < 2; parked++) {
    for (int i = 0; i < COUNT; i++) {
      points.rows[i].owner = parked ? -1 : 0;
      points.rows[i].parked = parked ? 0 : -1;
    }
    assert_int_equal(pags_lidar_planes_fit(&points, &planes), PAGS_OK);
    assert_int_equal(planes.count, 0);
    pags_lidar_planes_destroy(&planes);
  }
  pags_lidar_points_destroy(&points);
}

static void threads_change_no_bit(void **unused) {
  (void)unused;
  enum { MANY = 20000 };
  float(*means)[3] = calloc(MANY, sizeof *means);
  assert_non_null(means);
  for (int i = 0; i < MANY; i++) {
    for (int k = 0; k < 2; k++)
      means[i][k] = (float)(6.0 * pags_rng_uniform(3, (uint64_t)k, (uint64_t)i));
    means[i][2] = (float)(height((double)means[i][0], (double)means[i][1]) + 0.1 * noise(i, 2));
  }
  pags_lidar_points points = make_points();
  pags_lidar_planes planes;
  assert_int_equal(pags_lidar_planes_fit(&points, &planes), PAGS_OK);
  pags_gaussians one = make_shapes(MANY, (const float(*)[3])means), four = make_shapes(MANY, (const float(*)[3])means);
  for (int threads = 1; threads <= 4; threads += 3) {
    pags_tasks *tasks = pags_tasks_create(threads);
    assert_true(pags_lidar_planes_pull(&planes, threads == 1 ? &one : &four, 0.5, tasks));
    assert_true(pags_lidar_planes_lay(&planes, threads == 1 ? &one : &four, 0.3, tasks));
    pags_tasks_destroy(tasks);
  }
  for (int k = 0; k < PAGS_OPACITY; k++)
    assert_memory_equal(pags_plane(&one, PAGS_MEAN + k), pags_plane(&four, PAGS_MEAN + k), MANY * sizeof(float));
  pags_gaussians_destroy(&one);
  pags_gaussians_destroy(&four);
  pags_lidar_planes_destroy(&planes);
  pags_lidar_points_destroy(&points);
  free(means);
}

int main(void) {
  static const struct CMUnitTest tests[] = {
      cmocka_unit_test(gaussians_move_halfway_to_the_road),
      cmocka_unit_test(gaussians_become_flat_in_the_road),
      cmocka_unit_test(gaussians_on_walls_do_not_become_flat),
      cmocka_unit_test(objects_do_not_shape_background_planes),
      cmocka_unit_test(threads_change_no_bit),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
