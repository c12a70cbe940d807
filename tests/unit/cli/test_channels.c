/* SPDX-License-Identifier: Apache-2.0 */
/* Tests normals computed from depth, and the colour map of priorities. */
#include "cli/draw/picture.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

enum { WIDTH = 20, HEIGHT = 12, STRIDE = 32 };

typedef struct fixture {
  float depth[HEIGHT * STRIDE], normal[3][HEIGHT * STRIDE];
  pags_camera camera;
  pags_picture picture;
} fixture;

/* A camera rolled by a quarter turn about its viewing axis: its right axis is the world's down axis. */
static fixture *make(void) {
  fixture *f = calloc(1, sizeof *f);
  assert_non_null(f);
  f->camera = (pags_camera){.width = WIDTH,
                            .height = HEIGHT,
                            .fx = 30,
                            .fy = 25,
                            .cx = 9,
                            .cy = 6.5,
                            .world_from_camera = {0, 1, 0, 5, -1, 0, 0, 6, 0, 0, 1, 7}};
  f->picture = (pags_picture){.width = WIDTH, .height = HEIGHT, .stride = STRIDE, .depth = f->depth};
  return f;
}

/* Sets the depth of the plane n . p = d (camera axes) in columns [first, last). */
static void put_plane(fixture *f, const double n[3], double d, int first, int last) {
  for (int y = 0; y < HEIGHT; y++)
    for (int x = first; x < last; x++) {
      double rx = (x + 0.5 - f->camera.cx) / f->camera.fx, ry = (y + 0.5 - f->camera.cy) / f->camera.fy;
      f->depth[y * STRIDE + x] = (float)(d / (n[0] * rx + n[1] * ry + n[2]));
    }
}

static void assert_normals(fixture *f, int first, int last, const double n[3]) {
  const double world[3] = {n[1], -n[0], n[2]};
  for (int y = 0; y < HEIGHT; y++)
    for (int x = first; x < last; x++)
      for (int k = 0; k < 3; k++)
        assert_float_equal(f->normal[k][y * STRIDE + x], world[k], 1e-3);
}

static void compute(fixture *f) {
  pags_normals_from_depth(&f->picture, &f->camera, (float *const[3]){f->normal[0], f->normal[1], f->normal[2]});
}

static void planes_keep_their_normals_up_to_the_edge(void **state) {
  (void)state;
  fixture *f = make();
  const double near[3] = {0.48, -0.6, -0.64}, far[3] = {-0.6, 0, -0.8}; /* unit normals that point towards the camera */
  put_plane(f, near, -3, 0, 9);
  put_plane(f, far, -30, 9, WIDTH);
  compute(f);
  assert_normals(f, 0, 9, near);
  assert_normals(f, 9, WIDTH, far);
  free(f);
}

static void empty_pixels_have_no_normal(void **state) {
  (void)state;
  fixture *f = make();
  const double front[3] = {0, 0, -1};
  put_plane(f, front, -4, 3, 6);
  f->depth[5 * STRIDE + 12] = 2; /* a single pixel without neighbours */
  compute(f);
  assert_normals(f, 3, 6, front);
  assert_normals(f, 6, WIDTH, (const double[]){0, 0, 0});
  free(f);
}

static void the_colour_map_grows_lighter(void **state) {
  (void)state;
  float before = -1, rgb[3];
  for (int i = 0; i <= 100; i++) {
    pags_colormap_heat((float)i / 100, rgb);
    float light = 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2];
    assert_true(light > before);
    before = light;
  }
  float ends[2][3];
  pags_colormap_heat(-3, ends[0]);
  pags_colormap_heat(NAN, ends[1]);
  assert_memory_equal(ends[0], ends[1], sizeof ends[0]);
  pags_colormap_heat(7, ends[0]);
  assert_memory_equal(ends[0], rgb, sizeof rgb);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(planes_keep_their_normals_up_to_the_edge),
      cmocka_unit_test(empty_pixels_have_no_normal),
      cmocka_unit_test(the_colour_map_grows_lighter),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
