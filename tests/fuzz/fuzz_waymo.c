/* Damaged Waymo segments: whatever is done to them, importing returns, and either gives a data set or a message that names the
 * file and the record. Run it in the asan-ubsan preset to see more than crashes. The damage is pseudo-random with a fixed seed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include "base/rng.h"
#include "import/tfrecord.h"
#include "import/waymo_lidar.h"
#include "import/waymo_message.h"
#include "import/waymo_tracks.h"
#include "pags/dataset.h"
#include "pags/image.h"
#include "pags/import.h"
#include "raw_waymo.h"
#include "scratch_folder.h"
#include "shared_data.h"

#include <cmocka.h>

enum { WIDTH = 24, HEIGHT = 16, IMPORTS = 120, FLIPS = 400, CUTS = 100 };

static raw_waymo memory;
static pags_tasks *tasks;
static int accepted, refused;

static uint64_t draw(uint64_t stream, uint64_t index, uint64_t below) {
  return pags_rng_below(2026, stream, index, below);
}

static void must(pags_result result) {
  if (result != PAGS_OK)
    fail_msg("%s", pags_error_message());
}

/* ---- A frame of a few kilobytes with a bit of everything ---- */

static ProtobufCBinaryData picture(const char *name, pags_sample sample, int channels) {
  pags_image image;
  uint8_t *bytes;
  size_t size;
  must(pags_image_create(&image, WIDTH, HEIGHT, channels, sample));
  for (size_t i = 0; sample == PAGS_U16 && i < (size_t)WIDTH * HEIGHT; i++)
    ((uint16_t *)image.data)[i] = (uint16_t)(1000 * (i % 29) + i % 3);
  must(pags_image_save(scratch(name), &image));
  must(pags_file_read(scratch(name), &bytes, &size));
  uint8_t *copy = raw_waymo_alloc(&memory, size, 1);
  memcpy(copy, bytes, size);
  free(bytes);
  pags_image_destroy(&image);
  return (ProtobufCBinaryData){.len = size, .data = copy};
}

static const double still[12] = {1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3};

static Pags__Waymo__CameraCalibration *calibration(int name) {
  static double intrinsic[9] = {20, 20, 12, 8, -0.1, 0.01, 0.001, 0.001, 0};
  Pags__Waymo__CameraCalibration *c = raw_waymo_alloc(&memory, 1, sizeof *c);
  pags__waymo__camera_calibration__init(c);
  c->has_name = c->has_width = c->has_height = c->has_rolling_shutter_direction = 1;
  c->name = name;
  c->width = WIDTH;
  c->height = HEIGHT;
  c->rolling_shutter_direction = 2;
  c->n_intrinsic = 9;
  c->intrinsic = intrinsic;
  c->extrinsic = raw_transform(&memory, still);
  return c;
}

static Pags__Waymo__CameraImage *photograph(int name) {
  Pags__Waymo__CameraImage *m = raw_waymo_alloc(&memory, 1, sizeof *m);
  Pags__Waymo__CameraSegmentationLabel *label = raw_waymo_alloc(&memory, 1, sizeof *label);
  Pags__Waymo__Velocity *v = raw_waymo_alloc(&memory, 1, sizeof *v);
  pags__waymo__camera_image__init(m);
  pags__waymo__camera_segmentation_label__init(label);
  pags__waymo__velocity__init(v);
  m->has_name = m->has_image = m->has_pose_timestamp = m->has_shutter = 1;
  m->has_camera_trigger_time = m->has_camera_readout_done_time = v->has_v_x = v->has_w_z = 1;
  m->name = name;
  m->image = picture("a.jpg", PAGS_U8, 3);
  m->pose = raw_transform(&memory, still);
  m->pose_timestamp = 10;
  m->camera_trigger_time = 9.99;
  m->camera_readout_done_time = 10.02;
  m->velocity = v;
  v->v_x = 3;
  m->camera_segmentation_label = label;
  label->has_panoptic_label_divisor = label->has_panoptic_label = 1;
  label->panoptic_label_divisor = 1000;
  label->panoptic_label = picture("a.png", PAGS_U16, 1);
  return m;
}

static Pags__Waymo__Label *label(int i) {
  char id[8];
  Pags__Waymo__Label *l = raw_waymo_alloc(&memory, 1, sizeof *l);
  Pags__Waymo__Box *b = raw_waymo_alloc(&memory, 1, sizeof *b);
  pags__waymo__label__init(l);
  pags__waymo__box__init(b);
  snprintf(id, sizeof id, "id%d", i);
  l->box = b;
  l->id = raw_waymo_text(&memory, id);
  l->has_type = b->has_center_x = b->has_center_y = b->has_center_z = 1;
  b->has_length = b->has_width = b->has_height = b->has_heading = 1;
  l->type = i % 5;
  b->center_x = 5 * i;
  b->length = b->width = b->height = 2;
  b->heading = i;
  return l;
}

static float three_metres(void *user, const double origin[3], const double direction[3], int which) {
  (void)user;
  (void)origin;
  (void)direction;
  return (float)(3 + which);
}

static void stand(void *user, int column, float out[6]) {
  (void)user;
  memset(out, 0, 6 * sizeof *out);
  out[3] = (float)column;
}

static Pags__Waymo__Frame *small_frame(void) {
  static const double beams[4] = {-0.2, -0.1, 0, 0.1};
  raw_laser laser = {.name = 1, .rows = 4, .columns = 9, .inclinations = beams, .range = three_metres, .pose = stand};
  memcpy(laser.vehicle_from_laser, still, sizeof still);
  Pags__Waymo__Frame *f = raw_waymo_alloc(&memory, 1, sizeof *f);
  pags__waymo__frame__init(f);
  f->context = raw_waymo_alloc(&memory, 1, sizeof *f->context);
  pags__waymo__context__init(f->context);
  f->context->name = raw_waymo_text(&memory, "small");
  f->has_timestamp_micros = 1;
  f->timestamp_micros = 10000000;
  f->pose = raw_transform(&memory, still);
  f->context->camera_calibrations = raw_waymo_alloc(&memory, 2, sizeof *f->context->camera_calibrations);
  f->context->laser_calibrations = raw_waymo_alloc(&memory, 1, sizeof *f->context->laser_calibrations);
  f->images = raw_waymo_alloc(&memory, 2, sizeof *f->images);
  f->lasers = raw_waymo_alloc(&memory, 1, sizeof *f->lasers);
  f->laser_labels = raw_waymo_alloc(&memory, 5, sizeof *f->laser_labels);
  for (int c = 0; c < 2; c++) {
    f->context->camera_calibrations[f->context->n_camera_calibrations++] = calibration(c + 1);
    f->images[f->n_images++] = photograph(c + 1);
  }
  for (int i = 0; i < 5; i++)
    f->laser_labels[f->n_laser_labels++] = label(i);
  raw_laser_add(&memory, f, &laser);
  return f;
}

/* ---- What is done to it ---- */

static void try_import(const char *path, int expect_refusal) {
  pags_import_options options = pags_import_options_default();
  options.cameras = "0,1";
  char folder[SCRATCH_PATH]; /* scratch's own paths are overwritten by those of pictures */
  snprintf(folder, sizeof folder, "%.400s/out", scratch_folder);
  const pags_result result = pags_import_waymo(path, folder, &options, tasks, NULL, NULL);
  if (result != PAGS_OK) {
    const char *message = pags_error_message();
    if (!strstr(message, pags_path_name(path)) && !strstr(message, "out/"))
      fail_msg("the message names no file: %s", message);
    refused++;
  } else {
    assert_false(expect_refusal);
    pags_dataset *dataset;
    pags_dataset_options reading = pags_dataset_options_default();
    if (pags_dataset_open(folder, &reading, &dataset) == PAGS_OK)
      pags_dataset_close(dataset);
    accepted++;
  }
  must(pags_remove_tree(folder));
}

static void write_record(const char *path, const uint8_t *bytes, size_t size) {
  FILE *stream = fopen(path, "wb");
  assert_non_null(stream);
  raw_record_write(stream, bytes, size);
  assert_int_equal(fclose(stream), 0);
}

/* Messages that the CRCs vouch for. */
static void test_damaged_messages(void **state) {
  (void)state;
  size_t size;
  const uint8_t *bytes = raw_frame_pack(&memory, small_frame(), &size);
  uint8_t *copy = raw_waymo_alloc(&memory, size, 1);
  char path[SCRATCH_PATH];
  snprintf(path, sizeof path, "%.400s/segment.tfrecord", scratch_folder);
  write_record(path, bytes, size);
  try_import(path, 0);
  assert_int_equal(accepted, 1);
  for (uint64_t i = 0; i < IMPORTS; i++) {
    memcpy(copy, bytes, size);
    for (uint64_t k = 0; k <= draw(1, 16 * i, 4); k++)
      copy[draw(2, 16 * i + k, size)] = (uint8_t)draw(3, 16 * i + k, 256);
    write_record(path, copy, i % 8 ? size : draw(4, i, size));
    try_import(path, 0);
  }
  assert_true(accepted > IMPORTS / 20 && refused > IMPORTS / 20);
}

/* Any changed byte of the file is found out. */
static void test_damaged_files(void **state) {
  (void)state;
  size_t size;
  uint8_t *file;
  const uint8_t *bytes = raw_frame_pack(&memory, small_frame(), &size);
  write_record(scratch("whole"), bytes, size);
  must(pags_file_read(scratch("whole"), &file, &size));
  for (uint64_t i = 0; i < IMPORTS; i++) {
    const size_t place = i % 2 ? draw(5, i, size) : draw(5, i, 12);
    const uint8_t before = file[place];
    file[place] ^= (uint8_t)(1 + draw(6, i, 255));
    try_import(scratch_file("flipped", file, size), 1);
    file[place] = before;
    try_import(scratch_file("cut", file, draw(7, i, size)), 1);
  }
  free(file);
}

/* All that is made of a message in memory. */
static void decode(const uint8_t *bytes, size_t size) {
  pags_waymo_frame *frame;
  if (pags_waymo_unpack_frame(bytes, size, "real", &frame) != PAGS_OK) {
    refused++;
    return;
  }
  accepted++;
  double pose[12];
  pags_waymo_points points = {0};
  pags_waymo_boxes boxes = {0};
  pags_layout_track *tracks = NULL;
  int64_t count = 0;
  pags_waymo_lidar_points(frame, "real", &points);
  for (int64_t i = 0; i < 4 * points.count; i++)
    assert_true(isfinite(points.rows[i]));
  if (pags_waymo_transform(frame->pose, "real", "pose", pose) == PAGS_OK &&
      pags_waymo_boxes_add(&boxes, frame, 0, 0, pose, "real") == PAGS_OK)
    pags_waymo_boxes_tracks(&boxes, "real", &tracks, &count);
  for (int64_t i = 0; i < count; i++)
    pags_layout_track_destroy(&tracks[i]);
  free(tracks);
  pags_waymo_boxes_destroy(&boxes);
  pags_waymo_points_destroy(&points);
  pags_waymo_free_frame(frame);
}

/* The photographs are 91 % of the real frame: two thirds of the damage go where the rest is, before and behind them. */
static void test_damage_of_the_real_frame(void **state) {
  (void)state;
  char path[512];
  if (!pags_shared_data("waymo/pvps_data_one_frame.tfrecord", path, sizeof path))
    skip();
  pags_tfrecord *reader;
  pags_tfrecord_item item;
  must(pags_tfrecord_open(path, &reader));
  must(pags_tfrecord_next(reader, &item));
  uint8_t *copy = malloc(item.size);
  assert_non_null(copy);
  memcpy(copy, item.data, item.size);
  accepted = refused = 0;
  for (uint64_t i = 0; i < FLIPS; i++) {
    const size_t end = i % 3 == 0 ? 2900 : item.size, begin = i % 3 == 1 ? item.size - 40000 : 0;
    size_t places[4];
    for (uint64_t k = 0; k < 4; k++) {
      places[k] = begin + draw(8, 4 * i + k, end - begin);
      copy[places[k]] = (uint8_t)draw(9, 4 * i + k, 256);
    }
    decode(copy, item.size);
    for (int k = 0; k < 4; k++)
      copy[places[k]] = item.data[places[k]];
  }
  assert_true(accepted > FLIPS / 20 && refused > FLIPS / 20);
  for (uint64_t i = 0; i < CUTS; i++)
    decode(item.data, draw(10, i, item.size));
  free(copy);
  pags_tfrecord_close(reader);
}

static int tear_down(void **state) {
  (void)state;
  raw_waymo_free(&memory);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_teardown(test_damaged_messages, tear_down),
      cmocka_unit_test_teardown(test_damaged_files, tear_down),
      cmocka_unit_test_teardown(test_damage_of_the_real_frame, tear_down),
  };
  if (access("/dev/shm", W_OK) == 0) /* thousands of small files, each synced */
    setenv("TMPDIR", "/dev/shm", 0);
  if (scratch_make() != 0 || !(tasks = pags_tasks_create(1)))
    return 1;
  const int failed = cmocka_run_group_tests(tests, NULL, NULL);
  pags_tasks_destroy(tasks);
  return scratch_remove() != 0 || failed;
}
