/* SPDX-License-Identifier: Apache-2.0 */
/* Textures: charts show each place once and at the resolution that was asked for, also where a surface lies above
 * itself; in an atlas no chart shows the colour of another. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/memory.h"
#include "exporters/proxy/texture.h"
#include "image/formats.h"

static const float grey[3] = {0.5f, 0.5f, 0.5f};

/* Whether the middle of a texel is well inside of a triangle of a texture. */
static bool is_inside(const float *t, double x, double y, double margin) {
  for (int k = 0; k < 3; k++) {
    const float *a = t + 2 * k, *b = t + 2 * ((k + 1) % 3);
    const double dx = (double)(b[0] - a[0]), dy = (double)(b[1] - a[1]), length = hypot(dx, dy);
    if (!(dx * (y - (double)a[1]) - dy * (x - (double)a[0]) > margin * length))
      return false;
  }
  return true;
}

/* Cuts a mesh and checks that each texel has the one triangle that covers it, and that edges have about `need` texels a
 * metre. */
static void check(const pags_proxy_mesh *mesh, float need, double most, double least_share, pags_texture *texture) {
  PAGS_AUTOFREE int32_t *owners = NULL;
  PAGS_AUTOFREE float *needs = malloc((size_t)mesh->triangle_count * sizeof *needs);
  for (int64_t t = 0; t < mesh->triangle_count; t++)
    needs[t] = need;
  *texture = (pags_texture){0};
  assert_int_equal(pags_charts_make(mesh, needs, most, texture, &owners), PAGS_OK);
  for (int64_t t = 0; t < mesh->triangle_count; t++) {
    assert_in_range(texture->chart_of[t], 0, texture->chart_count - 1);
    const pags_chart *chart = &texture->charts[texture->chart_of[t]];
    const float *uv = texture->uv + 6 * t;
    double p[3][3];
    pags_proxy_mesh_corners(mesh, t, p);
    for (int k = 0; k < 3; k++) {
      const double length = pags_distance3(p[k], p[(k + 1) % 3]) * (double)need;
      const double pixels =
          hypot((double)(uv[2 * k] - uv[(2 * k + 2) % 6]), (double)(uv[2 * k + 1] - uv[(2 * k + 3) % 6]));
      assert_true(pixels > least_share * length - 0.2 && pixels < length + 0.2);
      assert_true(uv[2 * k] >= 0.5f && uv[2 * k] <= (float)chart->width - 0.5f);
      assert_true(uv[2 * k + 1] >= 0.5f && uv[2 * k + 1] <= (float)chart->height - 0.5f);
    }
    for (int i = 0; i < chart->width * chart->height; i++)
      if (is_inside(uv, i % chart->width + 0.5, i / chart->width + 0.5, 0.01))
        assert_int_equal(owners[chart->texel + i], t);
  }
}

static void boxes_have_a_chart_for_each_side(void **state) {
  (void)state;
  pags_proxy_mesh mesh;
  pags_texture texture;
  const double size[3] = {2, 1, 1};
  assert_int_equal(pags_proxy_mesh_box(size, grey, &mesh), PAGS_OK);
  check(&mesh, 40, 1e9, 0.99, &texture);
  assert_int_equal(texture.chart_count, 6);
  assert_true(texture.texel_count > 10 * 1600 && texture.texel_count < 10 * 1600 * 1.1);
  pags_texture_destroy(&texture);
  check(&mesh, 40, 4000, 0.49, &texture); /* a limit of a quarter of that */
  assert_true(texture.texel_count > 3900 && texture.texel_count < 4800);
  pags_texture_destroy(&texture);
  pags_proxy_mesh_destroy(&mesh);
}

/* A ramp of two turns, whose upper turn lies above the lower one. */
static void surfaces_above_each_other_are_cut(void **state) {
  (void)state;
  enum { STEPS = 96 };
  pags_proxy_mesh mesh = {0};
  pags_texture texture;
  for (int i = 0; i <= STEPS; i++)
    for (int side = 0; side < 2; side++) {
      const double angle = 4 * 3.14159265358979 * i / STEPS, radius = 2 + side;
      const float p[3] = {(float)(radius * cos(angle)), (float)(radius * sin(angle)), (float)(2.0 * i / STEPS)};
      pags_proxy_mesh_vertex(&mesh, p, grey, 1);
    }
  for (uint32_t i = 0; i < 2 * STEPS; i += 2) {
    pags_proxy_mesh_triangle(&mesh, i, i + 1, i + 3);
    pags_proxy_mesh_triangle(&mesh, i, i + 3, i + 2);
  }
  check(&mesh, 20, 1e9, 0.7, &texture);
  assert_in_range(texture.chart_count, 2, 8);
  pags_texture_destroy(&texture);
  pags_proxy_mesh_destroy(&mesh);
}

/* Paints the charts of three boxes in one colour each. All places near a chart have its colour, at full size and where
 * all must shrink. */
static void charts_in_an_atlas_keep_their_colours(void **state) {
  (void)state;
  static const uint8_t colors[3][3] = {{200, 40, 40}, {40, 200, 40}, {40, 40, 200}};
  for (int side = 64; side <= 512; side *= 8) {
    pags_proxy_mesh meshes[3];
    pags_texture textures[3], *list[3];
    int64_t triangles[3];
    pags_atlas atlas = {0};
    pags_image image = {0};
    for (int i = 0; i < 3; i++) {
      const double size[3] = {1 + i, 1, 0.5 * i + 0.2};
      assert_int_equal(pags_proxy_mesh_box(size, grey, &meshes[i]), PAGS_OK);
      check(&meshes[i], 30, 1e9, 0.99, &textures[i]);
      textures[i].rgb = malloc(3 * (size_t)textures[i].texel_count);
      for (int64_t k = 0; k < textures[i].texel_count; k++)
        memcpy(textures[i].rgb + 3 * k, colors[i], 3);
      list[i] = &textures[i];
      triangles[i] = meshes[i].triangle_count;
    }
    assert_int_equal(pags_atlas_make(list, triangles, 3, side, &atlas), PAGS_OK);
    assert_true(atlas.width <= side && atlas.height <= side &&
                (side > 64 || atlas.width * atlas.height > side * side / 2));
    const pags_encoded file = {.path = "atlas", .bytes = atlas.jpeg, .size = atlas.jpeg_size};
    assert_int_equal(pags_jpeg_decode(&file, 3, &image), PAGS_OK);
    assert_int_equal(image.width, atlas.width);
    for (int i = 0; i < 3; i++)
      for (int64_t k = 0; k < 3 * triangles[i]; k++)
        for (int way = 0; way < 9; way++) {
          const int x = (int)((double)textures[i].uv[2 * k] * atlas.width + 1.4 * (way % 3 - 1)),
                    y = (int)((double)textures[i].uv[2 * k + 1] * atlas.height + 1.4 * (way / 3 - 1));
          const uint8_t *pixel = (const uint8_t *)image.data + 3 * ((int64_t)y * atlas.width + x);
          for (int c = 0; c < 3; c++)
            assert_true(abs(pixel[c] - colors[i][c]) < 60);
        }
    pags_image_destroy(&image);
    pags_atlas_destroy(&atlas);
    for (int i = 0; i < 3; i++) {
      pags_texture_destroy(&textures[i]);
      pags_proxy_mesh_destroy(&meshes[i]);
    }
  }
}

static void too_many_charts_are_an_error(void **state) {
  (void)state;
  pags_proxy_mesh mesh;
  pags_texture texture, *list = &texture;
  pags_atlas atlas = {0};
  const double size[3] = {1, 1, 1};
  assert_int_equal(pags_proxy_mesh_box(size, grey, &mesh), PAGS_OK);
  check(&mesh, 20, 1e9, 0.99, &texture);
  texture.rgb = calloc(3, (size_t)texture.texel_count);
  assert_int_equal(pags_atlas_make(&list, &mesh.triangle_count, 1, 8, &atlas), PAGS_ERROR_LIMIT);
  assert_non_null(strstr(pags_error_message(), "6 charts"));
  pags_atlas_destroy(&atlas);
  pags_texture_destroy(&texture);
  pags_proxy_mesh_destroy(&mesh);
}

/* Without views, a texture has one colour. */
static void unseen_surfaces_are_grey(void **state) {
  (void)state;
  pags_proxy_mesh mesh;
  pags_texture texture = {0};
  const pags_depth_views views = {0};
  const double size[3] = {1, 2, 3};
  pags_tasks *tasks = pags_tasks_create(1);
  assert_int_equal(pags_proxy_mesh_box(size, grey, &mesh), PAGS_OK);
  assert_int_equal(pags_texture_bake(&mesh, &views, 0.1, 1e6, tasks, &texture), PAGS_OK);
  for (int64_t i = 0; i < 3 * texture.texel_count; i++)
    assert_int_equal(texture.rgb[i], 128);
  pags_tasks_destroy(tasks);
  pags_texture_destroy(&texture);
  pags_proxy_mesh_destroy(&mesh);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(boxes_have_a_chart_for_each_side), cmocka_unit_test(surfaces_above_each_other_are_cut),
      cmocka_unit_test(charts_in_an_atlas_keep_their_colours), cmocka_unit_test(too_many_charts_are_an_error),
      cmocka_unit_test(unseen_surfaces_are_grey)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
