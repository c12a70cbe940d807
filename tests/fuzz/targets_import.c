/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of the importers: KITTI's texts and tracklets, TFRecord files, Waymo's frames, range images and whole
 * segments. */
#include "fuzz/fuzz.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include <pags/dataset.h>
#include <pags/image.h>
#include <pags/import.h>

#include "base/bytes.h"
#include "base/file.h"
#include "import/kitti_files.h"
#include "import/tfrecord.h"
#include "import/waymo_lidar.h"
#include "import/waymo_message.h"
#include "import/waymo_tracks.h"
#include "raw_waymo.h"
#include "shared_data.h"

/* ---- KITTI's texts, separated by cut lines ---- */

static const char *const kitti_names[] = {"calib.txt",
                                          "day/calib_cam_to_cam.txt",
                                          "day/calib_velo_to_cam.txt",
                                          "day/calib_imu_to_velo.txt",
                                          "oxts.txt",
                                          "label.txt",
                                          "times.txt",
                                          "points.bin"};
enum { KITTI_FILES = sizeof kitti_names / sizeof *kitti_names };

static void check_calib(const pags_kitti_calib *calib) {
  for (int i = 0; i < 12; i++)
    FUZZ_CHECK(isfinite(calib->cam0_from_velo[i]));
  for (int c = 0; c < 4; c++) {
    double intrinsics[4], pose[12];
    if (pags_kitti_camera(calib, c, intrinsics, pose) == PAGS_OK)
      for (int i = 0; i < 12; i++)
        FUZZ_CHECK(isfinite(pose[i]) && isfinite(intrinsics[i % 4]));
  }
}

static pags_result read_calibs(const char *path, const char *day) {
  pags_kitti_calib calib;
  PAGS_TRY(pags_kitti_calib_read(path, &calib));
  check_calib(&calib);
  PAGS_TRY(pags_kitti_calib_read_raw(day, &calib));
  check_calib(&calib);
  return PAGS_OK;
}

static pags_result read_oxts(const char *path) {
  pags_kitti_table table;
  PAGS_TRY(pags_kitti_table_read(path, PAGS_KITTI_OXTS, &table));
  double pose[12];
  FUZZ_CHECK(table.rows > 0);
  for (int64_t i = 0; i < table.rows; i++)
    pags_kitti_oxts_pose(table.values + i * PAGS_KITTI_OXTS, pags_kitti_oxts_scale(table.values), pose);
  pags_kitti_table_destroy(&table);
  return PAGS_OK;
}

static pags_result read_labels(const char *path) {
  pags_kitti_labels labels;
  PAGS_TRY(pags_kitti_labels_read(path, true, &labels));
  for (int64_t i = 0; i < labels.count; i++) {
    double pose[12];
    if (pags_kitti_label_is_box(&labels.rows[i])) {
      pags_kitti_label_pose(&labels.rows[i], pose);
      FUZZ_CHECK(isfinite(pose[3]) && isfinite(pose[0]));
    }
  }
  pags_kitti_labels_destroy(&labels);
  return PAGS_OK;
}

static pags_result read_times(const char *path) {
  int64_t count;
  double *seconds;
  PAGS_TRY(pags_kitti_times_read(path, &count, &seconds));
  for (int64_t i = 0; i < count; i++)
    FUZZ_CHECK(!isinf(seconds[i])); /* a missing time is NaN */
  free(seconds);
  return PAGS_OK;
}

static pags_result read_points(const char *path) {
  int64_t count;
  float *rows;
  pags_kitti_form form;
  PAGS_TRY(pags_kitti_form_find(path, &form));
  PAGS_TRY(pags_kitti_points_read(path, &form, &count, &rows));
  /* Values aren't checked here: users of a sweep leave out points that aren't finite. */
  FUZZ_CHECK(count >= 0 && (count == 0 || rows));
  free(rows);
  return PAGS_OK;
}

static int read_part(pags_result result) {
  if (result != PAGS_OK)
    fuzz_refused(result, "/");
  return result == PAGS_OK;
}

static int run_kitti(const uint8_t *data, size_t size) {
  fuzz_part parts[KITTI_FILES];
  char paths[KITTI_FILES][1024], day[1024];
  fuzz_parts(data, size, KITTI_FILES, parts);
  for (int i = 0; i < KITTI_FILES; i++)
    snprintf(paths[i], sizeof paths[i], "%.900s", fuzz_file(kitti_names[i], parts[i].bytes, parts[i].size));
  fuzz_parts_free(KITTI_FILES, parts);
  snprintf(day, sizeof day, "%.900s/day", fuzz_folder());
  int accepted = read_part(read_calibs(paths[0], day));
  accepted &= read_part(read_oxts(paths[4]));
  accepted &= read_part(read_labels(paths[5]));
  accepted &= read_part(read_times(paths[6]));
  return accepted & read_part(read_points(paths[7]));
}

#define CALIB_ROWS "7.2e2 0 6.1e2 4.5e1 0 7.2e2 1.7e2 2.1e-1 0 0 1 2.7e-3\n"
#define TURN "0 -1 0 0 0 -1 1 0 0"

static void seed_kitti(void) {
  file_bytes out = {0};
  bytes_text(&out, "P0: " CALIB_ROWS "P1: " CALIB_ROWS "P2: " CALIB_ROWS "P3: " CALIB_ROWS);
  bytes_text(&out,
             "R_rect 1 0 0 0 1 0 0 0 1\nTr_velo_cam 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\nTr_imu_velo 1 0 0 -0.8 0 1 0 "
             "0.3 0 0 1 -0.8\n");
  bytes_text(
      &out, FUZZ_CUT
      "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.95e-02\nS_00: 1.4e3 5.1e2\nR_rect_00: 1 0 0 0 1 0 0 0 1\n");
  for (int c = 0; c < 4; c++)
    bytes_text(&out, "P_rect_%02d: " CALIB_ROWS, c);
  bytes_text(&out, FUZZ_CUT "calib_time: 15-Mar-2012 11:37:16\nR: " TURN "\nT: 0 -0.08 -0.27\ndelta_f: 0 0\n");
  bytes_text(&out, FUZZ_CUT "calib_time: 25-May-2012 16:47:16\nR: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n" FUZZ_CUT);
  for (int row = 0; row < 3; row++) {
    bytes_text(&out, "49.01150%d 8.4162%d 112.8", row, row);
    for (int k = 3; k < PAGS_KITTI_OXTS; k++)
      bytes_text(&out, " %g", k < 25 ? 0.01 * k : 4.0);
    bytes_text(&out, "\n");
  }
  bytes_text(&out, FUZZ_CUT
             "0 -1 DontCare -1 -1 -10 219.3 188.4 245.5 218.5 -1000 -1000 -1000 -10 -1 -1 -1\n"
             "0 2 Car 0 0 -1.7 296.7 161.7 455.2 292.3 2 1.8 4.4 -4.5 1.8 13.4 -2.1\n"
             "1 2 Car 0 0 -1.7 296.7 161.7 455.2 292.3 2 1.8 4.4 -4.5 1.8 12.4 -2.1\n");
  bytes_text(&out, FUZZ_CUT "2011-09-26 13:02:25.594360375\n2011-09-26 13:02:25.697987071\n" FUZZ_CUT);
  for (int i = 0; i < 8; i++)
    bytes_f32(&out, 0.25f * (float)i);
  fuzz_seed_bytes(out);
}

static const char *const kitti_words[] = {
    "P2: ",  "R_rect ", "R0_rect: ", "Tr_velo_to_cam: ", "Tr_imu_to_velo: ", "P_rect_02: ", "DontCare", "Pedestrian ",
    " nan ", " 1e308 ", " -1 ",      "2011-09-26 ",      "13:02:25.",        "\r\n",        NULL};
static const fuzz_target kitti = {
    .name = "kitti_text", .seeds = seed_kitti, .run = run_kitti, .words = kitti_words, .smoke = 5000};

/* ---- tracklet_labels.xml ---- */

static int run_tracklets(const uint8_t *data, size_t size) {
  pags_kitti_tracklets tracklets;
  const pags_result result = pags_kitti_tracklets_read(fuzz_file("tracklet_labels.xml", data, size), &tracklets);
  if (result != PAGS_OK) {
    fuzz_refused(result, "tracklet_labels.xml");
    return 0;
  }
  for (int64_t i = 0; i < tracklets.count; i++) {
    const pags_kitti_tracklet *const t = &tracklets.items[i];
    FUZZ_CHECK(t->count >= 0 && t->first_frame >= 0 && isfinite(t->height) && isfinite(t->length));
    for (int64_t k = 0; k < t->count; k++) {
      double pose[12];
      pags_kitti_tracklet_pose(t, k, pose);
      FUZZ_CHECK(isfinite(pose[0]) && isfinite(pose[11]));
    }
  }
  pags_kitti_tracklets_destroy(&tracklets);
  return 1;
}

static void seed_tracklets(void) {
  file_bytes out = {0};
  bytes_text(&out,
             "<?xml version=\"1.0\" encoding=\"UTF-8\" standalone=\"yes\" ?>\n<!DOCTYPE boost_serialization>\n"
             "<boost_serialization signature=\"serialization::archive\" version=\"9\">\n<tracklets class_id=\"0\" "
             "version=\"0\">\n"
             "<count>2</count>\n<item_version>1</item_version>\n");
  for (int i = 0; i < 2; i++) {
    bytes_text(&out,
               "<item class_id=\"1\" tracking_level=\"0\" "
               "version=\"1\">\n<objectType>%s</objectType>\n<h>1.5</h><w>1.7</w><l>4.2</l>\n"
               "<first_frame>%d</first_frame>\n<poses class_id=\"2\" "
               "version=\"0\">\n<count>2</count>\n<item_version>2</item_version>\n",
               i ? "Cyclist" : "Car", i);
    for (int k = 0; k < 2; k++)
      bytes_text(&out,
                 "<item><tx>%d.5</tx><ty>3</ty><tz>-1.7</tz><rx>0</rx><ry>0</ry><rz>%g</rz><state>2</state></item>\n",
                 4 + k, 0.25 * k);
    bytes_text(&out, "</poses>\n<finished>1</finished>\n</item>\n");
  }
  bytes_text(&out, "</tracklets>\n</boost_serialization>\n");
  fuzz_seed_bytes(out);
}

static const char *const xml_words[] = {"<item>",        "</item>",
                                        "<poses>",       "</poses>",
                                        "<tx>",          "</tx>",
                                        "<h>",           "<objectType>",
                                        "<first_frame>", "<!DOCTYPE a [<!ENTITY b \"c\">]>",
                                        "&b;",           "&#65;",
                                        "<![CDATA[",     "]]>",
                                        "<!--",          "-->",
                                        "<tracklets>",   NULL};
static const fuzz_target tracklets = {
    .name = "tracklets", .seeds = seed_tracklets, .run = run_tracklets, .words = xml_words};

/* ---- TFRecord ---- */

enum { RECORD_HEADER = 12, RECORD_FOOTER = 4 };

static int run_tfrecord(const uint8_t *data, size_t size) {
  pags_tfrecord *reader;
  pags_tfrecord_item item = {0};
  const char *const path = fuzz_file("a.tfrecord", data, size);
  int64_t records = 0;
  pags_result result = pags_tfrecord_open(path, &reader);
  FUZZ_CHECK(result == PAGS_OK);
  while ((result = pags_tfrecord_next(reader, &item)) == PAGS_OK && item.data) {
    FUZZ_CHECK(item.number == records++ && item.offset + RECORD_HEADER + item.size + RECORD_FOOTER <= size);
    FUZZ_CHECK(pags_tfrecord_fraction(reader) >= 0 && pags_tfrecord_fraction(reader) <= 1);
  }
  if (result != PAGS_OK)
    fuzz_refused(result, "a.tfrecord");
  pags_tfrecord_close(reader);
  int end = 0;
  FUZZ_CHECK(pags_tfrecord_open(path, &reader) == PAGS_OK);
  /* Every record that can be read can also be skipped. */
  for (int64_t i = 0; i < records && !end; i++)
    FUZZ_CHECK(pags_tfrecord_skip(reader, &end) == PAGS_OK && !end);
  pags_tfrecord_close(reader);
  return result == PAGS_OK;
}

static size_t mend_tfrecord(uint8_t *data, size_t size, size_t capacity) {
  (void)capacity;
  for (size_t at = 0; size - at >= RECORD_HEADER;) {
    const uint64_t length = pags_load_u64(data + at);
    pags_store_u32(data + at + 8, raw_masked_crc(data + at, 8));
    if (size - at < RECORD_HEADER + RECORD_FOOTER || length > size - at - RECORD_HEADER - RECORD_FOOTER)
      break;
    pags_store_u32(data + at + RECORD_HEADER + length, raw_masked_crc(data + at + RECORD_HEADER, (size_t)length));
    at += RECORD_HEADER + (size_t)length + RECORD_FOOTER;
  }
  return size;
}

static void put_record(file_bytes *out, const void *data, size_t size) {
  bytes_u64(out, size);
  bytes_u32(out, 0);
  bytes_put(out, data, size);
  bytes_u32(out, 0);
  mend_tfrecord(out->data, out->size, out->size);
}

static void seed_tfrecord(void) {
  static const size_t lengths[] = {5, 0, 300, 17};
  file_bytes out = {0};
  uint8_t data[300];
  for (size_t k = 0; k < sizeof data; k++)
    data[k] = (uint8_t)(k * 7);
  for (int i = 0; i < 4; i++)
    put_record(&out, data, lengths[i]);
  fuzz_seed_bytes(out);
}

static const fuzz_target tfrecord = {
    .name = "tfrecord", .seeds = seed_tfrecord, .run = run_tfrecord, .mend = mend_tfrecord};

/* ---- Waymo's frames ---- */

static int run_frame(const uint8_t *data, size_t size) {
  pags_waymo_frame *frame;
  const char *const where = "segment: record 0";
  pags_result result = pags_waymo_unpack_frame(data, size, where, &frame);
  if (result != PAGS_OK) {
    FUZZ_CHECK(!frame);
    fuzz_refused(result, where);
    return 0;
  }
  double pose[12];
  pags_waymo_points points = {0};
  pags_waymo_boxes boxes = {0};
  pags_layout_track *tracks = NULL;
  int64_t count = 0;
  result = pags_waymo_lidar_points(frame, where, &points);
  for (int64_t i = 0; i < PAGS_WAYMO_LIDAR_COLUMNS * points.count; i++)
    FUZZ_CHECK(isfinite(points.rows[i]));
  if (result == PAGS_OK)
    result = pags_waymo_transform(frame->pose, where, "pose", pose);
  if (result == PAGS_OK)
    result = pags_waymo_boxes_add(&boxes, frame, 0, 0, pose, where);
  if (result == PAGS_OK)
    result = pags_waymo_boxes_tracks(&boxes, where, &tracks, &count);
  for (int64_t i = 0; i < count; i++)
    pags_layout_track_destroy(&tracks[i]);
  free(tracks);
  for (int name = 0; name < 7; name++)
    if (pags_waymo_camera(frame, name) && pags_waymo_image(frame, name))
      FUZZ_CHECK(name == 0 || name > PAGS_WAYMO_CAMERAS || pags_waymo_camera_name(name));
  pags_waymo_boxes_destroy(&boxes);
  pags_waymo_points_destroy(&points);
  pags_waymo_free_frame(frame);
  if (result != PAGS_OK)
    fuzz_refused(result, where);
  return result == PAGS_OK;
}

enum { WIDTH = 24, HEIGHT = 16 };

static const double still[12] = {1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3};

static float three_metres(void *user, const double origin[3], const double direction[3], int which) {
  (void)user, (void)origin, (void)direction;
  return (float)(3 + which);
}

static void stand(void *user, int column, float out[6]) {
  (void)user;
  memset(out, 0, 6 * sizeof *out);
  out[3] = (float)column;
}

static void add_label(raw_waymo *memory, Pags__Waymo__Frame *f, int i) {
  Pags__Waymo__Label *const l = raw_waymo_alloc(memory, 1, sizeof *l);
  Pags__Waymo__Box *const b = raw_waymo_alloc(memory, 1, sizeof *b);
  pags__waymo__label__init(l);
  pags__waymo__box__init(b);
  l->box = b;
  l->id = raw_waymo_text(memory, i ? "b" : "a");
  l->has_type = b->has_center_x = b->has_center_y = b->has_center_z = 1;
  b->has_length = b->has_width = b->has_height = b->has_heading = 1;
  l->type = i + 1;
  b->center_x = 5 * i;
  b->length = b->width = b->height = 2;
  f->laser_labels[f->n_laser_labels++] = l;
}

static void add_camera(raw_waymo *memory, Pags__Waymo__Frame *f, int name) {
  static double intrinsic[9] = {20, 20, 12, 8, -0.1, 0.01, 0.001, 0.001, 0};
  Pags__Waymo__CameraCalibration *const c = raw_waymo_alloc(memory, 1, sizeof *c);
  Pags__Waymo__CameraImage *const m = raw_waymo_alloc(memory, 1, sizeof *m);
  Pags__Waymo__Velocity *const v = raw_waymo_alloc(memory, 1, sizeof *v);
  pags__waymo__camera_calibration__init(c);
  pags__waymo__camera_image__init(m);
  pags__waymo__velocity__init(v);
  c->has_name = c->has_width = c->has_height = c->has_rolling_shutter_direction = m->has_name = m->has_image = 1;
  m->has_pose_timestamp = m->has_shutter = m->has_camera_trigger_time = m->has_camera_readout_done_time = 1;
  v->has_v_x = v->has_w_z = 1;
  c->name = m->name = name;
  c->width = WIDTH;
  c->height = HEIGHT;
  c->rolling_shutter_direction = 2;
  c->n_intrinsic = 9;
  c->intrinsic = intrinsic;
  c->extrinsic = raw_transform(memory, still);
  m->image = (ProtobufCBinaryData){.len = 4, .data = (uint8_t *)raw_waymo_text(memory, "\xff\xd8\xff\xd9")};
  m->pose = raw_transform(memory, still);
  m->pose_timestamp = 10;
  m->camera_trigger_time = 9.99;
  m->camera_readout_done_time = 10.02;
  m->velocity = v;
  v->v_x = 3;
  f->context->camera_calibrations[f->context->n_camera_calibrations++] = c;
  f->images[f->n_images++] = m;
}

static Pags__Waymo__Frame *small_frame(raw_waymo *memory, int turning) {
  static const double beams[3] = {-0.2, -0.1, 0};
  raw_lidar laser = {.name = 1,
                     .rows = 3,
                     .columns = 5,
                     .inclinations = turning ? beams : NULL,
                     .low = -0.2,
                     .high = 0.1,
                     .range = three_metres,
                     .pose = turning ? stand : NULL};
  memcpy(laser.vehicle_from_laser, still, sizeof still);
  Pags__Waymo__Frame *const f = raw_waymo_alloc(memory, 1, sizeof *f);
  pags__waymo__frame__init(f);
  f->context = raw_waymo_alloc(memory, 1, sizeof *f->context);
  pags__waymo__context__init(f->context);
  f->context->name = raw_waymo_text(memory, "small");
  f->has_timestamp_micros = 1;
  f->timestamp_micros = 10000000;
  f->pose = raw_transform(memory, still);
  f->context->camera_calibrations = raw_waymo_alloc(memory, 2, sizeof *f->context->camera_calibrations);
  f->context->laser_calibrations = raw_waymo_alloc(memory, 1, sizeof *f->context->laser_calibrations);
  f->images = raw_waymo_alloc(memory, 2, sizeof *f->images);
  f->lasers = raw_waymo_alloc(memory, 1, sizeof *f->lasers);
  f->laser_labels = raw_waymo_alloc(memory, 2, sizeof *f->laser_labels);
  for (int i = 0; i < 2; i++) {
    add_camera(memory, f, i + 1);
    add_label(memory, f, i);
  }
  raw_lidar_add(memory, f, &laser);
  return f;
}

static void seed_message(raw_waymo *memory, const Pags__Waymo__Frame *f) {
  size_t size;
  const uint8_t *const bytes = raw_frame_pack(memory, f, &size);
  fuzz_seed(bytes, size);
}

/* Adds the frame of the shared test data without its pictures, which take most of its bytes. */
static void seed_real_frame(raw_waymo *memory) {
  char path[512];
  pags_tfrecord *reader;
  pags_tfrecord_item item;
  pags_waymo_frame *f;
  if (!pags_shared_data("waymo/pvps_data_one_frame.tfrecord", path, sizeof path))
    return;
  FUZZ_CHECK(pags_tfrecord_open(path, &reader) == PAGS_OK && pags_tfrecord_next(reader, &item) == PAGS_OK &&
             pags_waymo_unpack_frame(item.data, item.size, path, &f) == PAGS_OK);
  for (size_t i = 0; i < f->n_images; i++) {
    f->images[i]->image.len = 4;
    if (f->images[i]->camera_segmentation_label)
      f->images[i]->camera_segmentation_label->panoptic_label.len = 4;
  }
  seed_message(memory, f);
  pags_waymo_free_frame(f);
  pags_tfrecord_close(reader);
}

static void seed_frame(void) {
  raw_waymo memory = {0};
  for (int turning = 0; turning < 2; turning++)
    seed_message(&memory, small_frame(&memory, turning));
  seed_real_frame(&memory);
  raw_waymo_free(&memory);
}

/* The memory limit: protobuf-c may use 64 MiB; range images are inflated to up to 64 MiB each, one at a time. */
static const fuzz_target frame = {.name = "waymo_frame",
                                  .seeds = seed_frame,
                                  .run = run_frame,
                                  .memory = 260u << 20,
                                  .times = 1032,
                                  .nested = 1,
                                  .smoke = 5000};

/* The content of a range image, wrapped in a zlib stream of stored blocks. */
static int run_matrix(const uint8_t *data, size_t size) {
  file_bytes stream = {0};
  bytes_put(&stream, "\x78\x01", 2);
  bytes_stored(&stream, data, size);
  const uint32_t sum = (uint32_t)adler32(1, data, (uInt)size);
  for (int i = 3; i >= 0; i--)
    bytes_u8(&stream, sum >> (8 * i) & 255);
  pags_waymo_matrix *matrix;
  const ProtobufCBinaryData packed = {.len = stream.size, .data = stream.data};
  const pags_result result = pags_waymo_unpack_matrix(&packed, 4, "segment", "range image", &matrix);
  bytes_free(&stream);
  if (result != PAGS_OK) {
    FUZZ_CHECK(!matrix);
    fuzz_refused(result, "segment");
    return 0;
  }
  FUZZ_CHECK((int64_t)matrix->n_data == 4 * (int64_t)matrix->shape->dims[0] * matrix->shape->dims[1]);
  pags_waymo_free_matrix(matrix);
  return 1;
}

static void seed_matrix(void) {
  raw_waymo memory = {0};
  const float values[2 * 3 * 4] = {1, 2, 3, 4};
  const ProtobufCBinaryData packed = raw_matrix(&memory, values, 2, 3, 4);
  uint8_t plain[1024];
  uLongf size = sizeof plain;
  FUZZ_CHECK(uncompress(plain, &size, packed.data, (uLong)packed.len) == Z_OK);
  fuzz_seed(plain, size);
  raw_waymo_free(&memory);
}

static const fuzz_target matrix = {
    .name = "waymo_matrix", .seeds = seed_matrix, .run = run_matrix, .memory = 66u << 20, .times = 64, .smoke = 5000};

/* ---- A segment of one frame, imported: its pictures are decoded and written ---- */

static pags_tasks *tasks;

static int run_segment(const uint8_t *data, size_t size) {
  char folder[1024];
  file_bytes file = {0};
  put_record(&file, data, size);
  const char *const path = fuzz_file("segment.tfrecord", file.data, file.size);
  bytes_free(&file);
  pags_import_options options = pags_import_options_default();
  options.cameras = "0,1";
  snprintf(folder, sizeof folder, "%.900s/out", fuzz_folder());
  pags_result result = pags_import_waymo(path, folder, &options, tasks, NULL, NULL);
  if (result != PAGS_OK) {
    fuzz_refused(result, strstr(pags_error_message(), "out/") ? "out/" : "segment.tfrecord");
  } else {
    pags_dataset *dataset;
    const pags_dataset_options reading = pags_dataset_options_default();
    if (pags_dataset_open(folder, &reading, &dataset) == PAGS_OK)
      pags_dataset_close(dataset);
  }
  FUZZ_CHECK(pags_remove_tree(folder) == PAGS_OK);
  return result == PAGS_OK;
}

static ProtobufCBinaryData picture(raw_waymo *memory, const char *name, pags_sample sample, int channels) {
  pags_image image;
  uint8_t *bytes;
  size_t size;
  const char *const path = fuzz_file(name, "", 0);
  FUZZ_CHECK(pags_image_create(&image, WIDTH, HEIGHT, channels, sample) == PAGS_OK);
  for (size_t i = 0; sample == PAGS_U16 && i < (size_t)WIDTH * HEIGHT; i++)
    ((uint16_t *)image.data)[i] = (uint16_t)(1000 * (i % 29) + i % 3);
  FUZZ_CHECK(pags_image_save(path, &image) == PAGS_OK && pags_file_read(path, &bytes, &size) == PAGS_OK);
  pags_image_destroy(&image);
  const ProtobufCBinaryData out = {.len = size, .data = raw_waymo_alloc(memory, size, 1)};
  memcpy(out.data, bytes, size);
  free(bytes);
  return out;
}

static void add_pictures(raw_waymo *memory, Pags__Waymo__CameraImage *m) {
  Pags__Waymo__CameraSegmentationLabel *const label = raw_waymo_alloc(memory, 1, sizeof *label);
  pags__waymo__camera_segmentation_label__init(label);
  label->has_panoptic_label_divisor = label->has_panoptic_label = 1;
  label->panoptic_label_divisor = 1000;
  label->panoptic_label = picture(memory, "a.png", PAGS_U16, 1);
  m->image = picture(memory, "a.jpg", PAGS_U8, 3);
  m->camera_segmentation_label = label;
}

static void seed_segment(void) {
  raw_waymo memory = {0};
  Pags__Waymo__Frame *const f = small_frame(&memory, 1);
  for (size_t i = 0; i < f->n_images; i++)
    add_pictures(&memory, f->images[i]);
  seed_message(&memory, f);
  raw_waymo_free(&memory);
  tasks = pags_tasks_create(1);
  FUZZ_CHECK(tasks);
}

static const fuzz_target segment = {.name = "waymo_segment",
                                    .seeds = seed_segment,
                                    .run = run_segment,
                                    .memory = 260u << 20,
                                    .times = 1032,
                                    .nested = 1,
                                    .smoke = 3000};

const fuzz_target *const fuzz_targets[] = {&kitti, &tracklets, &tfrecord, &frame, &matrix, &segment, NULL};
