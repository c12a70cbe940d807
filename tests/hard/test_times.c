/* SPDX-License-Identifier: Apache-2.0 */
/* Hard times (case 24 of docs/lab/numerics.md): time ranges of zero length and of 1e6 s. Tracks, colours over time
 * and exposures have closed forms. A street of one time step and one that lasts twelve days are trained for 200
 * steps. */
#include "hard/hard.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pags/object.h>
#include <pags/scene.h>
#include <pags/synth.h>

#include "base/file.h"

static const double long_time = 1e6; /* seconds */

/* Makes a straight drive of 1 km that turns by 90 degrees about z. */
static void drive(pags_keyframe *keyframes, int count, double begin, double end) {
  for (int k = 0; k < count; k++) {
    const double u = count > 1 ? k / (count - 1.0) : 0, angle = 1.5707963267948966 * u;
    keyframes[k] = (pags_keyframe){
        .frame = k,
        .trained = 1,
        .time = begin + u * (end - begin),
        .world_from_object = {cos(angle), -sin(angle), 0, 1000 * u, sin(angle), cos(angle), 0, 0, 0, 0, 1, 0}};
  }
}

static void tracks(void **state) {
  (void)state;
  pags_keyframe keyframes[3];
  pags_object o = {.size = {4, 2, 1.5}, .keyframes = keyframes};
  double pose[12], worst = 0;
  drive(keyframes, 3, 0, long_time);
  o.keyframe_count = 3;
  for (int i = 0; i <= 1000; i++) {
    const double u = i / 1000.0, angle = 1.5707963267948966 * u;
    assert_int_equal(pags_object_pose(&o, u * long_time, pose), 1);
    worst = fmax(worst, fmax(fabs(pose[3] - 1000 * u), fabs(pose[0] - cos(angle))));
  }
  print_message("  a track of 1e6 s                         %.1e m or radians off\n", worst);
  assert_true(worst < 1e-9);
  assert_int_equal(pags_object_pose(&o, 2 * long_time, pose), 0);
  for (int k = 0; k < 2; k++) { /* a range of zero length, also at a Unix time */
    const double when = k ? 1.7e9 : 0;
    drive(keyframes, 1, when, when);
    o.keyframe_count = 1;
    assert_int_equal(pags_object_pose(&o, when, pose), 1);
    assert_true(pose[0] == 1 && pose[3] == 0);
    assert_int_equal(pags_object_pose(&o, when + 1, pose), 0);
    assert_int_equal(pags_object_pose(&o, (double)NAN, pose), 0);
  }
  pags_object_classify_motion(&o);
  assert_int_equal(o.moving, 0);
}

static void colours_over_time(void **state) {
  (void)state;
  double basis[5];
  assert_true(pags_fourier_phase(3, 3, 3) == 0 && pags_fourier_phase(3, 3, 1e300) == 0 &&
              pags_fourier_phase(3, 3, -5) == 0);
  assert_true(pags_fourier_phase(1.7e9, 1.7e9 + long_time, 1.7e9 + 0.25 * long_time) == 0.25);
  assert_true(pags_fourier_phase(0, long_time, 1e300) == 1 && pags_fourier_phase(0, long_time, -1e300) == 0);
  pags_fourier_basis(pags_fourier_phase(3, 3, 3), basis);
  assert_true(basis[0] == 1 && basis[1] == 0 && basis[2] == 1 && basis[3] == 0 && basis[4] == 1);
  pags_fourier_basis(pags_fourier_phase(0, long_time, 0.25 * long_time), basis);
  assert_true(fabs(basis[1] - 1) < 1e-12 && fabs(basis[2]) < 1e-12 && fabs(basis[3]) < 1e-12 &&
              fabs(basis[4] + 1) < 1e-12);
}

/* Exposure gains of 0 and 65535 at the two ends are interpolated; also with all views at one time, and at an unknown
 * time. */
static void exposures(void **state) {
  (void)state;
  pags_scene_view views[2] = {{.camera = {.time = 0}, .gain = {0, 0, 0}, .offset = {0, 0, 0}},
                              {.camera = {.time = 1e6}, .gain = {65535, 65535, 65535}, .offset = {-65535, 0, 1}}};
  const pags_scene scene = {.view_count = 2, .views = views};
  double gain[3], offset[3];
  for (int i = 0; i <= 100; i++) {
    pags_scene_exposure(&scene, 0, long_time * i / 100, gain, offset);
    assert_true(fabs(gain[0] - 65535.0 * i / 100) < 1e-9 && fabs(offset[0] + 65535.0 * i / 100) < 1e-9);
  }
  views[1].camera.time = 0;
  pags_scene_exposure(&scene, 0, 0, gain, offset);
  assert_true(isfinite(gain[0]) && isfinite(offset[0]));
  pags_scene_exposure(&scene, 0, (double)NAN, gain, offset);
  assert_true(gain[0] == 1 && offset[0] == 0);
}

static pags_tasks *tasks;

static int make_street(void **state) {
  pags_street_options options = pags_street_options_default();
  options.width = 64;
  options.height = 48;
  options.frames = 8;
  options.cameras = 1;
  options.samples = 1;
  options.objects = 3;
  options.lidar_points = 2000;
  options.shifts = 0;
  tasks = pags_tasks_create(2);
  return tasks && hard_begin(state) == 0 &&
                 pags_synth_street(hard_path("street"), &options, tasks, NULL, NULL) == PAGS_OK
             ? 0
             : -1;
}

static int remove_street(void **state) {
  pags_tasks_destroy(tasks);
  return hard_end(state);
}

static void train(const char *what, const char *name, const pags_dataset_options *reading, double range) {
  pags_dataset *dataset = NULL;
  pags_train_config config = pags_train_config_default();
  pags_scene scene;
  assert_int_equal(pags_dataset_open(hard_path("street"), reading, &dataset), PAGS_OK);
  config.schedule.iterations = HARD_STEPS;
  config.schedule.resolution_floor = 24;
  config.objects.tracks_from = 0;
  config.objects.fourier_from = 3000;
  config.objects.fourier_gain = 0;
  config.size_limit.max_gaussians = 2000;
  const pags_train_result r = hard_train(dataset, name, &config, NULL);
  assert_int_equal(pags_scene_load(hard_path(name), &scene), PAGS_OK);
  print_message("  %-40s %.1f dB, %d Gaussians, %d models, %d rows skipped\n", what, r.psnr, (int)r.gaussians,
                (int)scene.model_count, (int)r.bad_rows);
  assert_int_equal(r.bad_rows, 0);
  assert_true(r.psnr > 12);
  assert_true(scene.time_end - scene.time_begin == range);
  pags_scene_destroy(&scene);
  pags_dataset_close(dataset);
}

/* #24: a street whose first and last frame are the same. */
static void a_street_of_one_instant(void **state) {
  (void)state;
  pags_dataset_options reading = pags_dataset_options_default();
  reading.frame_first = reading.frame_last = 3;
  reading.split_every = 0;
  train("a street of one instant", "instant", &reading, 0);
}

/* Frames have intervals of an unusual unit, which isn't recognised as milli-, micro- or nanoseconds. */
static void a_street_of_twenty_million_seconds(void **state) {
  (void)state;
  if (hard_leaves_out())
    return;
  pags_dataset_options reading = pags_dataset_options_default();
  static const char times[] = "{\"frames\": [0, 3e6, 6e6, 9e6, 1.2e7, 1.5e7, 1.8e7, 2.1e7]}";
  assert_int_equal(pags_file_write(hard_path("street/timestamps.json"), times, sizeof times - 1), PAGS_OK);
  reading.split_every = 0;
  train("a street of 2.1e7 s", "long", &reading, 2.1e7);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(tracks),
      cmocka_unit_test(colours_over_time),
      cmocka_unit_test(exposures),
      cmocka_unit_test(a_street_of_one_instant),
      cmocka_unit_test(a_street_of_twenty_million_seconds),
  };
  return cmocka_run_group_tests(tests, make_street, remove_street);
}
