/* SPDX-License-Identifier: Apache-2.0 */
/* The courtyard: what is written reads back as a data set, its depth agrees with closed forms, and threads change no
 * byte. */
#include <pags/dataset.h>
#include <pags/image.h>
#include <pags/synth.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "base/file.h"
#include "synth/render.h"
#include "synth/texture.h"

enum { WIDTH = 96, HEIGHT = 64, VIEWS = 5, POINTS = 300 };

static char root[256];

static int make_root(void **state) {
  (void)state;
  const char *folder = getenv("TMPDIR");
  snprintf(root, sizeof root, "%s/pags_synth_%ld", folder ? folder : "/tmp", (long)getpid());
  return pags_make_dirs(root) == PAGS_OK ? 0 : -1;
}

static int remove_root(void **state) {
  (void)state;
  return pags_remove_tree(root) == PAGS_OK ? 0 : -1;
}

static void path_of(char *path, size_t size, const char *set, const char *name) {
  snprintf(path, size, "%s/%s%s%s", root, set, *name ? "/" : "", name);
}

static void write_room(const char *set, int threads, int depth) {
  char folder[512];
  pags_synth_options options = pags_synth_options_default();
  pags_tasks *tasks = pags_tasks_create(threads);
  options.width = WIDTH;
  options.height = HEIGHT;
  options.views = VIEWS;
  options.samples = 2;
  options.points = POINTS;
  options.seed = 3;
  options.depth = depth;
  path_of(folder, sizeof folder, set, "");
  if (pags_synth_room(folder, &options, tasks, NULL, NULL) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  pags_tasks_destroy(tasks);
}

static pags_dataset *open_set(const char *set) {
  char folder[512];
  pags_dataset *dataset = NULL;
  const pags_dataset_options options = pags_dataset_options_default();
  path_of(folder, sizeof folder, set, "");
  if (pags_dataset_open(folder, &options, &dataset) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  return dataset;
}

/* Camera z at which the ray through a pixel's centre leaves the courtyard: through the floor or a wall's inner face; 0
 * for one that passes above the walls. */
static double leave_depth(const pags_camera *camera, int x, int y) {
  const double u = (x + 0.5 - camera->cx) / camera->fx, v = (y + 0.5 - camera->cy) / camera->fy;
  const double *m = camera->world_from_camera;
  double origin[3], direction[3], nearest = HUGE_VAL;
  for (int k = 0; k < 3; k++) {
    origin[k] = m[4 * k + 3];
    direction[k] = m[4 * k] * u + m[4 * k + 1] * v + m[4 * k + 2];
  }
  for (int k = 0; k < 2; k++)
    nearest = fmin(nearest, ((direction[k] > 0.0 ? 4.0 : -4.0) - origin[k]) / direction[k]);
  if (direction[2] < 0.0)
    nearest = fmin(nearest, -origin[2] / direction[2]);
  return origin[2] + nearest * direction[2] > 3.0 ? 0.0 : nearest;
}

static void check_depth(const pags_camera *camera, const float *depth) {
  int same = 0, nearer = 0;
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++) {
      const double expected = leave_depth(camera, x, y), found = (double)depth[y * WIDTH + x];
      const int equal = fabs(found - expected) <= 2e-5 * (1.0 + expected);
      assert_true(equal || (found > 0.5 && found < expected));
      same += equal;
      nearer += !equal;
    }
  assert_true(same > WIDTH * HEIGHT / 2);    /* floor and walls */
  assert_true(nearer > WIDTH * HEIGHT / 10); /* things */
}

static void test_depth(void **state) {
  (void)state;
  write_room("depth", 2, 1);
  pags_dataset *dataset = open_set("depth");
  for (int i = 0; i < VIEWS; i++) {
    char name[32], path[512];
    pags_image depth = {0};
    snprintf(name, sizeof name, "depth/%04d.exr", i + 1);
    path_of(path, sizeof path, "depth", name);
    assert_int_equal(pags_image_load(path, PAGS_F32, 1, &depth), PAGS_OK);
    assert_int_equal(depth.width, WIDTH);
    check_depth(&pags_dataset_view(dataset, i)->camera, depth.data);
    pags_image_destroy(&depth);
  }
  pags_dataset_close(dataset);
}

/* Positions relative to the origin, back in the world. */
static void check_points(const pags_dataset *dataset) {
  const double *origin = pags_dataset_origin(dataset);
  int64_t count = 0;
  const float *xyz = NULL;
  const uint8_t *rgb = NULL;
  int random = 1, on_floor = 0, bright = 0;
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_int_equal(count, POINTS);
  assert_int_equal(random, 0);
  for (int64_t i = 0; i < count; i++) {
    for (int k = 0; k < 3; k++)
      assert_true(fabs(origin[k] + (double)xyz[3 * i + k]) < 4.0 + 1e-4);
    on_floor += fabs(origin[2] + (double)xyz[3 * i + 2]) < 1e-4;
    bright += rgb[3 * i] + rgb[3 * i + 1] + rgb[3 * i + 2] > 60;
  }
  assert_true(on_floor > POINTS / 10 && on_floor < POINTS);
  assert_true(bright > POINTS / 2);
}

static void test_reads_back(void **state) {
  (void)state;
  write_room("set", 1, 0);
  pags_dataset *dataset = open_set("set");
  assert_string_equal(pags_dataset_kind(dataset), "transforms.json");
  assert_int_equal(pags_dataset_view_count(dataset), VIEWS);
  for (int i = 0; i < VIEWS; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    const double *m = view->camera.world_from_camera;
    pags_image image = {0};
    assert_int_equal(view->camera.width, WIDTH);
    assert_true(fabs(sqrt(m[3] * m[3] + m[7] * m[7]) - 3.0) < 1e-9); /* on the circle */
    assert_true(m[9] < -0.7);                                        /* its y axis looks down */
    assert_int_equal(pags_image_load(view->image_path, PAGS_U8, 3, &image), PAGS_OK);
    assert_int_equal(image.height, HEIGHT);
    int64_t sum = 0;
    for (int k = 0; k < WIDTH * HEIGHT * 3; k++)
      sum += ((const uint8_t *)image.data)[k];
    assert_in_range(sum / (WIDTH * HEIGHT * 3), 60, 200);
    pags_image_destroy(&image);
  }
  check_points(dataset);
  pags_dataset_close(dataset);
}

static void assert_same_file(const char *a, const char *b, const char *name) {
  char path[512];
  uint8_t *bytes[2] = {NULL, NULL};
  size_t sizes[2] = {0, 0};
  for (int k = 0; k < 2; k++) {
    path_of(path, sizeof path, k ? b : a, name);
    assert_int_equal(pags_file_read(path, &bytes[k], &sizes[k]), PAGS_OK);
  }
  assert_int_equal(sizes[0], sizes[1]);
  assert_memory_equal(bytes[0], bytes[1], sizes[0]);
  free(bytes[0]);
  free(bytes[1]);
}

static void test_threads(void **state) {
  (void)state;
  write_room("one", 1, 1);
  write_room("three", 3, 1);
  assert_same_file("one", "three", "transforms.json");
  assert_same_file("one", "three", "points.ply");
  assert_same_file("one", "three", "images/0002.png");
  /* OpenEXR's header may hold the time of writing: the values count. */
  float *depth[2];
  pags_image images[2] = {{0}};
  for (int k = 0; k < 2; k++) {
    char path[512];
    path_of(path, sizeof path, k ? "three" : "one", "depth/0003.exr");
    assert_int_equal(pags_image_load(path, PAGS_F32, 1, &images[k]), PAGS_OK);
    depth[k] = images[k].data;
  }
  assert_memory_equal(depth[0], depth[1], WIDTH * HEIGHT * sizeof(float));
  pags_image_destroy(&images[0]);
  pags_image_destroy(&images[1]);
}

static int stop_at_once(void *user, double fraction, const char *what) {
  (void)fraction, (void)what;
  ++*(int *)user;
  return 0;
}

static void test_refusals(void **state) {
  (void)state;
  char folder[512], path[512];
  int calls = 0;
  pags_tasks *tasks = pags_tasks_create(1);
  pags_synth_options options = pags_synth_options_default();
  path_of(folder, sizeof folder, "refused", "");
  options.width = 7;
  assert_int_equal(pags_synth_room(folder, &options, tasks, NULL, NULL), PAGS_ERROR_ARGUMENT);
  assert_false(pags_path_exists(folder));
  options = pags_synth_options_default();
  assert_int_equal(pags_synth_room(folder, &options, tasks, stop_at_once, &calls), PAGS_CANCELLED);
  assert_int_equal(calls, 1);
  path_of(path, sizeof path, "refused", "transforms.json");
  assert_false(pags_path_exists(path));
  assert_int_equal(pags_synth_room(folder, &options, tasks, NULL, NULL), PAGS_ERROR_IO); /* no longer empty */
  pags_tasks_destroy(tasks);
}

static void test_textures(void **state) {
  (void)state;
  const pags_texture checker = {PAGS_PATTERN_CHECKER, 0.5f, {{0.9f, 0.8f, 0.7f}, {0.1f, 0.2f, 0.3f}}, 0.0f};
  float a[3], b[3];
  pags_texture_at(&checker, (const float[3]){0.0f, 0.0f, 0.0f}, 1, a);
  pags_texture_at(&checker, (const float[3]){0.5f, 0.0f, 0.0f}, 1, b);
  assert_true(fabsf(a[0] - 0.9f) < 1e-6f && fabsf(b[0] - 0.1f) < 1e-6f);
  for (int i = 0; i < 1000; i++) {
    const float p[3] = {(float)i * 0.37f - 100.0f, (float)i * 0.11f, -3.0f};
    const float q[3] = {p[0] + 1e-3f, p[1], p[2]};
    const float n = pags_noise(p, 9);
    assert_true(n >= 0.0f && n <= 1.0f);
    assert_true(fabsf(pags_noise(q, 9) - n) < 2e-2f); /* smooth across cells */
  }
  assert_int_equal(pags_encode_srgb(0.0f), 0);
  assert_int_equal(pags_encode_srgb(2.0f), 255);
  assert_int_equal(pags_encode_srgb(0.2159f), 128);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_depth),    cmocka_unit_test(test_reads_back), cmocka_unit_test(test_threads),
      cmocka_unit_test(test_refusals), cmocka_unit_test(test_textures),
  };
  return cmocka_run_group_tests(tests, make_root, remove_root);
}
