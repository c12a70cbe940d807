/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the import of Waymo segments: the real frame of the shared test data, and a synthetic segment that gives the
 * same data set again. */
#include "unit/scratch.h"

#include <math.h>

#include <pags/dataset.h>
#include <pags/import.h>
#include "base/bytes.h"
#include "base/json.h"
#include "import/tfrecord.h"
#include "import/waymo_masks.h"
#include "import/waymo_message.h"
#include "raw_waymo.h"
#include "same_file.h"
#include "scene/lens.h"
#include "shared_data.h"
#include "unit/waymo_check.h"
#include "unit/waymo_set.h"

static scratch s;
static pags_tasks *tasks;

/* A path in the scratch folder; valid until eight more calls. */
static const char *at(const char *format, ...) __attribute__((format(printf, 1, 2)));
static const char *at(const char *format, ...) {
  static char paths[8][512];
  static int next;
  char *path = paths[next++ % 8];
  va_list arguments;
  va_start(arguments, format);
  const int used = snprintf(path, sizeof paths[0], "%s/", s.folder);
  vsnprintf(path + used, sizeof paths[0] - (size_t)used, format, arguments);
  va_end(arguments);
  return path;
}

static pags_result import_to(const char *source, const char *folder, const char *cameras) {
  pags_import_options options = pags_import_options_default();
  options.cameras = cameras;
  return pags_import_waymo(source, folder, &options, tasks, NULL, NULL);
}

typedef struct bytes {
  uint8_t *data;
  size_t size;
} bytes;

static bytes read_bytes(const char *path) {
  bytes b;
  scratch_ok(pags_file_read(path, &b.data, &b.size));
  return b;
}

static void read_matrix(const char *path, double out[16]) {
  FILE *stream = fopen(path, "r");
  assert_non_null(stream);
  for (int i = 0; i < 16; i++)
    assert_int_equal(fscanf(stream, "%lf", &out[i]), 1);
  fclose(stream);
}

/* ---- The real frame ---- */

typedef struct real {
  char path[512];
  pags_tfrecord *reader;
  pags_tfrecord_item item;
  pags_waymo_frame *frame;
} real;

static int open_real(real *r) {
  if (!pags_shared_data("waymo/pvps_data_one_frame.tfrecord", r->path, sizeof r->path))
    return 0;
  scratch_ok(pags_tfrecord_open(r->path, &r->reader));
  scratch_ok(pags_tfrecord_next(r->reader, &r->item));
  scratch_ok(pags_waymo_unpack_frame(r->item.data, r->item.size, "real", &r->frame));
  return 1;
}

static void close_real(real *r) {
  pags_waymo_free_frame(r->frame);
  pags_tfrecord_close(r->reader);
}

static void check_real_images(const real *r, const char *folder) {
  /* Sizes of the JPEGs in the record, by camera number. */
  static const size_t sizes[5] = {446413, 545376, 460925, 248605, 275682};
  for (int c = 0; c < 5; c++) {
    const Pags__Waymo__CameraImage *image = pags_waymo_image(r->frame, c + 1);
    const bytes b = read_bytes(at("%s/images/000_%d.jpg", folder, c));
    int width, height;
    assert_int_equal(b.size, sizes[c]);
    assert_int_equal(image->image.len, sizes[c]);
    assert_memory_equal(b.data, image->image.data, b.size);
    scratch_ok(pags_image_size(at("%s/images/000_%d.jpg", folder, c), &width, &height));
    assert_int_equal(width, 1920);
    assert_int_equal(height, c < 3 ? 1280 : 886);
    free(b.data);
  }
}

/* The columns of C.txt are OpenCV's x, y, z axes (right, down, forward) in the vehicle's frame. */
static void check_real_calibration(const real *r, const char *folder) {
  static const double headings[5] = {0, 45, -45, 90, -90}; /* degrees to the left of the vehicle's x axis */
  for (int c = 0; c < 5; c++) {
    const Pags__Waymo__CameraCalibration *k = pags_waymo_camera(r->frame, c + 1);
    const double *e = k->extrinsic->transform;
    double m[16], heading = headings[c] * 3.14159265358979 / 180, number;
    read_matrix(at("%s/extrinsics/%d.txt", folder, c), m);
    for (int row = 0; row < 3; row++) {
      assert_true(m[4 * row] == -e[4 * row + 1] && m[4 * row + 1] == -e[4 * row + 2] && m[4 * row + 2] == e[4 * row] &&
                  m[4 * row + 3] == e[4 * row + 3]);
    }
    assert_true(m[2] * cos(heading) + m[6] * sin(heading) > 0.99);
    assert_true(m[9] < -0.99); /* the camera's y axis points down */
    FILE *stream = fopen(at("%s/intrinsics/%d.txt", folder, c), "r");
    assert_non_null(stream);
    for (int i = 0; i < 9; i++) {
      assert_int_equal(fscanf(stream, "%lf", &number), 1);
      assert_true(number == k->intrinsic[i]);
    }
    fclose(stream);
  }
}

static void check_real_poses(const real *r, const char *folder) {
  double ego[16], extrinsics[16], camera[16], expected[12];
  read_matrix(at("%s/ego_pose/000.txt", folder), ego);
  for (int i = 0; i < 16; i++)
    assert_true(ego[i] == r->frame->pose->transform[i]);
  assert_true(fabs(ego[3] + 25211.26) < 0.01 && fabs(ego[7] - 42391.08) < 0.01 && fabs(ego[11] + 160.62) < 0.01);
  /* The ego vehicle stands still: the poses of photographs differ from its pose by at most 0.1 mm and 1e-4 rad. */
  for (int c = 0; c < 5; c++) {
    read_matrix(at("%s/extrinsics/%d.txt", folder, c), extrinsics);
    read_matrix(at("%s/extrinsics/000_%d.txt", folder, c), camera);
    pags_rigid_multiply(ego, extrinsics, expected);
    for (int i = 0; i < 12; i++)
      assert_true(fabs(camera[i] - expected[i]) < 5e-4);
  }
}

static void check_real_boxes(const char *folder) {
  static const struct {
    const char *name;
    int count;
  } classes[] = {{"Vehicle", 37}, {"Pedestrian", 12}, {"Sign", 25}, {"Cyclist", 1}};
  pags_json *json;
  scratch_ok(pags_json_parse_file(at("%s/instances/instances_info.json", folder), &json));
  const pags_json_value *root = pags_json_root(json);
  assert_int_equal(root->count, 75);
  for (int i = 0; i < 4; i++) {
    int count = 0;
    for (const pags_json_value *v = root->first; v; v = v->next)
      count += strcmp(pags_json_member(v, "class_name")->text, classes[i].name) == 0;
    assert_int_equal(count, classes[i].count);
  }
  pags_json_destroy(json);
}

/* Box -zRacoa4APhIbgKYpgbiDQ: a pedestrian 10.23 m ahead and 1.98 m to the left, who walks to the left. */
static void check_a_real_box(const char *folder) {
  pags_dataset *dataset;
  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 0;
  scratch_ok(pags_dataset_open(at("%s", folder), &options, &dataset));
  assert_int_equal(pags_dataset_view_count(dataset), 5);
  assert_int_equal(pags_dataset_object_count(dataset), 75);
  assert_int_equal(pags_dataset_provides(dataset) & PAGS_PROVIDES_LIDAR, 0);
  assert_int_not_equal(pags_dataset_provides(dataset) & PAGS_PROVIDES_SEMANTIC, 0);
  const pags_object *found = NULL;
  for (int64_t i = 0; i < pags_dataset_object_count(dataset); i++)
    if (strcmp(pags_dataset_object(dataset, i)->id, "-zRacoa4APhIbgKYpgbiDQ") == 0)
      found = pags_dataset_object(dataset, i);
  assert_non_null(found);
  assert_int_equal(found->category, PAGS_CATEGORY_PEDESTRIAN);
  double ego[16], back[12], local[12];
  read_matrix(at("%s/ego_pose/000.txt", folder), ego);
  pags_rigid_inverse(ego, back);
  pags_rigid_multiply(back, found->keyframes[0].world_from_object, local);
  assert_true(fabs(local[3] - 10.23) < 0.005 && fabs(local[7] - 1.98) < 0.005 && fabs(local[11] - 0.83) < 0.005);
  assert_true(fabs(atan2(local[4], local[0]) - 1.55) < 0.005);
  assert_true(fabs(found->size[0] - 1.03) < 0.005 && fabs(found->size[1] - 0.87) < 0.005 &&
              fabs(found->size[2] - 1.59) < 0.005);
  pags_dataset_close(dataset);
}

static void check_real_masks(const char *folder) {
  pags_image panoptic, semantic, sky;
  scratch_ok(pags_image_load(at("%s/panoptic/000_0.png", folder), PAGS_U16, 1, &panoptic));
  scratch_ok(pags_image_load(at("%s/semantic/000_0.png", folder), PAGS_U8, 1, &semantic));
  scratch_ok(pags_image_load(at("%s/sky_masks/000_0.png", folder), PAGS_U8, 1, &sky));
  assert_int_equal(semantic.width, 1920);
  assert_int_equal(semantic.height, 1280);
  int64_t seen[256] = {0};
  for (size_t i = 0; i < (size_t)1920 * 1280; i++) {
    const uint8_t id = ((uint8_t *)semantic.data)[i];
    seen[id]++;
    assert_int_equal(id, pags_waymo_train_id(((uint16_t *)panoptic.data)[i] / 1000));
    assert_int_equal(((uint8_t *)sky.data)[i], id == 10 ? 255 : 0);
  }
  assert_true(seen[0] > 500000 && seen[10] > 400000 && seen[11] > 10000 && seen[13] > 1000);
  pags_image_destroy(&panoptic);
  pags_image_destroy(&semantic);
  pags_image_destroy(&sky);
}

static void test_imports_the_real_frame(void **state) {
  (void)state;
  real r;
  if (!open_real(&r))
    skip();
  scratch_ok(import_to(r.path, at("real"), "0,1,2,3,4"));
  check_real_images(&r, "real");
  check_real_calibration(&r, "real");
  check_real_poses(&r, "real");
  check_real_boxes("real");
  check_a_real_box("real");
  check_real_masks("real");
  assert_false(pags_path_exists(at("real/lidar")));
  scratch_ok(import_to(r.path, at("usual"), NULL));
  assert_true(pags_file_exists(at("usual/images/000_2.jpg")));
  assert_false(pags_path_exists(at("usual/images/000_3.jpg")));
  close_real(&r);
}

/* Imports the file with one byte changed, or cut at that byte, and expects an error. */
static void expect_damage(const bytes *file, size_t place, int cut, const char *part) {
  bytes copy = {.data = malloc(file->size), .size = cut ? place : file->size};
  assert_non_null(copy.data);
  memcpy(copy.data, file->data, file->size);
  if (!cut)
    copy.data[place] ^= 0x40;
  scratch_ok(pags_file_write(at("damaged"), copy.data, copy.size));
  scratch_expect(import_to(at("damaged"), at("from_damaged"), "0"), PAGS_ERROR_FORMAT, part);
  assert_false(pags_path_exists(at("from_damaged/dataset.json")));
  free(copy.data);
}

static void test_refuses_damage_of_the_real_frame(void **state) {
  (void)state;
  real r;
  if (!open_real(&r))
    skip();
  const bytes file = read_bytes(r.path);
  assert_int_equal(file.size, 2168774);
  expect_damage(&file, 0, 0, "damaged: record 0 at byte 0: the CRC of its length");
  expect_damage(&file, 7, 0, "damaged: record 0 at byte 0: the CRC of its length");
  expect_damage(&file, 9, 0, "damaged: record 0 at byte 0: the CRC of its length");
  expect_damage(&file, 1000000, 0, "damaged: record 0 at byte 0: the CRC of its data");
  expect_damage(&file, file.size - 2, 0, "damaged: record 0 at byte 0: the CRC of its data");
  expect_damage(&file, 5, 1, "damaged: record 0 at byte 0: the file ends");
  expect_damage(&file, file.size - 1, 1, "damaged: record 0 at byte 0: 2168758 bytes of data");
  expect_damage(&file, 0, 1, "no record");
  free(file.data);
  close_real(&r);
}

/* ---- A synthetic segment ---- */

/* The centre of the moving car lies inside the masks "all" and "vehicle" in every picture that shows it; the
 * picture's corner doesn't. Parked cars are in no dynamic mask. */
static void check_dynamic_masks(const pags_dataset *set, const char *folder) {
  int seen = 0;
  for (int t = 0; t < FRAMES; t++)
    for (int c = 0; c < CAMERAS; c++) {
      double camera[12], back[12], p[12], u, v;
      pags_lens lens = {.model.kind = PAGS_LENS_PERSPECTIVE,
                        .width = WIDTH,
                        .height = HEIGHT,
                        .fx = 70.1,
                        .fy = 70.3,
                        .cx = 48.7,
                        .cy = 31.9,
                        .model.k = {c == 2 ? -0.1 : 0, c == 2 ? -0.02 : 0}};
      scratch_ok(pags_lens_prepare(&lens, "test"));
      for (int64_t i = 0; i < TRACKS; i++) {
        const pags_object *o = pags_dataset_object(set, i);
        const pags_keyframe *k = o->keyframes;
        while (k < o->keyframes + o->keyframe_count && k->frame != t)
          k++;
        if (k == o->keyframes + o->keyframe_count || strcmp(o->class_name, "Vehicle") != 0)
          continue;
        double ego[12], on[12];
        waymo_set_ego(t, ego);
        waymo_set_camera(c, on);
        pags_rigid_multiply(ego, on, camera);
        pags_rigid_inverse(camera, back);
        pags_rigid_multiply(back, k->world_from_object, p);
        if (p[11] < 1 || !pags_lens_project(&lens, p[3] / p[11], p[7] / p[11], &u, &v) || u < 0 || v < 0 ||
            u >= WIDTH || v >= HEIGHT)
          continue;
        pags_image mask;
        scratch_ok(pags_image_load(at("%s/dynamic_masks/vehicle/%03d_%d.png", folder, t, c), PAGS_U8, 1, &mask));
        assert_int_equal(((uint8_t *)mask.data)[(int)v * WIDTH + (int)u], o->moving ? 255 : 0);
        pags_image_destroy(&mask);
        seen++;
      }
    }
  assert_true(seen >= FRAMES);
}

static void test_a_written_segment_reads_back_the_same(void **state) {
  (void)state;
  pags_dataset *a, *b;
  waymo_set_make(at("set"));
  raw_waymo_write(at("set"), at("segment.tfrecord"));
  scratch_ok(import_to(at("segment.tfrecord"), at("again"), "0,1,2"));
  for (int t = 0; t < FRAMES; t++) {
    assert_same_file(at("set/ego_pose/%03d.txt", t), at("again/ego_pose/%03d.txt", t));
    for (int c = 0; c < CAMERAS; c++) {
      assert_same_file(at("set/images/%03d_%d.jpg", t, c), at("again/images/%03d_%d.jpg", t, c));
      if ((t + c) % 2 == 0)
        assert_same_file(at("set/semantic/%03d_%d.png", t, c), at("again/semantic/%03d_%d.png", t, c));
      else
        assert_false(pags_path_exists(at("again/semantic/%03d_%d.png", t, c)));
    }
  }
  for (int c = 0; c < CAMERAS; c++) {
    assert_same_file(at("set/extrinsics/%d.txt", c), at("again/extrinsics/%d.txt", c));
    assert_same_file(at("set/intrinsics/%d.txt", c), at("again/intrinsics/%d.txt", c));
  }
  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 0;
  scratch_ok(pags_dataset_open(at("set"), &options, &a));
  scratch_ok(pags_dataset_open(at("again"), &options, &b));
  assert_int_equal(pags_dataset_view_count(b), FRAMES * CAMERAS);
  assert_int_equal(pags_dataset_object_count(b), TRACKS);
  assert_string_equal(pags_dataset_object(b, 3)->class_name, "Sign");
  check_same_views(a, b, 1e-9, 1e-12);
  check_same_objects(a, b, 1e-9, 1e-9);
  check_dynamic_masks(b, "again");
  assert_int_equal(pags_dataset_sweep_count(b), FRAMES);
  for (int64_t t = 0; t < FRAMES; t++)
    check_same_points(a, b, t, 0.95, 0.006); /* poses are float32, 42 km from the origin */
  assert_true(pags_dataset_fps(b) == 10);
  pags_dataset_close(a);
  pags_dataset_close(b);
}

/* ---- Stopping and resuming; options ---- */

static void assert_same_tree(const char *a, const char *b) {
  pags_dir_list left, right;
  scratch_ok(pags_dir_list_read(a, &left));
  scratch_ok(pags_dir_list_read(b, &right));
  assert_int_equal(left.count, right.count);
  for (int64_t i = 0; i < left.count; i++) {
    char *p = pags_path_join(a, left.names[i]), *q = pags_path_join(b, right.names[i]);
    assert_string_equal(left.names[i], right.names[i]);
    if (pags_dir_exists(p))
      assert_same_tree(p, q);
    else
      assert_same_file(p, q);
    free(p);
    free(q);
  }
  pags_dir_list_destroy(&left);
  pags_dir_list_destroy(&right);
}

static int stop_after(void *user, double fraction, const char *what) {
  int *left = user;
  assert_true(fraction >= 0 && fraction <= 1 && what);
  return (*left)-- > 0;
}

static void test_goes_on_where_it_was_stopped(void **state) {
  (void)state;
  for (int calls = 0; calls < 8; calls++) {
    int left = calls;
    const char *folder = at("stopped_%d", calls);
    const pags_result result = pags_import_waymo(at("segment.tfrecord"), folder, NULL, tasks, stop_after, &left);
    if (result == PAGS_OK)
      break;
    scratch_expect(result, PAGS_CANCELLED, "cancelled");
    assert_false(pags_file_exists(at("stopped_%d/dataset.json", calls)));
    scratch_ok(import_to(at("segment.tfrecord"), folder, NULL));
    assert_same_tree(at("again"), folder);
  }
  /* A resumed import doesn't write finished files again. */
  int left = 3;
  scratch_expect(pags_import_waymo(at("segment.tfrecord"), at("kept"), NULL, tasks, stop_after, &left), PAGS_CANCELLED,
                 "cancelled");
  scratch_ok(pags_file_write(at("kept/images/001_1.jpg"), "kept", 4));
  scratch_ok(pags_file_write(at("kept/lidar/001.bin"), "kept", 4));
  scratch_ok(import_to(at("segment.tfrecord"), at("kept"), NULL));
  const bytes image = read_bytes(at("kept/images/001_1.jpg")), sweep = read_bytes(at("kept/lidar/001.bin"));
  assert_int_equal(image.size, 4);
  assert_int_equal(sweep.size, 4);
  free(image.data);
  free(sweep.data);
  /* A finished import isn't changed, and importing other cameras into its folder is refused. */
  scratch_ok(import_to(at("segment.tfrecord"), at("again"), NULL));
  scratch_expect(import_to(at("segment.tfrecord"), at("again"), "0"), PAGS_ERROR_IO, "again");
}

/* Compares the counts of read and left-out data in import.json. */
static void check_account(const char *folder, int64_t steps, int64_t photographs, const char *const left_out[2]) {
  pags_json *json;
  const pags_json_value *result, *rows;
  int64_t count;
  scratch_ok(pags_json_parse_file(at("%s/import.json", folder), &json));
  scratch_ok(pags_json_object(json, pags_json_root(json), "result", &result));
  scratch_ok(pags_json_integer(json, result, "steps", 0, 99, &count));
  assert_int_equal(count, steps);
  scratch_ok(pags_json_integer(json, result, "photographs", 0, 99, &count));
  assert_int_equal(count, photographs);
  scratch_ok(pags_json_array(json, result, "left_out", &rows));
  assert_int_equal(rows->count, 2);
  assert_string_equal(pags_json_member(rows->first, "why")->text, left_out[0]);
  assert_string_equal(pags_json_member(rows->first->next, "why")->text, left_out[1]);
  pags_json_destroy(json);
}

static void test_takes_the_frames_asked_for(void **state) {
  (void)state;
  pags_import_options options = pags_import_options_default();
  options.frame_first = 1;
  options.frame_last = 2;
  options.cameras = "2,0";
  scratch_ok(pags_import_waymo(at("segment.tfrecord"), at("part"), &options, tasks, NULL, NULL));
  assert_same_file(at("part/ego_pose/001.txt"), at("again/ego_pose/002.txt"));
  assert_same_file(at("part/images/000_2.jpg"), at("again/images/001_2.jpg"));
  assert_false(pags_path_exists(at("part/images/002_0.jpg")));
  assert_false(pags_path_exists(at("part/images/000_1.jpg")));
  check_account("part", 2, 4, (const char *const[2]){"--frames chose others", "--cameras takes them"});
  options.frame_first = 4;
  options.frame_last = -1;
  assert_int_equal(pags_import_waymo(at("segment.tfrecord"), at("none"), &options, tasks, NULL, NULL),
                   PAGS_ERROR_ARGUMENT);
  scratch_expect(import_to(at("segment.tfrecord"), at("none"), "0,4"), PAGS_ERROR_FORMAT,
                 "record 0 at byte 0: no calibration of camera 4 (side_right)");
  scratch_expect(import_to(at("segment.tfrecord"), at("none"), "0,7"), PAGS_ERROR_ARGUMENT, "cameras");
  assert_false(pags_path_exists(at("none")));
}

/* ---- Poses of photographs ---- */

/* A car turns at 20 m/s. The recorded pose is from 4 ms before the middle of the exposure, and the import moves it
 * on to the middle. */
static void test_moves_poses_on_to_the_exposure(void **state) {
  (void)state;
  raw_waymo w = {0};
  pags_tfrecord *reader;
  pags_tfrecord_item item;
  pags_waymo_frame *f;
  double ego[12], on[12], expected[12], moved[12], found[16];
  scratch_ok(pags_tfrecord_open(at("segment.tfrecord"), &reader));
  scratch_ok(pags_tfrecord_next(reader, &item));
  scratch_ok(pags_waymo_unpack_frame(item.data, item.size, "test", &f));
  Pags__Waymo__CameraImage *image = (Pags__Waymo__CameraImage *)pags_waymo_image(f, 1);
  Pags__Waymo__Velocity v = PAGS__WAYMO__VELOCITY__INIT;
  v.has_v_x = v.has_v_y = v.has_v_z = v.has_w_x = v.has_w_y = v.has_w_z = 1;
  v.v_x = 12;
  v.v_y = 16;
  v.w_z = 0.5;
  image->velocity = &v;
  image->camera_trigger_time = image->pose_timestamp - 0.016;
  image->camera_readout_done_time = image->pose_timestamp + 0.024;
  size_t size;
  const uint8_t *packed = raw_frame_pack(&w, f, &size);
  FILE *stream = fopen(at("moving.tfrecord"), "wb");
  raw_record_write(stream, packed, size);
  assert_int_equal(fclose(stream), 0);
  scratch_ok(import_to(at("moving.tfrecord"), at("moving"), "0"));
  waymo_set_ego(0, ego);
  const double turn = 0.5 * 0.004, turned[12] = {cos(turn), -sin(turn), 0, 0, sin(turn), cos(turn), 0, 0, 0, 0, 1, 0};
  const double place[3] = {ego[3] + 12 * 0.004, ego[7] + 16 * 0.004, ego[11]};
  pags_rigid_multiply(turned, ego, moved); /* rotated about the world's z axis, then moved to the car's position */
  for (int i = 0; i < 3; i++)
    moved[4 * i + 3] = place[i];
  waymo_set_camera(0, on);
  pags_rigid_multiply(moved, on, expected);
  read_matrix(at("moving/extrinsics/000_0.txt"), found);
  for (int i = 0; i < 12; i++)
    assert_true(fabs(found[i] - expected[i]) < 2e-5); /* Unix times in double have steps of 0.24 us */
  read_matrix(at("moving/ego_pose/000.txt"), found);
  assert_true(found[3] == ego[3]);
  image->velocity = NULL;
  pags_waymo_free_frame(f);
  pags_tfrecord_close(reader);
  raw_waymo_free(&w);
}

static int set_up(void **state) {
  (void)state;
  scratch_begin(&s);
  tasks = pags_tasks_create(2);
  return tasks ? 0 : -1;
}

static int tear_down(void **state) {
  (void)state;
  pags_tasks_destroy(tasks);
  scratch_end(&s);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_imports_the_real_frame),
      cmocka_unit_test(test_refuses_damage_of_the_real_frame),
      cmocka_unit_test(test_a_written_segment_reads_back_the_same), /* the tests below use its segment */
      cmocka_unit_test(test_goes_on_where_it_was_stopped),
      cmocka_unit_test(test_takes_the_frames_asked_for),
      cmocka_unit_test(test_moves_poses_on_to_the_exposure),
  };
  return cmocka_run_group_tests(tests, set_up, tear_down);
}
