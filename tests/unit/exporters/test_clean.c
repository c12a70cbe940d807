/* SPDX-License-Identifier: Apache-2.0 */
/* pags_proxy_mesh_clean makes meshes fit for physics: it removes needles, caps, double triangles and edges of more
 * than two faces. Closed meshes stay closed, good meshes stay unchanged. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "exporters/proxy/mesh.h"

static const float grey[3] = {0.5f, 0.5f, 0.5f};

static pags_proxy_mesh box(void) {
  pags_proxy_mesh mesh;
  const double size[3] = {2, 1, 1};
  assert_int_equal(pags_proxy_mesh_box(size, grey, &mesh), PAGS_OK);
  return mesh;
}

static double area_of(const pags_proxy_mesh *m, int64_t i) {
  double p[3][3], n = 0;
  for (int c = 0; c < 3; c++)
    for (int k = 0; k < 3; k++)
      p[c][k] = (double)m->positions[3 * (int64_t)m->triangles[3 * i + c] + k];
  for (int k = 0; k < 3; k++) {
    const int u = (k + 1) % 3, v = (k + 2) % 3;
    const double a = (p[1][u] - p[0][u]) * (p[2][v] - p[0][v]) - (p[1][v] - p[0][v]) * (p[2][u] - p[0][u]);
    n += a * a;
  }
  return 0.5 * sqrt(n);
}

/* Checks the guarantees of a cleaned mesh. */
static void check(const pags_proxy_mesh *m, bool closed) {
  pags_proxy_mesh_topology topology;
  assert_int_equal(pags_proxy_mesh_inspect(m, &topology), PAGS_OK);
  assert_int_equal(topology.closed, closed);
  assert_int_equal(topology.crossed_edges, 0);
  for (int64_t i = 0; i < m->triangle_count; i++)
    assert_true(area_of(m, i) > 1e-10);
  for (int64_t i = 0; i < m->vertex_count; i++)
    for (int64_t j = 0; j < i; j++)
      assert_memory_not_equal(m->positions + 3 * i, m->positions + 3 * j, 3 * sizeof(float));
}

/* Splits triangle 0 at a vertex near or on its edge: `share` of the way from its first corner to its second, `off` of
 * the way to the third. The neighbour beyond the edge is left whole if `off` > 0. */
static void split(pags_proxy_mesh *m, float share, float off) {
  const uint32_t a = m->triangles[0], b = m->triangles[1], c = m->triangles[2];
  float p[3];
  for (int k = 0; k < 3; k++) {
    const float *pa = m->positions + 3 * a, *pb = m->positions + 3 * b, *pc = m->positions + 3 * c;
    p[k] = (1 - off) * ((1 - share) * pa[k] + share * pb[k]) + off * pc[k];
  }
  const uint32_t v = pags_proxy_mesh_vertex(m, p, grey, 1);
  m->triangles[2] = v; /* a b v: a cap or a needle */
  pags_proxy_mesh_triangle(m, b, c, v);
  pags_proxy_mesh_triangle(m, c, a, v);
}

static void good_mesh_stays(void **state) {
  (void)state;
  pags_proxy_mesh m = box();
  assert_int_equal(pags_proxy_mesh_clean(&m), PAGS_OK);
  assert_int_equal(m.vertex_count, 8);
  assert_int_equal(m.triangle_count, 12);
  check(&m, true);
  pags_proxy_mesh_destroy(&m);
}

static void caps_and_needles_are_removed(void **state) {
  (void)state;
  static const float places[][2] = {{0.5f, 0}, {0.3f, 1e-11f}, {1e-9f, 0}, {1, 0}, {0.999999f, 1e-12f}};
  for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
    pags_proxy_mesh m = box();
    pags_proxy_mesh_topology topology;
    split(&m, places[i][0], places[i][1]);
    assert_int_equal(pags_proxy_mesh_clean(&m), PAGS_OK);
    check(&m, true);
    assert_int_equal(pags_proxy_mesh_inspect(&m, &topology), PAGS_OK);
    assert_true(fabs(topology.volume - 2) < 1e-3);
    pags_proxy_mesh_destroy(&m);
  }
}

/* Two boxes share an edge of four faces, which the cleaning separates. */
static void boxes_that_share_an_edge_are_separated(void **state) {
  (void)state;
  pags_proxy_mesh m = box(), other = box();
  uint32_t at[8];
  for (uint32_t i = 0; i < 8; i++) {
    const float p[3] = {other.positions[3 * i] + 2, other.positions[3 * i + 1] + 1, other.positions[3 * i + 2]};
    at[i] = UINT32_MAX;
    for (uint32_t j = 0; j < 8; j++)
      at[i] = memcmp(m.positions + 3 * j, p, sizeof p) ? at[i] : j;
    at[i] = at[i] == UINT32_MAX ? pags_proxy_mesh_vertex(&m, p, grey, 1) : at[i];
  }
  for (int64_t i = 0; i < other.triangle_count; i++)
    pags_proxy_mesh_triangle(&m, at[other.triangles[3 * i]], at[other.triangles[3 * i + 1]],
                             at[other.triangles[3 * i + 2]]);
  assert_int_equal(m.vertex_count, 14);
  assert_int_equal(pags_proxy_mesh_clean(&m), PAGS_OK);
  assert_int_equal(m.triangle_count, 24);
  check(&m, true);
  pags_proxy_mesh_destroy(&m);
  pags_proxy_mesh_destroy(&other);
}

/* An open sheet has a double triangle, once turned over, and an edge with a third face. */
static void open_sheets_are_cleaned(void **state) {
  (void)state;
  static const float places[6][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5f, 0.5f, 1}, {-1, 1, 0.5f}};
  static const uint32_t faces[6][3] = {{0, 1, 2}, {0, 2, 3}, {0, 1, 2}, {2, 1, 0}, {0, 2, 4}, {0, 3, 5}};
  pags_proxy_mesh m = {0};
  for (int i = 0; i < 6; i++)
    pags_proxy_mesh_vertex(&m, places[i], grey, 1);
  for (int i = 0; i < 6; i++)
    pags_proxy_mesh_triangle(&m, faces[i][0], faces[i][1], faces[i][2]);
  assert_int_equal(pags_proxy_mesh_clean(&m), PAGS_OK);
  assert_int_equal(m.triangle_count, 4);
  check(&m, false);
  pags_proxy_mesh_destroy(&m);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(good_mesh_stays),
      cmocka_unit_test(caps_and_needles_are_removed),
      cmocka_unit_test(boxes_that_share_an_edge_are_separated),
      cmocka_unit_test(open_sheets_are_cleaned),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
