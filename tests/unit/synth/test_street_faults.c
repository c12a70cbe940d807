/* SPDX-License-Identifier: Apache-2.0 */
/* Tests faults of the synthetic street's cameras: each has the requested size in the pictures or in the data set's
 * statements and changes nothing else. The true values are in truth/. */
#include <pags/camera.h>
#include <pags/dataset.h>
#include <pags/image.h>
#include <pags/synth.h>
#include <pags/tasks.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/file.h"
#include "base/json.h"
#include "same_file.h"
#include "synth/faults.h"
#include "written_street.h"

enum { SIDE = 16, LAST = 40, CAMERAS = 3 };

/* A street of 0.2 s with the same houses and objects at any frame rate. */
static pags_street_options small_street(double fps) {
  pags_street_options options = pags_street_options_default();
  options.width = SIDE;
  options.height = SIDE;
  options.fps = fps;
  options.frames = 1 + (int)(0.2 * fps + 0.5);
  options.samples = 1;
  options.lidar_points = 0;
  options.shifts = 0;
  options.seed = 3;
  return options;
}

static void set_fault(pags_street_options *options, const char *text) {
  if (pags_street_faults_set(&options->faults, text) != PAGS_OK)
    fail_msg("%s", pags_error_message());
}

static pags_image load(const char *set, int frame, int camera) {
  pags_image image = {0};
  char name[96];
  snprintf(name, sizeof name, "%s/images/%03d_%d.png", set, frame, camera);
  if (pags_image_load(scratch(name), PAGS_U8, 3, &image) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  return image;
}

static pags_camera_path load_truth(const char *set, int camera) {
  pags_camera_path path = {0};
  char name[96];
  snprintf(name, sizeof name, "%s/truth/cameras/%d.json", set, camera);
  if (pags_camera_path_load(scratch(name), &path) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  return path;
}

static pags_dataset *open_set(const char *set) {
  pags_dataset *dataset = NULL;
  const pags_dataset_options options = pags_dataset_options_default();
  if (pags_dataset_open(scratch(set), &options, &dataset) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  return dataset;
}

/* Returns the largest difference of a byte between a line of one picture and a line of another; `column`: compares
 * columns. */
static int line_difference(const pags_image *a, const pags_image *b, int i, bool column) {
  int most = 0;
  for (int k = 0; k < SIDE; k++)
    for (int c = 0; c < 3; c++) {
      const size_t at = 3 * (size_t)(column ? k * SIDE + i : i * SIDE + k) + (size_t)c;
      const int difference = abs(((const uint8_t *)a->data)[at] - ((const uint8_t *)b->data)[at]);
      most = difference > most ? difference : most;
    }
  return most;
}

/* Each line of a picture that is read out in 0.16 s equals that line of a global-shutter picture at the line's time.
 * Line i is read (i - 7.5) 0.01 s after the middle. `lens`: a fault of both pictures, or NULL. */
static void check_rolling(const char *lens) {
  static const char *const faults[4] = {"rolling-down=0.16", "rolling-up=0.16", "rolling-right=0.16",
                                        "rolling-left=0.16"};
  char folder[2][32];
  static const char *const words[4] = {"top_to_bottom", "bottom_to_top", "left_to_right", "right_to_left"};
  pags_street_options fast = small_street(200);
  if (lens)
    set_fault(&fast, lens);
  snprintf(folder[0], sizeof folder[0], "fast%s", lens ? " lens" : "");
  write_street(folder[0], &fast, 2);
  for (int d = 0; d < 4; d++) {
    pags_street_options options = small_street(10);
    set_fault(&options, faults[d]);
    if (lens)
      set_fault(&options, lens);
    snprintf(folder[1], sizeof folder[1], "%s%s", words[d], lens ? " lens" : "");
    write_street(folder[1], &options, 1 + d % 2);
    for (int c = 0; c < CAMERAS; c++) {
      pags_image rolling = load(folder[1], 1, c);
      int64_t same = 0, other = 0;
      for (int i = 0; i < SIDE; i++) {
        const int line = d % 2 ? SIDE - 1 - i : i; /* the line that is read as number i */
        pags_image then = load(folder[0], 5 + 2 * i, c);
        same += line_difference(&rolling, &then, line, d >= 2) <= 1;
        other += line_difference(&rolling, &then, SIDE - 1 - line, d >= 2) <= 1;
        pags_image_destroy(&then);
      }
      pags_image_destroy(&rolling);
      /* A ray that just meets an edge may miss it, since times differ in their last digit. */
      assert_true(same >= SIDE - 1);
      assert_true(other < SIDE / 2);
    }
    char name[96];
    pags_json *json = NULL;
    snprintf(name, sizeof name, "%s/dataset.json", folder[1]);
    assert_int_equal(pags_json_parse_file(scratch(name), &json), PAGS_OK);
    assert_string_equal(pags_json_member(pags_json_member(pags_json_root(json), "rolling_shutter"), "2")->text,
                        words[d]);
    pags_json_destroy(json);
    snprintf(name, sizeof name, "%s/timestamps.json", folder[1]);
    assert_int_equal(pags_json_parse_file(scratch(name), &json), PAGS_OK);
    const pags_json_value *root = pags_json_root(json);
    const double begin = pags_json_member(pags_json_member(root, "trigger"), "1")->first->next->number,
                 end = pags_json_member(pags_json_member(root, "readout"), "1")->first->next->number;
    pags_json_destroy(json);
    assert_true(fabs(begin - 0.02) < 1e-12 && fabs(end - 0.18) < 1e-12);
  }
}

static void test_rolling(void **state) {
  (void)state;
  check_rolling(NULL);
  check_rolling("fisheye=170");
}

/* A delayed camera shows what a later frame would show, and the data set doesn't state the delay. */
static void test_delay(void **state) {
  (void)state;
  pags_street_options options = small_street(10);
  set_fault(&options, "delay=0.05");
  write_street("late", &options, 2);
  pags_dataset *dataset = open_set("late");
  double late[CAMERAS];
  for (int c = 0; c < CAMERAS; c++) {
    pags_camera_path path = load_truth("late", c);
    late[c] = path.cameras[0].time;
    for (int f = 0; f < options.frames; f++) {
      const pags_camera *camera = &path.cameras[f];
      assert_true(fabs(camera->time - late[c] - f / 10.0) < 1e-12);
      const pags_view *view = pags_dataset_view(dataset, f * CAMERAS + c);
      assert_true(view->camera.time == f / 10.0 && view->shutter_time == f / 10.0);
      /* The car drives at 9 to 11 m/s. */
      const double apart = camera->world_from_camera[3] - view->camera.world_from_camera[3];
      assert_true(fabs(apart - 10.0 * late[c]) < fabs(late[c]) * 1.3 + 1e-3);
    }
    pags_camera_path_destroy(&path);
    /* The best match is the picture at the time stated in truth/. */
    double best = HUGE_VAL;
    int nearest = 0;
    pags_image picture = load("late", 1, c);
    for (int j = 0; j <= LAST; j++) {
      pags_image then = load("fast", j, c);
      double sum = 0.0;
      for (int i = 0; i < 3 * SIDE * SIDE; i++)
        sum += fabs((double)((const uint8_t *)picture.data)[i] - (double)((const uint8_t *)then.data)[i]);
      nearest = sum < best ? j : nearest;
      best = fmin(best, sum);
      pags_image_destroy(&then);
    }
    pags_image_destroy(&picture);
    assert_true(fabs(nearest / 200.0 - (0.1 + late[c])) < 0.006);
  }
  pags_dataset_close(dataset);
  assert_true(fabs(late[0] - late[1]) > 1e-3 && fabs(late[1] - late[2]) > 1e-3);
  for (int c = 0; c < CAMERAS; c++)
    assert_true(fabs(late[c]) > 1e-4 && fabs(late[c]) < 0.2);
}

/* Returns the errors of the recorded camera's pose in the frame of the true one: rotation in degrees, position in
 * metres. */
static void pose_error(const pags_camera *truth, const pags_camera *recorded, double *degrees, double *metres) {
  double to[12], off[12];
  pags_rigid_inverse(truth->world_from_camera, to);
  pags_rigid_multiply(to, recorded->world_from_camera, off);
  *metres = sqrt(off[3] * off[3] + off[7] * off[7] + off[11] * off[11]);
  const double x = off[9] - off[6], y = off[2] - off[8], z = off[4] - off[1];
  *degrees = asin(0.5 * sqrt(x * x + y * y + z * z)) * 57.29577951308232;
}

static void test_poses(void **state) {
  (void)state;
  enum { FRAMES = 80 };
  pags_street_options options = small_street(10);
  options.frames = FRAMES;
  options.objects = 0;
  set_fault(&options, "position=0.05");
  set_fault(&options, "angle=0.3");
  write_street("moved", &options, 2);
  pags_dataset *dataset = open_set("moved");
  double squares[CAMERAS][2] = {{0}};
  for (int c = 0; c < CAMERAS; c++) {
    pags_camera_path path = load_truth("moved", c);
    assert_int_equal(path.count, FRAMES);
    for (int f = 0; f < FRAMES; f++) {
      double degrees, metres;
      pose_error(&path.cameras[f], &pags_dataset_view(dataset, f * CAMERAS + c)->camera, &degrees, &metres);
      squares[c][0] += degrees * degrees / FRAMES;
      squares[c][1] += metres * metres / FRAMES;
    }
    pags_camera_path_destroy(&path);
    /* The error of 80 steps, half of it correlated, is within a quarter of the request. All cameras turn with the
     * car; 1.6 m in front of the axle, a turn of 0.3 degrees adds a centimetre. */
    assert_true(fabs(sqrt(squares[c][0]) / 0.3 - 1.0) < 0.25);
    assert_true(fabs(sqrt(squares[c][1]) / 0.05 - 1.0) < 0.3);
    assert_true(fabs(squares[c][0] - squares[0][0]) < 1e-6);
  }
  pags_dataset_close(dataset);

  options.faults = (pags_street_faults){0};
  set_fault(&options, "mount-position=0.02");
  set_fault(&options, "mount-angle=0.5");
  options.frames = 3;
  write_street("bent", &options, 2);
  dataset = open_set("bent");
  double degrees[2 * CAMERAS], metres[2 * CAMERAS];
  for (int c = 0; c < CAMERAS; c++) {
    pags_camera_path path = load_truth("bent", c);
    for (int f = 0; f < 2; f++)
      pose_error(&path.cameras[f], &pags_dataset_view(dataset, f * CAMERAS + c)->camera, &degrees[CAMERAS * f + c],
                 &metres[CAMERAS * f + c]);
    pags_camera_path_destroy(&path);
    assert_true(fabs(degrees[c] - degrees[CAMERAS + c]) < 1e-6 && fabs(metres[c] - metres[CAMERAS + c]) < 1e-9);
    assert_true(degrees[c] > 0.05 && degrees[c] < 2.0 && metres[c] > 0.001 && metres[c] < 0.08);
  }
  pags_dataset_close(dataset);
  assert_true(fabs(degrees[0] - degrees[1]) > 1e-3 && fabs(metres[1] - metres[2]) > 1e-5);
}

/* Returns the linear light of one byte of a picture. */
static double light_at(const pags_image *image, int x, int y, double power) {
  const double s = pow(((const uint8_t *)image->data)[3 * (y * SIDE + x) + 1] / 255.0, 1.0 / power);
  return s <= 0.04045 ? s / 12.92 : pow((s + 0.055) / 1.055, 2.4);
}

static void test_light(void **state) {
  (void)state;
  static const double powers[CAMERAS] = {1.0, 1.2, 0.8};
  pags_street_options options = small_street(10);
  write_street("plain", &options, 2);
  set_fault(&options, "vignette=0.5");
  set_fault(&options, "response=0.2");
  write_street("dark", &options, 2);
  for (int c = 0; c < CAMERAS; c++) {
    pags_image plain = load("plain", 1, c), dark = load("dark", 1, c);
    for (int y = 0; y < SIDE; y++)
      for (int x = 0; x < SIDE; x++) {
        const double u = (x - 7.5) / 8.0, v = (y - 7.5) / 8.0, full = light_at(&plain, x, y, 1.0);
        if (full > 0.05 && full < 0.9) /* a byte is inexact when dark and clipped when bright */
          assert_true(fabs(light_at(&dark, x, y, powers[c]) / full - (1.0 - 0.5 * (u * u + v * v) / 2.0)) < 0.05);
      }
    pags_image_destroy(&plain);
    pags_image_destroy(&dark);
  }
}

/* Returns the share of equal pixels in a front camera's picture of a data set and the wanted picture. */
static double alike(const char *set, int frame, const pags_image *wanted) {
  pags_dataset *dataset = open_set(set);
  pags_tasks *tasks = pags_tasks_create(1);
  pags_photo_cache *cache = NULL;
  pags_photo photo;
  int64_t same = 0, used = 0;
  assert_int_equal(pags_photo_cache_create(dataset, tasks, 1 << 24, &cache), PAGS_OK);
  assert_int_equal(pags_photo_cache_get(cache, frame, 1, &photo), PAGS_OK);
  const pags_camera *camera = &pags_dataset_view(dataset, frame)->camera;
  for (int y = 0; y < photo.height; y++)
    for (int x = 0; x < photo.width; x++) {
      /* The same direction in the pinhole camera's picture. */
      const int px = (int)floor((x + 0.5 - camera->cx) / camera->fx * 0.8 * wanted->width + 0.5 * wanted->width),
                py = (int)floor((y + 0.5 - camera->cy) / camera->fy * 0.8 * wanted->width + 0.5 * wanted->height);
      if (px < 0 || py < 0 || px >= wanted->width || py >= wanted->height ||
          (photo.mask && !photo.mask[(int64_t)y * photo.stride + x]))
        continue;
      used++;
      same += abs(photo.rgb[(int64_t)y * photo.stride + x] -
                  ((const uint8_t *)wanted->data)[3 * (py * wanted->width + px)]) < 25;
    }
  pags_photo_cache_destroy(cache);
  pags_tasks_destroy(tasks);
  pags_dataset_close(dataset);
  assert_true(used > wanted->width * wanted->height / 3);
  return (double)same / (double)used;
}

/* An undistorted photograph shows the same as a pinhole camera. */
static void test_distortion(void **state) {
  (void)state;
  pags_street_options options = small_street(10);
  options.width = 96;
  options.height = 64;
  options.cameras = 1;
  options.samples = 4;
  write_street("straight", &options, 2);
  pags_image wanted = load("straight", 1, 0);
  set_fault(&options, "distortion=-0.2");
  write_street("distorted", &options, 2);
  pags_image distorted = load("distorted", 1, 0);
  int64_t same = 0;
  for (int i = 0; i < 3 * 96 * 64; i++)
    same += abs(((const uint8_t *)distorted.data)[i] - ((const uint8_t *)wanted.data)[i]) < 25;
  const double before = (double)same / (3 * 96 * 64), after = alike("distorted", 1, &wanted);
  print_message("distorted: %.1f %% alike, undistorted: %.1f %%\n", 100 * before, 100 * after);
  assert_true(after > 0.93 && 1.0 - after < 0.6 * (1.0 - before));
  pags_image_destroy(&distorted);
  pags_image_destroy(&wanted);
}

/* A fisheye's rays are those of the lens in the data set, and its picture is empty outside of the circle. */
static void test_fisheye(void **state) {
  (void)state;
  pags_street_options options = small_street(10);
  options.width = 48;
  options.height = 32;
  set_fault(&options, "fisheye=170");
  pags_camera camera = pags_faults_camera(&options, 1, 2, -1);
  if (pags_camera_check(&camera, "camera") != PAGS_OK)
    fail_msg("%s", pags_error_message());
  int seen = 0;
  for (int y = 0; y < 32; y++)
    for (int x = 0; x < 48; x++) {
      double traced[3], looked[3] = {0};
      const bool is_seen = pags_faults_ray(&options, &camera, x + 0.5, y + 0.5, traced);
      assert_int_equal(is_seen, pags_camera_look(&camera, x + 0.5, y + 0.5, looked));
      seen += is_seen;
      for (int k = 0; k < 3 && is_seen; k++)
        assert_true(fabs(traced[k] - looked[k]) < 1e-9);
    }
  assert_in_range(seen, 1100, 1480); /* the circle is as wide as the picture */
  write_street("fisheye", &options, 2);
  pags_image image = load("fisheye", 1, 0), classes = {0};
  if (pags_image_load(scratch("fisheye/semantic/001_0.png"), PAGS_U8, 1, &classes) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  assert_int_equal(((const uint8_t *)image.data)[0] + ((const uint8_t *)image.data)[2], 0);
  assert_int_equal(((const uint8_t *)classes.data)[0], 255);
  assert_true(((const uint8_t *)classes.data)[16 * 48 + 24] < 20);
  pags_image_destroy(&image);
  pags_image_destroy(&classes);
}

/* The street has the same bytes for any number of threads. */
static void test_threads(void **state) {
  (void)state;
  static const char *const all[] = {"rolling-right=0.03", "delay=0.01",   "position=0.05", "angle=0.3",
                                    "vignette=0.3",       "response=0.1", "distortion=0.1"};
  static const char *const files[] = {"images/001_2.png", "truth/depth/002_0.exr", "truth/cameras/1.json",
                                      "ego_pose/001.txt", "truth/street.json",     "semantic/001_1.png"};
  pags_street_options options = small_street(10);
  for (size_t i = 0; i < sizeof all / sizeof *all; i++)
    set_fault(&options, all[i]);
  write_street("one", &options, 1);
  write_street("three", &options, 3);
  for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
    char a[96], b[96];
    snprintf(a, sizeof a, "one/%s", files[i]);
    snprintf(b, sizeof b, "three/%s", files[i]);
    assert_same_file(scratch(a), scratch(b));
  }
}

/* A lively drive brakes from 13.6 m/s to 6.4 m/s within half of its wave. The true surfaces, built again, are those
 * that the LiDAR saw and that stand where the car met them. */
static void test_lively(void **state) {
  (void)state;
  pags_street_options options = small_street(5);
  pags_dataset_options opened = pags_dataset_options_default();
  pags_dataset *dataset;
  pags_street_truth *truth;
  double least = INFINITY, most = 0.0;
  options.frames = 18;
  options.lively = 1;
  options.lidar_points = 400;
  options.lidar_noise = 0.0;
  write_street("lively", &options, 2);
  pags_camera_path path = load_truth("lively", 0);
  for (int64_t i = 0; i + 1 < path.count; i++) {
    const double *a = path.cameras[i].world_from_camera, *b = path.cameras[i + 1].world_from_camera;
    const double speed = hypot(b[3] - a[3], b[7] - a[7]) * options.fps;
    least = fmin(least, speed);
    most = fmax(most, speed);
  }
  pags_camera_path_destroy(&path);
  if (!(least < 6.7 && most > 13.3))
    fail_msg("from %.2f to %.2f m/s", least, most);

  assert_int_equal(pags_dataset_open(scratch("lively"), &opened, &dataset), PAGS_OK);
  assert_int_equal(pags_street_truth_open(scratch("lively"), &truth), PAGS_OK);
  const pags_sweep *sweep = pags_dataset_sweep(dataset, 9);
  int64_t count;
  float *xyz, distances[2][400];
  assert_int_equal(pags_dataset_sweep_load(dataset, 9, &count, &xyz), PAGS_OK);
  for (int64_t i = 0; i < count; i++) {
    const double own[3] = {xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]};
    double world[3];
    pags_rigid_point(sweep->world_from_sweep, own, world);
    for (int k = 0; k < 3; k++)
      xyz[3 * i + k] = (float)world[k];
  }
  assert_int_equal(pags_street_truth_distances(truth, sweep->time, xyz, count, 1.0, distances[0], distances[1]),
                   PAGS_OK);
  for (int64_t i = 0; i < count; i++)
    if (!(fminf(distances[0][i], distances[1][i]) < 0.02f))
      fail_msg("point %d is %.3f m from any surface", (int)i, (double)fminf(distances[0][i], distances[1][i]));
  free(xyz);
  pags_street_truth_close(truth);
  pags_dataset_close(dataset);
}

static void test_names(void **state) {
  (void)state;
  pags_street_faults faults = {0};
  static const char *const wrong[] = {"rolling",    "rolling=0.1", "delay=", "delay=x",
                                      "vignette=1", "angle=-1",    "=1",     "position=nan"};
  for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
    assert_int_equal(pags_street_faults_set(&faults, wrong[i]), PAGS_ERROR_ARGUMENT);
  assert_int_equal(pags_street_faults_set(&faults, "shake=1"), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "mount-angle"));
  pags_street_options options = small_street(10);
  options.faults.vignette = 2.0;
  assert_int_equal(pags_synth_street(scratch("never"), &options, NULL, NULL, NULL), PAGS_ERROR_ARGUMENT);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_rolling), cmocka_unit_test(test_delay),      cmocka_unit_test(test_poses),
      cmocka_unit_test(test_light),   cmocka_unit_test(test_distortion), cmocka_unit_test(test_threads),
      cmocka_unit_test(test_lively),  cmocka_unit_test(test_fisheye),    cmocka_unit_test(test_names)};
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
