/* SPDX-License-Identifier: Apache-2.0 */
/* Tests optimised poses of objects and exposures of views: their gradients, their updates, and which parameters stay
 * fixed. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <pags/camera.h>

#include "base/rng.h"
#include "train/exposure.h"
#include "train/track_poses.h"

static pags_track_poses one_track(void) {
  pags_track_poses t = {.count = 1, .objects = calloc(1, sizeof *t.objects), .moments = calloc(1, sizeof *t.moments)};
  t.objects[0] = (pags_object){.keyframe_count = 3, .keyframes = calloc(3, sizeof(pags_keyframe))};
  t.moments[0] = calloc(3, sizeof(pags_adam6));
  t.objects[0].keyframes[1].frame = 4;
  t.objects[0].keyframes[2].frame = 8;
  return t;
}

/* Adds the gradient of the loss |p - target|^2 / 2 by a perturbation of the keyframe's pose, p being a point fixed in
 * the object's box. */
static void gradient_of(const pags_keyframe *k, const double point[3], const double target[3], double g[6]) {
  double m[12], error[3], local[3];
  pags_increment_matrix(k->rotation, k->translation, m);
  for (int i = 0; i < 3; i++)
    error[i] = m[4 * i] * point[0] + m[4 * i + 1] * point[1] + m[4 * i + 2] * point[2] + m[4 * i + 3] - target[i];
  for (int i = 0; i < 3; i++) /* rotates the error into the object's frame, in which the pose is perturbed */
    local[i] = m[i] * error[0] + m[4 + i] * error[1] + m[8 + i] * error[2];
  for (int i = 0; i < 3; i++) {
    int a = (i + 1) % 3, b = (i + 2) % 3;
    g[i] += point[a] * local[b] - point[b] * local[a];
    g[3 + i] += local[i];
  }
}

/* The labels of two keyframes are off by opposite amounts, so that the errors have zero mean, which the optimisation
 * keeps; a third keyframe is seen in no photograph. */
static void wrong_poses_are_corrected(void **unused) {
  (void)unused;
  static const double points[4][3] = {{2, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-2, 1, 0.5}};
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.schedule.iterations = 2000;
  config.objects.track_translation_rate = 0.01;
  config.objects.track_rotation_rate = 0.004;
  pags_schedule schedule = pags_schedule_make(&config, 1.0, 10);
  pags_track_poses tracks = one_track();
  for (int step = 1; step <= 1200; step++) {
    double g[6] = {0.0}, m[12], sign = step % 2 ? 1.0 : -1.0;
    int64_t k = pags_track_poses_keyframe(&tracks.objects[0], step % 2 ? 4 : 0);
    pags_increment_matrix((double[]){0, 0, 0.1 * sign}, (double[]){0.3 * sign, -0.2 * sign, 0.05 * sign}, m);
    for (int p = 0; p < 4; p++) {
      double target[3];
      for (int i = 0; i < 3; i++)
        target[i] = m[4 * i] * points[p][0] + m[4 * i + 1] * points[p][1] + m[4 * i + 2] * points[p][2] + m[4 * i + 3];
      gradient_of(&tracks.objects[0].keyframes[k], points[p], target, g);
    }
    pags_track_poses_update(&tracks, 0, k, g, &schedule, step);
  }
  const double turn[3] = {0, 0, 0.1}, way[3] = {0.3, -0.2, 0.05};
  pags_keyframe *keyframe = &tracks.objects[0].keyframes[1], *opposite = &tracks.objects[0].keyframes[0];
  for (int i = 0; i < 3; i++) {
    assert_true(fabs(keyframe->rotation[i] - turn[i]) < 0.005 && fabs(opposite->rotation[i] + turn[i]) < 0.005);
    assert_true(fabs(keyframe->translation[i] - way[i]) < 0.01 && fabs(opposite->translation[i] + way[i]) < 0.01);
    /* The mean of the increments stays zero. */
    assert_true(fabs(keyframe->translation[i] + opposite->translation[i]) < 1e-12);
    assert_true(tracks.objects[0].keyframes[2].translation[i] == 0.0);
  }
  double bad[6] = {NAN};
  pags_keyframe kept = *keyframe;
  pags_track_poses_update(&tracks, 0, 1, bad, &schedule, 601);
  assert_memory_equal(&kept, keyframe, sizeof kept);
  assert_int_equal(pags_track_poses_keyframe(&tracks.objects[0], 3), -1);
  pags_track_poses_destroy(&tracks);
}

/* A car brakes in a bend and is labelled with noise at each time step: smoothing removes most of the noise. A clean
 * track doesn't change, even one that swerves twice a second, which a fixed amount of smoothing would flatten. */
static void smoothing_removes_jitter_and_keeps_motion(void **unused) {
  (void)unused;
  enum { KEYFRAMES = 40 };
  for (int kind = 0; kind < 3; kind++) {
    const int noisy = kind == 1;
    const double swerve = kind == 2 ? 0.3 : 0.0;
    pags_track_poses t = {.count = 1, .objects = calloc(1, sizeof *t.objects), .moments = calloc(1, sizeof *t.moments)};
    double truth[KEYFRAMES][3], before = 0.0, after = 0.0, yaw_before = 0.0, yaw_after = 0.0;
    t.objects[0] =
        (pags_object){.keyframe_count = KEYFRAMES, .moving = 1, .keyframes = calloc(KEYFRAMES, sizeof(pags_keyframe))};
    t.moments[0] = calloc(KEYFRAMES, sizeof(pags_adam6));
    for (int k = 0; k < KEYFRAMES; k++) {
      double s = 0.1 * k, u[2], e[4];
      pags_rng_normal2(7, 1, (uint64_t)k, e);
      pags_rng_normal2(7, 2, (uint64_t)k, e + 2);
      u[0] = noisy * 0.2 * e[0], u[1] = noisy * 0.2 * e[1];
      truth[k][0] = 10.0 * s - 0.5 * s * s; /* brakes at 1 m/s^2 */
      truth[k][1] = 0.2 * s * s + swerve * sin(12.0 * s);
      truth[k][2] = 0.04 * s;
      double yaw = truth[k][2] + noisy * 0.05 * e[2];
      pags_keyframe keyframe = {.frame = k, .trained = 1, .time = 1.5e9 + s};
      double m[12] = {cos(yaw), -sin(yaw), 0, truth[k][0] + u[0], sin(yaw), cos(yaw), 0, truth[k][1] + u[1], 0,
                      0,        1,         0};
      memcpy(keyframe.world_from_object, m, sizeof m);
      t.objects[0].keyframes[k] = keyframe;
    }
    assert_int_equal(pags_tracks_smooth(&t), PAGS_OK);
    for (int k = 0; k < KEYFRAMES; k++) {
      const pags_keyframe *keyframe = &t.objects[0].keyframes[k];
      double m[12], pose[12];
      pags_increment_matrix(keyframe->rotation, keyframe->translation, m);
      pags_rigid_multiply(keyframe->world_from_object, m, pose);
      before +=
          hypot(keyframe->world_from_object[3] - truth[k][0], keyframe->world_from_object[7] - truth[k][1]) / KEYFRAMES;
      after += hypot(pose[3] - truth[k][0], pose[7] - truth[k][1]) / KEYFRAMES;
      yaw_before +=
          fabs(atan2(keyframe->world_from_object[4], keyframe->world_from_object[0]) - truth[k][2]) / KEYFRAMES;
      yaw_after += fabs(atan2(pose[4], pose[0]) - truth[k][2]) / KEYFRAMES;
    }
    if (noisy) {
      assert_true(after < 0.5 * before);
      assert_true(yaw_after < 0.5 * yaw_before);
    } else {
      /* The weakest smoothing still leaves an error of a hundredth of the swerve. */
      assert_true(after < 0.01 && yaw_after < 1e-3);
    }
    pags_track_poses_destroy(&t);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(wrong_poses_are_corrected),
      cmocka_unit_test(smoothing_removes_jitter_and_keeps_motion),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
