/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the proxies of trees, poles, signs, lamps and fences. Points and vertices are spread over known shapes on a
 * level ground; there are no labels unless a test gives some. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "exporters/proxy/background.h"

enum { WIDE = 96, HIGH = 64, CELLS = 200, MOST = 60000 };

/* A ground at height 0.5 of 40 m x 40 m about the origin, a view without labels, points and vertices. */
typedef struct place {
  pags_ground ground;
  float z[CELLS * CELLS], depth[WIDE * HIGH];
  uint8_t known[CELLS * CELLS], labels[WIDE * HIGH], rgb[3 * WIDE * HIGH];
  pags_depth_view view;
  pags_background b;
  float points[3 * MOST];
  int64_t count;
  pags_proxy_mesh leaves;
  pags_tasks *tasks;
} place;

static int open_place(void **state) {
  place *p = calloc(1, sizeof *p);
  assert_non_null(p);
  p->ground = (pags_ground){
      .nx = CELLS, .ny = CELLS, .x0 = -20, .y0 = -20, .step = 0.2, .z = p->z, .known = p->known, .nearest = p->z};
  for (int i = 0; i < CELLS * CELLS; i++) {
    p->z[i] = 0.5f;
    p->known[i] = 1;
  }
  /* The camera looks along y, from 8 m before the x axis: x right, z up. */
  const double pose[12] = {1, 0, 0, 0, 0, 0, 1, -8, 0, -1, 0, 1.5};
  p->view = (pags_depth_view){.depth = p->depth, .rgb = p->rgb, .nearest = 0.05};
  p->view.camera = (pags_camera){.width = WIDE, .height = HIGH, .fx = 48, .fy = 48, .cx = WIDE / 2, .cy = HIGH / 2};
  memcpy(p->view.camera.world_from_camera, pose, sizeof pose);
  const double inverse[12] = {1, 0, 0, 0, 0, 0, -1, 1.5, 0, 1, 0, 8};
  memcpy(p->view.camera_from_model, inverse, sizeof inverse);
  p->b = (pags_background){.depth_views = {.count = 1, .list = &p->view}};
  p->tasks = pags_tasks_create(2);
  assert_non_null(p->tasks);
  *state = p;
  return 0;
}

static int close_place(void **state) {
  place *p = *state;
  p->b.depth_views = (pags_depth_views){0};
  pags_background_destroy(&p->b);
  pags_proxy_mesh_destroy(&p->leaves);
  pags_tasks_destroy(p->tasks);
  free(p);
  return 0;
}

static void add_point(place *p, double x, double y, double height) {
  assert_true(p->count < MOST);
  float *at = p->points + 3 * p->count++;
  at[0] = (float)x;
  at[1] = (float)y;
  at[2] = (float)(0.5 + height);
}

/* Points on an upright cylinder, every 5 cm of height. */
static void add_cylinder(place *p, double x, double y, double radius, double from, double to) {
  int number = 0;
  for (double z = from; z < to; z += 0.05, number++)
    for (int k = 0; k < 3; k++)
      add_point(p, x + radius * cos(number + 2.1 * k), y + radius * sin(number + 2.1 * k), z);
}

static void add_leaf(place *p, double x, double y, double height) {
  static const float green[3] = {0.2f, 0.5f, 0.1f};
  pags_proxy_mesh_vertex(&p->leaves, (const float[3]){(float)x, (float)y, (float)(0.5 + height)}, green, 1);
}

/* Leaves on a ball and LiDAR points on some of them. */
static void add_crown(place *p, double x, double y, double height, double radius) {
  for (int i = 0; i < 3000; i++) {
    const double z = 1 - (2 * i + 1) / 3000.0, r = sqrt(1 - z * z), angle = 2.39996322972865332 * i;
    const double at[3] = {x + radius * r * cos(angle), y + radius * r * sin(angle), height + radius * z};
    add_leaf(p, at[0], at[1], at[2]);
    if (i % 3 == 0)
      add_point(p, x + 0.7 * (at[0] - x), y + 0.7 * (at[1] - y), at[2]);
  }
}

static void make(place *p) {
  const pags_proxy_maker w = {.tasks = p->tasks};
  pags_background *b = &p->b;
  pags_proxy_mesh nothing = {0};
  assert_int_equal(pags_cloud_make(p->points, p->count, &p->ground, &b->depth_views, &b->cloud), PAGS_OK);
  assert_int_equal(pags_columns_find(&b->cloud, &p->ground, &b->depth_views, &b->columns), PAGS_OK);
  assert_int_equal(pags_trees_make(&w, b, &p->ground, &p->leaves), PAGS_OK);
  assert_int_equal(pags_poles_make(&w, b, &p->ground, &nothing), PAGS_OK);
}

/* The only chunk; checks that it is closed and stands on the ground. */
static const pags_proxy_mesh *only(const place *p, const char *class_name, double lo[3], double hi[3]) {
  pags_proxy_mesh_topology topology;
  assert_int_equal(p->b.chunk_count, 1);
  const pags_chunk *chunk = &p->b.chunks[0];
  assert_string_equal(chunk->class_name, class_name);
  assert_int_equal(pags_proxy_mesh_inspect(&chunk->mesh, &topology), PAGS_OK);
  assert_true(topology.closed);
  pags_proxy_mesh_bounds(&chunk->mesh, lo, hi);
  assert_true(fabs(lo[2] - 0.5) < 0.1);
  return &chunk->mesh;
}

static void nothing_makes_nothing(void **state) {
  make(*state);
  assert_int_equal(((place *)*state)->b.chunk_count, 0);
}

static void a_wall_is_no_pole(void **state) {
  place *p = *state;
  for (double x = -3; x < 3; x += 0.05)
    for (double z = 0.3; z < 3; z += 0.1)
      add_point(p, x, 2 + 0.1 * x, z);
  make(p);
  assert_int_equal(p->b.chunk_count, 0);
}

static void a_pole_is_a_prism(void **state) {
  place *p = *state;
  double lo[3], hi[3];
  add_cylinder(p, 1.03, 2.11, 0.1, 0.1, 4);
  make(p);
  const pags_proxy_mesh *mesh = only(p, "pole", lo, hi);
  assert_true(mesh->triangle_count <= PAGS_POLE_TRIANGLES);
  assert_true(fabs(hi[2] - 4.5) < 0.3);
  assert_true(fabs(lo[0] - 0.93) < 0.03 && fabs(hi[0] - 1.13) < 0.03);
  assert_true(fabs(lo[1] - 2.01) < 0.03 && fabs(hi[1] - 2.21) < 0.03);
}

/* A parked car hides the lower half, and the LiDAR sees one side of the rest. */
static void a_hidden_foot_is_completed(void **state) {
  place *p = *state;
  double lo[3], hi[3];
  for (double z = 1.4; z < 3.2; z += 0.04)
    for (int k = -1; k <= 1; k++)
      add_point(p, -2 + 0.04 * k, 3 - 0.04 * cos(k), z);
  make(p);
  only(p, "pole", lo, hi);
  assert_true(fabs(0.5 * (lo[0] + hi[0]) + 2) < 0.03 && fabs(0.5 * (lo[1] + hi[1]) - 3) < 0.08);
  assert_true(fabs(hi[2] - 3.7) < 0.3);
}

static void a_plate_makes_a_sign(void **state) {
  place *p = *state;
  double lo[3], hi[3];
  add_cylinder(p, 0.5, 1, 0.035, 0.1, 2.75);
  for (double a = -0.3; a <= 0.3; a += 0.03) /* a disc that faces along x */
    for (double b = -0.3; b <= 0.3; b += 0.03)
      if (a * a + b * b < 0.09)
        add_point(p, 0.45, 1 + a, 2.4 + b);
  make(p);
  const pags_proxy_mesh *mesh = only(p, "sign", lo, hi);
  assert_true(mesh->triangle_count <= PAGS_POLE_TRIANGLES);
  assert_true(fabs(lo[1] - 0.7) < 0.06 && fabs(hi[1] - 1.3) < 0.06);
  assert_true(fabs(lo[0] - 0.43) < 0.04 && hi[0] < 0.6);
}

static void an_arm_makes_a_lamp(void **state) {
  place *p = *state;
  double lo[3], hi[3];
  add_cylinder(p, 0, 4, 0.07, 0.1, 6.6);
  for (double a = 1.8; a <= 2.6; a += 0.05) /* the head */
    for (int k = -1; k <= 1; k++)
      add_point(p, 0.12 * k, 4 - a, 7);
  make(p);
  const pags_proxy_mesh *mesh = only(p, "lamp", lo, hi);
  assert_true(mesh->triangle_count <= PAGS_POLE_TRIANGLES);
  assert_true(fabs(lo[1] - 1.4) < 0.1 && fabs(hi[1] - 4.07) < 0.1);
  assert_true(fabs(hi[2] - 7.55) < 0.2);
}

/* The crown's ball is covered: its hulls' corners lie near its surface, and together they reach all sides. */
static void check_tree(const pags_chunk *chunk, double x, double y, double height, double radius) {
  pags_proxy_mesh_topology topology;
  double lo[3], hi[3];
  assert_string_equal(chunk->class_name, "tree");
  assert_int_equal(pags_proxy_mesh_inspect(&chunk->mesh, &topology), PAGS_OK);
  assert_true(topology.closed);
  const double ball = 4.18879 * radius * radius * radius;
  assert_true(topology.volume > 0.5 * ball && topology.volume < 1.1 * ball);
  pags_proxy_mesh_bounds(&chunk->mesh, lo, hi);
  assert_true(fabs(lo[2] - 0.5) < 0.1 && fabs(hi[2] - 0.5 - height - radius) < 0.3);
  assert_true(fabs(lo[0] - x + radius) < 0.4 && fabs(hi[0] - x - radius) < 0.4);
  assert_true(fabs(lo[1] - y + radius) < 0.4 && fabs(hi[1] - y - radius) < 0.4);
}

static void a_tree_has_trunk_and_crown(void **state) {
  place *p = *state;
  add_cylinder(p, 2, 3, 0.17, 0.1, 2.7);
  add_crown(p, 2, 3, 4.5, 2);
  make(p);
  assert_int_equal(p->b.chunk_count, 1);
  check_tree(&p->b.chunks[0], 2, 3, 4.5, 2);
}

static void touching_trees_are_two(void **state) {
  place *p = *state;
  for (int i = 0; i < 2; i++) {
    add_cylinder(p, -2 + 3.8 * i, 3, 0.17, 0.1, 2.7);
    add_crown(p, -2 + 3.8 * i, 3, 4.5, 2);
  }
  make(p);
  assert_int_equal(p->b.chunk_count, 2);
  for (int i = 0; i < 2; i++)
    check_tree(&p->b.chunks[i], -2 + 3.8 * i, 3, 4.5, 2);
}

/* Nobody saw the trunks: the canopy's peaks tell the trees, and trunks are made up. */
static void peaks_divide_crowns_without_trunks(void **state) {
  place *p = *state;
  for (int i = 0; i < 2; i++)
    add_crown(p, -2 + 4.1 * i, 3, 4.5, 2);
  make(p);
  assert_int_equal(p->b.chunk_count, 2);
  for (int i = 0; i < 2; i++)
    check_tree(&p->b.chunks[i], -2 + 4.1 * i, 3, 4.5, 2);
}

/* The pictures show a fence 1.2 m high along x, at y = 0. */
static void labelled_pixels_make_a_fence(void **state) {
  place *p = *state;
  double lo[3], hi[3];
  p->b.labelled = true;
  p->view.labels = p->labels;
  for (int y = 0; y < HIGH; y++)
    for (int x = 0; x < WIDE; x++) {
      const double height = 1.0 - (y + 0.5 - HIGH / 2) / 6, side = (x + 0.5 - WIDE / 2) / 6; /* at y = 0 */
      if (height > 0 && height < 1.2 && fabs(side) < 3) {
        p->labels[y * WIDE + x] = PAGS_LABEL_FENCE;
        p->depth[y * WIDE + x] = 8;
      }
    }
  make(p);
  const pags_proxy_mesh *mesh = only(p, "fence", lo, hi);
  assert_true(mesh->triangle_count <= PAGS_POLE_TRIANGLES);
  assert_true(fabs(lo[0] + 3) < 0.3 && fabs(hi[0] - 3) < 0.3);
  assert_true(fabs(lo[1]) < 0.1 && fabs(hi[1]) < 0.1 && fabs(hi[2] - 1.7) < 0.25);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup_teardown(nothing_makes_nothing, open_place, close_place),
      cmocka_unit_test_setup_teardown(a_wall_is_no_pole, open_place, close_place),
      cmocka_unit_test_setup_teardown(a_pole_is_a_prism, open_place, close_place),
      cmocka_unit_test_setup_teardown(a_hidden_foot_is_completed, open_place, close_place),
      cmocka_unit_test_setup_teardown(a_plate_makes_a_sign, open_place, close_place),
      cmocka_unit_test_setup_teardown(an_arm_makes_a_lamp, open_place, close_place),
      cmocka_unit_test_setup_teardown(a_tree_has_trunk_and_crown, open_place, close_place),
      cmocka_unit_test_setup_teardown(touching_trees_are_two, open_place, close_place),
      cmocka_unit_test_setup_teardown(peaks_divide_crowns_without_trunks, open_place, close_place),
      cmocka_unit_test_setup_teardown(labelled_pixels_make_a_fence, open_place, close_place),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
