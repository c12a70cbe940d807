/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the blocks that are made of walls: closed, down to the ground, as thick as was seen or stated. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "base/vec3.h"
#include "exporters/proxy/blocks.h"
#include "exporters/proxy/mesh_query.h"

enum { SIDE = 200, WIDE = 64 }; /* points of the ground's lattice a side, 0.2 m apart; pixels of a picture */

static const double step = 0.1; /* of the points on walls, metres */

typedef struct street {
  pags_proxy_options options;
  pags_proxy_maker maker;
  float heights[SIDE * SIDE];
  uint8_t known[SIDE * SIDE];
  pags_ground ground;
  pags_proxy_mesh walls;
  pags_background made;
} street;

/* Makes a street of level ground at z = 0 from (-20, -20) to (20, 20) without walls. */
static int set_up(void **state) {
  static street s;
  memset(&s, 0, sizeof s);
  memset(s.known, 1, sizeof s.known);
  s.options = pags_proxy_options_default();
  s.options.voxel = 0.15;
  s.maker.options = &s.options;
  s.ground = (pags_ground){.nx = SIDE,
                           .ny = SIDE,
                           .x0 = -20,
                           .y0 = -20,
                           .step = 0.2,
                           .z = s.heights,
                           .known = s.known,
                           .nearest = s.heights};
  *state = &s;
  s.maker.tasks = pags_tasks_create(2);
  return s.maker.tasks ? 0 : -1;
}

static int tear_down(void **state) {
  street *s = *state;
  pags_background_destroy(&s->made);
  pags_proxy_mesh_destroy(&s->walls);
  pags_tasks_destroy(s->maker.tasks);
  return 0;
}

/* Adds an upright wall from (x, y), `length` metres towards (dx, dy), between the heights z0 and z1, that faces to the
 * right of this direction. It is open where hole[0] < distance along it < hole[1] and hole[2] < z < hole[3]. */
static void add_wall(street *s, double x, double y, double dx, double dy, double length, double z0, double z1,
                     const double *hole) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  const int nu = (int)lround(length / step), nv = (int)lround((z1 - z0) / step);
  const uint32_t first = (uint32_t)s->walls.vertex_count, row = (uint32_t)nu + 1;
  for (int j = 0; j <= nv; j++)
    for (int i = 0; i <= nu; i++) {
      const float p[3] = {(float)(x + dx * step * i), (float)(y + dy * step * i), (float)(z0 + step * j)};
      pags_proxy_mesh_vertex(&s->walls, p, grey, 1);
    }
  for (int j = 0; j < nv; j++)
    for (int i = 0; i < nu; i++) {
      const double u = step * (i + 0.5), z = z0 + step * (j + 0.5);
      const uint32_t a = first + (uint32_t)j * row + (uint32_t)i;
      if (hole && u > hole[0] && u < hole[1] && z > hole[2] && z < hole[3])
        continue;
      pags_proxy_mesh_triangle(&s->walls, a, a + 1, a + row + 1);
      pags_proxy_mesh_triangle(&s->walls, a, a + row + 1, a + row);
    }
}

/* Makes the blocks and checks what holds of all. */
static void make(street *s) {
  assert_int_equal(pags_proxy_mesh_compact(&s->walls), PAGS_OK);
  assert_int_equal(pags_blocks_make(&s->maker, &s->made, &s->ground, &s->walls), PAGS_OK);
  for (int64_t i = 0; i < s->made.chunk_count; i++) {
    const pags_chunk *chunk = &s->made.chunks[i];
    pags_proxy_mesh_topology topology;
    assert_int_equal(pags_proxy_mesh_inspect(&chunk->mesh, &topology), PAGS_OK);
    assert_true(topology.closed);
    assert_true(chunk->mesh.triangle_count <= 500);
    assert_true(chunk->unseen_depth > 0 && chunk->unseen_depth <= 1);
    assert_true(chunk->observed > 0 && chunk->observed < 1);
    assert_string_equal(chunk->class_name, "building");
  }
}

/* The distance at which a ray first hits any block; negative: none. */
static double hit(const street *s, double x, double y, double z, double dx, double dy, double dz) {
  const double from[3] = {x, y, z}, along[3] = {dx, dy, dz};
  double nearest = -1;
  for (int64_t i = 0; i < s->made.chunk_count; i++) {
    pags_mesh_query *query;
    assert_int_equal(pags_mesh_query_of_mesh(&s->made.chunks[i].mesh, &query), PAGS_OK);
    const double t = pags_mesh_query_ray(query, from, along, NULL);
    nearest = t >= 0 && (nearest < 0 || t < nearest) ? t : nearest;
    pags_mesh_query_destroy(query);
  }
  return nearest;
}

static void assert_near(double a, double b, double tolerance) {
  if (!(fabs(a - b) <= tolerance))
    fail_msg("%g and %g differ by more than %g", a, b, tolerance);
}

/* The lowest part of the wall is hidden, by a car say. */
static void test_wall_reaches_the_ground(void **state) {
  street *s = *state;
  double lo[3], hi[3];
  add_wall(s, -4, 0, 1, 0, 8, 1.2, 6, NULL);
  make(s);
  assert_int_equal(s->made.chunk_count, 1);
  pags_proxy_mesh_bounds(&s->made.chunks[0].mesh, lo, hi);
  assert_near(lo[0], -4, 0.21);
  assert_near(hi[0], 4, 0.21);
  assert_near(lo[1], 0, 0.01);
  assert_near(hi[1], s->made.chunks[0].unseen_depth, 0.01);
  assert_true(lo[2] < 0 && lo[2] > -0.5);
  assert_near(hi[2], 6, 0.21);
  for (double z = 0.05; z < 5.9; z += 0.4)
    for (double x = -3.9; x < 4; x += 0.6)
      assert_near(hit(s, x, -5, z, 0, 1, 0), 5, 0.01);
  assert_near(s->made.chunks[0].observed, 8 * 4.8 / (2 * 8 * 6.2 + 2 * 0.5 * 14.2), 0.04);
}

static void test_wall_seen_from_both_sides(void **state) {
  street *s = *state;
  add_wall(s, -4, 0, 1, 0, 8, 0.2, 2, NULL);
  add_wall(s, 4, 0.2, -1, 0, 8, 0.2, 2, NULL);
  make(s);
  assert_int_equal(s->made.chunk_count, 1);
  for (double x = -3.5; x < 4; x += 0.5) {
    assert_near(hit(s, x, -5, 1, 0, 1, 0), 5, 0.02);
    assert_near(hit(s, x, 5, 1, 0, -1, 0), 4.8, 0.02);
  }
}

/* The glass is not there; a shop's window is 3 m wide. */
static void test_windows_are_closed(void **state) {
  street *s = *state;
  const double hole[4] = {2, 5, 0.5, 3};
  add_wall(s, -4, 0, 1, 0, 8, 0, 6, hole);
  make(s);
  assert_int_equal(s->made.chunk_count, 1);
  for (double x = -1.5; x < 1; x += 0.25)
    assert_near(hit(s, x, -5, 1.5, 0, 1, 0), 5, 0.02);
}

static void test_window_set_back(void **state) {
  street *s = *state;
  const double hole[4] = {3, 5, 1, 3};
  add_wall(s, -4, 0, 1, 0, 8, 0, 6, hole);
  add_wall(s, -1, 0.25, 1, 0, 2, 1, 3, NULL);
  make(s);
  assert_int_equal(s->made.chunk_count, 1);
  assert_near(hit(s, 0, -5, 2, 0, 1, 0), 5.25, 0.03);
  assert_near(hit(s, -2, -5, 2, 0, 1, 0), 5, 0.03);
}

static void test_corner_of_a_house(void **state) {
  street *s = *state;
  add_wall(s, -6, 0, 1, 0, 6, 0, 6, NULL); /* faces -y */
  add_wall(s, 0, 0, 0, 1, 5, 0, 6, NULL);  /* faces +x, beyond the corner */
  make(s);
  assert_int_equal(s->made.chunk_count, 2);
  for (double z = 0.1; z < 6; z += 0.7) {
    assert_near(hit(s, -3, -5, z, 0, 1, 0), 5, 0.02);
    assert_near(hit(s, 5, 2.5, z, -1, 0, 0), 5, 0.02);
    assert_true(hit(s, 4, -4, z, -0.70711, 0.70711, 0) < 6); /* no gap at the corner */
  }
}

/* The front of a balcony doesn't reach down to the ground; a long row of houses becomes several blocks. */
static void test_what_hangs_stays_up(void **state) {
  street *s = *state;
  add_wall(s, -18, 0, 1, 0, 36, 0, 4, NULL);
  add_wall(s, -2, -1, 1, 0, 3, 3.3, 4.3, NULL);
  make(s);
  assert_in_range(s->made.chunk_count, 4, 6);
  for (double x = -17.9; x < 18; x += 0.3)
    assert_near(hit(s, x, 5, 2, 0, -1, 0), 4.5, 0.02);
  assert_near(hit(s, 0, -5, 3.8, 0, 1, 0), 4, 0.02);
  assert_near(hit(s, 0, -5, 2, 0, 1, 0), 5, 0.02);
}

/* A camera at (0, -8), 1.6 m high, that looks along y. */
static void look_ahead(pags_depth_view *view, float *depth, uint8_t *labels, uint8_t *rgb) {
  const double pose[12] = {1, 0, 0, 0, 0, 0, 1, -8, 0, -1, 0, 1.6};
  *view = (pags_depth_view){.depth = depth, .labels = labels, .rgb = rgb};
  view->camera.width = view->camera.height = WIDE;
  view->camera.fx = view->camera.fy = WIDE / 2;
  view->camera.cx = view->camera.cy = WIDE / 2;
  memcpy(view->camera.world_from_camera, pose, sizeof pose);
  pags_rigid_inverse(pose, view->camera_from_model);
}

/* LiDAR measured a wall 8 m before two cameras. It becomes a block if the pictures show a building there, although
 * their depths are 3 m too far, and a car is before it in one of them; not if depths or labels say that something else
 * is there. */
static void test_lidar_knows_better_where_walls_are(void **state) {
  static float points[100000], depths[2][WIDE * WIDE];
  static uint8_t labels[2][WIDE * WIDE], rgb[3 * WIDE * WIDE];
  enum { CAR = 13, BUILDING = 2, PLANTS = 8 };
  static const struct {
    float depth;
    uint8_t labels[2];
    bool wall;
  } cases[] = {{11, {BUILDING, BUILDING}, true}, {PAGS_DEPTH_VIEW_FREE, {BUILDING, BUILDING}, true},
               {11, {BUILDING, CAR}, true},      {5, {BUILDING, BUILDING}, false},
               {11, {PLANTS, PLANTS}, false},    {11, {CAR, CAR}, false}};
  for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
    pags_depth_view views[2];
    int64_t count = 0;
    street *s;
    set_up(state);
    s = *state;
    for (double x = -4; x < 4; x += step)
      for (double z = 0.1; z < 4; z += step) {
        pags_narrow3((const double[3]){x, 0.01 * sin(30 * x * z), z}, points + 3 * count++);
      }
    for (int v = 0; v < 2; v++) {
      look_ahead(&views[v], depths[v], labels[v], rgb);
      memset(labels[v], cases[c].labels[v], sizeof labels[v]);
      for (int i = 0; i < WIDE * WIDE; i++)
        depths[v][i] = cases[c].depth;
    }
    s->maker.lidar = (pags_lidar){.count = count, .points = points};
    s->made.labelled = true;
    s->made.depth_views = (pags_depth_views){.count = 2, .list = views};
    make(s);
    assert_int_equal(s->made.chunk_count > 0, cases[c].wall);
    if (cases[c].wall)
      assert_near(hit(s, 0.05, -5, 1, 0, 1, 0), 5, 0.03);
    s->made.depth_views = (pags_depth_views){0};
    tear_down(state);
  }
  set_up(state); /* for the tear-down that follows */
}

static void test_nothing_to_build(void **state) {
  street *s = *state;
  static const float grey[3] = {0}, points[4][3] = {{0, 0, 0}, {0.1f, 0, 0}, {0.1f, 0, 0.1f}, {0, 0, 0.1f}};
  make(s);
  assert_int_equal(s->made.chunk_count, 0);
  for (int i = 0; i < 4; i++)
    pags_proxy_mesh_vertex(&s->walls, points[i], grey, 1);
  pags_proxy_mesh_triangle(&s->walls, 0, 1, 2);
  pags_proxy_mesh_triangle(&s->walls, 0, 2, 3);
  make(s);
  assert_int_equal(s->made.chunk_count, 0);
}

/* Without ground a wall ends where it was seen to end. */
static void test_no_ground(void **state) {
  street *s = *state;
  double lo[3], hi[3];
  s->ground = (pags_ground){0};
  add_wall(s, -4, 0, 1, 0, 8, 1, 4, NULL);
  make(s);
  assert_int_equal(s->made.chunk_count, 1);
  pags_proxy_mesh_bounds(&s->made.chunks[0].mesh, lo, hi);
  assert_near(lo[2], 1, 0.21);
}

static void test_same_bytes_for_any_threads(void **state) {
  street *s = *state;
  pags_background one;
  add_wall(s, -6, 0, 1, 0, 6, 0, 6, NULL);
  add_wall(s, 0, 0, 0, 1, 5, 0, 6, NULL);
  make(s);
  one = s->made;
  s->made = (pags_background){0};
  pags_tasks_destroy(s->maker.tasks);
  s->maker.tasks = pags_tasks_create(5);
  make(s);
  assert_int_equal(one.chunk_count, s->made.chunk_count);
  for (int64_t i = 0; i < one.chunk_count; i++) {
    const pags_proxy_mesh *a = &one.chunks[i].mesh, *b = &s->made.chunks[i].mesh;
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_int_equal(a->triangle_count, b->triangle_count);
    assert_memory_equal(a->positions, b->positions, (size_t)a->vertex_count * 3 * sizeof(float));
    assert_memory_equal(a->triangles, b->triangles, (size_t)a->triangle_count * 3 * sizeof(uint32_t));
  }
  pags_background_destroy(&one);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup_teardown(test_same_bytes_for_any_threads, set_up, tear_down),
      cmocka_unit_test_setup_teardown(test_wall_reaches_the_ground, set_up, tear_down),
      cmocka_unit_test_setup_teardown(test_wall_seen_from_both_sides, set_up, tear_down),
      cmocka_unit_test_setup_teardown(test_windows_are_closed, set_up, tear_down),
      cmocka_unit_test_setup_teardown(test_window_set_back, set_up, tear_down),
      cmocka_unit_test_setup_teardown(test_corner_of_a_house, set_up, tear_down),
      cmocka_unit_test_setup_teardown(test_what_hangs_stays_up, set_up, tear_down),
      cmocka_unit_test_setup_teardown(test_lidar_knows_better_where_walls_are, set_up, tear_down),
      cmocka_unit_test_setup_teardown(test_nothing_to_build, set_up, tear_down),
      cmocka_unit_test_setup_teardown(test_no_ground, set_up, tear_down),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
