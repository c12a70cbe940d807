/* SPDX-License-Identifier: Apache-2.0 */
/* Tests driving data sets: the conventions of every kind on a set with known truth, options and errors. Also reads
 * scene 002 of PandaSet. */
#include <pags/dataset.h>

#include "dataset/internal.h"
#include "shared_data.h"
#include "unit/driving_tree.h"

static void expect_matrix(const double *found, const double *expected) {
  for (int i = 0; i < 12; i++)
    if (!(fabs(found[i] - expected[i]) < 1e-9))
      fail_msg("entry %d: %g, expected %g", i, found[i], expected[i]);
}

static void check_views(const pags_dataset *dataset) {
  static const double shutters[2][TREE_FRAMES] = {{99.9, 100.4, 100.9, 101.4, 101.9},
                                                  {99.8, 100.3, 100.8, 101.3, (double)NAN}};
  assert_int_equal(pags_dataset_view_count(dataset), TREE_FRAMES * TREE_CAMERAS);
  for (int i = 0; i < TREE_FRAMES * TREE_CAMERAS; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    int frame = i / TREE_CAMERAS, sensor = i % TREE_CAMERAS;
    double pose[12];
    char name[32];
    snprintf(name, sizeof name, "%03d_%d.png", frame, sensor);
    assert_string_equal(view->name, name);
    tree_view(frame, sensor, pose);
    expect_matrix(view->camera.world_from_camera, pose);
    assert_true(view->frame == frame && view->sensor == sensor && view->test == (frame == 4));
    assert_true(view->camera.width == TREE_WIDTH && view->camera.height == TREE_HEIGHT);
    assert_true(view->camera.fx == (sensor ? 42 : 40) && view->camera.cy == (sensor ? 16 : 15.5));
    assert_true(view->camera.time == 100 + 0.5 * frame);
    double shutter = shutters[sensor][frame];
    assert_true(isnan(shutter) ? isnan(view->shutter_time) : view->shutter_time == shutter);
  }
}

static void check_objects(const pags_dataset *dataset) {
  assert_int_equal(pags_dataset_object_count(dataset), 2);
  for (int i = 0; i < 2; i++) {
    const pags_object *object = pags_dataset_object(dataset, i);
    assert_string_equal(object->id, i ? "7" : "a");
    assert_int_equal(object->category, i ? PAGS_CATEGORY_PEDESTRIAN : PAGS_CATEGORY_VEHICLE);
    assert_memory_equal(object->size, tree_sizes[i], sizeof tree_sizes[i]);
    assert_int_equal(object->moving, i == 0);
    assert_int_equal(object->keyframe_count, i ? 3 : TREE_FRAMES);
    for (int k = 0; k < object->keyframe_count; k++) {
      const pags_keyframe *keyframe = &object->keyframes[k];
      double pose[12];
      tree_box(i, keyframe->frame, pose);
      expect_matrix(keyframe->world_from_object, pose);
      assert_true(keyframe->frame == k + i && keyframe->time == 100 + 0.5 * keyframe->frame &&
                  keyframe->trained == (keyframe->frame != 4));
    }
  }
}

static void check_sweeps(const pags_dataset *dataset) {
  assert_int_equal(pags_dataset_sweep_count(dataset), TREE_FRAMES);
  for (int t = 0; t < TREE_FRAMES; t++) {
    const pags_sweep *sweep = pags_dataset_sweep(dataset, t);
    const double *m = sweep->world_from_sweep;
    double ego[12];
    int64_t count;
    float *xyz;
    tree_ego(t, ego);
    assert_true(sweep->frame == t && sweep->test == (t == 4) && sweep->time == 100 + 0.5 * t);
    scratch_ok(pags_dataset_sweep_load(dataset, t, &count, &xyz));
    assert_int_equal(count, 2);
    for (int i = 0; i < 2; i++)
      for (int k = 0; k < 3; k++) {
        const double *p = tree_points[i], *e = ego + 4 * k;
        double expected = e[0] * p[0] + e[1] * p[1] + e[2] * p[2] + e[3], found = m[4 * k + 3];
        for (int j = 0; j < 3; j++)
          found += m[4 * k + j] * (double)xyz[3 * i + j];
        assert_true(fabs(found - expected) < 1e-5);
      }
    free(xyz);
  }
}

static void every_kind_reads_the_same(void **state) {
  (void)state;
  for (int i = 0; i < TREE_KINDS; i++)
    for (int described = 0; described < 2; described++) {
      pags_dataset_options options = tree_options(described ? NULL : tree_kinds[i].name);
      pags_dataset *dataset;
      char text[64];
      scratch s;
      scratch_begin(&s);
      tree_write(&s, &tree_kinds[i]);
      snprintf(text, sizeof text, "{\"kind\": \"%s\", \"cameras\": {\"1\": \"left\", \"9\": \"none\"}}",
               tree_kinds[i].name);
      if (described)
        tree_text(&s, "dataset.json", text);
      scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
      assert_string_equal(pags_dataset_kind(dataset), tree_kinds[i].name);
      assert_int_equal(pags_dataset_up(dataset), PAGS_UP_Z);
      assert_true(pags_dataset_fps(dataset) == 2);
      assert_string_equal(pags_dataset_sensor_name(dataset, 1), described ? "left" : "1");
      assert_null(pags_dataset_sensor_name(dataset, 9));
      assert_int_equal(pags_dataset_provides(dataset), PAGS_PROVIDES_BOXES | PAGS_PROVIDES_LIDAR);
      check_views(dataset);
      check_objects(dataset);
      check_sweeps(dataset);
      pags_dataset_close(dataset);
      scratch_end(&s);
    }
}

/* dataset.json may state every convention. The kind pags has no conventions, so all are stated; other kinds'
 * conventions are overridden. */
static void stated_keys_win(void **state) {
  (void)state;
  const tree_kind mixed = {"pags", 1, 1, 1, 1, 7, 2};
  const char *const stated =
      "\"camera_axes\": \"waymo\", \"extrinsics\": \"per-frame camera-to-world (TTT_C.txt)\",\n"
      "\"lidar_columns\": [\"a\", \"b\", \"x\", \"y\", \"z\", \"c\", \"d\"],"
      "\"lidar_frame\": \"laser\", \"object_forward\": \"+y\", \"fps\": 4, \"geographic_origin\": [37.75, -122.5, 12]}";
  static const char *const kinds[] = {"{\"kind\": \"pags\",", "{\"kind\": \"kitti\",", "{"};
  static const double waymo_from_opencv[12] = {0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0};
  scratch s;
  scratch_begin(&s);
  tree_write(&s, &mixed);
  for (int i = 0; i < TREE_FRAMES * TREE_CAMERAS; i++) {
    double pose[12], inverse[12];
    char name[32];
    pags_rigid_inverse(waymo_from_opencv, inverse);
    tree_view(i / 2, i % 2, pose);
    pags_rigid_multiply(pose, inverse, pose);
    snprintf(name, sizeof name, "extrinsics/%03d_%d.txt", i / 2, i % 2);
    tree_write_matrix(&s, name, pose);
  }
  for (int i = 0; i < 4; i++) {
    /* The kind in the options overrides the kind in the file, but not the file's other keys. */
    pags_dataset_options options = tree_options(i == 3 ? "nuplan" : NULL);
    pags_dataset *dataset;
    char text[1024];
    snprintf(text, sizeof text, "%s%s", kinds[i % 3], stated);
    tree_text(&s, "dataset.json", text);
    scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
    assert_true(pags_dataset_fps(dataset) == 4);
    const pags_place place = pags_dataset_place(dataset);
    assert_true(place.known && place.latitude == 37.75 && place.longitude == -122.5 && place.altitude == 12);
    check_views(dataset);
    check_objects(dataset);
    check_sweeps(dataset);
    pags_dataset_close(dataset);
  }
  scratch_end(&s);
}

static void options_choose(void **state) {
  (void)state;
  pags_dataset_options options = tree_options("kitti");
  pags_dataset *dataset;
  scratch s;
  scratch_begin(&s);
  tree_write(&s, &tree_kinds[2]);
  options.cameras = "1";
  options.frame_first = 1;
  options.frame_last = 3;
  options.split_every = 2;
  options.downscale = 2;
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  assert_int_equal(pags_dataset_view_count(dataset), 3);
  for (int i = 0; i < 3; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    assert_true(view->sensor == 1 && view->frame == i + 1 && view->test == (i == 1) && view->camera.width == 24);
    assert_true(pags_dataset_sweep(dataset, i)->test == (i == 1));
    assert_true(pags_dataset_object(dataset, 0)->keyframes[i].trained == (i != 1));
  }
  pags_dataset_close(dataset);
  options = tree_options("kitti");
  options.split_every = 0;
  options.holdout_camera = "0";
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  for (int i = 0; i < TREE_FRAMES * TREE_CAMERAS; i++)
    assert_int_equal(pags_dataset_view(dataset, i)->test, i % 2 == 0);
  assert_int_equal(pags_dataset_sweep(dataset, 4)->test, 0);
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_true(count == 0 && random == 0);
  pags_dataset_close(dataset);
  options.cameras = "0,2";
  scratch_expect(tree_open(&s, &options), PAGS_ERROR_ARGUMENT, "camera 2 was requested");
  options.cameras = "0,";
  scratch_expect(tree_open(&s, &options), PAGS_ERROR_ARGUMENT, "cameras '0,'");
  options.cameras = "1";
  scratch_expect(tree_open(&s, &options), PAGS_ERROR_ARGUMENT, "held-out camera '0'");
  options = tree_options("kitti");
  options.frame_first = 7;
  scratch_expect(tree_open(&s, &options), PAGS_ERROR_FORMAT, "found none");
  options = tree_options("lyft");
  scratch_expect(tree_open(&s, &options), PAGS_ERROR_ARGUMENT, "kind 'lyft' is not known; expected waymo");
  options = tree_options(NULL);
  scratch_expect(tree_open(&s, &options), PAGS_ERROR_FORMAT, "pass --kind");
  scratch_end(&s);
}

static void without_times_and_boxes(void **state) {
  (void)state;
  pags_dataset_options options = tree_options(NULL);
  pags_dataset *dataset;
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  tree_text(&s, "dataset.json", "{}");
  scratch_ok(pags_dataset_open(scratch_path(&s, "dataset.json"), &options,
                               &dataset)); /* recognised as PandaSet by its TTT_C file names */
  assert_string_equal(pags_dataset_kind(dataset), "pandaset");
  assert_int_equal(pags_dataset_provides(dataset), 0);
  assert_true(pags_dataset_fps(dataset) == 10);
  assert_true(pags_dataset_view(dataset, 7)->camera.time == 0.3);
  assert_true(isnan(pags_dataset_view(dataset, 7)->shutter_time));
  assert_int_equal(pags_dataset_object_count(dataset) + pags_dataset_sweep_count(dataset), 0);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

/* In each case one file of a sound set is replaced (removed if the replacement is NULL), and the message must name
 * the fault. */
static void bad_files_are_explained(void **state) {
  (void)state;
  static const struct {
    const char *file, *text, *message;
  } cases[] = {
      {"images/003_1.png", NULL, "images/003_1.png"},
      {"intrinsics/1.txt", NULL, "intrinsics/1.txt"},
      {"intrinsics/1.txt", "1 2 3\n", "intrinsics/1.txt: 3 numbers, expected fx fy cx cy"},
      {"intrinsics/1.txt", "1 2\n3 x 5", "intrinsics/1.txt:2: expected a number, found 'x'"},
      {"intrinsics/1.txt", "0 0 0\n0 0 0\n0 0 0", "focal lengths above 0"},
      {"extrinsics/0.txt", NULL, "extrinsics/0.txt"},
      {"extrinsics/0.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 1 1\n", "extrinsics/0.txt:4: expected 0 0 0 1"},
      {"ego_pose/002.txt", NULL, "ego_pose/002.txt"},
      {"ego_pose/002.txt", "1 0 0 0\n0 1 0 0\n0 0 2 0\n0 0 0 1\n", "ego_pose/002.txt:1: the pose is not a rotation"},
      {"ego_pose/002.txt", "1 0 0 0\n0 1 0 0\n0 0 x 0\n0 0 0 1\n", "ego_pose/002.txt:3: expected a number"},
      {"lidar/001.bin", "0123456789abcdef!", "lidar/001.bin: 17 bytes, expected a multiple of 16"},
      {"timestamps.json", "{\"frames\": [0, 1, 2, 3]}", "timestamps.json:1: 'frames' has 4 times"},
      {"timestamps.json", "{\"frames\": [0, 1,\n 1, 2, 3]}", "timestamps.json:2: frame 2: expected a later time"},
      {"timestamps.json", "{\"frames\": [0, 1, 2, 3, ]}", "timestamps.json:1: "},
      {"instances/instances_info.json", "{\"0\":\n{\"id\": 1}}",
       "instances_info.json:2: expected a string for 'class_name'"},
      {"instances/instances_info.json",
       "{\"0\": {\"id\": 1, \"class_name\": \"Car\", \"frame_annotations\": {\"frame_idx\": [0],\n"
       "\"obj_to_world\": [[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]], \"box_size\": [\n[1, 5000, 1]]}}}",
       "instances_info.json:3: Car '1' in frame 0: expected box_size above 0 and below 1000 m, found 5000"},
      {"instances/instances_info.json",
       "{\"0\": {\"id\": 1, \"class_name\": \"Car\", \"frame_annotations\": {\"frame_idx\": [0],\n"
       "\"obj_to_world\": [[1,0,0,0, 0,1,0,0, 0,0,-1,0, 0,0,0,1]], \"box_size\": [[1, 1, 1]]}}}",
       "instances_info.json:2: obj_to_world of Car '1' in frame 0: the pose is not a rotation"},
      {"instances/instances_info.json",
       "{\"0\": {\"id\": 1, \"class_name\": \"Car\", \"frame_annotations\": {\"frame_idx\": [0],\n"
       "\"obj_to_world\": [[1,0,0,0]], \"box_size\": [[1, 1, 1]]}}}",
       "instances_info.json:2: expected 16 numbers for obj_to_world of Car '1' in frame 0, found 4"},
      {"instances/frame_instances.json", "{\"0\": [0],\n\"1\": [0.5]}",
       "frame_instances.json:2: expected the number of an instance, found 0.5"},
      {"dataset.json", "{\"kind\": \"lyft\"}", "dataset.json:1: kind 'lyft' is not known"},
      {"dataset.json", "{\"camera_axes\": \"left\"}",
       "dataset.json:1: expected 'camera_axes' to be 'opencv' or 'waymo'"},
      {"dataset.json", "{\"lidar_columns\": [\"x\", \"z\"]}", "x, y and z among them"},
      {"dataset.json", "{\"fps\": 0}", "expected 'fps' above 0"},
      {"dataset.json", "{\"labels\": \"ade20k\"}", "expected 'labels'"},
      {"dataset.json", "{\"geographic_origin\": [91, 0, 0]}", "expected latitude (-90..90)"},
      {"dataset.json", "{\"geographic_origin\": [45, 7]}", "geographic_origin"},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    pags_dataset_options options = tree_options(strstr(cases[i].text ? cases[i].text : "", "lyft") ? NULL : "kitti");
    scratch s;
    scratch_begin(&s);
    tree_write(&s, &tree_kinds[2]);
    if (strstr(cases[i].file, "instances_info"))
      scratch_ok(pags_remove_tree(scratch_path(&s, "instances/frame_instances.json")));
    if (cases[i].text)
      tree_text(&s, cases[i].file, cases[i].text);
    else
      scratch_ok(pags_remove_tree(scratch_path(&s, cases[i].file)));
    pags_result result = tree_open(&s, &options);
    if (result != PAGS_ERROR_FORMAT && result != PAGS_ERROR_IO)
      fail_msg("case %d: %s", (int)i, pags_result_name(result));
    scratch_expect(result, result, cases[i].message);
    scratch_end(&s);
  }
}

static void pandaset_reads(void **state) {
  (void)state;
  pags_dataset *dataset = tree_pandaset();
  if (!dataset)
    skip();
  assert_int_equal(pags_dataset_view_count(dataset), 240);
  assert_int_equal(pags_dataset_object_count(dataset), 37);
  assert_int_equal(pags_dataset_sweep_count(dataset), 76);
  assert_string_equal(pags_dataset_sensor_name(dataset, 1), "front_left");
  int64_t test = 0, points = 0;
  for (int64_t i = 0; i < 240; i++)
    test += pags_dataset_view(dataset, i)->test;
  assert_int_equal(test, 3 * 19);
  for (int64_t i = 0; i < 76; i++) {
    int64_t count;
    float *xyz;
    scratch_ok(pags_dataset_sweep_load(dataset, i, &count, &xyz));
    points += count;
    free(xyz);
  }
  assert_int_equal(points, 395796);
  pags_dataset_close(dataset);
}

/* The boxes of vehicles faster than 2 m/s face their direction of motion. */
static void pandaset_boxes_look_ahead(void **state) {
  (void)state;
  pags_dataset *dataset = tree_pandaset();
  if (!dataset)
    skip();
  double sum = 0;
  int samples = 0;
  for (int64_t i = 0; i < pags_dataset_object_count(dataset); i++) {
    const pags_object *object = pags_dataset_object(dataset, i);
    assert_true(object->size[0] >= object->size[1] || object->category != PAGS_CATEGORY_VEHICLE);
    for (int64_t k = 1; k + 1 < object->keyframe_count && object->category == PAGS_CATEGORY_VEHICLE; k++) {
      const pags_keyframe *a = &object->keyframes[k - 1], *b = &object->keyframes[k + 1];
      const double *m = object->keyframes[k].world_from_object;
      double step[3], length, dt = b->time - a->time;
      for (int c = 0; c < 3; c++)
        step[c] = b->world_from_object[4 * c + 3] - a->world_from_object[4 * c + 3];
      length = sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2]);
      if (dt > 0.3 || length < 2 * dt)
        continue;
      sum += (m[0] * step[0] + m[4] * step[1] + m[8] * step[2]) / length;
      samples++;
    }
  }
  assert_true(samples > 1000);
  if (!(sum / samples > 0.99))
    fail_msg("mean cosine %g of %d", sum / samples, samples);
  pags_dataset_close(dataset);
}

static void missing_pictures_may_be_left_out(void **state) {
  (void)state;
  pags_dataset_options options = tree_options("kitti");
  pags_dataset *dataset;
  scratch s;
  scratch_begin(&s);
  tree_write(&s, &tree_kinds[2]);
  scratch_ok(pags_remove_tree(scratch_path(&s, "images/001_0.png")));
  options.allow_missing = 1;
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  assert_true(pags_dataset_missing(dataset) == 1 && pags_dataset_view_count(dataset) == 9);
  for (int i = 0; i < 9; i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    int place = i < 2 ? i : i + 1;
    double pose[12];
    assert_true(view->frame == place / 2 && view->sensor == place % 2 && view->camera.time == 100 + 0.5 * view->frame);
    tree_view(view->frame, view->sensor, pose);
    expect_matrix(view->camera.world_from_camera, pose);
  }
  pags_dataset_close(dataset);
  scratch_end(&s);
}

/* SfM points: points that fewer than two training views see, and points 10 km away, are left out; image ids are matched
 * by image name. */
static void sfm_points_are_added(void **state) {
  (void)state;
  pags_dataset_options options = tree_options("pandaset");
  pags_dataset *dataset;
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  int random;
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  tree_text(&s, "sfm/sparse/0/cameras.txt", "1 PINHOLE 48 32 40 40 24 16\n");
  tree_text(&s, "sfm/sparse/0/images.txt",
            "5 1 0 0 0 0 0 0 1 000_0.png\n\n6 1 0 0 0 0 0 0 1 cam1/001_1.png\n\n9 1 0 0 0 0 0 0 1 004_0.png\n\n");
  tree_text(&s, "sfm/sparse/0/points3D.txt",
            "1 1 2 3 10 20 30 0.5 5 0 6 0\n2 4 5 6 40 50 60 0.5 5 0 9 0\n3 7 8 9 70 80 90 0.5 6 0 5 0 9 0\n"
            "4 1e7 8 9 70 80 90 0.5 6 0 5 0 9 0\n");
  options.sfm = "sfm";
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_true(count == 2 && random == 0 && (pags_dataset_provides(dataset) & PAGS_PROVIDES_SFM));
  assert_true(xyz[0] == 1 && xyz[5] == 9 && rgb[0] == 10 && rgb[5] == 90);
  pags_dataset_close(dataset);
  options.sfm = "nowhere";
  scratch_expect(tree_open(&s, &options), PAGS_ERROR_FORMAT, "nowhere: not a COLMAP model");
  scratch_end(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(every_kind_reads_the_same),
      cmocka_unit_test(stated_keys_win),
      cmocka_unit_test(options_choose),
      cmocka_unit_test(without_times_and_boxes),
      cmocka_unit_test(bad_files_are_explained),
      cmocka_unit_test(missing_pictures_may_be_left_out),
      cmocka_unit_test(sfm_points_are_added),
      cmocka_unit_test(pandaset_reads),
      cmocka_unit_test(pandaset_boxes_look_ahead),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
