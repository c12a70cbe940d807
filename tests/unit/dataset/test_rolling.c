/* SPDX-License-Identifier: Apache-2.0 */
/* Tests rolling shutters of a driving set's cameras: read-out direction and time, velocities, and camera files. */
#include <pags/object.h>

#include "unit/driving_tree.h"

static void close_to(const double *found, const double *expected, int count, double bound) {
  for (int i = 0; i < count; i++)
    if (!(fabs(found[i] - expected[i]) < bound))
      fail_msg("number %d: %g, expected %g", i, found[i], expected[i]);
}

/* The velocity between two poses, applied to the first pose, gives the second. */
static void test_motion(void **state) {
  (void)state;
  const double w[3] = {0.3, -0.2, 0.5}, place[3] = {3, -1, 2}, velocity[6] = {0.4, 0.1, -0.3, 5, -2, 1};
  double m[12], before[12], after[12], found[6];
  pags_rigid_from_angles(w, place, m);
  pags_rigid_move(m, velocity, -0.05, before);
  pags_rigid_move(m, velocity, 0.05, after);
  pags_rigid_velocity(before, m, after, 0.1, found);
  close_to(found, velocity, 6, 1e-9);
  pags_rigid_move(m, velocity, 0, after);
  close_to(after, m, 12, 1e-15);
}

/* An object drives round a circle at 0.5 rad/s and 6 m/s; it has ten labels a second. */
static void test_object(void **state) {
  (void)state;
  pags_keyframe keyframes[11] = {0};
  const pags_object object = {.keyframe_count = 11, .keyframes = keyframes};
  double velocity[6];
  for (int k = 0; k < 11; k++) {
    keyframes[k].time = 0.1 * k;
    keyframes[k].frame = k;
    tree_turn(0.05 * k, 12 * sin(0.05 * k), 12 * (1 - cos(0.05 * k)), 0, keyframes[k].world_from_object);
  }
  const double expected[6] = {0, 0, 0.5, 6, 0, 0};
  pags_object_velocity(&object, 0.5, velocity);
  close_to(velocity, expected, 6, 0.01);
  pags_object_velocity(&object, 0.43, velocity);
  close_to(velocity, expected, 6, 0.2); /* poses between labels lie on a straight line */
  pags_object_velocity(&object, 0, velocity);
  close_to(velocity, expected, 6, 0.2);
  pags_object_velocity(&object, 7, velocity);
  close_to(velocity, (const double[6]){0}, 6, 1e-300);
}

static void write_tree(scratch *s, const char *description, const char *more_times) {
  char text[1024];
  tree_write(s, &tree_kinds[1]);
  tree_text(s, "dataset.json", description);
  snprintf(text, sizeof text, "{\"frames\": [100, 100.5, 101, 101.5, 102]%s}", more_times);
  tree_text(s, "timestamps.json", text);
}

static void test_read(void **state) {
  (void)state;
  scratch s;
  scratch_begin(&s);
  pags_dataset *dataset;
  write_tree(&s,
             "{\"kind\": \"pandaset\", \"rolling_shutter\": {\"0\": \"bottom_to_top\", \"1\": \"left_to_right\"},\n"
             "\"read_out\": {\"1\": 0.045}}",
             ", \"trigger\": {\"0\": [1, 2, null, 4, 5]}, \"readout\": {\"0\": [1.04, 2.04, 3.04, 4.05, 5.9]},\n"
             "\"shutter\": {\"0\": [0.01, 0.01, 0.01, 0.01, 0.01]}");
  const pags_dataset_options options = tree_options(NULL);
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  const double read_out[5] = {0.03, 0.03, 0, 0.04,
                              0}; /* the third frame has no time, and the last frame's time isn't plausible */
  for (int t = 0; t < TREE_FRAMES; t++) {
    const pags_camera *first = &pags_dataset_view(dataset, 2 * t)->camera,
                      *second = &pags_dataset_view(dataset, 2 * t + 1)->camera;
    assert_true(fabs(first->shutter.down + read_out[t]) < 1e-12 && first->shutter.across == 0);
    assert_true(second->shutter.across == 0.045 && second->shutter.down == 0);
  }
  assert_true(tree_has_note(dataset, "camera 0 is read bottom_to_top in 33.3 ms, 3 of 5 views"));

  /* The car moves at 4 m/s along x and 1 m/s along y and turns left at 0.2 rad/s; a camera's z axis points ahead. */
  const pags_shutter *shutter = &pags_dataset_view(dataset, 2)->camera.shutter;
  double world[3] = {0}, pose[12], before[12], after[12];
  tree_view(1, 0, pose);
  tree_view(0, 0, before);
  tree_view(2, 0, after);
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 3; i++)
      world[k] += pose[4 * k + i] * shutter->velocity[3 + i];
  close_to(world, (const double[3]){after[3] - before[3], after[7] - before[7], after[11] - before[11]}, 3, 1e-9);
  close_to(shutter->velocity, (const double[3]){0, -0.2, 0}, 3, 1e-9);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

/* Without read-out times or a direction a camera has a global shutter; an unknown direction is refused with its
 * position in the file. */
static void test_unknown(void **state) {
  (void)state;
  const char *const descriptions[] = {"{\"kind\": \"pandaset\"}",
                                      "{\"kind\": \"pandaset\", \"rolling_shutter\": {\"0\": \"none\"}}",
                                      "{\"kind\": \"pandaset\", \"rolling_shutter\": {\"0\": \"top_to_bottom\"}}"};
  const pags_dataset_options options = tree_options(NULL);
  scratch s;
  scratch_begin(&s);
  for (int k = 0; k < 3; k++) {
    pags_dataset *dataset;
    write_tree(&s, descriptions[k], k < 2 ? ", \"trigger\": {\"0\": [0]}, \"readout\": {\"0\": [0.03]}" : "");
    scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
    for (int i = 0; i < TREE_FRAMES * TREE_CAMERAS; i++)
      assert_false(pags_camera_rolls(&pags_dataset_view(dataset, i)->camera));
    assert_true(tree_has_note(dataset, "drawn as read at once") == (k == 2));
    pags_dataset_close(dataset);
  }
  write_tree(&s, "{\"kind\": \"pandaset\",\n\"rolling_shutter\": {\"0\": \"downwards\"}}", "");
  assert_int_equal(tree_open(&s, &options), PAGS_ERROR_FORMAT);
  assert_non_null(strstr(pags_error_message(), "dataset.json:2"));
  assert_non_null(strstr(pags_error_message(), "found 'downwards'"));
  scratch_end(&s);
}

/* A camera file keeps the shutter. A point of a standing object is seen on the line that is read at that time. */
static void test_camera(void **state) {
  (void)state;
  scratch s;
  scratch_begin(&s);
  pags_camera camera = {.width = 64, .height = 48, .fx = 50, .fy = 50, .cx = 32, .cy = 24};
  camera.world_from_camera[0] = camera.world_from_camera[5] = camera.world_from_camera[10] = 1;
  camera.shutter = (pags_shutter){.velocity = {0.1, 0.2, 0.3, 4, 5, 6}};
  assert_true(pags_shutter_set(&camera.shutter, "right_to_left", 0.03));
  assert_true(camera.shutter.across == -0.03 && camera.shutter.down == 0);
  assert_false(pags_shutter_set(&camera.shutter, "sideways", 0.03));
  const pags_camera_path path = {.count = 1, .cameras = &camera};
  pags_camera_path back;
  scratch_ok(pags_camera_path_save(scratch_path(&s, "c.json"), &path));
  scratch_ok(pags_camera_path_load(scratch_path(&s, "c.json"), &back));
  assert_memory_equal(&back.cameras[0].shutter, &camera.shutter, sizeof camera.shutter);

  const double middle[3] = {0.5, 0.3, 2};
  double seen[3], pose[12], there[12], again[3];
  pags_camera_see(&camera, middle, seen);
  const double t = pags_camera_read_at(&camera, camera.fx * seen[0] / seen[2] + camera.cx, 0);
  pags_rigid_move(camera.world_from_camera, camera.shutter.velocity, t, pose);
  pags_rigid_inverse(pose, there);
  pags_rigid_point(there, middle, again);
  close_to(seen, again, 3, 1e-6); /* 1e-4 px at this focal length */
  assert_true(fabs(seen[0] - middle[0]) > 1e-3);

  camera.shutter.down = 0.03;
  assert_int_equal(pags_camera_check(&camera, "both ways"), PAGS_ERROR_FORMAT);
  camera.shutter.across = 0, camera.shutter.velocity[2] = (double)NAN;
  assert_int_equal(pags_camera_check(&camera, "no velocity"), PAGS_ERROR_FORMAT);
  pags_camera_path_destroy(&back);
  scratch_end(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_motion),  cmocka_unit_test(test_object), cmocka_unit_test(test_read),
      cmocka_unit_test(test_unknown), cmocka_unit_test(test_camera),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
