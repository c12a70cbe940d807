/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the division of meshes into convex parts: an angle becomes two blocks, a ball stays one part, and the parts
 * of a ring cover it and leave its hole free. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/vec3.h"
#include "exporters/proxy/convex_parts.h"
#include "exporters/proxy/tsdf.h"

static pags_proxy_mesh_topology inspect(const pags_proxy_mesh *mesh) {
  pags_proxy_mesh_topology topology;
  assert_int_equal(pags_proxy_mesh_inspect(mesh, &topology), PAGS_OK);
  return topology;
}

/* Makes the parts and checks that they are closed, convex, within the limits and without common vertices. Returns
 * the sum of their volumes. */
static double make_parts(const pags_proxy_mesh *mesh, int64_t budget, pags_proxy_mesh *out, pags_convex_parts *parts) {
  double sum = 0;
  assert_int_equal(pags_proxy_mesh_convex(mesh, budget, out, parts), PAGS_OK);
  assert_true(out->triangle_count <= budget);
  assert_true(parts->count >= 1 && parts->count <= PAGS_MOST_PARTS);
  assert_int_equal(parts->ends[parts->count - 1], out->triangle_count);
  int64_t vertices = 0;
  for (int i = 0; i < parts->count; i++) {
    pags_proxy_mesh part;
    assert_int_equal(pags_convex_part(out, parts, i, &part), PAGS_OK);
    assert_true(part.triangle_count <= PAGS_PART_TRIANGLES);
    assert_true(inspect(&part).closed);
    sum += inspect(&part).volume;
    vertices += part.vertex_count;
    pags_proxy_mesh_destroy(&part);
  }
  assert_int_equal(vertices, out->vertex_count);
  return sum;
}

/* Returns the distance of a point from one part: the largest distance in front of any of its faces, 0 or less inside.
 */
static double outside(const pags_proxy_mesh *mesh, int64_t begin, int64_t end, const float *point) {
  double most = -HUGE_VAL;
  for (int64_t t = begin; t < end; t++) {
    double v[3][3], n[3], to[3];
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        v[i][k] = (double)mesh->positions[3 * (int64_t)mesh->triangles[3 * t + i] + k];
    for (int k = 0; k < 3; k++) {
      to[k] = (double)point[k] - v[0][k];
      v[1][k] -= v[0][k];
      v[2][k] -= v[0][k];
    }
    pags_cross3(v[1], v[2], n);
    most = fmax(most, pags_dot3(n, to) / pags_length3(n));
  }
  return most;
}

static void assert_convex(const pags_proxy_mesh *mesh, const pags_convex_parts *parts) {
  for (int i = 0; i < parts->count; i++) {
    const int64_t begin = i ? parts->ends[i - 1] : 0;
    for (int64_t c = 3 * begin; c < 3 * parts->ends[i]; c++)
      assert_true(outside(mesh, begin, parts->ends[i], mesh->positions + 3 * (int64_t)mesh->triangles[c]) < 1e-5);
  }
}

static void test_angle(void **state) {
  (void)state;
  static const float corners[6][2] = {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}}, grey[3] = {0.5f, 0.5f, 0.5f};
  static const uint32_t face[4][3] = {{0, 1, 3}, {1, 2, 3}, {0, 3, 5}, {3, 4, 5}};
  pags_proxy_mesh mesh = {0}, out;
  pags_convex_parts parts;
  for (int z = 0; z < 2; z++)
    for (int i = 0; i < 6; i++)
      pags_proxy_mesh_vertex(&mesh, (const float[3]){corners[i][0], corners[i][1], (float)z}, grey, 1);
  for (uint32_t i = 0; i < 6; i++) {
    const uint32_t next = (i + 1) % 6;
    pags_proxy_mesh_triangle(&mesh, i, next, 6 + next);
    pags_proxy_mesh_triangle(&mesh, i, 6 + next, 6 + i);
  }
  for (int i = 0; i < 4; i++) {
    pags_proxy_mesh_triangle(&mesh, face[i][0], face[i][2], face[i][1]);
    pags_proxy_mesh_triangle(&mesh, 6 + face[i][0], 6 + face[i][1], 6 + face[i][2]);
  }
  assert_true(inspect(&mesh).closed);
  assert_true(fabs(inspect(&mesh).volume - 3) < 1e-6);
  assert_true(fabs(make_parts(&mesh, 4000, &out, &parts) - 3) < 1e-3); /* a single hull would have a volume of 3.5 */
  assert_int_equal(parts.count, 2);
  assert_convex(&out, &parts);
  pags_proxy_mesh_destroy(&out);
  make_parts(&mesh, 12, &out, &parts); /* the limit allows only one part */
  assert_int_equal(parts.count, 1);
  pags_proxy_mesh_destroy(&out);
  pags_proxy_mesh_destroy(&mesh);
}

/* A ball of 1 m, or a ring: a circle of 1.2 m radius with a section of 0.4 m by 0.4 m. */
static pags_proxy_mesh round_mesh(bool ring) {
  const double lo[3] = {-2, -2, -2}, hi[3] = {2, 2, 2}, step = 0.1;
  pags_tsdf grid;
  pags_proxy_mesh mesh;
  assert_int_equal(pags_tsdf_create(&grid, lo, hi, step, 0), PAGS_OK);
  for (int z = 0; z < grid.n[2]; z++)
    for (int y = 0; y < grid.n[1]; y++)
      for (int x = 0; x < grid.n[0]; x++) {
        const double p[3] = {lo[0] + x * step, lo[1] + y * step, lo[2] + z * step};
        const double r = sqrt(p[0] * p[0] + p[1] * p[1]) - 1.2;
        grid.distance[(z * grid.n[1] + y) * grid.n[0] + x] =
            (float)(ring ? sqrt(r * r + p[2] * p[2]) - 0.4 : pags_length3(p) - 1);
      }
  assert_int_equal(pags_tsdf_surface(&grid, 0, &mesh), PAGS_OK);
  pags_tsdf_destroy(&grid);
  return mesh;
}

static void test_ball(void **state) {
  (void)state;
  pags_proxy_mesh mesh = round_mesh(false), out;
  pags_convex_parts parts;
  make_parts(&mesh, 4000, &out, &parts);
  assert_int_equal(parts.count, 1);
  pags_proxy_mesh_destroy(&out);
  pags_proxy_mesh_destroy(&mesh);
}

static void test_ring(void **state) {
  (void)state;
  static const float middle[3] = {0, 0, 0};
  pags_proxy_mesh mesh = round_mesh(true), out, hull;
  pags_convex_parts parts;
  assert_int_equal(pags_proxy_mesh_hull(&mesh, 252, &hull), PAGS_OK);
  const double sum = make_parts(&mesh, 4000, &out, &parts);
  assert_true(parts.count >= 4);
  assert_true(sum < 0.75 * inspect(&hull).volume);
  assert_true(sum > inspect(&mesh).volume * 0.97);
  assert_convex(&out, &parts);
  double worst =
      0; /* largest distance of a vertex of the ring from all parts: 64 vertices cut off 8 cm of its roundness */
  for (int64_t i = 0; i < mesh.vertex_count; i++) {
    double least = HUGE_VAL;
    for (int p = 0; p < parts.count; p++)
      least = fmin(least, outside(&out, p ? parts.ends[p - 1] : 0, parts.ends[p], mesh.positions + 3 * i));
    worst = fmax(worst, least);
  }
  assert_true(worst < 0.09);
  for (int p = 0; p < parts.count; p++)
    assert_true(outside(&out, p ? parts.ends[p - 1] : 0, parts.ends[p], middle) > 0.1); /* the hole is free */
  pags_proxy_mesh_destroy(&hull);
  pags_proxy_mesh_destroy(&out);
  pags_proxy_mesh_destroy(&mesh);
}

static void test_flat(void **state) {
  (void)state;
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  pags_proxy_mesh mesh = {0}, out;
  pags_convex_parts parts;
  for (int i = 0; i < 4; i++)
    pags_proxy_mesh_vertex(&mesh, (const float[3]){(float)(i & 1), (float)(i >> 1), 0}, grey, 1);
  for (uint32_t i = 0; i < 2; i++) { /* both triangles of a square */
    pags_proxy_mesh_triangle(&mesh, 0, 1 + i, 2 - i);
    pags_proxy_mesh_triangle(&mesh, 3, 2 - i, 1 + i);
  }
  assert_int_equal(pags_proxy_mesh_convex(&mesh, 4000, &out, &parts), PAGS_ERROR_ARGUMENT);
  pags_proxy_mesh_destroy(&mesh);
}

/* A ring and a box next to it become the ring's parts and the box as it is. */
static void test_several_surfaces(void **state) {
  (void)state;
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  const double size[3] = {0.3, 0.2, 0.1};
  pags_proxy_mesh mesh = round_mesh(true), box, *parts;
  int64_t count, boxes = 0;
  double sum = 0;
  assert_int_equal(pags_proxy_mesh_box(size, grey, &box), PAGS_OK);
  const double wanted = inspect(&mesh).volume + inspect(&box).volume;
  for (int64_t i = 0; i < box.vertex_count; i++)
    box.positions[3 * i] += 9;
  assert_int_equal(pags_proxy_mesh_append(&box, &mesh), PAGS_OK);
  assert_int_equal(pags_convex_meshes_make(&mesh, &parts, &count), PAGS_OK);
  assert_true(count >= 5 && count <= PAGS_MOST_PARTS + 1);
  for (int64_t i = 0; i < count; i++) {
    double lo[3], hi[3];
    assert_true(inspect(&parts[i]).closed);
    sum += inspect(&parts[i]).volume;
    pags_proxy_mesh_bounds(&parts[i], lo, hi);
    boxes += lo[0] > 8;
    if (lo[0] > 8)
      assert_int_equal(parts[i].triangle_count, 12);
    pags_proxy_mesh_destroy(&parts[i]);
  }
  assert_int_equal(boxes, 1);
  assert_true(sum > 0.97 * wanted && sum < 1.3 * wanted);
  free(parts);
  pags_proxy_mesh_destroy(&box);
  pags_proxy_mesh_destroy(&mesh);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_angle), cmocka_unit_test(test_ball),
                                     cmocka_unit_test(test_ring), cmocka_unit_test(test_flat),
                                     cmocka_unit_test(test_several_surfaces)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
