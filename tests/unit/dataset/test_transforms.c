/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the reader of transforms.json, and the checks that apply to data sets of every format. */
#include <pags/dataset.h>

#include "base/log.h"
#include "shared_data.h"
#include "unit/scratch.h"

#include <math.h>

#define assert_near(value, expected, tolerance) assert_true(fabs((value) - (expected)) <= (tolerance))

static uint8_t grey(int x, int y, int c) {
  (void)x, (void)y, (void)c;
  return 90;
}

static pags_dataset *open_ok(const char *path, const pags_dataset_options *options) {
  pags_dataset *dataset = NULL;
  scratch_ok(pags_dataset_open(path, options, &dataset));
  return dataset;
}

static void open_fails(const char *path, const pags_dataset_options *options, pags_result code, const char *part) {
  pags_dataset *dataset = NULL;
  pags_result result = pags_dataset_open(path, options, &dataset);
  assert_null(dataset);
  scratch_expect(result, code, part);
}

/* Writes three pictures of 8 x 6 pixels, a.png, b.png and c.png, and a transforms.json with the text `top` before the
 * frames and `in_b` inside b's frame. */
static const char *write_set(scratch *s, const char *top, const char *in_b) {
  char text[4096];
  const char *const pose = "\"transform_matrix\": [[1,0,0,%d],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";
  char poses[3][128];
  for (int i = 0; i < 3; i++)
    snprintf(poses[i], sizeof poses[i], pose, i);
  snprintf(text, sizeof text,
           "{%s \"frames\": [\n {\"file_path\": \"./images/c.png\", %s},\n {\"file_path\": \"images/b\", %s %s},\n"
           " {\"file_path\": \"images/a.png\", %s}]}",
           top, poses[2], in_b, poses[1], poses[0]);
  for (int i = 0; i < 3; i++) {
    const char *const names[] = {"images/a.png", "images/b.png", "images/c.png"};
    scratch_picture(s, names[i], 8, 6, grey);
  }
  scratch_text(s, "transforms.json", text);
  return scratch_path(s, "transforms.json");
}

static void test_order_axes_and_split(void **state) {
  scratch *s = *state;
  write_set(s, "\"fl_x\": 10, \"w\": 8.0, \"h\": 6,", "");
  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 2;
  pags_dataset *dataset = open_ok(s->folder, &options);
  assert_string_equal(pags_dataset_kind(dataset), "transforms.json");
  assert_string_equal(pags_dataset_path(dataset), s->folder);
  assert_int_equal(pags_dataset_up(dataset), PAGS_UP_Z);
  assert_int_equal(pags_dataset_view_count(dataset), 3);
  for (int i = 0; i < 3; i++) {
    const char *const names[] = {"a.png", "b.png", "c.png"};
    const pags_view *view = pags_dataset_view(dataset, i);
    const double expected[12] = {1, 0, 0, i, 0, -1, 0, 2, 0, 0, -1, 3};
    assert_string_equal(view->name, names[i]);
    assert_int_equal(view->test, i % 2 == 0);
    assert_null(view->mask_path);
    assert_true(isnan(view->camera.time));
    for (int j = 0; j < 12; j++)
      assert_true(view->camera.world_from_camera[j] == expected[j]);
    assert_true(view->camera.width == 8 && view->camera.height == 6);
    assert_true(view->camera.fx == 10 && view->camera.fy == 10 && view->camera.cx == 4 && view->camera.cy == 3);
  }
  pags_dataset_close(dataset);
}

static void test_intrinsics(void **state) {
  scratch *s = *state;
  /* A frame's own values take precedence; angles of view are used where there is no focal length; without a stated
   * size the picture's size is used. */
  write_set(s, "\"camera_angle_x\": 1.5707963267948966,", "\"fl_x\": 7, \"cx\": 3.5, \"camera_model\": \"PINHOLE\",");
  pags_dataset *dataset = open_ok(s->folder, NULL);
  const pags_camera *a = &pags_dataset_view(dataset, 0)->camera, *b = &pags_dataset_view(dataset, 1)->camera;
  assert_near(a->fx, 4, 1e-12);
  assert_near(a->fy, 4, 1e-12);
  assert_true(a->cx == 4 && a->cy == 3);
  assert_true(b->fx == 7 && b->fy == 7 && b->cx == 3.5 && b->cy == 3);
  pags_dataset_close(dataset);
}

static void test_downscale(void **state) {
  scratch *s = *state;
  write_set(s, "\"fl_x\": 10, \"fl_y\": 12,", "");
  pags_dataset_options options = pags_dataset_options_default();
  options.downscale = 2.5;
  pags_dataset *dataset = open_ok(s->folder, &options);
  const pags_camera *camera = &pags_dataset_view(dataset, 0)->camera;
  assert_true(camera->width == 3 && camera->height == 2);
  assert_near(camera->fx, 4, 1e-12);
  assert_near(camera->fy, 4.8, 1e-12);
  assert_near(camera->cx, 1.6, 1e-12);
  pags_dataset_close(dataset);
  options.downscale = 0.5;
  open_fails(s->folder, &options, PAGS_ERROR_ARGUMENT, "downscale");
  options = pags_dataset_options_default();
  options.split_every = 1;
  open_fails(s->folder, &options, PAGS_ERROR_ARGUMENT, "split");
}

static void test_masks_and_points(void **state) {
  scratch *s = *state;
  static const char ply[] =
      "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 2\nproperty double x\n"
      "property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
      "property uchar blue\nend_header\n1 2 3 10 20 30\n-1.5 0 4 255 0 7\n";
  write_set(s, "\"fl_x\": 10, \"ply_file_path\": \"points.ply\",", "\"mask_path\": \"masks/b.png\",");
  scratch_text(s, "points.ply", ply);
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "transforms.json:3: ");
  scratch_picture(s, "masks/b.png", 8, 6, grey);
  pags_dataset *dataset = open_ok(s->folder, NULL);
  assert_non_null(strstr(pags_dataset_view(dataset, 1)->mask_path, "masks/b.png"));
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  const float expected[6] = {1, 2, 3, -1.5f, 0, 4};
  const uint8_t colours[6] = {10, 20, 30, 255, 0, 7};
  assert_true(count == 2 && !random);
  assert_memory_equal(xyz, expected, sizeof expected);
  assert_memory_equal(rgb, colours, sizeof colours);
  pags_dataset_close(dataset);

  scratch_write(s, "points.ply", ply, sizeof ply - 20);
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "points.ply");
  scratch_text(s, "points.ply",
               "ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nproperty float y\n"
               "property float z\nend_header\n");
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "points.ply");
}

static void test_binary_points(void **state) {
  scratch *s = *state;
  static const char header[] =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar blue\n"
      "property float z\nproperty float nx\nproperty float x\nproperty double y\nend_header\n";
  struct {
    char bytes[sizeof header - 1 + 21];
  } file;
  const float z = 3, nx = NAN, x = 1;
  const double y = 2;
  char *at = file.bytes + sizeof header - 1;
  memcpy(file.bytes, header, sizeof header - 1);
  *at = 77;
  memcpy(at + 1, &z, 4);
  memcpy(at + 5, &nx, 4);
  memcpy(at + 9, &x, 4);
  memcpy(at + 13, &y, 8);
  write_set(s, "\"fl_x\": 10, \"ply_file_path\": \"points.ply\",", "");
  scratch_write(s, "points.ply", file.bytes, sizeof file.bytes);
  pags_dataset *dataset = open_ok(s->folder, NULL);
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_true(count == 1 && xyz[0] == 1 && xyz[1] == 2 && xyz[2] == 3);
  assert_true(rgb[0] == 128 && rgb[1] == 128 && rgb[2] == 77);
  pags_dataset_close(dataset);
  scratch_write(s, "points.ply", file.bytes, sizeof file.bytes - 1);
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "points.ply");
}

static void test_large_coordinates(void **state) {
  scratch *s = *state;
  char text[512];
  scratch_picture(s, "a.png", 8, 6, grey);
  scratch_picture(s, "b.png", 8, 6, grey);
  snprintf(text, sizeof text,
           "{\"fl_x\": 9, \"frames\": ["
           "{\"file_path\": \"a\", \"transform_matrix\": [[1,0,0,500000.25],[0,1,0,-4000000],[0,0,1,3]]},"
           "{\"file_path\": \"b\", \"transform_matrix\": [[1,0,0,500004.25],[0,1,0,-4000000],[0,0,1,3]]}]}");
  scratch_text(s, "transforms.json", text);
  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 0;
  pags_dataset *dataset = open_ok(s->folder, &options);
  const double *origin = pags_dataset_origin(dataset);
  assert_true(origin[0] == 500002 && origin[1] == -4000000 && origin[2] == 3);
  assert_true(pags_dataset_view(dataset, 0)->camera.world_from_camera[3] == 500000.25);
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_true(count == 10000 && random);
  pags_dataset_close(dataset);
}

static void test_bad_files(void **state) {
  scratch *s = *state;
  open_fails(scratch_path(s, "nothing"), NULL, PAGS_ERROR_IO, "nothing");
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "no transforms.json or transforms_train.json, and no COLMAP model");
  scratch_text(s, "x.txt", "hello");
  open_fails(scratch_path(s, "x.txt"), NULL, PAGS_ERROR_FORMAT, "x.txt");
  scratch_text(s, "transforms.json", "{\"frames\": [}");
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "transforms.json:1");
  scratch_text(s, "transforms.json", "[1, 2]");
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "transforms.json");
  scratch_text(s, "transforms.json", "{\"fl_x\": 5}");
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "frames");
  scratch_text(s, "transforms.json", "{\"fl_x\": 5, \"frames\": []}");
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "at least one image");
  scratch_text(s, "transforms.json", "{\"fl_x\": 5, \"frames\": [3]}");
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "frame");
}

/* Each entry breaks one value of the middle frame, which begins on line 3. */
static void test_bad_frames(void **state) {
  scratch *s = *state;
  static const struct {
    const char *top, *in_b, *part;
    pags_result code;
  } cases[] = {
      {"", "", "fl_x", PAGS_ERROR_FORMAT},
      {"\"fl_x\": 5,", "\"fl_x\": \"five\",", "transforms.json:3: ", PAGS_ERROR_FORMAT},
      {"\"fl_x\": 5,", "\"fl_x\": -5,", "transforms.json:3", PAGS_ERROR_FORMAT},
      {"\"fl_x\": 5,", "\"w\": 16, \"h\": 24,", "b.png has 8 x 6 pixels, expected 16 x 24", PAGS_ERROR_FORMAT},
      {"\"camera_angle_x\": 63.2,", "", "'camera_angle_x' is 63.2, expected radians", PAGS_ERROR_FORMAT},
      {"\"camera_angle_x\": 0,", "", "'camera_angle_x' is 0, expected radians", PAGS_ERROR_FORMAT},
      {"\"x_fov\": 190,", "", "'x_fov' is 190, expected degrees", PAGS_ERROR_FORMAT},
      {"\"fl_x\": 0.1,", "", "an angle of view of", PAGS_ERROR_FORMAT},
      {"\"fl_x\": 5,", "\"equirectangular\": true,",
       "transforms.json:3: camera_model 'equal-area cylinder' is not known", PAGS_ERROR_FORMAT},
      {"\"fl_x\": 5,", "\"w\": 7.5, \"h\": 6,", "whole number", PAGS_ERROR_FORMAT},
      {"\"fl_x\": 5,", "\"camera_model\": \"ROUND\",", "expected PINHOLE", PAGS_ERROR_FORMAT},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    const char *path = write_set(s, cases[i].top, cases[i].in_b);
    open_fails(path, NULL, cases[i].code, cases[i].part);
  }
  /* Absurd distortion gives an error or a small picture, never a crash. */
  pags_dataset *dataset = NULL;
  if (pags_dataset_open(write_set(s, "\"fl_x\": 5,", "\"k1\": -100,"), NULL, &dataset) == PAGS_OK)
    pags_dataset_close(dataset);
  if (pags_dataset_open(write_set(s, "\"fl_x\": 5,", "\"k1\": 1e200, \"p1\": 1e200,"), NULL, &dataset) == PAGS_OK)
    pags_dataset_close(dataset);
}

static void write_pose(scratch *s, const char *matrix, const char *second_name) {
  char text[512];
  snprintf(text, sizeof text,
           "{\"fl_x\": 9, \"frames\": [{\"file_path\": \"a.png\", \"transform_matrix\": %s},\n"
           "{\"file_path\": \"%s\", \"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]}",
           matrix, second_name);
  scratch_text(s, "transforms.json", text);
  scratch_picture(s, "a.png", 8, 6, grey);
  scratch_picture(s, "sub/a.png", 8, 6, grey);
  scratch_picture(s, "b.png", 8, 6, grey);
}

static void test_bad_poses(void **state) {
  scratch *s = *state;
  static const char *const bad[] = {"[[2,0,0,0],[0,1,0,0],[0,0,1,0]]",  "[[1,0,0,0],[0,1,0,0],[0,0,-1,0]]",
                                    "[[0,0,0,0],[0,0,0,0],[0,0,0,0]]",  "[[1,0,0,0],[0,1,0.1,0],[0,0,1,0]]",
                                    "[[1,0,0],[0,1,0],[0,0,1]]",        "[[1,0,0,1e999],[0,1,0,0],[0,0,1,0]]",
                                    "[[1,0,0,NaN],[0,1,0,0],[0,0,1,0]]"};
  for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
    write_pose(s, bad[i], "b.png");
    open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "transforms.json:1");
  }
  write_pose(s, "[[1,0,0,0],[0,1,0,0],[0,0,1,0]]", "a.png");
  open_fails(s->folder, NULL, PAGS_ERROR_FORMAT, "a.png occurs twice");
  write_pose(s, "[[1,0,0,0],[0,1,0,0],[0,0,1,0]]", "sub/a.png");
  scratch_picture(s, "sub/a.png", 8, 6, grey);
  pags_dataset *dataset = open_ok(s->folder, NULL);
  assert_string_equal(pags_dataset_view(dataset, 0)->name, "a.png");
  assert_string_equal(pags_dataset_view(dataset, 1)->name, "sub/a.png");
  pags_dataset_close(dataset);
}

static int logged;

static void count_line(void *user, pags_log_level level, const char *line) {
  (void)user;
  logged += level == PAGS_LOG_WARNING && strstr(line, "1 of 3 images are missing") != NULL;
}

static void test_missing(void **state) {
  scratch *s = *state;
  write_set(s, "\"fl_x\": 10,", "");
  assert_int_equal(remove(scratch_path(s, "images/b.png")), 0);
  open_fails(s->folder, NULL, PAGS_ERROR_IO, "images/b; 1 of 3 images are missing (--allow-missing");
  pags_dataset_options options = pags_dataset_options_default();
  options.allow_missing = 1;
  logged = 0;
  pags_log_set(count_line, NULL);
  pags_dataset *dataset = open_ok(s->folder, &options);
  pags_log_set(NULL, NULL);
  assert_int_equal(logged, 1);
  assert_int_equal(pags_dataset_view_count(dataset), 2);
  assert_int_equal(pags_dataset_missing(dataset), 1);
  assert_string_equal(pags_dataset_view(dataset, 1)->name, "c.png");
  pags_dataset_close(dataset);
  /* A missing picture doesn't change the split: every second picture is held out, and a.png and c.png are the first
   * and the third of three. */
  options.split_every = 2;
  dataset = NULL;
  pags_result result = pags_dataset_open(s->folder, &options, &dataset);
  scratch_expect(result, PAGS_ERROR_FORMAT, "all of its views are held out");
  options.split_every = 3;
  dataset = open_ok(s->folder, &options);
  assert_true(pags_dataset_view(dataset, 0)->test && !pags_dataset_view(dataset, 1)->test);
  pags_dataset_close(dataset);
  assert_int_equal(remove(scratch_path(s, "images/a.png")), 0);
  assert_int_equal(remove(scratch_path(s, "images/c.png")), 0);
  open_fails(s->folder, &options, PAGS_ERROR_IO, "all 3 images are missing");
}

static void test_points_to_match(void **state) {
  scratch *s = *state;
  write_set(s, "\"fl_x\": 10,", "");
  pags_dataset_options options = pags_dataset_options_default();
  options.random_points = 777;
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int to_match;
  pags_dataset *dataset = open_ok(s->folder, &options);
  pags_dataset_points(dataset, &count, &xyz, &rgb, &to_match);
  assert_true(count == 777 && to_match);
  pags_dataset_close(dataset);
}

/* ---- Real data ---- */

static int fox(const char *name, char path[512]) {
  char below[64];
  snprintf(below, sizeof below, "fox/%s", name);
  return pags_shared_data(below, path, 512);
}

static void test_fox(void **state) {
  (void)state;
  char path[512];
  if (!fox("transforms.json", path))
    skip();
  pags_dataset *dataset = open_ok(path, NULL);
  assert_int_equal(pags_dataset_view_count(dataset), 50);
  int test = 0;
  for (int64_t i = 0; i < 50; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    test += view->test;
    /* COLMAP's undistorter gives 534 x 948 pixels for these pictures of 540 x 960. */
    assert_true(view->camera.width >= 530 && view->camera.width <= 540);
    assert_true(view->camera.height >= 945 && view->camera.height <= 960);
  }
  assert_int_equal(test, 7);
  pags_dataset_close(dataset);
}

static void test_fox_missing(void **state) {
  (void)state;
  char path[512];
  if (!fox("transforms_missing.json", path))
    skip();
  open_fails(path, NULL, PAGS_ERROR_IO, "0005.jpg; 17 of 67 images are missing");
  pags_dataset_options options = pags_dataset_options_default();
  options.allow_missing = 1;
  pags_dataset *dataset = open_ok(path, &options);
  assert_int_equal(pags_dataset_view_count(dataset), 50);
  assert_int_equal(pags_dataset_missing(dataset), 17);
  pags_dataset_close(dataset);
}

static void test_fox_full(void **state) {
  (void)state;
  char path[512];
  if (!fox("transforms_full.json", path))
    skip();
  /* Cameras are stated for 1080 x 1920 pixels, pictures have 540 x 960: the intrinsics are scaled. */
  open_fails(path, NULL, PAGS_ERROR_IO, "0005.jpg; 17 of 67 images are missing");
  pags_dataset_options options = pags_dataset_options_default();
  options.allow_missing = 1;
  pags_dataset *dataset = open_ok(path, &options);
  assert_true(pags_dataset_view(dataset, 0)->camera.width >= 530 && pags_dataset_view(dataset, 0)->camera.width <= 540);
  pags_dataset_close(dataset);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      scratch_test(test_order_axes_and_split),
      scratch_test(test_intrinsics),
      scratch_test(test_downscale),
      scratch_test(test_masks_and_points),
      scratch_test(test_binary_points),
      scratch_test(test_large_coordinates),
      scratch_test(test_bad_files),
      scratch_test(test_bad_frames),
      scratch_test(test_bad_poses),
      scratch_test(test_missing),
      scratch_test(test_points_to_match),
      cmocka_unit_test(test_fox),
      cmocka_unit_test(test_fox_missing),
      cmocka_unit_test(test_fox_full),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
