/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the ground's height map, which is made from camera depths and LiDAR points. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "exporters/proxy/background.h"
#include "exporters/proxy/mesh_query.h"

enum { WIDE = 64, STEPS = 6, MOST = 100000 };

static const double eye = 1.6; /* height above the road in metres */

/* The depth picture of a camera `eye` metres above the origin that looks straight down at the road z = 0: x right, y
 * up in the picture. */
static void look_down(pags_depth_view *depth_view, float depth[WIDE * WIDE]) {
  const double pose[12] = {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, eye};
  *depth_view = (pags_depth_view){.depth = depth};
  depth_view->camera.width = depth_view->camera.height = WIDE;
  depth_view->camera.fx = depth_view->camera.fy = WIDE / 2;
  depth_view->camera.cx = depth_view->camera.cy = WIDE / 2;
  for (int k = 0; k < 12; k++)
    depth_view->camera.world_from_camera[k] = pose[k];
  for (int i = 0; i < WIDE * WIDE; i++)
    depth[i] = (float)eye;
}

static pags_lidar no_points(void) {
  pags_lidar lidar = {.points = malloc(MOST * 3 * sizeof *lidar.points)};
  assert_non_null(lidar.points);
  return lidar;
}

/* Adds LiDAR points every 5 cm of a rectangle at height `z`. */
static void measure(pags_lidar *lidar, double x0, double x1, double y0, double y1, double z) {
  int nx = (int)lround((x1 - x0) / 0.05), ny = (int)lround((y1 - y0) / 0.05);
  for (int j = 0; j <= ny; j++)
    for (int i = 0; i <= nx; i++) {
      float *p = lidar->points + 3 * lidar->count++;
      assert_true(lidar->count < MOST);
      p[0] = (float)(x0 + 0.05 * i);
      p[1] = (float)(y0 + 0.05 * j);
      p[2] = (float)z;
    }
}

/* Adds LiDAR points of a wall along x, every 5 cm from the road to height `top`. */
static void measure_wall(pags_lidar *lidar, double x0, double x1, double y, double top) {
  for (double z = 0; z < top; z += 0.05)
    measure(lidar, x0, x1, y, y, z);
}

/* Finds the ground from the depths of views and LiDAR points. */
static void find_in(const pags_lidar *lidar, const pags_depth_views *depth_views, pags_ground *out) {
  double path[3 * STEPS];
  for (int i = 0; i < STEPS; i++) {
    path[3 * i] = 0.1 * i;
    path[3 * i + 1] = 0;
    path[3 * i + 2] = eye;
  }
  assert_int_equal(pags_ground_find(depth_views, lidar, path, STEPS, 10, 25, out), PAGS_OK);
}

/* Finds the ground from camera depths that put the road `lift` metres too high, and LiDAR points. */
static void find_seen(const pags_lidar *lidar, double lift, pags_ground *out) {
  float depth[WIDE * WIDE];
  pags_depth_view depth_view;
  look_down(&depth_view, depth);
  for (int i = 0; i < WIDE * WIDE; i++)
    depth[i] -= (float)lift;
  find_in(lidar, &(const pags_depth_views){.count = 1, .list = &depth_view}, out);
}

static void find(const pags_lidar *lidar, pags_ground *out) {
  find_seen(lidar, 0, out);
}

static double height(const pags_ground *ground, double x, double y) {
  double z;
  assert_true(pags_ground_height(ground, x, y, &z));
  return z;
}

/* LiDAR rings leave gaps of a metre: a surface beyond the gap is ground if it continues at about the same height; a
 * table isn't. */
static void gaps_between_rings_are_bridged(void **state) {
  (void)state;
  pags_lidar lidar = no_points();
  pags_ground ground;
  measure(&lidar, -3, 3, -3, 3, 0);
  measure(&lidar, -3, 3, 4, 5, -0.12); /* beyond a gap the road lies lower */
  measure(&lidar, -3, 3, 6, 7, -0.2);  /* the road continues at about this height */
  measure(&lidar, -3, 3, -5, -4, 0.8); /* a table, which isn't ground */
  find(&lidar, &ground);
  assert_true(fabs(height(&ground, 0, 1)) < 0.005);
  assert_true(fabs(height(&ground, 0, 4.5) + 0.12) < 0.01);
  assert_true(fabs(height(&ground, 0, 6.5) + 0.2) < 0.01);
  assert_true(fabs(height(&ground, 0, -4.5)) < 0.05);
  pags_ground_destroy(&ground);
  free(lidar.points);
}

/* Ground cells where LiDAR hits a wall are left out; the ground on both sides gives their height. */
static void walls_are_not_climbed(void **state) {
  (void)state;
  pags_lidar lidar = no_points();
  pags_ground ground;
  measure(&lidar, -3, 3, -3, 4, 0);
  /* A leaning wall: each row of cells holds a lower part of it. */
  for (int i = 0; i < 6; i++)
    measure_wall(&lidar, -3, 3, 4.05 + 0.1 * i, 2.5 - 0.3 * i);
  find(&lidar, &ground);
  for (int i = 0; i < 12; i++)
    assert_true(fabs(height(&ground, 0.5, 3.9 + 0.1 * i)) < 0.01);
  pags_ground_destroy(&ground);
  free(lidar.points);
}

/* Between LiDAR rings the ground is interpolated from them, even though camera depths there are 5 cm higher. */
static void lidar_outweighs_pixels(void **state) {
  (void)state;
  pags_lidar lidar = no_points();
  pags_ground ground;
  for (int i = -3; i <= 3; i++)
    measure(&lidar, -3, 3, i - 0.1, i + 0.1, 0);
  find_seen(&lidar, 0.05, &ground);
  assert_true(fabs(height(&ground, 0.2, 0)) < 0.005);
  assert_true(fabs(height(&ground, 0.2, 0.5)) < 0.02);
  assert_true(fabs(height(&ground, 0.2, -0.5)) < 0.02);
  pags_ground_destroy(&ground);
  free(lidar.points);
}

/* With a limit of nearly as many triangles as the lattice has, nearly all are used, and each runs counter-clockwise
 * seen from above. */
static void the_limit_of_triangles_is_used(void **state) {
  (void)state;
  enum { SIDE = 150, FULL = 2 * (SIDE - 1) * (SIDE - 1), BUDGET = FULL * 9 / 10 };
  pags_ground ground = {
      .step = 0.2, .nx = SIDE, .ny = SIDE, .z = malloc(SIDE * SIDE * sizeof(float)), .known = malloc(SIDE * SIDE)};
  pags_proxy_mesh mesh;
  assert_true(ground.z && ground.known);
  for (int i = 0; i < SIDE * SIDE; i++) {
    ground.known[i] = 1;
    ground.z[i] = (i / SIDE < 100 ? 0 : 0.13f) +
                  0.001f * (float)((uint32_t)i * 2654435761u >> 24) / 256; /* a kerb across a level street */
  }
  assert_int_equal(pags_ground_mesh(&ground, BUDGET, &mesh), PAGS_OK);
  assert_in_range(mesh.triangle_count, BUDGET * 3 / 4, BUDGET);
  for (int64_t i = 0; i < mesh.triangle_count; i++) {
    const float *a = mesh.positions + 3 * (int64_t)mesh.triangles[3 * i],
                *b = mesh.positions + 3 * (int64_t)mesh.triangles[3 * i + 1];
    const float *c = mesh.positions + 3 * (int64_t)mesh.triangles[3 * i + 2];
    assert_true((b[0] - a[0]) * (c[1] - a[1]) > (b[1] - a[1]) * (c[0] - a[0]));
  }
  for (int64_t i = 0; i < mesh.vertex_count; i++)
    assert_true(mesh.positions[3 * i + 2] < 0.001f || mesh.positions[3 * i + 2] >= 0.13f);
  pags_proxy_mesh_destroy(&mesh);
  pags_ground_destroy(&ground);
}

static bool has_ground(const pags_ground *ground, double x, double y) {
  double z;
  return pags_ground_height(ground, x, y, &z);
}

/* Far from the path, a place without points that ground surrounds is ground, at its height, and so is a narrow bay; a
 * wide one isn't, and neither is a hole as large as a house. */
static void small_holes_are_filled(void **state) {
  (void)state;
  static const double sides[4] = {2.9, 1.7, 2.9, 6};
  for (int form = 0; form < 4; form++) { /* hole, narrow bay, wide bay, large hole */
    pags_lidar lidar = no_points();
    pags_ground ground;
    const double side = sides[form];
    measure(&lidar, -3, 3, -3, 3, 0);
    for (int k = -1; k <= 1; k += 2) {
      measure(&lidar, 0, 24, k * side - 0.2, k * side + 0.2, 0.1);
      measure(&lidar, 2.6, 3, k > 0 ? 0 : -side, k > 0 ? side : 0, 0);
    }
    if (form % 3 == 0)
      measure(&lidar, 23.6, 24, -side, side, 0.1);
    find(&lidar, &ground);
    assert_true(has_ground(&ground, 8, 0)); /* near the path */
    assert_int_equal(has_ground(&ground, 18, 0), form < 2);
    if (form < 2)
      assert_true(fabs(height(&ground, 18, 0) - 0.1) < 0.02);
    pags_ground_destroy(&ground);
    free(lidar.points);
  }
}

/* Where only labels show ground, at a depth that says nothing of its height, it continues that of the nearest ground;
 * where they show a house, and without labels, it ends. */
static void labels_continue_the_ground(void **state) {
  (void)state;
  for (int labelled = 0; labelled < 2; labelled++) {
    float near[WIDE * WIDE], depth[WIDE * WIDE];
    uint8_t labels[WIDE * WIDE];
    pags_depth_view views[2], *view = &views[1];
    pags_ground ground;
    pags_lidar lidar = no_points();
    measure(&lidar, -3, 3, -3, 3, 0.02);
    look_down(&views[0], near);
    look_down(view, depth);
    const double above = 20; /* from there a pixel is 0.6 m wide */
    const double inverse[12] = {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, above};
    for (int k = 0; k < 12; k++)
      view->camera_from_model[k] = inverse[k];
    view->camera.world_from_camera[11] = above;
    for (int i = 0; i < WIDE * WIDE; i++) {
      depth[i] = (float)above - 0.25f; /* too high */
      labels[i] = (i % WIDE - WIDE / 2 + 0.5) * above / (WIDE / 2) > 15 ? 2 : 0;
    }
    view->labels = labelled ? labels : NULL;
    find_in(&lidar, &(const pags_depth_views){.count = 2, .list = views}, &ground);
    assert_int_equal(has_ground(&ground, 13, 1), labelled);
    assert_false(has_ground(&ground, 17, 1));
    if (labelled)
      assert_true(fabs(height(&ground, 13, 1) - 0.02) < 0.01);
    pags_ground_destroy(&ground);
    free(lidar.points);
  }
}

/* Without LiDAR the camera's depths alone give the ground; around them it continues at their height. */
static void camera_depths_give_the_ground_without_lidar(void **state) {
  (void)state;
  const pags_lidar none = {0};
  pags_ground ground;
  find(&none, &ground);
  assert_true(fabs(height(&ground, 0.5, 0.5)) < 1e-4);
  assert_true(fabs(height(&ground, -5, 5)) < 1e-3);
  pags_ground_destroy(&ground);
}

/* Without a level surface below the cameras no ground is found, and that is no error. */
static void missing_ground_is_no_error(void **state) {
  (void)state;
  const pags_lidar none = {0};
  const pags_depth_views nothing = {0};
  const double path[3] = {0, 0, eye};
  pags_ground ground;
  double z;
  assert_int_equal(pags_ground_find(&nothing, &none, path, 1, 10, 25, &ground), PAGS_OK);
  assert_int_equal(ground.nx, 0);
  assert_false(pags_ground_height(&ground, 0, 0, &z));
  assert_int_equal(pags_ground_find(&nothing, &none, path, 0, 10, 25, &ground), PAGS_OK);
  assert_int_equal(ground.nx, 0);
}

/* A road at height 0 and a pavement 0.13 m above it, with a kerb along y at x = 0.07, whose heights are blurred over
 * 0.4 m; a car hides both beyond y = 1. Both become meshes of their own, with a sharp kerb in between. In the pictures
 * the kerb is up to `noise` metres off its place. */
static void make_kerb(double noise) {
  enum { SIDE = 60 };
  float depth[WIDE * WIDE], z[SIDE * SIDE];
  uint8_t known[SIDE * SIDE], labels[WIDE * WIDE], rgb[3 * WIDE * WIDE] = {0};
  pags_depth_view view;
  pags_ground ground = {.step = 0.1, .nx = SIDE, .ny = SIDE, .x0 = -3, .y0 = -3, .z = z, .known = known, .nearest = z};
  look_down(&view, depth);
  view.rgb = rgb;
  view.labels = labels;
  const double inverse[12] = {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, eye};
  for (int k = 0; k < 12; k++)
    view.camera_from_model[k] = inverse[k];
  for (int i = 0; i < SIDE * SIDE; i++) {
    z[i] = (float)(0.13 * fmin(fmax((-3 + 0.1 * (i % SIDE) - 0.07) / 0.4 + 0.5, 0), 1));
    known[i] = 1;
  }
  for (int i = 0; i < WIDE * WIDE; i++) {
    const double x = (i % WIDE + 0.5 - WIDE / 2) / (WIDE / 2) * eye, y = (WIDE / 2 - i / WIDE - 0.5) / (WIDE / 2) * eye;
    const double off = noise * ((double)((uint32_t)(i / WIDE) * 2654435761u >> 8) / 8388608.0 - 1);
    labels[i] = y > 1 ? 13 : x > 0.07 + off;
  }
  pags_proxy_options options = pags_proxy_options_default();
  options.voxel = 0.15;
  const pags_proxy_maker w = {.tasks = pags_tasks_create(2), .options = &options};
  pags_background b = {.depth_views = {.count = 1, .list = &view}, .labelled = true};
  assert_int_equal(pags_ground_parts_make(&w, &b, &ground), PAGS_OK);
  assert_int_equal(b.chunk_count, 2);
  for (int i = 0; i < 2; i++) {
    const bool road = !strcmp(b.chunks[i].class_name, "ground_road");
    const double down[3] = {0, 0, -1};
    pags_mesh_query *query;
    assert_true(road || !strcmp(b.chunks[i].class_name, "ground_pavement"));
    assert_int_equal(pags_mesh_query_of_mesh(&b.chunks[i].mesh, &query), PAGS_OK);
    for (double y = -1; y < 1.5; y += 0.1)
      for (double x = -1; x < 1; x += 0.05) {
        const double t = pags_mesh_query_ray(query, (const double[3]){x, y, 1}, down, NULL);
        if (x < 0.02 || x > 0.12)
          assert_true(road == (x < 0.07) ? fabs(1 - t - (road ? 0 : 0.13)) < 0.012 : t < 0);
      }
    pags_mesh_query_destroy(query);
  }
  b.depth_views = (pags_depth_views){0};
  pags_background_destroy(&b);
  pags_tasks_destroy(w.tasks);
}

static void kerbs_are_sharp(void **state) {
  (void)state;
  make_kerb(0);
}

static void kerbs_are_straight(void **state) {
  (void)state;
  make_kerb(0.12);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(gaps_between_rings_are_bridged),
      cmocka_unit_test(walls_are_not_climbed),
      cmocka_unit_test(lidar_outweighs_pixels),
      cmocka_unit_test(the_limit_of_triangles_is_used),
      cmocka_unit_test(camera_depths_give_the_ground_without_lidar),
      cmocka_unit_test(missing_ground_is_no_error),
      cmocka_unit_test(small_holes_are_filled),
      cmocka_unit_test(labels_continue_the_ground),
      cmocka_unit_test(kerbs_are_sharp),
      cmocka_unit_test(kerbs_are_straight),
  };
  return cmocka_run_group_tests_name("ground", tests, NULL, NULL);
}
