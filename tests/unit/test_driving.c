/* Driving sets: every kind's conventions on a set with known truth, options, errors; PandaSet's scene 002. */
#include <pags/dataset.h>

#include "dataset/internal.h"
#include "shared_data.h"
#include "unit/driving_tree.h"

static pags_dataset_options with_kind(const char *kind) {
  pags_dataset_options options = pags_dataset_options_default();
  options.kind = kind;
  return options;
}

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
    assert_int_equal(object->knot_count, i ? 3 : TREE_FRAMES);
    for (int k = 0; k < object->knot_count; k++) {
      const pags_knot *knot = &object->knots[k];
      double pose[12];
      tree_box(i, knot->frame, pose);
      expect_matrix(knot->world_from_object, pose);
      assert_true(knot->frame == k + i && knot->time == 100 + 0.5 * knot->frame && knot->trained == (knot->frame != 4));
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
      pags_dataset_options options = with_kind(described ? NULL : tree_kinds[i].name);
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

/* dataset.json states everything: kind pags, which has no rules of its own, and another kind whose rules it overrules. */
static void stated_keys_win(void **state) {
  (void)state;
  const tree_kind mixed = {"pags", 1, 1, 1, 1, 7, 2};
  const char *const stated =
      "\"camera_axes\": \"waymo\", \"extrinsics\": \"per-frame camera-to-world (TTT_C.txt)\",\n"
      "\"lidar_columns\": [\"a\", \"b\", \"x\", \"y\", \"z\", \"c\", \"d\"],"
      "\"lidar_frame\": \"laser\", \"object_forward\": \"+y\", \"fps\": 4}";
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
    pags_dataset_options options = with_kind(i == 3 ? "nuplan" : NULL); /* overrides the file's kind, not its keys */
    pags_dataset *dataset;
    char text[1024];
    snprintf(text, sizeof text, "%s%s", kinds[i % 3], stated);
    tree_text(&s, "dataset.json", text);
    scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
    assert_true(pags_dataset_fps(dataset) == 4);
    check_views(dataset);
    check_objects(dataset);
    check_sweeps(dataset);
    pags_dataset_close(dataset);
  }
  scratch_end(&s);
}

static pags_result open_in(scratch *s, const pags_dataset_options *options) {
  pags_dataset *dataset;
  pags_result result = pags_dataset_open(s->folder, options, &dataset);
  pags_dataset_close(dataset);
  return result;
}

static void options_choose(void **state) {
  (void)state;
  pags_dataset_options options = with_kind("kitti");
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
    assert_true(pags_dataset_object(dataset, 0)->knots[i].trained == (i != 1));
  }
  pags_dataset_close(dataset);
  options = with_kind("kitti");
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
  scratch_expect(open_in(&s, &options), PAGS_ERROR_ARGUMENT, "camera 2 is asked for");
  options.cameras = "0,";
  scratch_expect(open_in(&s, &options), PAGS_ERROR_ARGUMENT, "cameras '0,'");
  options.cameras = "1";
  scratch_expect(open_in(&s, &options), PAGS_ERROR_ARGUMENT, "held-out camera '0'");
  options = with_kind("kitti");
  options.frame_first = 7;
  scratch_expect(open_in(&s, &options), PAGS_ERROR_FORMAT, "found none");
  options = with_kind("lyft");
  scratch_expect(open_in(&s, &options), PAGS_ERROR_ARGUMENT, "kind 'lyft' is not known; expected waymo");
  options = with_kind(NULL);
  scratch_expect(open_in(&s, &options), PAGS_ERROR_FORMAT, "pass --kind");
  scratch_end(&s);
}

static void without_times_and_boxes(void **state) {
  (void)state;
  pags_dataset_options options = with_kind(NULL);
  pags_dataset *dataset;
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  tree_text(&s, "dataset.json", "{}");
  scratch_ok(pags_dataset_open(scratch_path(&s, "dataset.json"), &options,
                               &dataset)); /* TTT_C files say that it is PandaSet's */
  assert_string_equal(pags_dataset_kind(dataset), "pandaset");
  assert_int_equal(pags_dataset_provides(dataset), 0);
  assert_true(pags_dataset_fps(dataset) == 10);
  assert_true(pags_dataset_view(dataset, 7)->camera.time == 0.3);
  assert_true(isnan(pags_dataset_view(dataset, 7)->shutter_time));
  assert_int_equal(pags_dataset_object_count(dataset) + pags_dataset_sweep_count(dataset), 0);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

/* Each: one file of a sound set replaced, and what is said about it. A replacement of NULL removes the file. */
static void bad_files_are_explained(void **state) {
  (void)state;
  static const struct {
    const char *file, *text, *message;
  } cases[] = {
      {"images/003_1.png", NULL, "images/003_1.png"},
      {"intrinsics/1.txt", NULL, "intrinsics/1.txt"},
      {"intrinsics/1.txt", "1 2 3\n", "found 3"},
      {"intrinsics/1.txt", "1 2\n3 x 5", "intrinsics/1.txt:2: expected a number, found 'x'"},
      {"intrinsics/1.txt", "0 0 0\n0 0 0\n0 0 0", "focal lengths above 0"},
      {"extrinsics/0.txt", NULL, "extrinsics/0.txt"},
      {"extrinsics/0.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 1 1\n", "extrinsics/0.txt:4: expected 0 0 0 1"},
      {"ego_pose/002.txt", NULL, "ego_pose/002.txt"},
      {"ego_pose/002.txt", "1 0 0 0\n0 1 0 0\n0 0 2 0\n0 0 0 1\n", "ego_pose/002.txt:1: the pose is not a rotation"},
      {"ego_pose/002.txt", "1 0 0 0\n0 1 0 0\n0 0 nan 0\n0 0 0 1\n", "ego_pose/002.txt:3: expected a number"},
      {"lidar/001.bin", "0123456789abcdef!", "lidar/001.bin: 17 bytes, expected a multiple of 16"},
      {"timestamps.json", "{\"frames\": [0, 1, 2, 3]}", "timestamps.json:1: 'frames' has 4 times"},
      {"timestamps.json", "{\"frames\": [0, 1,\n 1, 2, 3]}", "timestamps.json:2: frame 2: expected a later time"},
      {"timestamps.json", "{\"frames\": [0, 1, 2, 3, ]}", "timestamps.json:1: "},
      {"instances/instances_info.json", "{\"0\":\n{\"id\": 1}}",
       "instances_info.json:2: expected a string for 'class_name'"},
      {"instances/instances_info.json",
       "{\"0\": {\"id\": 1, \"class_name\": \"Car\", \"frame_annotations\": {\"frame_idx\": [0],\n"
       "\"obj_to_world\": [[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]], \"box_size\": [\n[1, 0, 1]]}}}",
       "instances_info.json:3: expected box_size above 0"},
      {"instances/instances_info.json",
       "{\"0\": {\"id\": 1, \"class_name\": \"Car\", \"frame_annotations\": {\"frame_idx\": [0],\n"
       "\"obj_to_world\": [[1,0,0,0, 0,1,0,0, 0,0,-1,0, 0,0,0,1]], \"box_size\": [[1, 1, 1]]}}}",
       "instances_info.json:2: obj_to_world: the pose is not a rotation"},
      {"instances/instances_info.json",
       "{\"0\": {\"id\": 1, \"class_name\": \"Car\", \"frame_annotations\": {\"frame_idx\": [0],\n"
       "\"obj_to_world\": [[1,0,0,0]], \"box_size\": [[1, 1, 1]]}}}",
       "instances_info.json:2: expected 16 numbers for obj_to_world, found 4"},
      {"instances/frame_instances.json", "{\"0\": [0],\n\"1\": [2]}", "frame_instances.json:2: expected an instance"},
      {"dataset.json", "{\"kind\": \"lyft\"}", "dataset.json:1: kind 'lyft' is not known"},
      {"dataset.json", "{\"camera_axes\": \"left\"}",
       "dataset.json:1: expected 'camera_axes' to be 'opencv' or 'waymo'"},
      {"dataset.json", "{\"lidar_columns\": [\"x\", \"z\"]}", "x, y and z among them"},
      {"dataset.json", "{\"fps\": 0}", "expected 'fps' above 0"},
      {"dataset.json", "{\"labels\": \"ade20k\"}", "expected 'labels'"},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    pags_dataset_options options = with_kind(strstr(cases[i].text ? cases[i].text : "", "lyft") ? NULL : "kitti");
    scratch s;
    scratch_begin(&s);
    tree_write(&s, &tree_kinds[2]);
    if (strstr(cases[i].file, "instances_info"))
      scratch_ok(pags_remove_tree(scratch_path(&s, "instances/frame_instances.json")));
    if (cases[i].text)
      tree_text(&s, cases[i].file, cases[i].text);
    else
      scratch_ok(pags_remove_tree(scratch_path(&s, cases[i].file)));
    pags_result result = open_in(&s, &options);
    if (result != PAGS_ERROR_FORMAT && result != PAGS_ERROR_IO)
      fail_msg("case %d: %s", (int)i, pags_result_name(result));
    scratch_expect(result, result, cases[i].message);
    scratch_end(&s);
  }
}

static pags_dataset *open_pandaset(void) {
  char path[1024];
  pags_dataset *dataset;
  if (!pags_shared_data("pandaset-002", path, sizeof path))
    return NULL;
  scratch_ok(pags_dataset_open(path, NULL, &dataset));
  return dataset;
}

static void pandaset_reads(void **state) {
  (void)state;
  pags_dataset *dataset = open_pandaset();
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

/* Vehicles faster than 2 m/s look where they go. */
static void pandaset_boxes_look_ahead(void **state) {
  (void)state;
  pags_dataset *dataset = open_pandaset();
  if (!dataset)
    skip();
  double sum = 0;
  int samples = 0;
  for (int64_t i = 0; i < pags_dataset_object_count(dataset); i++) {
    const pags_object *object = pags_dataset_object(dataset, i);
    assert_true(object->size[0] >= object->size[1] || object->category != PAGS_CATEGORY_VEHICLE);
    for (int64_t k = 1; k + 1 < object->knot_count && object->category == PAGS_CATEGORY_VEHICLE; k++) {
      const pags_knot *a = &object->knots[k - 1], *b = &object->knots[k + 1];
      const double *m = object->knots[k].world_from_object;
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

/* Labels. */

static void with_photo(const pags_dataset *dataset, int64_t view, int shrink, void (*look)(const pags_photo *, void *),
                       void *context) {
  pags_tasks *tasks = pags_tasks_create(1);
  pags_photo_cache *cache;
  pags_photo photo;
  scratch_ok(pags_photo_cache_create(dataset, tasks, UINT64_C(1) << 26, &cache));
  scratch_ok(pags_photo_cache_get(cache, view, shrink, &photo));
  look(&photo, context);
  pags_photo_cache_destroy(cache);
  pags_tasks_destroy(tasks);
}

static void copy_photo(const pags_photo *photo, void *context) {
  pags_photo *out = context;
  size_t plane = (size_t)photo->stride * (size_t)photo->height;
  *out = *photo;
  out->rgb = NULL;
  uint8_t *labels = photo->labels ? malloc(plane) : NULL, *mask = photo->mask ? malloc(plane) : NULL;
  if (labels)
    memcpy(labels, photo->labels, plane);
  if (mask)
    memcpy(mask, photo->mask, plane);
  out->labels = labels;
  out->mask = mask;
}

static void drop_photo(pags_photo *photo) {
  free((void *)(uintptr_t)photo->labels);
  free((void *)(uintptr_t)photo->mask);
}

/* A grey picture of the tree's size. */
static void write_grey(scratch *s, const char *name, uint8_t (*paint)(int x, int y)) {
  pags_image image;
  scratch_ok(pags_image_create(&image, TREE_WIDTH, TREE_HEIGHT, 1, PAGS_U8));
  for (int i = 0; i < TREE_WIDTH * TREE_HEIGHT; i++)
    ((uint8_t *)image.data)[i] = paint(i % TREE_WIDTH, i / TREE_WIDTH);
  char *folder = pags_path_folder(scratch_path(s, name));
  scratch_ok(pags_make_dirs(folder));
  free(folder);
  scratch_ok(pags_image_save(scratch_path(s, name), &image));
  pags_image_destroy(&image);
}

static uint8_t white_above(int x, int y) {
  (void)x;
  return y < 6 ? 255 : 0;
}

static uint8_t white_right(int x, int y) {
  (void)y;
  return x >= 40 ? 255 : 0;
}

static uint8_t white_low(int x, int y) {
  (void)x;
  return y >= 30 ? 255 : 0;
}

static uint8_t classes(int x, int y) {
  return y < 4 ? 10 : x < 5 ? 13 : x < 10 ? 11 : x < 15 ? 19 : 0; /* sky, car, person, unknown, road */
}

static int label_at(const pags_photo *photo, int x, int y) {
  return photo->labels[y * photo->stride + x];
}

/* Bits that boxes give, drawn here from their outlines. */
static int box_bits(const pags_dataset *dataset, const pags_view *view, int x, int y, const int bits[2]) {
  int sum = 0;
  for (int i = 0; i < 2; i++) {
    double pose[12], corners[32];
    uint8_t plane[TREE_WIDTH * TREE_HEIGHT] = {0};
    const pags_object *object = pags_dataset_object(dataset, i);
    if (!pags_object_pose(object, view->camera.time, pose) || (i == 1 && (view->frame == 0 || view->frame == 4)))
      continue;
    int count = pags_box_outline(&view->camera, pose, object->size, corners);
    pags_outline_fill(corners, count, view->camera.width, view->camera.height, view->camera.width, 1, plane);
    sum |= plane[y * view->camera.width + x] ? bits[i] : 0;
  }
  return sum;
}

/* Expected bits of every pixel; files are named by letters: s sky, c semantic classes, d dynamic, b boxes. */
static void check_labels(scratch *s, const char *files, int shrink) {
  pags_dataset_options options = with_kind("pandaset");
  pags_dataset *dataset;
  pags_photo photo;
  options.downscale = shrink;
  scratch_ok(pags_dataset_open(s->folder, &options, &dataset));
  const pags_view *view = pags_dataset_view(dataset, 4);
  with_photo(dataset, 4, 1, copy_photo, &photo);
  bool sky = strchr(files, 's'), semantic = strchr(files, 'c'), dynamic = strchr(files, 'd'),
       boxes = strchr(files, 'b');
  const int critical = semantic ? 0 : PAGS_LABEL_CRITICAL;
  const int bits[2] = {PAGS_LABEL_VEHICLE | critical | (dynamic ? 0 : PAGS_LABEL_MOVING), PAGS_LABEL_PARKED | critical};
  int seen = 0;
  for (int y = 0; y < photo.height; y++)
    for (int x = 0; x < photo.width; x++) {
      int u = x * shrink + shrink / 2, v = y * shrink + shrink / 2,
          expected = boxes ? box_bits(dataset, view, x, y, bits) : 0;
      expected |= (sky ? white_above(u, v) : semantic && classes(u, v) == 10) ? PAGS_LABEL_SKY : 0;
      expected |= semantic && classes(u, v) >= 11 && classes(u, v) <= 18 ? PAGS_LABEL_CRITICAL : 0;
      expected |= dynamic && white_right(u, v) ? PAGS_LABEL_MOVING | PAGS_LABEL_CRITICAL : 0;
      if (label_at(&photo, x, y) != expected)
        fail_msg("%s / %d: label %d at %d %d, expected %d", files, shrink, label_at(&photo, x, y), x, y, expected);
      seen |= expected;
      bool used =
          boxes || !((semantic && classes(u, v) >= 11 && classes(u, v) <= 18) || (dynamic && white_right(u, v)));
      if (shrink == 1)
        assert_int_equal(photo.mask ? photo.mask[y * photo.stride + x] : 255, used ? 255 : 0);
    }
  if (boxes)
    assert_true((seen & PAGS_LABEL_VEHICLE) && (seen & PAGS_LABEL_PARKED));
  drop_photo(&photo);
  pags_dataset_close(dataset);
}

static void labels_come_from_what_there_is(void **state) {
  (void)state;
  static const char *const sets[] = {"s", "c", "d", "b", "sc", "cb", "db", "sdb", "scdb"};
  for (size_t i = 0; i < sizeof sets / sizeof *sets; i++)
    for (int shrink = 1; shrink <= 2; shrink++) {
      scratch s;
      scratch_begin(&s);
      tree_write_cameras(&s, &tree_kinds[1]);
      if (strchr(sets[i], 's'))
        write_grey(&s, "sky_masks/002_0.png", white_above);
      if (strchr(sets[i], 'c'))
        write_grey(&s, "semantic/002_0.png", classes);
      if (strchr(sets[i], 'd'))
        write_grey(&s, "dynamic_masks/all/002_0.png", white_right);
      if (strchr(sets[i], 'b'))
        tree_write_boxes(&s, &tree_kinds[1]);
      check_labels(&s, sets[i], shrink);
      scratch_end(&s);
    }
}

/* The budget holds with label planes, too, and all of them come out the same as with plenty. */
static void budgets_count_labels(void **state) {
  (void)state;
  pags_dataset *dataset;
  scratch s;
  scratch_begin(&s);
  tree_write(&s, &tree_kinds[1]);
  for (int t = 0; t < TREE_FRAMES; t++) {
    char name[64];
    snprintf(name, sizeof name, "semantic/%03d_0.png", t);
    write_grey(&s, name, classes);
  }
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  /* Three photographs with a label plane; a decode holds the source's six bytes a pixel besides. */
  const uint64_t room = 3 * (5 * 48 * TREE_HEIGHT + 64) + 6 * 48 * TREE_HEIGHT;
  for (int round = 0; round < 3; round++) {
    uint64_t budget = room + (uint64_t)round * 9000, used, peak, decoded;
    pags_tasks *tasks = pags_tasks_create(2);
    pags_photo_cache *cache;
    int64_t order[TREE_FRAMES * TREE_CAMERAS];
    scratch_ok(pags_photo_cache_create(dataset, tasks, budget, &cache));
    for (int i = 0; i < TREE_FRAMES * TREE_CAMERAS; i++)
      order[i] = i * 3 % (TREE_FRAMES * TREE_CAMERAS);
    pags_photo_cache_prefetch(cache, order, TREE_FRAMES * TREE_CAMERAS, 1);
    for (int i = 0; i < TREE_FRAMES * TREE_CAMERAS; i++) {
      pags_photo photo, alone;
      with_photo(dataset, order[i], 1, copy_photo, &alone);
      scratch_ok(pags_photo_cache_get(cache, order[i], 1, &photo));
      assert_memory_equal(photo.labels, alone.labels, (size_t)(photo.stride * photo.height));
      drop_photo(&alone);
      pags_photo_cache_figures(cache, &used, &peak, &decoded);
      assert_true(used >= 4 * 48 * TREE_HEIGHT && peak <= budget);
    }
    pags_photo_cache_destroy(cache);
    pags_tasks_destroy(tasks);
  }
  pags_dataset_close(dataset);
  scratch_end(&s);
}

static void missing_pictures_may_be_left_out(void **state) {
  (void)state;
  pags_dataset_options options = with_kind("kitti");
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

static void a_mask_of_another_size_is_refused(void **state) {
  (void)state;
  pags_dataset *dataset;
  pags_photo_cache *cache;
  pags_photo photo;
  pags_tasks *tasks = pags_tasks_create(1);
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  scratch_picture(&s, "sky_masks/000_0.png", 20, 10, tree_paint);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  scratch_ok(pags_photo_cache_create(dataset, tasks, UINT64_C(1) << 24, &cache));
  scratch_expect(pags_photo_cache_get(cache, 0, 1, &photo), PAGS_ERROR_FORMAT, "sky_masks/000_0.png: 20 x 10 pixels");
  pags_photo_cache_destroy(cache);
  pags_dataset_close(dataset);
  pags_tasks_destroy(tasks);
  scratch_end(&s);
}

/* Barrel distortion: labels move with the picture. The mask's border, straight in the source, is found where the lens puts it. */
static void labels_are_undistorted(void **state) {
  (void)state;
  pags_dataset *dataset;
  pags_photo photo;
  scratch s;
  scratch_begin(&s);
  tree_write_cameras(&s, &tree_kinds[1]);
  tree_text(&s, "intrinsics/0.txt", "40 40 24 16 -0.2 0.01 0 0 0");
  write_grey(&s, "dynamic_masks/all/000_0.png", white_right);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  with_photo(dataset, 0, 1, copy_photo, &photo);
  const pags_camera *camera = &pags_dataset_view(dataset, 0)->camera;
  int moving = 0;
  for (int y = 0; y < photo.height; y++)
    for (int x = 0; x < photo.width; x++) {
      double a = (x + 0.5 - camera->cx) / camera->fx, b = (y + 0.5 - camera->cy) / camera->fy, r = a * a + b * b;
      double u = 40 * a * (1 - 0.2 * r + 0.01 * r * r) + 24;
      assert_int_equal(label_at(&photo, x, y), u >= 40 ? PAGS_LABEL_MOVING | PAGS_LABEL_CRITICAL : 0);
      moving += u >= 40;
    }
  assert_true(moving > 0 && photo.width < TREE_WIDTH + 8);
  drop_photo(&photo);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

/* A wall of laser points over the left half, up to some 5 degrees; the right half has a road only. */
static void sky_is_guessed_from_the_laser(void **state) {
  (void)state;
  enum { COUNT = 40 * 60 };
  static float rows[COUNT * 5];
  pags_dataset *dataset;
  pags_photo photo;
  scratch s;
  scratch_begin(&s);
  tree_write(&s, &tree_kinds[1]);
  scratch_ok(pags_remove_tree(scratch_path(&s, "instances")));
  for (int i = 0; i < COUNT; i++) {
    double azimuth = (i % 60 - 30) * 0.03, elevation = i / 60 * 0.006 - 0.14, range = 30;
    bool wall = azimuth > 0; /* y is left */
    float *row = rows + 5 * i;
    row[0] = (float)(range * cos(azimuth) + 1.5), row[1] = (float)(range * sin(azimuth) + 0.3);
    row[2] = (float)(1.6 + range * tan(wall ? elevation : -0.1));
    if (!wall && i == 0) /* a mast far to the right shows how high the laser looks */
      row[2] = (float)(1.6 + range * tan(0.4));
  }
  tree_bytes(&s, "lidar/000.bin", rows, sizeof rows);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  with_photo(dataset, 0, 1, copy_photo, &photo);
  const pags_camera *camera = &pags_dataset_view(dataset, 0)->camera;
  int sky = 0;
  for (int y = 0; y < photo.height; y++)
    for (int x = 0; x < photo.width; x++) {
      double azimuth = -atan((x + 0.5 - camera->cx) / camera->fx);
      double elevation = atan((camera->cy - y - 0.5) / hypot(camera->fx, x + 0.5 - camera->cx));
      int found = label_at(&photo, x, y) & PAGS_LABEL_SKY;
      if (fabs(azimuth) < 0.06 || azimuth < -0.4)
        continue;
      double top = azimuth > 0 ? 39 * 0.006 - 0.14 + 0.026 : 0.0175;
      if (fabs(elevation - top) > 0.02)
        assert_int_equal(found, elevation > top);
      sky += found;
    }
  assert_true(sky > 100);
  drop_photo(&photo);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

/* Ego masks. */

enum { WIDE = 320, HIGH = 200, DRIVE = 24 };

static int drive_frame;

/* Noise that goes by, and, below, a patterned bonnet that stays. */
static uint8_t paint_drive(int x, int y, int c) {
  bool bonnet = y > 150 + (x - 160) * (x - 160) / 400;
  unsigned seed =
      (unsigned)(x / 4) * 73856093u ^ (unsigned)(y / 4) * 19349663u ^ (bonnet ? 0 : (unsigned)drive_frame * 83492791u);
  seed = (seed ^ seed >> 13) * 1274126177u;
  return (uint8_t)((seed >> 16 & 127) + (unsigned)c);
}

static uint8_t paint_open(int x, int y, int c) {
  return paint_drive(x, y > 150 ? 300 - y : y, c);
}

static void write_drive(scratch *s, uint8_t (*paint)(int x, int y, int c)) {
  for (drive_frame = 0; drive_frame < DRIVE; drive_frame++) {
    double pose[12];
    char name[64];
    snprintf(name, sizeof name, "images/%03d_0.png", drive_frame);
    scratch_picture(s, name, WIDE, HIGH, paint);
    snprintf(name, sizeof name, "extrinsics/%03d_0.txt", drive_frame);
    tree_view(drive_frame, 0, pose);
    tree_write_matrix(s, name, pose);
  }
  tree_text(s, "intrinsics/0.txt", "200 200 160 100 0 0 0 0 0");
}

static bool has_note(const pags_dataset *dataset, const char *part) {
  for (int64_t i = 0; i < pags_dataset_note_count(dataset); i++)
    if (strstr(pags_dataset_note(dataset, i), part))
      return true;
  return false;
}

static void the_own_car_is_found(void **state) {
  (void)state;
  pags_dataset *dataset;
  pags_photo photo;
  scratch s;
  scratch_begin(&s);
  write_drive(&s, paint_drive);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  assert_true(has_note(dataset, "ego mask: camera 0 sees"));
  with_photo(dataset, 3, 1, copy_photo, &photo);
  assert_non_null(photo.mask);
  for (int y = 0; y < HIGH; y++)
    for (int x = 0; x < WIDE; x++) {
      int depth = y - (150 + (x - 160) * (x - 160) / 400); /* px below the bonnet's edge */
      if (depth > 4 && abs(x - 160) < 100)
        assert_int_equal(photo.mask[y * photo.stride + x], 0);
      if (depth < -8)
        assert_int_equal(photo.mask[y * photo.stride + x], 255);
    }
  drop_photo(&photo);
  pags_dataset_close(dataset);
  write_drive(&s, paint_open);
  scratch_ok(pags_dataset_open(s.folder, NULL, &dataset));
  assert_true(has_note(dataset, "none found"));
  pags_dataset_close(dataset);
  scratch_end(&s);
}

static void given_ego_masks_are_used(void **state) {
  (void)state;
  for (int given = 0; given < 3; given++) {
    pags_dataset_options options = with_kind("pandaset");
    pags_dataset *dataset;
    scratch s;
    scratch_begin(&s);
    tree_write_cameras(&s, &tree_kinds[1]);
    write_grey(&s, given == 0 ? "ego_masks/1.png" : "elsewhere/1.png", white_low);
    char path[256];
    snprintf(path, sizeof path, "%s/%s", s.folder, given == 1 ? "elsewhere" : "elsewhere/1.png");
    options.ego_mask = given > 0 ? path : NULL;
    scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
    for (int view = 0; view < 2; view++) { /* cameras 0 and 1 */
      pags_photo photo;
      with_photo(dataset, view, 1, copy_photo, &photo);
      bool masked = given == 2 || view == 1;
      assert_true((photo.mask != NULL) == masked);
      for (int i = 0; masked && i < TREE_WIDTH * TREE_HEIGHT; i++)
        assert_int_equal(photo.mask[i / TREE_WIDTH * photo.stride + i % TREE_WIDTH],
                         white_low(0, i / TREE_WIDTH) ? 0 : 255);
      drop_photo(&photo);
    }
    pags_dataset_close(dataset);
    scratch_picture(&s, given == 0 ? "ego_masks/1.png" : "elsewhere/1.png", 20, 10, tree_paint);
    scratch_expect(open_in(&s, &options), PAGS_ERROR_FORMAT, "ego mask of 20 x 10 pixels");
    scratch_end(&s);
  }
}

/* SfM points: those that fewer than two training views see are left out; ids go by image name. */
static void sfm_points_are_added(void **state) {
  (void)state;
  pags_dataset_options options = with_kind("pandaset");
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
            "1 1 2 3 10 20 30 0.5 5 0 6 0\n2 4 5 6 40 50 60 0.5 5 0 9 0\n3 7 8 9 70 80 90 0.5 6 0 5 0 9 0\n");
  options.sfm = "sfm";
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  pags_dataset_points(dataset, &count, &xyz, &rgb, &random);
  assert_true(count == 2 && random == 0 && (pags_dataset_provides(dataset) & PAGS_PROVIDES_SFM));
  assert_true(xyz[0] == 1 && xyz[5] == 9 && rgb[0] == 10 && rgb[5] == 90);
  pags_dataset_close(dataset);
  options.sfm = "nowhere";
  scratch_expect(open_in(&s, &options), PAGS_ERROR_FORMAT, "nowhere: not a COLMAP model");
  scratch_end(&s);
}

/* Boxes of all objects against dynamic_masks/all, which were drawn from them by other code. */
static void pandaset_boxes_match_masks(void **state) {
  (void)state;
  pags_dataset *dataset = open_pandaset();
  if (!dataset)
    skip();
  int64_t both = 0, either = 0;
  for (int64_t i = 0; i < 240; i += 7) {
    pags_photo photo;
    const pags_view *view = pags_dataset_view(dataset, i);
    with_photo(dataset, i, 1, copy_photo, &photo);
    uint8_t *plane = calloc((size_t)photo.stride, (size_t)photo.height);
    assert_non_null(plane);
    for (int64_t k = 0; k < pags_dataset_object_count(dataset); k++) {
      const pags_object *object = pags_dataset_object(dataset, k);
      double corners[32];
      for (int64_t j = 0; j < object->knot_count; j++)
        if (object->knots[j].frame == view->frame)
          pags_outline_fill(corners,
                            pags_box_outline(&view->camera, object->knots[j].world_from_object, object->size, corners),
                            photo.width, photo.height, photo.stride, 1, plane);
    }
    for (int j = 0; j < photo.stride * photo.height; j++) {
      bool mask = photo.labels[j] & PAGS_LABEL_MOVING, box = plane[j];
      both += mask && box;
      either += mask || box;
    }
    free(plane);
    drop_photo(&photo);
  }
  assert_true(either > 100000);
  if (!((double)both / (double)either >= 0.97))
    fail_msg("intersection over union %g", (double)both / (double)either);
  pags_dataset_close(dataset);
}

/* Whether a point of the world lies in the box of a moving vehicle at that frame. */
static bool in_vehicle(const pags_dataset *dataset, int frame, const double p[3]) {
  for (int64_t k = 0; k < pags_dataset_object_count(dataset); k++) {
    const pags_object *object = pags_dataset_object(dataset, k);
    for (int64_t j = 0; object->moving && object->category == PAGS_CATEGORY_VEHICLE && j < object->knot_count; j++) {
      const double *m = object->knots[j].world_from_object;
      bool inside = object->knots[j].frame == frame;
      for (int c = 0; c < 3 && inside; c++)
        inside =
            fabs(m[c] * (p[0] - m[3]) + m[4 + c] * (p[1] - m[7]) + m[8 + c] * (p[2] - m[11])) < 0.5 * object->size[c];
      if (inside)
        return true;
    }
  }
  return false;
}

/* Laser points in boxes of moving vehicles, projected, fall on dynamic_masks/vehicle: poses, axes and times of all fit. */
static void pandaset_laser_hits_masks(void **state) {
  (void)state;
  char path[1024], name[1100];
  pags_dataset *dataset = open_pandaset();
  if (!dataset || !pags_shared_data("pandaset-002", path, sizeof path))
    skip();
  int64_t inside = 0, all = 0;
  for (int64_t i = 0; i < pags_dataset_sweep_count(dataset); i += 5) {
    const pags_sweep *sweep = pags_dataset_sweep(dataset, i);
    const pags_camera *camera = &pags_dataset_view(dataset, 3 * sweep->frame)->camera;
    double from_world[12];
    int64_t count;
    float *xyz;
    pags_image mask;
    snprintf(name, sizeof name, "%s/dynamic_masks/vehicle/%03d_0.png", path, sweep->frame);
    scratch_ok(pags_image_load(name, PAGS_U8, 1, &mask));
    scratch_ok(pags_dataset_sweep_load(dataset, i, &count, &xyz));
    pags_rigid_inverse(camera->world_from_camera, from_world);
    for (int64_t k = 0; k < count; k++) {
      double world[3], p[3];
      const double *m = sweep->world_from_sweep;
      for (int c = 0; c < 3; c++)
        world[c] = m[4 * c] * (double)xyz[3 * k] + m[4 * c + 1] * (double)xyz[3 * k + 1] +
                   m[4 * c + 2] * (double)xyz[3 * k + 2] + m[4 * c + 3];
      for (int c = 0; c < 3; c++)
        p[c] = from_world[4 * c] * world[0] + from_world[4 * c + 1] * world[1] + from_world[4 * c + 2] * world[2] +
               from_world[4 * c + 3];
      double u = camera->fx * p[0] / p[2] + camera->cx, v = camera->fy * p[1] / p[2] + camera->cy;
      if (p[2] < 0.5 || u < 0 || v < 0 || u >= camera->width || v >= camera->height ||
          !in_vehicle(dataset, sweep->frame, world))
        continue;
      all++;
      inside += ((uint8_t *)mask.data)[(int)v * mask.width + (int)u] >= 128;
    }
    pags_image_destroy(&mask);
    free(xyz);
  }
  assert_true(all > 500);
  if (!((double)inside / (double)all >= 0.99))
    fail_msg("%g of %d points", (double)inside / (double)all, (int)all);
  assert_true(has_note(dataset, "ego mask: none given, none found"));
  assert_true(has_note(dataset, "none for 4 frames: 056 057 058 071"));
  pags_dataset_close(dataset);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(every_kind_reads_the_same),
      cmocka_unit_test(stated_keys_win),
      cmocka_unit_test(options_choose),
      cmocka_unit_test(without_times_and_boxes),
      cmocka_unit_test(bad_files_are_explained),
      cmocka_unit_test(labels_come_from_what_there_is),
      cmocka_unit_test(budgets_count_labels),
      cmocka_unit_test(missing_pictures_may_be_left_out),
      cmocka_unit_test(a_mask_of_another_size_is_refused),
      cmocka_unit_test(labels_are_undistorted),
      cmocka_unit_test(sky_is_guessed_from_the_laser),
      cmocka_unit_test(the_own_car_is_found),
      cmocka_unit_test(given_ego_masks_are_used),
      cmocka_unit_test(sfm_points_are_added),
      cmocka_unit_test(pandaset_reads),
      cmocka_unit_test(pandaset_boxes_look_ahead),
      cmocka_unit_test(pandaset_boxes_match_masks),
      cmocka_unit_test(pandaset_laser_hits_masks),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
