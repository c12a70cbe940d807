/* SPDX-License-Identifier: Apache-2.0 */
/* Tests exporters: meshes stay closed through every operation, size limits are kept, unusual scenes give boxes, and
 * splat files can be read again. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "exporters/format/bake.h"
#include "exporters/format/splat_save.h"
#include "exporters/proxy/mesh_query.h"
#include "exporters/proxy/tsdf.h"

#include <pags/export.h>
#include "base/file.h"
#include "base/log.h"
#include "base/rng.h"
#include "base/text.h"
#include "scene/axes.h"

#include "scratch_folder.h"
#include "splat_files.h"

/* cmocka compares in float; this function compares in double. */
static void assert_near(double a, double b, double tolerance) {
  if (!(fabs(a - b) <= tolerance))
    fail_msg("%.9g and %.9g differ by more than %g", a, b, tolerance);
}

/* Signed distance of two overlapping balls and a ring around them. */
static double built_distance(const double p[3]) {
  double a = sqrt(pow(p[0] - 0.5, 2) + p[1] * p[1] + p[2] * p[2]) - 0.8;
  double b = sqrt(pow(p[0] + 0.5, 2) + p[1] * p[1] + p[2] * p[2]) - 0.7;
  double r = sqrt(p[0] * p[0] + p[1] * p[1]) - 1.3, ring = sqrt(r * r + p[2] * p[2]) - 0.25;
  return fmin(fmin(a, b), ring);
}

static pags_proxy_mesh built_mesh(double step) {
  const double lo[3] = {-2, -2, -2}, hi[3] = {2, 2, 2};
  pags_tsdf grid;
  pags_proxy_mesh mesh;
  assert_int_equal(pags_tsdf_create(&grid, lo, hi, step, 0), PAGS_OK);
  for (int z = 0; z < grid.n[2]; z++)
    for (int y = 0; y < grid.n[1]; y++)
      for (int x = 0; x < grid.n[0]; x++) {
        const double p[3] = {lo[0] + x * step, lo[1] + y * step, lo[2] + z * step};
        grid.distance[(z * grid.n[1] + y) * grid.n[0] + x] = (float)built_distance(p);
      }
  assert_int_equal(pags_tsdf_surface(&grid, 0, &mesh), PAGS_OK);
  pags_tsdf_destroy(&grid);
  return mesh;
}

static pags_proxy_mesh_topology inspect(const pags_proxy_mesh *mesh) {
  pags_proxy_mesh_topology topology;
  assert_int_equal(pags_proxy_mesh_inspect(mesh, &topology), PAGS_OK);
  return topology;
}

static void test_box(void **state) {
  (void)state;
  const double size[3] = {4, 2, 1.5};
  const float grey[3] = {0.5f, 0.5f, 0.5f};
  pags_proxy_mesh box;
  assert_int_equal(pags_proxy_mesh_box(size, grey, &box), PAGS_OK);
  assert_true(inspect(&box).closed);
  assert_near(inspect(&box).volume, 12, 1e-5);
  box.triangle_count--;
  assert_false(inspect(&box).closed);
  assert_int_equal(inspect(&box).open_edges, 3);
  pags_proxy_mesh_destroy(&box);
}

static void test_surface_is_closed_and_where_it_should_be(void **state) {
  (void)state;
  pags_proxy_mesh mesh = built_mesh(0.08);
  assert_true(inspect(&mesh).closed);
  for (int64_t i = 0; i < mesh.vertex_count; i++) {
    const double p[3] = {(double)mesh.positions[3 * i], (double)mesh.positions[3 * i + 1],
                         (double)mesh.positions[3 * i + 2]};
    assert_true(fabs(built_distance(p)) < 0.08);
  }
  pags_proxy_mesh_destroy(&mesh);
}

static void test_budgets(void **state) {
  (void)state;
  static const int64_t budgets[] = {5000, 2000, 500, 100, 40};
  pags_proxy_mesh mesh = built_mesh(0.08), simple;
  assert_true(mesh.triangle_count > 5000);
  for (size_t i = 0; i < sizeof budgets / sizeof budgets[0]; i++) {
    assert_int_equal(pags_proxy_mesh_simplify(&mesh, budgets[i], &simple), PAGS_OK);
    assert_true(simple.triangle_count <= budgets[i]);
    assert_true(inspect(&simple).closed);
    pags_proxy_mesh_destroy(&simple);
  }
  pags_proxy_mesh_destroy(&mesh);
}

/* Two tetrahedra that share an edge: four faces meet at that edge, and the repair cuts them into two closed parts. */
static void test_repair(void **state) {
  (void)state;
  static const float points[6][3] = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {1, 1, 0}, {-1, 0, 0}, {-1, -1, 0}},
                     grey[3] = {0};
  pags_proxy_mesh s = {0};
  for (int i = 0; i < 6; i++)
    pags_proxy_mesh_vertex(&s, points[i], grey, 1);
  static const uint32_t tetrahedra[2][4] = {{0, 1, 2, 3}, {0, 1, 4, 5}};
  for (int t = 0; t < 2; t++) { /* oriented outward if vertices 0 1 2 3 have a positive volume */
    const uint32_t *v = tetrahedra[t];
    pags_proxy_mesh_triangle(&s, v[0], v[2], v[1]);
    pags_proxy_mesh_triangle(&s, v[0], v[1], v[3]);
    pags_proxy_mesh_triangle(&s, v[0], v[3], v[2]);
    pags_proxy_mesh_triangle(&s, v[1], v[2], v[3]);
  }
  double volume = inspect(&s).volume;
  if (volume < 0)
    for (int64_t i = 0; i < s.triangle_count; i++) {
      uint32_t v = s.triangles[3 * i];
      s.triangles[3 * i] = s.triangles[3 * i + 1];
      s.triangles[3 * i + 1] = v;
    }
  assert_int_equal(inspect(&s).crossed_edges, 1);
  assert_int_equal(pags_proxy_mesh_repair(&s), PAGS_OK);
  assert_true(inspect(&s).closed);
  assert_int_equal(s.vertex_count, 8);
  assert_near(inspect(&s).volume, fabs(volume), 1e-6);
  pags_proxy_mesh_destroy(&s);
}

static void add_box(pags_proxy_mesh *to, double side, double x, double z) {
  const double size[3] = {side, side, side};
  const float grey[3] = {0};
  uint32_t first = (uint32_t)to->vertex_count;
  pags_proxy_mesh box;
  assert_int_equal(pags_proxy_mesh_box(size, grey, &box), PAGS_OK);
  for (int64_t i = 0; i < box.vertex_count; i++) {
    const float p[3] = {box.positions[3 * i] + (float)x, box.positions[3 * i + 1], box.positions[3 * i + 2] + (float)z};
    pags_proxy_mesh_vertex(to, p, grey, 0);
  }
  for (int64_t i = 0; i < box.triangle_count; i++) {
    const uint32_t *t = box.triangles + 3 * i;
    pags_proxy_mesh_triangle(to, first + t[0], first + t[1], first + t[2]);
  }
  pags_proxy_mesh_destroy(&box);
}

/* Two squares that share a corner, a metre each: their slab has two closed parts. */
static void test_slab(void **state) {
  (void)state;
  static const float points[7][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0.1f}, {0, 1, 0}, {2, 1, 0}, {2, 2, 0}, {1, 2, 0}},
                     grey[3] = {0};
  static const uint32_t triangles[4][3] = {{0, 1, 2}, {0, 2, 3}, {2, 4, 5}, {2, 5, 6}};
  pags_proxy_mesh s = {0};
  for (int i = 0; i < 7; i++)
    pags_proxy_mesh_vertex(&s, points[i], grey, 1);
  for (int t = 0; t < 4; t++)
    pags_proxy_mesh_triangle(&s, triangles[t][0], triangles[t][1], triangles[t][2]);
  assert_int_equal(pags_proxy_mesh_thicken(&s, 0.5), PAGS_OK);
  assert_true(inspect(&s).closed);
  assert_near(inspect(&s).volume, 2 * 0.5, 1e-5);
  pags_proxy_mesh_destroy(&s);
}

/* Which of five smaller parts are kept together with the main body. */
static void test_parts(void **state) {
  (void)state;
  const double size[3] = {1.6, 1.2, 1.05};
  for (int annex = 0; annex < 2; annex++) {
    pags_proxy_mesh s = {0};
    add_box(&s, 1, 0, 0);
    add_box(&s, 0.2, 0.65, 0);   /* like a mirror: 0.05 from the body, kept if a size is given */
    add_box(&s, 0.2, -0.75, 0);  /* 0.15 from the body, too far */
    add_box(&s, 0.2, 0, 0.65);   /* near the body, but outside of the object's box */
    add_box(&s, 0.02, -0.55, 0); /* near the body, but too small */
    add_box(&s, 0.5, 0, 3);      /* large enough to be kept at any distance */
    assert_int_equal(pags_proxy_mesh_keep_parts(&s, 0.1, 0.1, annex ? size : NULL), PAGS_OK);
    assert_int_equal(s.vertex_count, annex ? 24 : 16);
    assert_near(inspect(&s).volume, 1 + 0.125 + (annex ? 0.008 : 0), 1e-5);
    double right = 0;
    for (int64_t i = 0; i < s.vertex_count; i++)
      right = fmax(right, (double)s.positions[3 * i]);
    assert_near(right, annex ? 0.75 : 0.5, 1e-6);
    pags_proxy_mesh_destroy(&s);
  }
}

static void test_hull(void **state) {
  (void)state;
  pags_proxy_mesh mesh = built_mesh(0.1), hull;
  assert_int_equal(pags_proxy_mesh_hull(&mesh, 200, &hull), PAGS_OK);
  assert_true(hull.triangle_count <= 200);
  assert_true(inspect(&hull).closed);
  assert_true(inspect(&hull).volume > inspect(&mesh).volume);
  pags_proxy_mesh_destroy(&hull);
  for (int64_t i = 0; i < mesh.vertex_count; i++)
    mesh.positions[3 * i + 2] = 0;
  assert_int_equal(pags_proxy_mesh_hull(&mesh, 200, &hull), PAGS_ERROR_ARGUMENT);
  pags_proxy_mesh_destroy(&mesh);
}

/* Returns the mean distance of the vertices of one mesh from the surface of another. */
static double mean_off(const pags_proxy_mesh *from, const pags_proxy_mesh *to) {
  pags_mesh_query *query;
  double sum = 0;
  assert_int_equal(pags_mesh_query_of_mesh(to, &query), PAGS_OK);
  for (int64_t i = 0; i < from->vertex_count; i++) {
    const double p[3] = {(double)from->positions[3 * i], (double)from->positions[3 * i + 1],
                         (double)from->positions[3 * i + 2]};
    sum += pags_mesh_query_distance(query, p, NULL);
  }
  pags_mesh_query_destroy(query);
  return sum / (double)from->vertex_count;
}

static void test_cage(void **state) {
  /* Limit of the mean distance by level: the higher the level, the fewer quads has the cage. */
  static const double sticks_out[3] = {0, 0.0135, 0.043};
  (void)state;
  pags_proxy_mesh mesh = built_mesh(0.1), cage;
  assert_int_equal(pags_proxy_mesh_keep_parts(&mesh, 0.9, 0, NULL), PAGS_OK);
  for (int level = 0; level <= 2; level++) {
    assert_int_equal(pags_proxy_mesh_cage(&mesh, level, 3000, &cage), PAGS_OK);
    assert_true(cage.triangle_count <= 3000);
    assert_true(inspect(&cage).closed);
    if (level) { /* the cage's vertices lie outside of the surface that it encloses */
      assert_true(mean_off(&cage, &mesh) < 0.04);
      assert_true(mean_off(&mesh, &cage) < sticks_out[level]);
    }
    pags_proxy_mesh_destroy(&cage);
  }
  pags_proxy_mesh_destroy(&mesh);
}

static void test_nearest_point(void **state) {
  (void)state;
  const double size[3] = {2, 2, 2}, corner[3] = {3, 3, 3}, side[3] = {0.3, -5, 0.2};
  const float grey[3] = {0};
  pags_proxy_mesh box;
  pags_mesh_query *query;
  double nearest[3];
  assert_int_equal(pags_proxy_mesh_box(size, grey, &box), PAGS_OK);
  assert_int_equal(pags_mesh_query_of_mesh(&box, &query), PAGS_OK);
  assert_near(pags_mesh_query_nearest(query, corner, nearest), sqrt(12.0), 1e-6);
  assert_near(nearest[0], 1, 1e-6);
  assert_near(pags_mesh_query_nearest(query, side, nearest), 4, 1e-6);
  assert_near(nearest[0], 0.3, 1e-6);
  assert_near(nearest[1], -1, 1e-6);
  pags_mesh_query_destroy(query);
  pags_proxy_mesh_destroy(&box);
}

/* ---- Rotated spherical harmonics ---- */

static void rotation_about(int axis, double angle, double r[9]) {
  int u = (axis + 1) % 3, v = (axis + 2) % 3;
  memset(r, 0, 9 * sizeof *r);
  r[4 * axis] = 1;
  r[4 * u] = r[4 * v] = cos(angle);
  r[3 * u + v] = -sin(angle);
  r[3 * v + u] = sin(angle);
}

static void test_half_turns(void **state) {
  (void)state;
  static const int about_x[15] = {-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1};
  double r[9], rest[15];
  pags_sh_rotation turn;
  rotation_about(0, 3.14159265358979323846, r);
  pags_sh_rotation_make(r, &turn);
  for (int k = 0; k < 15; k++)
    rest[k] = k + 1;
  pags_sh_rotation_apply(&turn, 3, rest);
  for (int k = 0; k < 15; k++)
    assert_near(rest[k], about_x[k] * (k + 1), 1e-9);
}

/* SH of degree 1 rotate like a vector, whose components (-x, -y, z) are the terms 3, 1, 2. Two rotations in turn
 * equal the rotation by their product. */
static void test_turns_compose(void **state) {
  (void)state;
  double a[9], b[9], ab[9] = {0}, one[15], two[15];
  pags_sh_rotation turn_a, turn_b, turn_ab;
  rotation_about(2, 0.7, a);
  rotation_about(1, -1.9, b);
  for (int i = 0; i < 9; i++)
    for (int k = 0; k < 3; k++)
      ab[i] += a[i / 3 * 3 + k] * b[3 * k + i % 3];
  pags_sh_rotation_make(a, &turn_a);
  pags_sh_rotation_make(b, &turn_b);
  pags_sh_rotation_make(ab, &turn_ab);
  for (int k = 0; k < 15; k++)
    one[k] = two[k] = sin(k + 1.0);
  const double vector[3] = {-one[2], -one[0], one[1]};
  pags_sh_rotation_apply(&turn_b, 3, one);
  pags_sh_rotation_apply(&turn_a, 3, one);
  pags_sh_rotation_apply(&turn_ab, 3, two);
  for (int k = 0; k < 15; k++)
    assert_near(one[k], two[k], 1e-9);
  const double turned[3] = {-two[2], -two[0], two[1]};
  for (int k = 0; k < 3; k++)
    assert_near(turned[k], ab[3 * k] * vector[0] + ab[3 * k + 1] * vector[1] + ab[3 * k + 2] * vector[2], 1e-9);
}

/* ---- Splat files ---- */

static void check_rotations(const pags_gaussians *a, const pags_gaussians *b, int64_t i, double tolerance) {
  double along = 0, la = 0, lb = 0;
  for (int k = 0; k < 4; k++) {
    double p = (double)pags_plane(a, PAGS_ROTATION + k)[i], q = (double)pags_plane(b, PAGS_ROTATION + k)[i];
    along += p * q;
    la += p * p;
    lb += q * q;
  }
  assert_true(fabs(along) / sqrt(la * lb) > 1 - tolerance);
}

static void check_read_back(const char *path, const pags_gaussians *g, double position, double scale, double rotation,
                            double rest) {
  pags_gaussians back;
  assert_int_equal(pags_splat_load(path, &back, NULL, NULL), PAGS_OK);
  assert_int_equal(back.count, g->count);
  for (int64_t i = 0; i < g->count; i++) {
    for (int k = 0; k < 3; k++) {
      assert_near((double)pags_plane(&back, PAGS_MEAN + k)[i], (double)pags_plane(g, PAGS_MEAN + k)[i], position);
      assert_near((double)pags_plane(&back, PAGS_SCALE + k)[i], (double)pags_plane(g, PAGS_SCALE + k)[i], scale);
    }
    double a = 1 / (1 + exp(-(double)pags_plane(g, PAGS_OPACITY)[i])),
           b = 1 / (1 + exp(-(double)pags_plane(&back, PAGS_OPACITY)[i]));
    assert_near(a, b, 0.5 / 255 + 1e-5);
    check_rotations(g, &back, i, rotation);
    for (int p = PAGS_SH + 3; rest > 0 && p < pags_plane_count(g->sh_degree); p++)
      assert_near((double)pags_plane(&back, p)[i], fmin(fmax((double)pags_plane(g, p)[i], -1), 0.99), rest);
  }
  pags_gaussians_destroy(&back);
}

static void test_splat_files(void **state) {
  (void)state;
  char path[1024];
  pags_gaussians g;
  sample_gaussians(&g, 300, 3, 5);
  snprintf(path, 1024, "%s/a.splat", scratch_folder);
  assert_int_equal(pags_splat_save(path, &g), PAGS_OK);
  check_read_back(path, &g, 0, 1e-5, 1e-3, 0);
  for (int version = 3; version <= 4; version++) {
    snprintf(path, 1024, "%s/v%d.spz", scratch_folder, version);
    for (int axes = PAGS_AXES_LDB; axes <= PAGS_AXES_RUF;
         axes++) { /* the record of the coordinate system restores the axes */
      assert_int_equal(pags_spz_save(path, &g, &(pags_spz_options){version, axes, NULL}), PAGS_OK);
      check_read_back(path, &g, 0.5 / 4096 + 1e-6, 0.5 / 16 + 1e-5, 1e-4, 8.5 / 128 + 1e-5);
    }
  }
  pags_gaussians_destroy(&g);
}

static int warnings;

static void count_warnings(void *user, pags_log_level level, const char *line) {
  (void)user, (void)line;
  warnings += level == PAGS_LOG_WARNING;
}

/* Positions beyond 2048 m have fewer fractional bits; the export warns if steps are coarse or values are clamped. */
static void test_spz_beyond_its_range(void **state) {
  (void)state;
  char path[1024];
  pags_gaussians g, back;
  const pags_spz_options options = {4, PAGS_AXES_RUB, NULL};
  snprintf(path, sizeof path, "%s/far.spz", scratch_folder);
  for (int k = 0; k < 3; k++) {
    static const double far[3] = {2500, 500000, 1e9}, step[3] = {1.0 / 2048, 1.0 / 16, 1}, error[3] = {1e-3, 0.1, 1e9};
    static const int expected[3] = {0, 1, 2};
    sample_gaussians(&g, 60, 0, 5);
    pags_plane(&g, PAGS_MEAN)[7] = (float)far[k];
    warnings = 0;
    pags_log_set(count_warnings, NULL);
    assert_int_equal(pags_spz_save(path, &g, &options), PAGS_OK);
    pags_log_set(NULL, NULL);
    assert_int_equal(warnings, expected[k]);
    assert_int_equal(pags_splat_load(path, &back, NULL, NULL), PAGS_OK);
    assert_near((double)pags_plane(&back, PAGS_MEAN)[7], far[k], error[k]);
    for (int i = 0; i < 7; i++)
      assert_near((double)pags_plane(&back, PAGS_MEAN)[i], (double)pags_plane(&g, PAGS_MEAN)[i], step[k]);
    pags_gaussians_destroy(&back);
    pags_gaussians_destroy(&g);
  }

  /* Leaves out up to one in a thousand Gaussians, so that the others keep fine steps. */
  sample_gaussians(&g, 1000, 0, 5);
  memset(pags_plane(&g, PAGS_SH), 0, 3 * (size_t)g.stride * sizeof(float)); /* no colours beyond the range */
  pags_plane(&g, PAGS_MEAN + 1)[7] = 1e9f;
  warnings = 0;
  pags_log_set(count_warnings, NULL);
  assert_int_equal(pags_spz_save(path, &g, &options), PAGS_OK);
  pags_log_set(NULL, NULL);
  assert_int_equal(warnings, 1);
  assert_int_equal(pags_splat_load(path, &back, NULL, NULL), PAGS_OK);
  assert_int_equal(back.count, 999);
  assert_near((double)pags_plane(&back, PAGS_MEAN)[7], (double)pags_plane(&g, PAGS_MEAN)[8], 1.0 / 8192 + 1e-6);
  pags_gaussians_destroy(&back);
  pags_gaussians_destroy(&g);

  sample_gaussians(&g, 60, 1, 5);
  pags_plane(&g, PAGS_SCALE + 1)[3] = 8;
  pags_plane(&g, PAGS_SH + 5)[3] = 2.5f;
  pags_plane(&g, PAGS_SH + 1)[3] = -9;
  warnings = 0;
  pags_log_set(count_warnings, NULL);
  assert_int_equal(pags_spz_save(path, &g, &options), PAGS_OK);
  pags_log_set(NULL, NULL);
  assert_int_equal(warnings, 3);
  pags_gaussians_destroy(&g);
}

/* ---- Scenes ---- */

/* Fills a ball of radius r with opaque Gaussians; if `flat`, a disc in the plane z = 0. */
static void fill_ball(pags_gaussians *g, int64_t count, double r, int flat) {
  assert_int_equal(pags_gaussians_create(g, count, 0), PAGS_OK);
  for (int64_t i = 0; i < count; i++) {
    double z = 1 - (2 * (double)i + 1) / (double)count, s = sqrt(1 - z * z), angle = 2.39996322972865332 * (double)i;
    pags_plane(g, PAGS_MEAN)[i] = (float)(r * s * cos(angle));
    pags_plane(g, PAGS_MEAN + 1)[i] = (float)(r * s * sin(angle));
    pags_plane(g, PAGS_MEAN + 2)[i] = flat ? 0 : (float)(r * z);
    for (int k = 0; k < 3; k++)
      pags_plane(g, PAGS_SCALE + k)[i] = (float)log(0.025);
    pags_plane(g, PAGS_ROTATION)[i] = 1;
    pags_plane(g, PAGS_OPACITY)[i] = 5;
  }
}

/* Adds cameras on a circle around the centre, 6 m away. */
static void add_views(pags_scene *scene, int count) {
  scene->view_count = count;
  scene->views = calloc((size_t)count, sizeof *scene->views);
  for (int i = 0; i < count; i++) {
    double a = 6.283185307 * i / count, c = cos(a), s = sin(a), lift = i % 3 - 1.0, d = sqrt(36 + lift * lift * 9);
    /* x right, y down, z forward, looking at the centre from (6 c, 6 s, 3 lift) */
    const double forward[3] = {-6 * c / d, -6 * s / d, -3 * lift / d}, right[3] = {-s, c, 0};
    pags_camera camera = {.width = 320, .height = 240, .fx = 400, .fy = 400, .cx = 160, .cy = 120};
    for (int k = 0; k < 3; k++) {
      int u = (k + 1) % 3, v = (k + 2) % 3;
      camera.world_from_camera[4 * k] = right[k];
      camera.world_from_camera[4 * k + 1] = forward[u] * right[v] - forward[v] * right[u];
      camera.world_from_camera[4 * k + 2] = forward[k];
    }
    camera.world_from_camera[3] = 6 * c;
    camera.world_from_camera[7] = 6 * s;
    camera.world_from_camera[11] = 3 * lift;
    scene->views[i].camera = camera;
    scene->views[i].name = pags_text_copy("view");
    assert_int_equal(pags_camera_check(&scene->views[i].camera, "view"), PAGS_OK);
  }
}

static void add_object(pags_scene *scene, const char *id, int64_t model, double size, double left, int64_t keyframes) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  pags_scene_object *o = &scene->objects[scene->object_count++];
  *o = (pags_scene_object){.model = model, .critical = 1, .rigid = 1};
  o->record.id = pags_text_copy(id);
  o->record.class_name = pags_text_copy("Regular Vehicle");
  o->record.category = PAGS_CATEGORY_VEHICLE;
  o->record.moving = keyframes > 1;
  for (int k = 0; k < 3; k++)
    o->record.size[k] = size;
  o->record.keyframe_count = keyframes;
  o->record.keyframes = calloc((size_t)keyframes, sizeof *o->record.keyframes);
  for (int64_t i = 0; i < keyframes; i++) {
    memcpy(o->record.keyframes[i].world_from_object, identity, sizeof identity);
    o->record.keyframes[i].world_from_object[7] = left;
    o->record.keyframes[i].time = 0.1 * (double)i;
  }
}

/* A scene of a background without Gaussians, a ball, an object of three Gaussians and a flat object, each of another
 * size. A fourth object of three Gaussians has the ball's size. */
static pags_scene built_scene(void) {
  pags_scene scene = {.up = PAGS_UP_Z};
  scene.model_count = 4;
  scene.models = calloc(4, sizeof *scene.models);
  scene.objects = calloc(4, sizeof *scene.objects);
  for (int i = 0; i < 4; i++) {
    scene.models[i].name = pags_text_copy(i ? "model" : "background");
    scene.models[i].file = NULL;
  }
  assert_int_equal(pags_gaussians_create(&scene.models[0].gaussians, 0, 0), PAGS_OK);
  /* Above the ground, as low and level Gaussians would count as shadow. */
  fill_ball(&scene.models[1].gaussians, 7000, 0.7, 0);
  fill_ball(&scene.models[2].gaussians, 3, 0.8, 0);
  fill_ball(&scene.models[3].gaussians, 400, 0.8, 1);
  add_object(&scene, "ball", 1, 1.7, 0, 3);
  add_object(&scene, "three", 2, 1.2, 2, 1);
  add_object(&scene, "flat", 3, 2.1, -2, 1);
  add_object(&scene, "like", 2, 1.7, 4, 1);
  add_views(&scene, 16);
  return scene;
}

static void test_proxies_of_a_scene(void **state) {
  (void)state;
  char path[1024];
  pags_tasks *tasks = pags_tasks_create(2);
  pags_scene scene = built_scene();
  for (int level = PAGS_PROXY_MESH; level < PAGS_PROXY_LEVELS; level++) {
    pags_proxy_options options = pags_proxy_options_default();
    pags_proxy_report report;
    options.level = (pags_proxy_level)level;
    options.triangles = 800;
    snprintf(path, 1024, "%s/%d.glb", scratch_folder, level);
    assert_int_equal(pags_export_proxies(&scene, path, &options, tasks, NULL, NULL, &report), PAGS_OK);
    assert_int_equal(report.count, 4);
    assert_string_equal(report.proxies[0].name, "regular_vehicle_0000");
    assert_int_equal(report.proxies[0].level, level);
    assert_null(report.proxies[0].note);
    for (int i = 0; i < 4; i++) {
      assert_true(report.proxies[i].closed);
      assert_true(report.proxies[i].triangles <= 800);
    }
    if (level != PAGS_PROXY_BOX) {
      assert_true(report.proxies[0].to_gaussians.mean < 0.04);
      assert_true(report.proxies[0].from_gaussians.mean < 0.04);
      /* One part of 100 triangles has 52 vertices on the ball. */
      assert_true(report.proxies[0].silhouette_iou > (level == PAGS_PROXY_CONVEX ? 0.85 : 0.9));
      assert_int_equal(report.proxies[1].level, PAGS_PROXY_BOX);
      assert_non_null(report.proxies[1].note);
      /* The fourth object takes the ball's shape as a prior, and the note says so. */
      assert_int_equal(report.proxies[3].level, level);
      assert_non_null(strstr(report.proxies[3].note, "of its size"));
      assert_true(report.proxies[3].observed < 0.01);
      assert_true(fabs(report.proxies[3].volume / report.proxies[0].volume - 1) < 0.06);
    }
    pags_proxy_report_destroy(&report);
  }
  pags_scene_destroy(&scene);
  pags_tasks_destroy(tasks);
}

/* A small ball near the large one, not connected to it, is part of the mesh. */
static void test_what_stands_off_is_kept(void **state) {
  (void)state;
  char path[1024];
  pags_tasks *tasks = pags_tasks_create(2);
  pags_scene scene = built_scene();
  pags_gaussians *g = &scene.models[1].gaussians;
  pags_proxy_options options = pags_proxy_options_default();
  pags_proxy_report report;
  for (int64_t i = 0; i < g->count; i += 8)
    for (int k = 0; k < 3; k++)
      pags_plane(g, PAGS_MEAN + k)[i] = pags_plane(g, PAGS_MEAN + k)[i] * 0.1f + (k == 0 ? 0.7f : 0);
  for (int64_t i = 0; i < g->count; i++)
    if (i % 8)
      for (int k = 0; k < 3; k++)
        pags_plane(g, PAGS_MEAN + k)[i] *= 0.65f;
  snprintf(path, 1024, "%s/off.glb", scratch_folder);
  assert_int_equal(pags_export_proxies(&scene, path, &options, tasks, NULL, NULL, &report), PAGS_OK);
  assert_true(report.proxies[0].closed);
  assert_true(report.proxies[0].from_gaussians.max < 0.1);
  pags_proxy_report_destroy(&report);
  pags_scene_destroy(&scene);
  pags_tasks_destroy(tasks);
}

static void test_same_bytes(void **state) {
  (void)state;
  char path[2][1024];
  uint8_t *bytes[2];
  size_t sizes[2];
  pags_scene scene = built_scene();
  pags_proxy_options options = pags_proxy_options_default();
  options.lod = 1;
  options.physics = 1;
  options.visibility = 1;
  for (int i = 0; i < 2; i++) {
    pags_tasks *tasks = pags_tasks_create(i ? 3 : 1);
    snprintf(path[i], 1024, "%s/same%d.glb", scratch_folder, i);
    assert_int_equal(pags_export_proxies(&scene, path[i], &options, tasks, NULL, NULL, NULL), PAGS_OK);
    assert_int_equal(pags_file_read(path[i], &bytes[i], &sizes[i]), PAGS_OK);
    pags_tasks_destroy(tasks);
  }
  assert_int_equal(sizes[0], sizes[1]);
  assert_memory_equal(bytes[0], bytes[1], sizes[0]);
  free(bytes[0]);
  free(bytes[1]);
  pags_scene_destroy(&scene);
}

static void test_empty_scene(void **state) {
  (void)state;
  char path[1024];
  pags_scene scene = {.up = PAGS_UP_Z};
  pags_proxy_options options = pags_proxy_options_default();
  pags_proxy_report report;
  pags_tasks *tasks = pags_tasks_create(1);
  snprintf(path, 1024, "%s/empty.gltf", scratch_folder);
  assert_int_equal(pags_export_proxies(&scene, path, &options, tasks, NULL, NULL, &report), PAGS_OK);
  assert_int_equal(report.count, 0);
  pags_proxy_report_destroy(&report);
  pags_tasks_destroy(tasks);
}

/* A Gaussian with an alpha_min is exported with the same alpha at its mean and the same integral over the picture,
 * for viewers that cut at 1/255. Gaussians that are never visible are left out. If all parts have the same alpha_min,
 * the file can keep it. */
static void test_other_cuts(void **state) {
  (void)state;
  pags_gaussians g[2], baked;
  pags_part parts[2];
  for (int p = 0; p < 2; p++) {
    assert_int_equal(pags_gaussians_create(&g[p], 2, 0), PAGS_OK);
    for (int i = 0; i < 2; i++) {
      pags_plane(&g[p], PAGS_ROTATION)[i] = 1;
      pags_plane(&g[p], PAGS_OPACITY)[i] = i ? -4.6f : 0; /* opacities of 1/2 and 0.00995 */
    }
    parts[p] = (pags_part){.gaussians = &g[p], .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  }
  g[0].alpha_min = 0.02f;
  assert_int_equal(pags_splats_bake(parts, 2, 0, true, &baked), PAGS_OK);
  assert_true(baked.count == 3 && baked.alpha_min == 0.0f);
  const double a = (double)0.02f, alpha = 1 / (1 + exp(-(double)pags_plane(&baked, PAGS_OPACITY)[0]));
  const double variance = exp(2 * (double)pags_plane(&baked, PAGS_SCALE)[0]);
  double covered = 0; /* integral of (o G - a) / (1 - a) over rings of the plane */
  for (double r = 0.0005; r < 6; r += 0.001)
    covered += fmax(0, (0.5 * exp(-0.5 * r * r) - a) / (1 - a)) * 2 * 3.14159265358979 * r * 0.001;
  assert_true(fabs(alpha - (0.5 - a) / (1 - a)) < 1e-6);
  assert_true(fabs(alpha * variance * 2 * 3.14159265358979 - covered) < 1e-4);
  assert_true(pags_plane(&baked, PAGS_SCALE)[1] == 0 && pags_plane(&baked, PAGS_OPACITY)[2] == -4.6f);
  pags_gaussians_destroy(&baked);
  g[1].alpha_min = 0.02f;
  assert_int_equal(pags_splats_bake(parts, 2, 0, true, &baked), PAGS_OK);
  assert_true(baked.count == 4 && baked.alpha_min == 0.02f && pags_plane(&baked, PAGS_SCALE)[0] == 0);
  pags_gaussians_destroy(&baked);
  pags_gaussians_destroy(&g[0]);
  pags_gaussians_destroy(&g[1]);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_box),
      cmocka_unit_test(test_surface_is_closed_and_where_it_should_be),
      cmocka_unit_test(test_budgets),
      cmocka_unit_test(test_repair),
      cmocka_unit_test(test_slab),
      cmocka_unit_test(test_parts),
      cmocka_unit_test(test_hull),
      cmocka_unit_test(test_cage),
      cmocka_unit_test(test_nearest_point),
      cmocka_unit_test(test_half_turns),
      cmocka_unit_test(test_turns_compose),
      cmocka_unit_test(test_splat_files),
      cmocka_unit_test(test_other_cuts),
      cmocka_unit_test(test_spz_beyond_its_range),
      cmocka_unit_test(test_proxies_of_a_scene),
      cmocka_unit_test(test_what_stands_off_is_kept),
      cmocka_unit_test(test_same_bytes),
      cmocka_unit_test(test_empty_scene),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
