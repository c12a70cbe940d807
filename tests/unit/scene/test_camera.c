/* SPDX-License-Identifier: Apache-2.0 */
/* Tests rigid motions, the check of cameras, and camera and path files. */
#include <pags/camera.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include "base/rng.h"
#include "scratch_folder.h"
#include "shared_data.h"

#include <cmocka.h>

static pags_camera sample(uint64_t seed) {
  double q[4], r[9];
  pags_camera camera = {
      .width = 640, .height = 480, .fx = 500, .fy = 510, .cx = 320.25, .cy = 239.5, .time = (double)NAN};
  pags_rng_normal2(seed, 0, 0, q);
  pags_rng_normal2(seed, 1, 0, q + 2);
  pags_rotation_from_quaternion(q, r);
  for (int i = 0; i < 3; i++) {
    memcpy(camera.world_from_camera + 4 * i, r + 3 * i, 3 * sizeof *r);
    camera.world_from_camera[4 * i + 3] = pags_rng_uniform(seed, 2, (uint64_t)i) * 10;
  }
  return camera;
}

static double difference(const double *a, const double *b, int count) {
  double largest = 0;
  for (int i = 0; i < count; i++)
    largest = fmax(largest, fabs(a[i] - b[i]));
  return largest;
}

static void a_quarter_turn_about_z(void **state) {
  (void)state;
  const double half = sqrt(0.5), q[4] = {2 * half, 0, 0, 2 * half}, zero[4] = {0};
  const double turn[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1}, identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  double r[9];
  pags_rotation_from_quaternion(q, r);
  assert_true(difference(r, turn, 9) < 1e-15);
  pags_rotation_from_quaternion(zero, r);
  assert_true(difference(r, identity, 9) == 0);
}

static void quaternions_round_trip(void **state) {
  (void)state;
  for (uint64_t i = 0; i < 1000; i++) {
    double q[4], r[9], back[4], again[9];
    pags_rng_normal2(1, 0, i, q);
    pags_rng_normal2(1, 1, i, q + 2);
    if (i % 4) /* rotations near half turns, where the quaternion's w is small */
      q[0] *= 1e-9;
    pags_rotation_from_quaternion(q, r);
    pags_quaternion_from_rotation(r, back);
    pags_rotation_from_quaternion(back, again);
    assert_true(back[0] >= 0);
    assert_true(difference(r, again, 9) < 4e-15);
  }
}

static void the_inverse_undoes(void **state) {
  (void)state;
  const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  pags_camera camera = sample(3);
  double inverse[12], product[12];
  pags_rigid_inverse(camera.world_from_camera, inverse);
  pags_rigid_multiply(camera.world_from_camera, inverse, product);
  assert_true(difference(product, identity, 12) < 1e-14);
}

static void the_check_makes_rotations_exact_once(void **state) {
  (void)state;
  for (uint64_t seed = 0; seed < 100; seed++) {
    pags_camera camera = sample(seed), exact = camera;
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        camera.world_from_camera[4 * i + j] += 4e-4 * (pags_rng_uniform(seed, 9, (uint64_t)(3 * i + j)) - 0.5);
    assert_int_equal(pags_camera_check(&camera, "view"), PAGS_OK);
    assert_true(difference(camera.world_from_camera, exact.world_from_camera, 12) < 1e-3);
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++) {
        const double *a = camera.world_from_camera + 4 * i, *b = camera.world_from_camera + 4 * j;
        assert_true(fabs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] - (i == j)) < 2e-15);
      }
    pags_camera again = camera;
    assert_int_equal(pags_camera_check(&again, "view"), PAGS_OK);
    assert_memory_equal(again.world_from_camera, camera.world_from_camera, sizeof camera.world_from_camera);
  }
}

static void assert_refused(pags_camera camera, const char *message) {
  assert_int_equal(pags_camera_check(&camera, "view 3"), PAGS_ERROR_FORMAT);
  assert_non_null(strstr(pags_error_message(), message));
  assert_memory_equal(pags_error_message(), "view 3: ", 8);
}

static void the_check_refuses(void **state) {
  (void)state;
  pags_camera camera = sample(5), bad = camera;
  bad.width = 0;
  assert_refused(bad, "1 to 65535 pixels");
  bad = camera;
  bad.fy = (double)NAN;
  assert_refused(bad, "positive focal lengths");
  bad = camera;
  bad.cx = (double)INFINITY;
  assert_refused(bad, "finite principal point");
  bad = camera;
  bad.world_from_camera[3] = (double)NAN;
  assert_refused(bad, "pose is not finite");
  bad = camera;
  for (int i = 0; i < 3; i++)
    bad.world_from_camera[4 * i] *= -1; /* a reflection instead of a rotation */
  assert_refused(bad, "not a rotation");
  bad = camera;
  bad.world_from_camera[0] += 0.01;
  assert_refused(bad, "not a rotation");
}

static void downscaling_divides(void **state) {
  (void)state;
  pags_camera camera = sample(6);
  camera.width = 1067;
  pags_camera half = pags_camera_downscale(&camera, 4);
  assert_int_equal(half.width, 266);
  assert_int_equal(half.height, 120);
  assert_true(half.fx == 125 && half.cx == 80.0625);
  assert_int_equal(pags_camera_downscale(&camera, 1000).height, 1);
}

static void paths_survive_files(void **state) {
  (void)state;
  pags_camera cameras[2] = {sample(7), sample(8)};
  cameras[1].time = 0.25;
  const pags_camera_path two = {24, 2, cameras}, one = {0, 1, cameras};
  pags_camera_path back;
  assert_int_equal(pags_camera_path_save(scratch("path.json"), &two), PAGS_OK);
  assert_int_equal(pags_camera_path_load(scratch("path.json"), &back), PAGS_OK);
  assert_true(back.fps == 24 && back.count == 2);
  assert_true(isnan(back.cameras[0].time) && back.cameras[1].time == 0.25);
  for (int i = 0; i < 2; i++) {
    assert_true(difference(back.cameras[i].world_from_camera, cameras[i].world_from_camera, 12) < 1e-14);
    assert_true(back.cameras[i].cx == cameras[i].cx && back.cameras[i].fy == cameras[i].fy);
  }
  pags_camera_path_destroy(&back);
  assert_int_equal(pags_camera_path_save(scratch("camera.json"), &one), PAGS_OK);
  assert_int_equal(pags_camera_path_load(scratch("camera.json"), &back), PAGS_OK);
  assert_true(back.fps == 0 && back.count == 1);
  pags_camera_path_destroy(&back);
}

static void assert_load_fails(const char *text, const char *message) {
  pags_camera_path path;
  assert_int_equal(pags_camera_path_load(scratch_file("bad.json", text, strlen(text)), &path), PAGS_ERROR_FORMAT);
  assert_null(path.cameras);
  if (!strstr(pags_error_message(), message))
    fail_msg("expected '%s' in '%s'", message, pags_error_message());
}

static void bad_files_are_explained(void **state) {
  (void)state;
  assert_load_fails("[]", "bad.json:1: expected an object for 'a camera or a path'");
  assert_load_fails("{\"width\": 1,\n\"height\": \"x\"}", "bad.json:2: expected a number for 'height', found a string");
  assert_load_fails("{\"frames\": [], \"fps\": 1}", "at least one camera");
  assert_load_fails("{\"frames\": [{}], \"fps\": 0}", "a positive number for 'fps'");
  assert_load_fails(
      "{\"width\": 4, \"height\": 4, \"fx\": 4, \"fy\": 4, \"cx\": 2, \"cy\": 2,\n\"lens\": {\"kind\": \"fisheye\", "
      "\"k\": "
      "null}}",
      "expected an array for 'k', found null");
  assert_load_fails("{\"fps\": 10, \"frames\": [\n3]}", "bad.json:2: expected an object with 'width', found a number");
  assert_load_fails(
      "{\"width\": 1, \"height\": 1, \"fx\": 1, \"fy\": 1, \"cx\": 0, \"cy\": 0,"
      "\"camera_from_world_quaternion_wxyz\": [0, 0, 0, 0], \"camera_from_world_translation\": [0, 0, 0]}",
      "about unit length");
}

static void the_fox_camera_reads(void **state) {
  (void)state;
  char path[1024];
  if (!pags_shared_data("splats/fox_31k_view.json", path, sizeof path))
    skip();
  pags_camera_path fox;
  assert_int_equal(pags_camera_path_load(path, &fox), PAGS_OK);
  assert_int_equal(fox.cameras[0].width, 534);
  double inverse[12];
  pags_rigid_inverse(fox.cameras[0].world_from_camera, inverse);
  assert_true(fabs(inverse[11] - 4.741534361611549) < 1e-12);
  pags_camera_path_destroy(&fox);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_quarter_turn_about_z), cmocka_unit_test(quaternions_round_trip),
      cmocka_unit_test(the_inverse_undoes),     cmocka_unit_test(the_check_makes_rotations_exact_once),
      cmocka_unit_test(the_check_refuses),      cmocka_unit_test(downscaling_divides),
      cmocka_unit_test(paths_survive_files),    cmocka_unit_test(bad_files_are_explained),
      cmocka_unit_test(the_fox_camera_reads),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
