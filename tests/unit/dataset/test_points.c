/* SPDX-License-Identifier: Apache-2.0 */
/* Tests points triangulated by matching photographs: of a textured plane of known depth, with masks, and of pictures
 * without texture. */
#include <pags/dataset.h>

#include "dataset/parsed.h"
#include "unit/scratch.h"

#include <math.h>

enum { VIEWS = 6, WIDTH = 96, HEIGHT = 80, COUNT = 1000 };

/* Camera i stands at (0.25 i - 0.6, 0, 0) and looks along +z (OpenCV axes), focal length 90. The plane is z = 3 + 0.4
 * x. */
static int current;

static double camera_x(int view) {
  return 0.25 * view - 0.6;
}

static uint8_t plane(int x, int y, int c) {
  double rx = (x + 0.5 - 48) / 90, ry = (y + 0.5 - 40) / 90, cx = camera_x(current);
  double depth = (3 + 0.4 * cx) / (1 - 0.4 * rx);
  double px = cx + rx * depth, py = ry * depth;
  double value = sin(9 * px + 2 * c) + sin(7 * py + 3 * px) + sin(13 * px - 11 * py) + sin(17 * py + 1);
  return (uint8_t)(128 + 30 * value);
}

static uint8_t flat_grey(int x, int y, int c) {
  (void)x, (void)y, (void)c;
  return 100;
}

static void write_set(scratch *s, uint8_t (*paint)(int, int, int), const char *in_frames) {
  char text[4096] = "{\"fl_x\": 90, \"frames\": [", name[32];
  for (current = 0; current < VIEWS; current++) {
    size_t end = strlen(text);
    snprintf(name, sizeof name, "%d.png", current);
    scratch_picture(s, name, WIDTH, HEIGHT, paint);
    snprintf(text + end, sizeof text - end,
             "%s{\"file_path\": \"%s\", %s \"transform_matrix\": [[1,0,0,%g],[0,-1,0,0],[0,0,-1,0]]}",
             current ? "," : "", name, in_frames, camera_x(current));
  }
  snprintf(text + strlen(text), sizeof text - strlen(text), "]}");
  scratch_text(s, "transforms.json", text);
}

static pags_dataset *open_all(scratch *s) {
  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 0;
  pags_dataset *dataset;
  scratch_ok(pags_dataset_open(s->folder, &options, &dataset));
  return dataset;
}

static void match(const pags_dataset *dataset, int threads, uint64_t seed, float **xyz, uint8_t **rgb) {
  pags_tasks *tasks = pags_tasks_create(threads);
  scratch_ok(pags_dataset_match_points(dataset, tasks, COUNT, seed, xyz, rgb));
  pags_tasks_destroy(tasks);
}

static void test_plane_is_found(void **state) {
  scratch *s = *state;
  write_set(s, plane, "");
  pags_dataset *dataset = open_all(s);
  float *xyz;
  uint8_t *rgb;
  match(dataset, 2, 0, &xyz, &rgb);
  int near = 0;
  for (int i = 0; i < COUNT; i++) {
    double truth = 3 + 0.4 * (double)xyz[3 * i];
    near += fabs((double)xyz[3 * i + 2] - truth) < 0.02 * truth;
  }
  assert_true(near > COUNT * 85 / 100);
  free(xyz);
  free(rgb);
  pags_dataset_close(dataset);
}

/* Every point has the colour that photograph i % VIEWS shows at its projection, even at the photographs' edges, where
 * up to half of the points lie. */
static void test_colours(void **state) {
  scratch *s = *state;
  write_set(s, plane, "");
  pags_dataset *dataset = open_all(s);
  float *xyz;
  uint8_t *rgb;
  match(dataset, 1, 0, &xyz, &rgb);
  for (int i = 0; i < COUNT; i++) {
    current = i % VIEWS;
    double x = (double)xyz[3 * i] - camera_x(current), z = (double)xyz[3 * i + 2];
    double u = 90 * x / z + 48, v = 90 * (double)xyz[3 * i + 1] / z + 40;
    if (fabs(u - round(u)) < 1e-3 || fabs(v - round(v)) < 1e-3)
      continue; /* on a border between two pixels, up to float rounding */
    for (int c = 0; c < 3; c++)
      assert_int_equal(rgb[3 * i + c], plane((int)u, (int)v, c));
  }
  free(xyz);
  free(rgb);
  pags_dataset_close(dataset);
}

static void test_same_for_any_threads(void **state) {
  scratch *s = *state;
  write_set(s, plane, "");
  pags_dataset *dataset = open_all(s);
  float *xyz[4];
  uint8_t *rgb[4];
  for (int i = 0; i < 4; i++)
    match(dataset, i + 1, i == 3, &xyz[i], &rgb[i]);
  assert_memory_equal(xyz[0], xyz[1], COUNT * 12);
  assert_memory_equal(xyz[0], xyz[2], COUNT * 12);
  assert_memory_equal(rgb[0], rgb[2], COUNT * 3);
  assert_memory_not_equal(xyz[0], xyz[3], COUNT * 12); /* another seed gives other points */
  for (int i = 0; i < 4; i++) {
    free(xyz[i]);
    free(rgb[i]);
  }
  pags_dataset_close(dataset);
}

static void test_masked_pixels_give_none(void **state) {
  scratch *s = *state;
  write_set(s, plane, "\"mask_path\": \"mask.png\",");
  pags_image mask;
  scratch_ok(pags_image_create(&mask, WIDTH, HEIGHT, 1, PAGS_U8));
  for (int i = 0; i < WIDTH * HEIGHT; i++)
    ((uint8_t *)mask.data)[i] = i < WIDTH * HEIGHT / 2 ? 255 : 0; /* the lower half is masked */
  scratch_ok(pags_image_save(scratch_path(s, "mask.png"), &mask));
  pags_image_destroy(&mask);
  pags_dataset *dataset = open_all(s);
  float *xyz;
  uint8_t *rgb;
  match(dataset, 2, 0, &xyz, &rgb);
  for (int i = 0; i < COUNT; i++)
    assert_true(xyz[3 * i + 1] < 1e-4f); /* the y axis points down */
  free(xyz);
  free(rgb);
  pags_dataset_close(dataset);
}

static void test_nothing_to_match(void **state) {
  scratch *s = *state;
  write_set(s, flat_grey, "");
  pags_dataset *dataset = open_all(s);
  float *xyz;
  uint8_t *rgb;
  match(dataset, 2, 0, &xyz, &rgb);
  for (int i = 0; i < 3 * COUNT; i++)
    assert_true(isfinite(xyz[i]) && rgb[i] == 100);
  free(xyz);
  free(rgb);

  /* A photograph that can't be decoded any more is an error whose message names it. */
  scratch_text(s, "3.png", "\x89PNG");
  pags_tasks *tasks = pags_tasks_create(2);
  scratch_expect(pags_dataset_match_points(dataset, tasks, COUNT, 0, &xyz, &rgb), PAGS_ERROR_FORMAT, "3.png");
  assert_true(!xyz && !rgb);
  pags_tasks_cancel(tasks);
  scratch_expect(pags_dataset_match_points(dataset, tasks, COUNT, 0, &xyz, &rgb), PAGS_CANCELLED, "cancelled");
  pags_tasks_destroy(tasks);
  pags_dataset_close(dataset);
}

static pags_camera looking_from(double x, double z, double yaw) {
  pags_camera camera = {.width = 100, .height = 100, .fx = 100, .fy = 100, .cx = 50, .cy = 50};
  const double m[12] = {cos(yaw), 0, sin(yaw), x, 0, 1, 0, 0, -sin(yaw), 0, cos(yaw), z};
  memcpy(camera.world_from_camera, m, sizeof m);
  return camera;
}

static void test_subject(void **state) {
  (void)state;
  pags_camera cameras[4];
  const pags_camera *list[4] = {&cameras[0], &cameras[1], &cameras[2], &cameras[3]};
  double distance;
  /* Cameras on an arc of radius 5 around the point (1, 0, 2): they focus on its centre. */
  for (int i = 0; i < 4; i++) {
    double yaw = 0.3 * i - 0.5;
    cameras[i] = looking_from(1 - 5 * sin(yaw), 2 - 5 * cos(yaw), yaw);
  }
  scratch_ok(pags_focus_distance(list, 4, &distance));
  assert_true(fabs(distance - 5) < 1e-9);
  /* Cameras side by side with parallel axes: the focus distance is 4 times their spread. */
  for (int i = 0; i < 4; i++)
    cameras[i] = looking_from(i % 2 ? 1 : -1, 0, 0);
  scratch_ok(pags_focus_distance(list, 4, &distance));
  assert_true(fabs(distance - 4) < 1e-9);
  scratch_ok(pags_focus_distance(list, 1, &distance));
  assert_true(distance == 1);
  const double ahead[3] = {-1, 0, 2}, aside[3] = {2, 0, 2}, behind[3] = {-1, 0, -2};
  assert_true(pags_camera_sees(&cameras[0], ahead, 1));
  assert_false(pags_camera_sees(&cameras[0], ahead, 3));
  assert_false(pags_camera_sees(&cameras[0], aside, 1));
  assert_false(pags_camera_sees(&cameras[0], behind, 1));
}

int main(void) {
  const struct CMUnitTest tests[] = {
      scratch_test(test_plane_is_found),       scratch_test(test_colours),
      scratch_test(test_same_for_any_threads), scratch_test(test_masked_pixels_give_none),
      scratch_test(test_nothing_to_match),     cmocka_unit_test(test_subject),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
