/* SPDX-License-Identifier: Apache-2.0 */
/* Tests corrections of camera poses (train/camera_poses.h): gradients compared with finite differences, fixed poses,
 * poses between two corrections, and recovery of wrong poses. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <pags/camera.h>

#include "small_street.h"
#include "train/camera_poses.h"

enum { POINTS = 40 };

/* A loss for one view: weighted image positions of points in front of its camera, which a motion of the world moves. */
typedef struct toy {
  double points[POINTS][3]; /* absolute coordinates */
  double weights[POINTS][2];
} toy;

static double hashed(int a, int b) {
  const double x = sin(12.9898 * a + 78.233 * b + 1.3) * 43758.5453;
  return x - floor(x) - 0.5;
}

static toy make_toy(int64_t view) {
  toy t;
  const double *m = pags_dataset_view(dataset, view)->camera.world_from_camera;
  for (int i = 0; i < POINTS; i++) {
    const double z = 4.0 + 20.0 * (hashed(i, 2) + 0.5), own[3] = {z * hashed(i, 0), z * hashed(i, 1), z};
    pags_rigid_point(m, own, t.points[i]);
    t.weights[i][0] = hashed(i, 3);
    t.weights[i][1] = hashed(i, 4);
  }
  return t;
}

static double loss_of(const toy *t, const pags_camera *camera) {
  double from[12], sum = 0.0;
  pags_rigid_inverse(camera->world_from_camera, from);
  for (int i = 0; i < POINTS; i++) {
    double own[3];
    pags_rigid_point(from, t->points[i], own);
    sum += t->weights[i][0] * own[0] / own[2] + t->weights[i][1] * own[1] / own[2];
  }
  return sum;
}

/* Gradient of the loss by a motion of all points about the data set's origin, by central differences. */
static void world_gradient(toy t, const pags_camera *camera, double out[6]) {
  const double *origin = pags_dataset_origin(dataset);
  for (int axis = 0; axis < 6; axis++) {
    double sides[2];
    for (int side = 0; side < 2; side++) {
      double value[6] = {0}, motion[12];
      toy moved = t;
      value[axis] = side ? 1e-6 : -1e-6;
      pags_increment_matrix(value, value + 3, motion);
      for (int i = 0; i < POINTS; i++) {
        const double local[3] = {t.points[i][0] - origin[0], t.points[i][1] - origin[1], t.points[i][2] - origin[2]};
        pags_rigid_point(motion, local, moved.points[i]);
        for (int k = 0; k < 3; k++)
          moved.points[i][k] += origin[k];
      }
      sides[side] = loss_of(&moved, camera);
    }
    out[axis] = (sides[1] - sides[0]) / 2e-6;
  }
}

static void test_gradient(void **state) {
  (void)state;
  pags_camera_poses poses;
  assert_int_equal(pags_camera_poses_create(&poses, dataset), PAGS_OK);
  assert_int_equal(poses.steps, FRAMES);
  assert_int_equal(poses.sensors, 2);
  for (int64_t view = 1; view < 6; view++) {
    const toy t = make_toy(view);
    const pags_camera camera = pags_camera_poses_view(&poses, dataset, view);
    double by_world[6], got[3][6];
    world_gradient(t, &camera, by_world);
    pags_camera_poses_gradient(&poses, dataset, view, by_world, got[0], got[1], got[2]);
    pags_camera_part *items[3] = {&poses.items[poses.step_of[view]], &poses.items[poses.steps + poses.sensor_of[view]],
                                  &poses.items[poses.steps + poses.sensors + poses.sensor_of[view]]};
    const double *speed = poses.speeds[view] + 3; /* in metres a second; the street's car drives at 9 to 11 m/s */
    assert_true(fabs(sqrt(speed[0] * speed[0] + speed[1] * speed[1] + speed[2] * speed[2]) - 10.0) < 1.2);
    items[0]->moments.count = 1; /* without this its value would count as unknown */
    for (int part = 0; part < 3; part++)
      for (int axis = 0; axis < (part < 2 ? 6 : 1); axis++) {
        double sides[2];
        for (int side = 0; side < 2; side++) {
          items[part]->value[axis] = side ? 1e-6 : -1e-6;
          const pags_camera moved = pags_camera_poses_view(&poses, dataset, view);
          sides[side] = loss_of(&t, &moved);
        }
        items[part]->value[axis] = 0.0;
        const double want = (sides[1] - sides[0]) / 2e-6;
        if (!(fabs(got[part][axis] - want) < 1e-5 * (1.0 + fabs(want))))
          fail_msg("view %d, part %d, axis %d: %.9g, should be %.9g", (int)view, part, axis, got[part][axis], want);
      }
    items[0]->moments.count = 0;
  }
  pags_camera_poses_destroy(&poses);
}

/* A camera whose delay is a whole frame stands where the next photograph was taken. */
static void test_delay(void **state) {
  (void)state;
  pags_camera_poses poses;
  assert_int_equal(pags_camera_poses_create(&poses, dataset), PAGS_OK);
  for (int64_t view = 6; view < 14; view++) { /* the speed is a mean over two photographs on either side */
    const pags_camera *next = &pags_dataset_view(dataset, view + 2)->camera;
    double *const delay = poses.items[poses.steps + poses.sensors + poses.sensor_of[view]].value;
    delay[0] = next->time - pags_dataset_view(dataset, view)->camera.time;
    const pags_camera late = pags_camera_poses_view(&poses, dataset, view);
    delay[0] = 0.0;
    assert_int_equal(poses.sensor_of[view + 2], poses.sensor_of[view]);
    for (int k = 0; k < 12; k++) /* within 10 cm of about 1 m, as the car brakes and turns */
      assert_true(fabs(late.world_from_camera[k] - next->world_from_camera[k]) < (k % 4 == 3 ? 0.1 : 0.01));
  }
  pags_camera_poses_destroy(&poses);
}

/* Time steps without a correction get one interpolated between their neighbours; without any correction poses don't
 * change. */
static void test_between(void **state) {
  (void)state;
  pags_camera_poses poses;
  assert_int_equal(pags_camera_poses_create(&poses, dataset), PAGS_OK);
  for (int64_t i = 0; i < poses.count; i++) {
    const pags_camera camera = pags_camera_poses_view(&poses, dataset, i);
    for (int k = 0; k < 12; k++)
      assert_true(fabs(camera.world_from_camera[k] - pags_dataset_view(dataset, i)->camera.world_from_camera[k]) <
                  1e-12);
  }
  poses.items[3].moments.count = poses.items[5].moments.count = 1;
  poses.items[3].value[4] = 0.1;
  poses.items[5].value[4] = 0.3;
  static const double want[FRAMES] = {0.1, 0.1, 0.1, 0.1, 0.2, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3};
  for (int64_t i = 0; i < poses.count; i++) {
    const pags_camera camera = pags_camera_poses_view(&poses, dataset, i);
    const double moved = camera.world_from_camera[7] - pags_dataset_view(dataset, i)->camera.world_from_camera[7];
    assert_true(fabs(moved - want[poses.step_of[i]]) < 1e-9);
  }
  pags_camera_poses_destroy(&poses);
}

/* Descent on the squared image positions finds noise on the poses again; mean corrections are kept at 0. */
static void test_found(void **state) {
  (void)state;
  enum { ROUNDS = 400 };
  pags_camera_poses poses;
  pags_train_config config = pags_train_config_default();
  assert_int_equal(pags_camera_poses_create(&poses, dataset), PAGS_OK);
  pags_schedule schedule = pags_schedule_make(&config, 1.0, poses.count);
  schedule.length = ROUNDS * poses.count;
  double wrong[FRAMES][6], mean[6] = {0}, before = 0.0, after = 0.0;
  for (int f = 0; f < FRAMES; f++)
    for (int k = 0; k < 6; k++) {
      wrong[f][k] = (k < 3 ? 0.01 : 0.1) * hashed(f, 10 + k);
      mean[k] += wrong[f][k] / FRAMES;
    }
  for (int64_t step = 1; step <= schedule.length; step++) {
    /* The loss is the square of the error. Its gradient by a motion of the world is minus its gradient by the motion
     * of the step. */
    const int64_t view = (step * 7) % poses.count;
    const int f = poses.step_of[view];
    const double *place = poses.places[f];
    double by_world[6], lever[3], off[6];
    for (int k = 0; k < 6; k++)
      off[k] = poses.items[f].value[k] - (wrong[f][k] - mean[k]);
    /* by_step = -(turn + push x place), -push */
    for (int k = 0; k < 3; k++)
      by_world[3 + k] = -off[3 + k];
    lever[0] = by_world[4] * place[2] - by_world[5] * place[1];
    lever[1] = by_world[5] * place[0] - by_world[3] * place[2];
    lever[2] = by_world[3] * place[1] - by_world[4] * place[0];
    for (int k = 0; k < 3; k++)
      by_world[k] = -off[k] - lever[k];
    assert_true(pags_camera_poses_update(&poses, dataset, view, by_world, &schedule, step));
  }
  for (int k = 0; k < 6; k++) {
    double sum = 0.0;
    for (int f = 0; f < FRAMES; f++) {
      sum += poses.items[f].value[k];
      before += pow(wrong[f][k] - mean[k], 2) * (k < 3 ? 100.0 : 1.0);
      after += pow(poses.items[f].value[k] - wrong[f][k] + mean[k], 2) * (k < 3 ? 100.0 : 1.0);
    }
    assert_true(fabs(sum) < 1e-9);
  }
  print_message("error %.4g before, %.4g after\n", sqrt(before), sqrt(after));
  assert_true(sqrt(after) < 0.1 * sqrt(before));
  const double bad[6] = {0, 0, (double)NAN, 0, 0, 0};
  const pags_camera_part kept = poses.items[2];
  assert_false(pags_camera_poses_update(&poses, dataset, 4, bad, &schedule, 5));
  assert_memory_equal(&kept, &poses.items[2], sizeof kept);
  pags_camera_poses_destroy(&poses);
}

int main(void) {
  small_street_cameras = 2;
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_gradient), cmocka_unit_test(test_delay),
                                     cmocka_unit_test(test_between), cmocka_unit_test(test_found)};
  return cmocka_run_group_tests(tests, make_street, remove_street);
}
