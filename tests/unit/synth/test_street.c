/* SPDX-License-Identifier: Apache-2.0 */
/* The synthetic street has every file of a driving set, with the same bytes for any number of threads. LiDAR, boxes,
 * masks and depth agree, and requested noise changes only its own quantity. */
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
#include "base/text.h"
#include "written_street.h"

enum { WIDTH = 64, HEIGHT = 36, FRAMES = 6, CAMERAS = 3, PIXELS = WIDTH * HEIGHT };

static pags_street_options small_street(void) {
  pags_street_options options = pags_street_options_default();
  options.width = WIDTH;
  options.height = HEIGHT;
  options.frames = FRAMES;
  options.samples = 2;
  options.lidar_points = 4000;
  options.lidar_noise = 0.0;
  options.seed = 5;
  return options;
}

static int make_sets(void **state) {
  (void)state;
  const pags_street_options options = small_street();
  if (scratch_make() != 0)
    return -1;
  write_street("street", &options, 2);
  return 0;
}

/* Returns the path of a file of a set; valid until four more calls. */
static const char *file_of(const char *set, const char *format, ...) {
  char relative[64], name[96];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(relative, sizeof relative, format, arguments);
  va_end(arguments);
  snprintf(name, sizeof name, "%s/%s", set, relative);
  return scratch(name);
}

static void read_numbers(const char *path, int count, double *out) {
  uint8_t *bytes = NULL;
  size_t size = 0;
  assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
  char *at = (char *)bytes;
  for (int i = 0; i < count; i++) {
    char *end = at;
    out[i] = pags_text_to_double(at, &end);
    assert_true(end > at);
    at = end;
  }
  free(bytes);
}

static pags_camera read_camera(const char *set, int frame, int camera) {
  double ego[16], mount[16], k[9];
  pags_camera out = {.width = WIDTH, .height = HEIGHT};
  read_numbers(file_of(set, "ego_pose/%03d.txt", frame), 16, ego);
  read_numbers(file_of(set, "extrinsics/%d.txt", camera), 16, mount);
  read_numbers(file_of(set, "intrinsics/%d.txt", camera), 9, k);
  out.fx = k[0];
  out.fy = k[1];
  out.cx = k[2];
  out.cy = k[3];
  pags_rigid_multiply(ego, mount, out.world_from_camera);
  assert_int_equal(pags_camera_check(&out, "camera"), PAGS_OK);
  return out;
}

/* Loads a picture of one channel and checks its size. */
static pags_image load(const char *path, pags_sample sample) {
  pags_image image = {0};
  if (pags_image_load(path, sample, 1, &image) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  assert_int_equal(image.width, WIDTH);
  assert_int_equal(image.height, HEIGHT);
  return image;
}

static pags_json *load_instances(const char *path) {
  pags_json *json = NULL;
  if (pags_json_parse_file(path, &json) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  return json;
}

static void test_files(void **state) {
  (void)state;
  static const char *const fixed[] = {"dataset.json",
                                      "timestamps.json",
                                      "instances/instances_info.json",
                                      "instances/frame_instances.json",
                                      "truth/instances/instances_info.json",
                                      "truth/street.json",
                                      "truth/shift/right1/path.json",
                                      "truth/shift/right3/00000.png",
                                      "truth/shift/up1/00000.png"};
  static const char *const each[] = {"images/%03d_%d.png",
                                     "semantic/%03d_%d.png",
                                     "sky_masks/%03d_%d.png",
                                     "dynamic_masks/all/%03d_%d.png",
                                     "dynamic_masks/vehicle/%03d_%d.png",
                                     "dynamic_masks/human/%03d_%d.png",
                                     "truth/depth/%03d_%d.exr",
                                     "truth/ids/%03d_%d.png"};
  for (size_t i = 0; i < sizeof fixed / sizeof fixed[0]; i++)
    assert_true(pags_file_exists(file_of("street", "%s", fixed[i])));
  for (int f = 0; f < FRAMES; f++)
    for (int c = 0; c < CAMERAS; c++)
      for (size_t i = 0; i < sizeof each / sizeof each[0]; i++) {
        char name[64];
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
        snprintf(name, sizeof name, each[i], f, c);
#pragma GCC diagnostic pop
        assert_true(pags_file_exists(file_of("street", "%s", name)));
      }
  pags_camera_path path = {0};
  assert_int_equal(pags_camera_path_load(file_of("street", "truth/shift/right2/path.json"), &path), PAGS_OK);
  assert_int_equal(path.count, 1); /* only the camera of frame 4 */
  const pags_camera front = read_camera("street", 4, 0);
  double aside[3], to[12];
  pags_rigid_inverse(front.world_from_camera, to);
  for (int r = 0; r < 3; r++) {
    aside[r] = to[4 * r + 3];
    for (int k = 0; k < 3; k++)
      aside[r] += to[4 * r + k] * path.cameras[0].world_from_camera[4 * k + 3];
  }
  assert_true(fabs(aside[0] - 2.0) < 1e-6 && fabs(aside[1]) < 1e-6 && fabs(aside[2]) < 1e-6);
  assert_true(fabs(path.cameras[0].time - 0.4) < 1e-9);
  pags_camera_path_destroy(&path);
}

/* FNV-1a hash over names and contents of a folder, in the order of names. */
static uint64_t hash_tree(const char *folder, uint64_t hash, int *files) {
  pags_dir_list list;
  assert_int_equal(pags_dir_list_read(folder, &list), PAGS_OK);
  for (int64_t i = 0; i < list.count; i++) {
    char *path = pags_path_join(folder, list.names[i]);
    if (pags_dir_exists(path)) {
      hash = hash_tree(path, hash, files);
    } else {
      uint8_t *bytes = NULL;
      size_t size = 0;
      assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
      for (size_t b = 0; b < size; b++)
        hash = (hash ^ bytes[b]) * 0x100000001b3u;
      free(bytes);
      ++*files;
    }
    free(path);
  }
  pags_dir_list_destroy(&list);
  return hash;
}

static void test_threads(void **state) {
  (void)state;
  pags_street_options options = small_street();
  int files[3] = {0};
  write_street("one", &options, 1);
  const uint64_t two = hash_tree(scratch("street"), 1, &files[0]), one = hash_tree(scratch("one"), 1, &files[1]);
  assert_int_equal(files[0], files[1]);
  assert_true(files[0] > FRAMES * CAMERAS * 8);
  assert_true(one == two);
  options.seed = 6;
  options.frames = 2;
  write_street("other", &options, 3);
  assert_true(hash_tree(scratch("other"), 1, &files[2]) != one);
}

/* Projects a world point: pixel and camera z; returns 0 outside of the picture. */
static int project(const pags_camera *camera, const double p[3], int *x, int *y, double *z) {
  double from[12], q[3];
  pags_rigid_inverse(camera->world_from_camera, from);
  for (int r = 0; r < 3; r++)
    q[r] = from[4 * r] * p[0] + from[4 * r + 1] * p[1] + from[4 * r + 2] * p[2] + from[4 * r + 3];
  if (q[2] < 0.5)
    return 0;
  const double u = camera->fx * q[0] / q[2] + camera->cx, v = camera->fy * q[1] / q[2] + camera->cy;
  *x = (int)floor(u);
  *y = (int)floor(v);
  *z = q[2];
  return u >= 0.0 && u < WIDTH && v >= 0.0 && v < HEIGHT;
}

/* Compares LiDAR with the depth pictures. The LiDAR isn't at the camera and a pixel of a small picture is large, so
 * most points lie within the depth range of the 3 x 3 pixels around their projection. */
static void test_lidar(void **state) {
  (void)state;
  int64_t seen = 0, agree = 0;
  for (int f = 0; f < FRAMES; f++) {
    double ego[16];
    uint8_t *bytes = NULL;
    size_t size = 0;
    const pags_camera camera = read_camera("street", f, 0);
    read_numbers(file_of("street", "ego_pose/%03d.txt", f), 16, ego);
    assert_int_equal(pags_file_read(file_of("street", "lidar/%03d.bin", f), &bytes, &size), PAGS_OK);
    assert_true(size % 16 == 0 && size > 16 * 1500);
    pags_image depth = load(file_of("street", "truth/depth/%03d_0.exr", f), PAGS_F32);
    for (size_t i = 0; i < size / 16; i++) {
      float point[4];
      double world[3], z, lo = HUGE_VAL, hi = 0.0;
      int x, y;
      memcpy(point, bytes + 16 * i, sizeof point);
      assert_true(point[3] >= 0.0f && point[3] <= 1.0f);
      for (int r = 0; r < 3; r++)
        world[r] = ego[4 * r] * (double)point[0] + ego[4 * r + 1] * (double)point[1] +
                   ego[4 * r + 2] * (double)point[2] + ego[4 * r + 3];
      assert_true(world[2] > -0.02);
      if (!project(&camera, world, &x, &y, &z) || x < 1 || y < 1 || x > WIDTH - 2 || y > HEIGHT - 2)
        continue;
      for (int n = 0; n < 9; n++) {
        const double d = (double)((const float *)depth.data)[(y + n / 3 - 1) * WIDTH + x + n % 3 - 1];
        lo = fmin(lo, d > 0.0 ? d : HUGE_VAL);
        hi = fmax(hi, d > 0.0 ? d : HUGE_VAL);
      }
      seen++;
      agree += z > lo - 0.1 && z < hi + 0.1;
    }
    pags_image_destroy(&depth);
    free(bytes);
  }
  assert_true(seen > 1000);
  assert_true((double)agree > 0.97 * (double)seen);
}

/* The surface point of every pixel lies on a true surface of its label's kind (critical or other), and a point 3 cm
 * in front of it is about that far from one. */
static void test_nearest_surfaces(void **state) {
  (void)state;
  enum { MOST = PIXELS };
  static float points[3 * MOST], critical[MOST], other[MOST], far_critical[MOST], far_other[MOST];
  static int is_critical[MOST];
  pags_street_truth *truth = NULL;
  assert_int_equal(pags_street_truth_open(scratch("street"), &truth), PAGS_OK);
  assert_non_null(truth);
  int64_t of_kind[2] = {0};
  for (int f = 0; f < FRAMES; f += FRAMES - 1)
    for (int step = 0; step < 2; step++) { /* the second pass tests points 3 cm in front of the surface */
      const pags_camera camera = read_camera("street", f, 1);
      pags_image depth = load(file_of("street", "truth/depth/%03d_1.exr", f), PAGS_F32);
      pags_image labels = load(file_of("street", "semantic/%03d_1.png", f), PAGS_U8);
      int64_t count = 0;
      for (int i = 0; i < PIXELS; i++) {
        const double z = (double)((const float *)depth.data)[i];
        if (!(z > 0.0 && z < 60.0))
          continue;
        const double near = z - 0.03 * step;
        const double q[3] = {(i % WIDTH + 0.5 - camera.cx) / camera.fx * near,
                             (i / WIDTH + 0.5 - camera.cy) / camera.fy * near, near};
        for (int r = 0; r < 3; r++) {
          const double *m = camera.world_from_camera + 4 * r;
          points[3 * count + r] = (float)(m[0] * q[0] + m[1] * q[1] + m[2] * q[2] + m[3]);
        }
        /* Cityscapes ids 11 to 18: person, rider, vehicles, bicycle. */
        const int label = ((const uint8_t *)labels.data)[i];
        is_critical[count++] = label >= 11 && label <= 18;
      }
      pags_image_destroy(&depth);
      pags_image_destroy(&labels);
      assert_int_equal(pags_street_truth_distances(truth, f / 10.0, points, count, 0.3, critical, other), PAGS_OK);
      assert_int_equal(pags_street_truth_distances(truth, f / 10.0, points, count, 1.0, far_critical, far_other),
                       PAGS_OK);
      for (int64_t i = 0; i < count; i++) {
        const double own = (double)(is_critical[i] ? critical : other)[i];
        assert_true(own < (step ? 0.05 : 0.003)); /* 3 cm in z are longer along the ray */
        assert_true(critical[i] > 0.3f ? far_critical[i] > 0.3f : far_critical[i] == critical[i]);
        assert_true(other[i] > 0.3f ? far_other[i] > 0.3f : far_other[i] == other[i]);
        of_kind[is_critical[i]]++;
      }
    }
  assert_true(of_kind[0] > 2000 && of_kind[1] > 50);
  pags_street_truth_close(truth);
  assert_int_equal(pags_street_truth_open(scratch("street/images"), &truth), PAGS_OK);
  assert_null(truth);
}

typedef struct box {
  double pose[12], size[3];
  int moving, vehicle;
} box;

/* Reads an object's box at `frame`; returns 0 if it has none. */
static int read_box(const pags_json *json, int number, int frame, box *out) {
  char key[16];
  snprintf(key, sizeof key, "%d", number);
  const pags_json_value *object = pags_json_member(pags_json_root(json), key);
  if (!object)
    return 0;
  const pags_json_value *notes = pags_json_member(object, "frame_annotations");
  const pags_json_value *index = pags_json_member(notes, "frame_idx")->first;
  const pags_json_value *pose = pags_json_member(notes, "obj_to_world")->first,
                        *size = pags_json_member(notes, "box_size")->first;
  for (; index; index = index->next, pose = pose->next, size = size->next) {
    if ((int)index->number != frame)
      continue;
    const pags_json_value *row = pose->first, *side = size->first;
    for (int r = 0; r < 3; r++, row = row->next, side = side->next) {
      const pags_json_value *cell = row->first;
      for (int c = 0; c < 4; c++, cell = cell->next)
        out->pose[4 * r + c] = cell->number;
      out->size[r] = side->number;
    }
    const char *id = pags_json_member(object, "id")->text;
    out->moving = strncmp(id, "moving", 6) == 0;
    out->vehicle = strcmp(pags_json_member(object, "class_name")->text, "Car") == 0;
    return 1;
  }
  return 0;
}

/* Returns whether the surface point of a pixel, at its true depth z, lies inside a box, with a tolerance of 1 cm. */
static int inside(const pags_camera *camera, int x, int y, double z, const box *b) {
  const double q[3] = {(x + 0.5 - camera->cx) / camera->fx * z, (y + 0.5 - camera->cy) / camera->fy * z, z};
  double p[3], from[12];
  for (int r = 0; r < 3; r++) {
    const double *m = camera->world_from_camera + 4 * r;
    p[r] = m[0] * q[0] + m[1] * q[1] + m[2] * q[2] + m[3];
  }
  pags_rigid_inverse(b->pose, from);
  for (int r = 0; r < 3; r++)
    if (fabs(from[4 * r] * p[0] + from[4 * r + 1] * p[1] + from[4 * r + 2] * p[2] + from[4 * r + 3]) >
        0.5 * b->size[r] + 0.01)
      return 0;
  return 1;
}

static void check_pixels(const pags_json *json, int frame, int camera, int64_t counts[3]) {
  const pags_camera view = read_camera("street", frame, camera);
  static const char *const folders[5] = {"semantic", "sky_masks", "dynamic_masks/all", "dynamic_masks/vehicle",
                                         "dynamic_masks/human"};
  pags_image plane[5], ids = load(file_of("street", "truth/ids/%03d_%d.png", frame, camera), PAGS_U16);
  pags_image depth = load(file_of("street", "truth/depth/%03d_%d.exr", frame, camera), PAGS_F32);
  for (int i = 0; i < 5; i++)
    plane[i] = load(file_of("street", "%s/%03d_%d.png", folders[i], frame, camera), PAGS_U8);
  for (int i = 0; i < PIXELS; i++) {
    const int id = ((const uint16_t *)ids.data)[i];
    const double z = (double)((const float *)depth.data)[i];
    int at[5];
    box b = {0};
    for (int k = 0; k < 5; k++)
      at[k] = ((const uint8_t *)plane[k].data)[i];
    assert_int_equal(at[0] == 10, z == 0.0);
    assert_int_equal(at[1], at[0] == 10 ? 255 : 0);
    counts[0] += at[0] == 10;
    if (id > 0 && !read_box(json, id - 1, frame, &b)) {
      /* Labels end 90 m from the car; camera z is smaller at the side of the picture. */
      assert_true(z > 45.0);
      continue;
    }
    if (id > 0) {
      assert_true(inside(&view, i % WIDTH, i / WIDTH, z, &b));
      assert_true(b.vehicle ? at[0] == 13 : at[0] == 11 || at[0] == 12 || at[0] == 18);
      counts[1 + b.moving]++;
    }
    assert_int_equal(at[2], b.moving ? 255 : 0);
    assert_int_equal(at[3], b.moving && b.vehicle ? 255 : 0);
    assert_int_equal(at[4], b.moving && !b.vehicle ? 255 : 0);
  }
  for (int i = 0; i < 5; i++)
    pags_image_destroy(&plane[i]);
  pags_image_destroy(&ids);
  pags_image_destroy(&depth);
}

static void test_masks_and_boxes(void **state) {
  (void)state;
  pags_json *json = load_instances(file_of("street", "instances/instances_info.json"));
  int64_t counts[3] = {0}; /* pixels of the sky, of parked and of moving objects */
  for (int f = 0; f < FRAMES; f += 2)
    for (int c = 0; c < CAMERAS; c++)
      check_pixels(json, f, c, counts);
  for (int i = 0; i < 3; i++)
    assert_true(counts[i] > PIXELS / 20);
  pags_json_destroy(json);
}

static void test_noise(void **state) {
  (void)state;
  pags_street_options options = small_street();
  options.pose_noise = 0.3;
  options.yaw_noise = 2.0;
  options.lidar_noise = 0.05;
  options.cameras = 1;
  options.shifts = 0;
  write_street("noisy", &options, 2);
  assert_false(pags_path_exists(file_of("noisy", "truth/shift")));
  pags_json *noisy = load_instances(file_of("noisy", "instances/instances_info.json"));
  pags_json *exact = load_instances(file_of("noisy", "truth/instances/instances_info.json"));
  pags_json *plain = load_instances(file_of("street", "instances/instances_info.json"));
  double sum[3] = {0};
  int count = 0;
  for (int number = 0, frame = 0; number < 200; frame++) {
    box a, b, c;
    if (frame == FRAMES) {
      frame = -1;
      number++;
      continue;
    }
    if (!read_box(exact, number, frame, &a))
      continue;
    assert_true(read_box(noisy, number, frame, &b) && read_box(plain, number, frame, &c));
    assert_memory_equal(a.pose, c.pose, sizeof a.pose); /* the true pose is the same with and without noise */
    assert_true(fabs(a.pose[11] - b.pose[11]) < 1e-12);
    if (!a.moving) {
      assert_memory_equal(a.pose, b.pose, sizeof a.pose);
      continue;
    }
    sum[0] += pow(a.pose[3] - b.pose[3], 2);
    sum[1] += pow(a.pose[7] - b.pose[7], 2);
    sum[2] += pow(asin(b.pose[4] * a.pose[0] - b.pose[0] * a.pose[4]), 2);
    count++;
  }
  assert_int_equal(count, 8 * FRAMES);
  assert_true(fabs(sqrt(sum[0] / count) - 0.3) < 0.12 && fabs(sqrt(sum[1] / count) - 0.3) < 0.12);
  assert_true(fabs(sqrt(sum[2] / count) * 57.29578 - 2.0) < 0.8);
  pags_json_destroy(noisy);
  pags_json_destroy(exact);
  pags_json_destroy(plain);
}

/* The dataset reader opens the street for training. */
static void test_reads_back(void **state) {
  (void)state;
  const int provided = PAGS_PROVIDES_BOXES | PAGS_PROVIDES_LIDAR | PAGS_PROVIDES_SKY_MASKS | PAGS_PROVIDES_SEMANTIC |
                       PAGS_PROVIDES_DYNAMIC_MASKS;
  const pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *dataset = NULL;
  int moving = 0, held_out = 0;
  if (pags_dataset_open(scratch("street"), &options, &dataset) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  assert_int_equal(pags_dataset_provides(dataset), provided);
  assert_int_equal(pags_dataset_view_count(dataset), FRAMES * CAMERAS);
  assert_int_equal(pags_dataset_sweep_count(dataset), FRAMES);
  assert_true(pags_dataset_up(dataset) == PAGS_UP_Z && pags_dataset_fps(dataset) == 10.0);
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    const pags_camera camera = read_camera("street", view->frame, view->sensor);
    for (int k = 0; k < 12; k++)
      assert_true(fabs(view->camera.world_from_camera[k] - camera.world_from_camera[k]) < 1e-9);
    assert_true(fabs(view->camera.cx - camera.cx) < 1e-9 && fabs(view->camera.time - view->frame / 10.0) < 1e-9);
    held_out += view->test;
  }
  assert_int_equal(held_out, CAMERAS); /* both views of frame 4 */
  for (int64_t i = 0; i < pags_dataset_object_count(dataset); i++) {
    const pags_object *object = pags_dataset_object(dataset, i);
    moving += object->moving;
    assert_true(object->category != PAGS_CATEGORY_OTHER);
    if (object->category == PAGS_CATEGORY_VEHICLE)
      assert_true(object->size[0] > 4.0 && object->size[1] < 2.3); /* x is the forward axis */
    if (object->moving)
      assert_true(strncmp(object->id, "moving", 6) == 0);
  }
  /* Within half a second some objects don't move far enough to count as moving. */
  assert_true(moving >= 4 && moving <= 8);
  pags_dataset_close(dataset);
}

static int stop_at_once(void *user, double fraction, const char *what) {
  (void)fraction;
  (void)what;
  return --*(int *)user > 0;
}

static void test_refusals(void **state) {
  (void)state;
  pags_street_options options = small_street();
  pags_tasks *tasks = pags_tasks_create(1);
  /* Refused, as the folder isn't empty. */
  assert_int_equal(pags_synth_street(scratch("street"), &options, tasks, NULL, NULL), PAGS_ERROR_IO);
  options.frames = 1;
  assert_int_equal(pags_synth_street(scratch("bad"), &options, tasks, NULL, NULL), PAGS_ERROR_ARGUMENT);
  options = small_street();
  options.pose_noise = (double)NAN;
  assert_int_equal(pags_synth_street(scratch("bad"), &options, tasks, NULL, NULL), PAGS_ERROR_ARGUMENT);
  assert_false(pags_path_exists(scratch("bad")));
  options = small_street();
  int left = 2;
  assert_int_equal(pags_synth_street(scratch("stopped"), &options, tasks, stop_at_once, &left), PAGS_CANCELLED);
  assert_true(pags_file_exists(file_of("stopped", "images/000_0.png")));
  assert_false(pags_path_exists(file_of("stopped", "dataset.json")));
  options.overwrite = 1;
  options.objects = 0;
  options.frames = 2;
  assert_int_equal(pags_synth_street(scratch("stopped"), &options, tasks, NULL, NULL), PAGS_OK);
  assert_true(pags_file_exists(file_of("stopped", "dataset.json")));
  pags_tasks_destroy(tasks);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_files),           cmocka_unit_test(test_threads),
                                     cmocka_unit_test(test_lidar),           cmocka_unit_test(test_nearest_surfaces),
                                     cmocka_unit_test(test_masks_and_boxes), cmocka_unit_test(test_noise),
                                     cmocka_unit_test(test_reads_back),      cmocka_unit_test(test_refusals)};
  return cmocka_run_group_tests(tests, make_sets, scratch_teardown);
}
