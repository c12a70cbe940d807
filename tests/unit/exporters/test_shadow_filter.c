/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the filter that separates a vehicle from the shadow and the road below it: which parts of a depth view it
 * removes, and which it keeps. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "exporters/proxy/depth_view.h"

enum { SIDE = 4, PIXELS = SIDE * SIDE };

/* Filters a depth view taken 1 m from `place`, from above or from the vehicle's side, of a patch at one depth and of
 * one brightness; returns whether the filter cleared the patch. */
static int is_cleared(const double size[3], const double place[3], int from_above, uint8_t brightness) {
  /* Camera axes: aside looks along +y, above looks down. */
  static const double aside[9] = {1, 0, 0, 0, 0, 1, 0, -1, 0}, above[9] = {1, 0, 0, 0, -1, 0, 0, 0, -1};
  float depth[PIXELS], bounds[2];
  uint8_t cover[PIXELS], rgb[3 * PIXELS];
  pags_depth_view depth_view = {
      .depth = depth, .cover = cover, .rgb = rgb, .cells_x = 1, .cells_y = 1, .lo = bounds, .hi = bounds + 1};
  depth_view.camera =
      (pags_camera){.width = SIDE, .height = SIDE, .fx = 200, .fy = 200, .cx = 0.5 * SIDE, .cy = 0.5 * SIDE};
  for (int i = 0; i < 9; i++)
    depth_view.camera.world_from_camera[4 * (i / 3) + i % 3] = from_above ? above[i] : aside[i];
  for (int k = 0; k < 3; k++)
    depth_view.camera.world_from_camera[4 * k + 3] = place[k] - depth_view.camera.world_from_camera[4 * k + 2];
  for (int i = 0; i < PIXELS; i++) {
    depth[i] = 1;
    cover[i] = 255;
    rgb[3 * i] = rgb[3 * i + 1] = rgb[3 * i + 2] = brightness;
  }
  assert_int_equal(pags_depth_view_filter_shadow(&depth_view, size), PAGS_OK);
  int64_t cleared = 0;
  for (int i = 0; i < PIXELS; i++) {
    assert_true(fabsf(depth[i]) == 1.0f && (depth[i] < 0) == (cover[i] == 0));
    cleared += depth[i] < 0;
  }
  assert_true(cleared == 0 || cleared == PIXELS);
  return cleared > 0;
}

static const double car[3] = {4.5, 2, 1.5}, lorry[3] = {9, 2, 1.5};

/* An upright patch at `height` metres above the box's lower face. */
static int upright(const double size[3], double along, double across, double height, uint8_t brightness) {
  const double place[3] = {along, across, height - 0.5 * size[2]};
  return is_cleared(size, place, 0, brightness);
}

static int level(const double size[3], double along, double across, double height, uint8_t brightness) {
  const double place[3] = {along, across, height - 0.5 * size[2]};
  return is_cleared(size, place, 1, brightness);
}

static void test_dark_under_the_sill_is_air(void **state) {
  (void)state;
  assert_true(upright(car, 0, -0.9, 0.15, 30));    /* the dark gap between front and rear wheels */
  assert_true(upright(car, 2, -0.9, 0.15, 30));    /* shadow behind the rear wheels */
  assert_false(upright(car, 1.3, -0.9, 0.15, 30)); /* a wheel must stay */
  assert_true(upright(car, 1.3, -0.3, 0.15, 30));  /* between the left and the right wheel */
  assert_false(upright(car, 0, -0.9, 0.35, 30));   /* the body stays */
  assert_false(upright(car, 0, -0.9, 0.15, 120));  /* bright: painted bodywork */
  assert_false(upright(lorry, 0, -0.9, 0.15, 30)); /* a lorry's wheels may be anywhere along it */
}

static void test_level_ground_is_no_part(void **state) {
  (void)state;
  assert_true(level(car, 0, 0, 0.08, 120));
  assert_false(level(car, 0, 0, 0.2, 120));   /* too high above the road */
  assert_true(level(car, 0, 0.95, 0.2, 120)); /* a footway next to the car */
  assert_false(level(car, 0, 0.95, 0.4, 120));
  assert_false(upright(car, 0, -0.95, 0.2, 120)); /* the car's side stays */
}

/* A pixel whose neighbours have no depth has no known slope: then only half the height of level ground is cleared. */
static int lone_pixel(double height) {
  float depth[PIXELS] = {0}, bounds[2];
  uint8_t cover[PIXELS] = {0}, rgb[3 * PIXELS];
  pags_depth_view view = {
      .depth = depth, .cover = cover, .rgb = rgb, .cells_x = 1, .cells_y = 1, .lo = bounds, .hi = bounds + 1};
  view.camera = (pags_camera){.width = SIDE, .height = SIDE, .fx = 200, .fy = 200, .cx = 0.5, .cy = 0.5};
  static const double above[12] = {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0};
  for (int i = 0; i < 12; i++)
    view.camera.world_from_camera[i] = above[i];
  view.camera.world_from_camera[11] = 1 + height - 0.5 * car[2];
  for (int i = 0; i < 3 * PIXELS; i++)
    rgb[i] = 120;
  depth[0] = 1;
  cover[0] = 255;
  assert_int_equal(pags_depth_view_filter_shadow(&view, car), PAGS_OK);
  return depth[0] < 0;
}

static void test_unknown_slope_is_cleared_to_half_the_height(void **state) {
  (void)state;
  assert_true(level(car, 0, 0, 0.08, 120));
  assert_false(lone_pixel(0.08));
  assert_true(lone_pixel(0.03));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_dark_under_the_sill_is_air),
                                     cmocka_unit_test(test_level_ground_is_no_part),
                                     cmocka_unit_test(test_unknown_slope_is_cleared_to_half_the_height)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
