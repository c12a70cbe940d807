/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the readers of KITTI's files with the real samples of the shared test data and with damaged files. */
#include "unit/scratch.h"

#include <math.h>
#include <pags/camera.h>

#include "base/bytes.h"
#include "import/kitti_files.h"
#include "shared_data.h"

/* ---- The real samples ---- */

static pags_kitti_calib object_calib(int frame) {
  char name[64], path[512];
  pags_kitti_calib calib;
  snprintf(name, sizeof name, "kitti/object/calib/%06d.txt", frame);
  if (!pags_shared_data(name, path, sizeof path))
    skip();
  scratch_ok(pags_kitti_calib_read(path, &calib));
  return calib;
}

/* Counts the points of a sweep inside a label's box, extended by 5 cm below its bottom as for the counts in the
 * sample's README. Also counts those of them that project into its 2D box, with 2 px tolerance. */
static const pags_kitti_form usual = {4, 4, 1};

static void count_points(const pags_kitti_calib *calib, const pags_kitti_label *label, int64_t count, const float *xyzr,
                         int *inside, int *seen) {
  double cam0_from_object[12], object_from_cam0[12], intrinsics[4], cam0_from_camera[12], camera_from_cam0[12];
  pags_kitti_label_pose(label, cam0_from_object);
  pags_rigid_inverse(cam0_from_object, object_from_cam0);
  scratch_ok(pags_kitti_camera(calib, 2, intrinsics, cam0_from_camera));
  pags_rigid_inverse(cam0_from_camera, camera_from_cam0);
  *inside = *seen = 0;
  for (int64_t i = 0; i < count; i++) {
    const double velo[3] = {xyzr[4 * i], xyzr[4 * i + 1], xyzr[4 * i + 2]};
    double cam0[3], p[3], c[3];
    pags_rigid_point(calib->cam0_from_velo, velo, cam0);
    pags_rigid_point(object_from_cam0, cam0, p);
    if (fabs(p[0]) > label->length / 2 || fabs(p[1]) > label->width / 2 || p[2] > label->height / 2 ||
        p[2] < -label->height / 2 - 0.05)
      continue;
    pags_rigid_point(camera_from_cam0, cam0, c);
    const double x = intrinsics[0] * c[0] / c[2] + intrinsics[2], y = intrinsics[1] * c[1] / c[2] + intrinsics[3];
    ++*inside;
    *seen += c[2] > 0 && x > label->box[0] - 1.5 && x < label->box[2] + 2.5 && y > label->box[1] - 1.5 &&
             y < label->box[3] + 2.5;
  }
}

static const struct expected_box {
  int frame, row;
  const char *type;
  int points;
  double share;
} expected_boxes[] = {{0, 0, "Pedestrian", 412, 0.995}, {1, 0, "Truck", 70, 1},  {1, 1, "Car", 9, 1},
                      {1, 2, "Cyclist", 18, 1},         {2, 0, "Misc", 1359, 1}, {2, 1, "Car", 79, 1}};

static void object_boxes_hold_the_lidar_points(void **state) {
  (void)state;
  for (size_t i = 0; i < sizeof expected_boxes / sizeof expected_boxes[0]; i++) {
    const struct expected_box *e = &expected_boxes[i];
    const pags_kitti_calib calib = object_calib(e->frame);
    char name[64], path[512];
    pags_kitti_labels labels;
    int64_t count;
    float *xyzr;
    int inside, seen;
    snprintf(name, sizeof name, "kitti/object/label_2/%06d.txt", e->frame);
    assert_true(pags_shared_data(name, path, sizeof path));
    scratch_ok(pags_kitti_labels_read(path, false, &labels));
    snprintf(name, sizeof name, "kitti/object/velodyne/%06d.bin", e->frame);
    assert_true(pags_shared_data(name, path, sizeof path));
    scratch_ok(pags_kitti_points_read(path, &usual, &count, &xyzr));
    assert_true(e->row < labels.count);
    assert_string_equal(labels.rows[e->row].type, e->type);
    count_points(&calib, &labels.rows[e->row], count, xyzr, &inside, &seen);
    assert_int_equal(inside, e->points);
    assert_true(fabs((double)seen / inside - e->share) < 5e-4);
    free(xyzr);
    pags_kitti_labels_destroy(&labels);
  }
}

static void sweeps_have_their_points(void **state) {
  static const struct {
    const char *name;
    int64_t count;
  } sweeps[] = {{"kitti/object/velodyne/000000.bin", 115384},
                {"kitti/object/velodyne/000001.bin", 120268},
                {"kitti/object/velodyne/000002.bin", 126891}};
  (void)state;
  for (int i = 0; i < 3; i++) {
    char path[512];
    int64_t count;
    float *xyzr;
    if (!pags_shared_data(sweeps[i].name, path, sizeof path))
      skip();
    scratch_ok(pags_kitti_points_read(path, &usual, &count, &xyzr));
    assert_int_equal(count, sweeps[i].count);
    for (int64_t k = 0; k < count; k++)
      assert_true(xyzr[4 * k + 3] >= 0 && xyzr[4 * k + 3] <= 1 && fabsf(xyzr[4 * k]) < 130);
    free(xyzr);
  }
}

/* P2 = K [I | t]: camera 2 is 6 cm to the left of camera 0, camera 3 is 47 cm to the right of it, 53 cm apart. */
static void projections_give_the_stereo_pair(void **state) {
  (void)state;
  const pags_kitti_calib calib = object_calib(1);
  double left[12], right[12], intrinsics[4];
  assert_true(calib.has_imu);
  scratch_ok(pags_kitti_camera(&calib, 2, intrinsics, left));
  scratch_ok(pags_kitti_camera(&calib, 3, intrinsics, right));
  assert_true(fabs(intrinsics[0] - 721.5377) < 1e-9 && fabs(intrinsics[2] - 610.0593) < 1e-9 &&
              fabs(intrinsics[3] - 173.354) < 1e-9);
  assert_true(fabs(left[3] + (44.85728 - 609.5593 * 2.745884e-3) / 721.5377) < 1e-12);
  assert_true(fabs(left[11] + 2.745884e-3) < 1e-12);
  assert_true(fabs(right[3] - left[3] - 0.5327) < 1e-3);
  /* The pinhole camera gives the same pixel as the projection matrix, in whose convention the centre of the first
   * pixel is at 0. */
  const double p[3] = {2, 1, 10}, *m = calib.projection[2];
  double camera_from_cam0[12], c[3];
  pags_rigid_inverse(left, camera_from_cam0);
  pags_rigid_point(camera_from_cam0, p, c);
  const double w = m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11];
  const double u = (m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]) / w,
               v = (m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7]) / w;
  scratch_ok(pags_kitti_camera(&calib, 2, intrinsics, left));
  assert_true(fabs(intrinsics[0] * c[0] / c[2] + intrinsics[2] - 0.5 - u) < 1e-9);
  assert_true(fabs(intrinsics[1] * c[1] / c[2] + intrinsics[3] - 0.5 - v) < 1e-9);
}

static void tracking_labels_count(void **state) {
  static const struct {
    const char *type;
    int rows;
  } classes[] = {{"Car", 243}, {"Van", 292}, {"Cyclist", 154}, {"Pedestrian", 22}, {"DontCare", 378}};
  char path[512];
  pags_kitti_labels labels;
  int tracks[64] = {0}, distinct = 0, last = 0;
  (void)state;
  if (!pags_shared_data("kitti/tracking/label_02/0000.txt", path, sizeof path))
    skip();
  scratch_ok(pags_kitti_labels_read(path, true, &labels));
  assert_int_equal(labels.count, 1089);
  for (size_t c = 0; c < sizeof classes / sizeof classes[0]; c++) {
    int rows = 0;
    for (int64_t i = 0; i < labels.count; i++)
      rows += !strcmp(labels.rows[i].type, classes[c].type);
    assert_int_equal(rows, classes[c].rows);
  }
  for (int64_t i = 0; i < labels.count; i++) {
    const pags_kitti_label *row = &labels.rows[i];
    last = row->frame > last ? row->frame : last;
    if (pags_kitti_label_is_box(row) && !tracks[row->track]++)
      distinct++;
  }
  assert_int_equal(distinct, 15);
  assert_int_equal(last, 153);
  pags_kitti_labels_destroy(&labels);
}

/* Checks a file of poses (3x4 rows, camera to first camera): each is a rotation and the first is the identity. */
static void check_poses(const char *name, int64_t rows) {
  char path[512];
  pags_kitti_table table;
  if (!pags_shared_data(name, path, sizeof path))
    skip();
  scratch_ok(pags_kitti_table_read(path, 12, &table));
  assert_int_equal(table.rows, rows);
  for (int i = 0; i < 12; i++)
    assert_true(fabs(table.values[i] - (i % 5 == 0)) < 1e-6);
  for (int64_t k = 0; k < rows; k++) {
    pags_camera camera = {.width = 1, .height = 1, .fx = 1, .fy = 1};
    memcpy(camera.world_from_camera, table.values + 12 * k, sizeof camera.world_from_camera);
    scratch_ok(pags_camera_check(&camera, name));
  }
  pags_kitti_table_destroy(&table);
}

static void odometry_clips_parse(void **state) {
  char path[512];
  (void)state;
  for (int clip = 1; clip <= 2; clip++) {
    char name[64];
    pags_kitti_table calib;
    snprintf(name, sizeof name, "kitti/odometry_clip_%d/poses.txt", clip);
    check_poses(name, 51);
    snprintf(name, sizeof name, "kitti/odometry_clip_%d/calib.txt", clip);
    assert_true(pags_shared_data(name, path, sizeof path));
    scratch_ok(pags_kitti_table_read(path, 12, &calib)); /* a file with rows but without the labels P0: and P1: */
    assert_int_equal(calib.rows, 2);
    assert_true(calib.values[0] == calib.values[5] && calib.values[3] == 0 && calib.values[15] < -370);
    pags_kitti_table_destroy(&calib);
  }
  check_poses("kitti/tracking/poses_orbslam3/0000.txt", 154);
}

/* Returns the mean image gradient at depth edges of the sweep, with pixels shifted horizontally. The calibration is
 * right if every shift gives a lower value. */
static double edge_strength(const pags_image *image, const pags_kitti_calib *calib, int64_t count, const float *xyzr,
                            int shift) {
  const uint8_t *grey = image->data;
  double sum = 0;
  int64_t used = 0;
  double intrinsics[4], pose[12], camera_from_cam0[12], last = 0;
  scratch_ok(pags_kitti_camera(calib, 2, intrinsics, pose));
  pags_rigid_inverse(pose, camera_from_cam0);
  for (int64_t i = 0; i < count; i++) {
    const double velo[3] = {xyzr[4 * i], xyzr[4 * i + 1], xyzr[4 * i + 2]};
    const double range = sqrt(velo[0] * velo[0] + velo[1] * velo[1] + velo[2] * velo[2]), step = last - range;
    double cam0[3], c[3];
    last = range;
    if (step < 1 || step > 20) /* only steps to a nearer surface, by 1 m to 20 m */
      continue;
    pags_rigid_point(calib->cam0_from_velo, velo, cam0);
    pags_rigid_point(camera_from_cam0, cam0, c);
    const int x = (int)floor(intrinsics[0] * c[0] / c[2] + intrinsics[2]) + shift,
              y = (int)floor(intrinsics[1] * c[1] / c[2] + intrinsics[3]);
    if (c[2] < 1 || x < 2 || x >= image->width - 2 || y < 0 || y >= image->height)
      continue;
    const uint8_t *p = grey + (size_t)y * (size_t)image->width + x;
    sum += abs(p[2] - p[-2]);
    used++;
  }
  assert_true(used > 200);
  return sum / (double)used;
}

static void raw_sweeps_fit_their_pictures(void **state) {
  static const int shifts[] = {-40, -20, 20, 40};
  char path[512];
  pags_kitti_calib calib;
  (void)state;
  if (!pags_shared_data("kitti/raw_2011_09_26/calib.txt", path, sizeof path))
    skip();
  scratch_ok(pags_kitti_calib_read(path, &calib));
  for (int frame = 0; frame < 4; frame++) {
    char name[96];
    pags_image image;
    int64_t count;
    float *xyzr;
    snprintf(name, sizeof name, "kitti/raw_2011_09_26/image_02/data/%010d.png", frame);
    assert_true(pags_shared_data(name, path, sizeof path));
    scratch_ok(pags_image_load(path, PAGS_U8, 1, &image));
    assert_true(image.width == 1242 && image.height == 375);
    snprintf(name, sizeof name, "kitti/raw_2011_09_26/velodyne_points/data/%010d.bin", frame);
    assert_true(pags_shared_data(name, path, sizeof path));
    scratch_ok(pags_kitti_points_read(path, &usual, &count, &xyzr));
    const double here = edge_strength(&image, &calib, count, xyzr, 0);
    for (size_t i = 0; i < sizeof shifts / sizeof shifts[0]; i++) {
      const double aside = edge_strength(&image, &calib, count, xyzr, shifts[i]);
      assert_true(aside < 0.75 * here); /* measured: ratios of 0.31 to 0.57 */
    }
    pags_image_destroy(&image);
    free(xyzr);
  }
}

/* ---- Written files ---- */

static void oxts_follow_the_development_kit(void **state) {
  double row[PAGS_KITTI_OXTS] = {49, 8.4, 112.5, 0.02, -0.03, 0.7}, pose[12], next[12];
  const double pi = acos(-1.0), scale = pags_kitti_oxts_scale(row);
  (void)state;
  assert_true(fabs(scale - cos(49 * pi / 180)) < 1e-15);
  pags_kitti_oxts_pose(row, scale, pose);
  assert_true(pose[11] == 112.5);
  /* The forward axis is Rz Ry x; roll and pitch tilt the up axis. */
  assert_true(fabs(pose[0] - cos(0.7) * cos(-0.03)) < 1e-15 && fabs(pose[4] - sin(0.7) * cos(-0.03)) < 1e-15 &&
              fabs(pose[8] - sin(0.03)) < 1e-15);
  assert_true(fabs(pose[9] - cos(-0.03) * sin(0.02)) < 1e-15);
  /* A thousandth of a degree moves the pose by 6378137 * pi / 180 * 0.001 m to the north, cos(lat) times that to the
   * east. */
  row[PAGS_OXTS_LAT] += 0.001;
  row[PAGS_OXTS_LON] += 0.001;
  pags_kitti_oxts_pose(row, scale, next);
  assert_true(fabs(next[7] - pose[7] - 111.3194908) < 2e-3);
  assert_true(fabs(next[3] - pose[3] - 111.3194908 * cos(49 * pi / 180)) < 1e-5);
  const pags_place place = pags_kitti_place((double[]){next[3], next[7], next[11]}, scale);
  assert_true(place.known && place.altitude == 112.5);
  assert_true(fabs(place.latitude - 49.001) < 1e-10 && fabs(place.longitude - 8.401) < 1e-10);
}

static void times_parse(void **state) {
  scratch s;
  int64_t count;
  double *seconds;
  (void)state;
  scratch_begin(&s);
  scratch_text(&s, "t.txt", "2011-09-26 13:02:25.594360375\r\n2012-02-29 00:00:00\n1970-01-01 00:00:01.5\n");
  scratch_ok(pags_kitti_times_read(s.path, &count, &seconds));
  assert_int_equal(count, 3);
  assert_true(fabs(seconds[0] - 1317042145.594360375) < 1e-6);
  assert_true(seconds[1] == 1330473600 && seconds[2] == 1.5);
  free(seconds);
  scratch_text(&s, "t.txt",
               "\n1970-01-01 00:00:01\n \n\r\n1970-01-01 00:00:04\n\n\n"); /* lines whose time is missing */
  scratch_ok(pags_kitti_times_read(s.path, &count, &seconds));
  assert_int_equal(count, 5);
  assert_true(isnan(seconds[0]) && seconds[1] == 1 && isnan(seconds[2]) && isnan(seconds[3]) && seconds[4] == 4);
  free(seconds);
  scratch_text(&s, "t.txt", "2011-09-26 13:02:25.5\n2011-09-26 13:99:25.5\n");
  scratch_expect(pags_kitti_times_read(s.path, &count, &seconds), PAGS_ERROR_FORMAT, "t.txt:2: expected a time");
  scratch_end(&s);
}

static void bad_rows_are_refused_with_their_line(void **state) {
  static const struct {
    const char *text, *part;
  } cases[] = {{"1 2 3\n4 x 6\n", ":2: expected a number in column 2, found 'x'"},
               {"1 2 3\n4 5\n", ":2: expected 3 numbers, found 2"},
               {"1 2 3 4\n", ":1: expected 3 numbers, found more"},
               {"1 2 nan\n", ":1: expected a number in column 3"},
               {"1 2 3\n\n4 5 6\n", ":3: expected nothing after an empty line"},
               {"", "expected rows of 3 numbers, found none"}};
  scratch s;
  pags_kitti_table table;
  (void)state;
  scratch_begin(&s);
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    scratch_text(&s, "rows.txt", cases[i].text);
    scratch_expect(pags_kitti_table_read(s.path, 3, &table), PAGS_ERROR_FORMAT, cases[i].part);
  }
  scratch_write(&s, "rows.txt", "1 2 3\n4 \0 6\n", 12);
  scratch_expect(pags_kitti_table_read(s.path, 3, &table), PAGS_ERROR_FORMAT, "zero byte at byte 8");
  scratch_write(&s, "points.bin", "0123456789abcdefg", 17);
  int64_t count;
  float *xyzr;
  scratch_expect(pags_kitti_points_read(s.path, &usual, &count, &xyzr), PAGS_ERROR_FORMAT, "16 bytes");
  scratch_end(&s);
}

/* Writes 400 points on the ground and on walls in a given format, with each position multiplied by `unit` and moved
 * by `shift`. */
static void write_sweep(scratch *s, int columns, int width, double unit, double shift) {
  static uint8_t bytes[400 * 5 * 8];
  for (int i = 0; i < 400; i++) {
    const double row[5] = {unit * (0.1 * (i % 97) + 3 - i % 2 * 20) + shift, unit * (0.2 * (i % 61) - 6) + shift,
                           unit * (0.01 * (i % 200) - 1.7), 0.0025 * i, i % 64};
    for (int c = 0; c < columns; c++)
      if (width == 8)
        pags_store_f64(bytes + 8 * (i * columns + c), row[c]);
      else
        pags_store_f32(bytes + 4 * (i * columns + c), (float)row[c]);
  }
  scratch_write(s, "sweep.bin", bytes, (size_t)(400 * columns * width));
}

static void forms_of_sweeps_are_recognised(void **state) {
  static const pags_kitti_form cases[] = {{4, 4, 1}, {3, 4, 1}, {5, 4, 1},     {4, 8, 1},
                                          {3, 8, 1}, {5, 8, 1}, {4, 4, 0.001}, {5, 8, 0.001}};
  scratch s;
  (void)state;
  scratch_begin(&s);
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    pags_kitti_form found;
    int64_t count;
    float *xyzr;
    write_sweep(&s, cases[i].columns, cases[i].width, 1 / cases[i].scale, 0);
    scratch_ok(pags_kitti_form_find(s.path, &found));
    assert_true(found.columns == cases[i].columns && found.width == cases[i].width && found.scale == cases[i].scale);
    assert_int_equal(pags_kitti_form_is_usual(&found), i == 0);
    scratch_ok(pags_kitti_points_read(s.path, &found, &count, &xyzr));
    assert_int_equal(count, 400);
    assert_true(fabs((double)xyzr[4 * 3] - (0.3 + 3 - 20)) < 1e-4 && fabs((double)xyzr[4 * 3 + 2] + 1.67) < 1e-5);
    assert_true(fabs((double)xyzr[4 * 3 + 3] - (cases[i].columns > 3 ? 0.0075 : 0)) < 1e-7);
    free(xyzr);
  }
  pags_kitti_form found;
  write_sweep(&s, 4, 4, 1, 100);
  scratch_expect(pags_kitti_form_find(s.path, &found), PAGS_ERROR_FORMAT, "no point lies within 15 m");
  write_sweep(&s, 4, 4, 1, 4e6);
  scratch_expect(pags_kitti_form_find(s.path, &found), PAGS_ERROR_FORMAT, "not those of the world");
  scratch_write(&s, "sweep.bin", "0123456789abcdefghijklmnopqrstuv", 32);
  scratch_expect(pags_kitti_form_find(s.path, &found), PAGS_ERROR_FORMAT, "within a LiDAR's reach");
  scratch_end(&s);
}

#define LABEL "0 3 Car 0 0 -1.5 10 20 30 40 1.5 1.6 4.0 1 2 20 0.1"

static void bad_labels_are_refused_with_their_line(void **state) {
  static const struct {
    const char *text, *part;
  } cases[] = {
      {LABEL "\n0 4 Car 0 0 -1.5 10 20 30 40 1.5 1.6 4.0 1 2 20\n", ":2: expected a number for 'rotation_y', found ''"},
      {LABEL " 7 8\n", ":1: expected 17 columns, or 18 with a score, found more"},
      {LABEL " x\n", ":1: expected 17 columns, or 18"},
      {"0 3 Car 0 0 -1.5 10 20 30 40 1500 1600 4000 1 2 20 0.1\n",
       ":1: Car of track 3 in frame 0: expected a height, width and length below 100 m"},
      {"0 3 Car 0 0 -1.5 10 20 30 40 1.5 1.6 4 1 2 20 90\n", "expected rotation_y in radians"},
      {"0 3 Car 0 0 -1.5 10 20 30 40 1.5 1.6 4 100 200 20000 0\n", "expected a place in the camera's axes in metres"},
      {"0.5 3 Car 0 0 -1.5 10 20 30 40 1.5 1.6 4.0 1 2 20 0.1\n", ":1: expected an integer of 0..1000000 for 'frame'"},
      {"-4 3 Car 0 0 -1.5 10 20 30 40 1 1.6 4.0 1 2 20 0.1\n", ":1: expected an integer of 0..1000000 for 'frame'"},
      {"0 -1 Car 0 0 -1.5 10 20 30 40 1 1.6 4.0 1 2 20 0.1\n", ":1: a Car without track id"},
      {"0 1 Caaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaar 0 0 0 0 0 0 0 1 1 1 1 1 1 1\n", ":1: expected a class name"}};
  scratch s;
  pags_kitti_labels labels;
  (void)state;
  scratch_begin(&s);
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    scratch_text(&s, "labels.txt", cases[i].text);
    scratch_expect(pags_kitti_labels_read(s.path, true, &labels), PAGS_ERROR_FORMAT, cases[i].part);
  }
  scratch_text(&s, "labels.txt", "");
  scratch_ok(pags_kitti_labels_read(s.path, true, &labels));
  assert_int_equal(labels.count, 0);

  /* Labels with a score, whole numbers with a decimal point, another spelling of DontCare, and a detection without a
   * position in space. */
  scratch_text(&s, "labels.txt",
               LABEL
               " 0.75\n1.0 3.0 Car 0 0.0 -1.5 10 20 30 40 1.5 1.6 4.0 1 2 20 0.1\n"
               "1 -1 dontcare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10\n"
               "1 4 Car -1 -1 -10 10 20 30 40 -1 -1 -1 -1000 -1000 -1000 -10 0.5\n");
  scratch_ok(pags_kitti_labels_read(s.path, true, &labels));
  assert_int_equal(labels.count, 4);
  assert_true(labels.rows[0].scored && labels.rows[0].score == 0.75 && !labels.rows[1].scored);
  assert_true(labels.rows[1].frame == 1 && labels.rows[1].track == 3);
  assert_true(!pags_kitti_label_is_box(&labels.rows[2]) && pags_kitti_label_is_box(&labels.rows[3]));
  assert_true(pags_kitti_label_has_volume(&labels.rows[0]) && !pags_kitti_label_has_volume(&labels.rows[3]));
  pags_kitti_labels_destroy(&labels);
  scratch_end(&s);
}

static void bad_calibrations_are_refused(void **state) {
  static const char good[] =
      "P0: 700 0 600 0 0 700 180 0 0 0 1 0\nP1: 700 0 600 -380 0 700 180 0 0 0 1 0\n"
      "P2: 700 0 600 40 0 700 180 0 0 0 1 0\nP3: 700 0 600 -340 0 700 180 0 0 0 1 0\n"
      "R_rect 1 0 0 0 1 0 0 0 1\nTr_velo_cam 0 -1 0 0 0 0 -1 0 1 0 0 0\n";
  scratch s;
  pags_kitti_calib calib;
  char text[1024];
  (void)state;
  scratch_begin(&s);
  scratch_text(&s, "calib.txt", good);
  scratch_ok(pags_kitti_calib_read(s.path, &calib));
  assert_false(calib.has_imu);
  snprintf(text, sizeof text, "%sTr_imu_velo 1 0 0 0 0 1 0 0 0 0 2 0\n", good);
  scratch_text(&s, "calib.txt", text);
  scratch_expect(pags_kitti_calib_read(s.path, &calib), PAGS_ERROR_FORMAT, "Tr_imu_to_velo");
  snprintf(text, sizeof text, "%sTr_imu_velo 1 0 0 0 0 1 0 0 0 0 1\n", good);
  scratch_text(&s, "calib.txt", text);
  scratch_expect(pags_kitti_calib_read(s.path, &calib), PAGS_ERROR_FORMAT,
                 ":7: expected 12 numbers for 'Tr_imu_velo', found nothing");
  snprintf(text, sizeof text, "%sP2: 700 0 600 40 0 700 180 0 0 0 1 0\n", good);
  scratch_text(&s, "calib.txt", text);
  scratch_expect(pags_kitti_calib_read(s.path, &calib), PAGS_ERROR_FORMAT, ":7: 'P2' stands here and in line 3");
  scratch_text(&s, "calib.txt", strchr(good, '\n') + 1);
  scratch_expect(pags_kitti_calib_read(s.path, &calib), PAGS_ERROR_FORMAT, "expected a line 'P0:'");
  scratch_end(&s);
}

#define POSE "<item><tx>1</tx><ty>2</ty><tz>-1.5</tz><rx>0</rx><ry>0</ry><rz>0.5</rz><state>1</state></item>"
#define XML_HEAD                                                                                                   \
  "<?xml version=\"1.0\" encoding=\"UTF-8\" standalone=\"yes\" ?>\n<!DOCTYPE boost_serialization>\n"               \
  "<boost_serialization signature=\"serialization::archive\" version=\"9\">\n<tracklets class_id=\"0\">\n<count>1" \
  "</count>\n<item class_id=\"1\">\n"
#define XML_BODY "<objectType>Car</objectType><h>1.5</h><w>1.6</w><l>4.2</l><first_frame>2</first_frame>\n"
#define XML_TAIL "<finished>1</finished></item></tracklets></boost_serialization>\n"

static void tracklets_parse(void **state) {
  scratch s;
  pags_kitti_tracklets t;
  double pose[12];
  (void)state;
  scratch_begin(&s);
  scratch_text(&s, "t.xml",
               XML_HEAD XML_BODY "<poses><count>2</count><item_version>2</item_version>" POSE POSE "</poses>" XML_TAIL);
  scratch_ok(pags_kitti_tracklets_read(s.path, &t));
  assert_int_equal(t.count, 1);
  assert_string_equal(t.items[0].type, "Car");
  assert_true(t.items[0].height == 1.5 && t.items[0].width == 1.6 && t.items[0].length == 4.2);
  assert_int_equal(t.items[0].first_frame, 2);
  assert_int_equal(t.items[0].count, 2);
  pags_kitti_tracklet_pose(&t.items[0], 1, pose);
  assert_true(pose[3] == 1 && pose[7] == 2 && pose[11] == -0.75 && pose[0] == cos(0.5) && pose[4] == sin(0.5) &&
              pose[10] == 1);
  pags_kitti_tracklets_destroy(&t);
  scratch_end(&s);
}

static void bad_tracklets_are_refused_with_their_line(void **state) {
  static const struct {
    const char *text, *part;
  } cases[] = {{XML_HEAD XML_BODY "<poses>" POSE "</poses>", ":8: "}, /* a document that ends early */
               {XML_HEAD XML_BODY XML_TAIL, ":8: expected objectType h w l first_frame poses"},
               {XML_HEAD XML_BODY "<poses><item><tx>1</tx></item></poses>" XML_TAIL, ":8: expected tx ty tz rx ry rz"},
               {XML_HEAD "<h>1500</h>" XML_TAIL, ":7: expected a size below 100 m in <h> of tracklet 0"},
               {XML_HEAD "<h>one</h>" XML_TAIL, ":7: expected a number in <h>, found 'one'"},
               {XML_HEAD "<h>1</h><h>1</h>" XML_TAIL, ":7: <h> stands twice"},
               {XML_HEAD "<first_frame>-3</first_frame>" XML_TAIL, ":7: expected the number of a frame"},
               {"<!DOCTYPE a [<!ENTITY b \"cc\">]><a>&b;</a>", ":1: expected no entities"},
               {"<a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><a><a>", ":1: expected no more than 16"},
               {"no xml", ":1: "}};
  scratch s;
  pags_kitti_tracklets t;
  (void)state;
  scratch_begin(&s);
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    scratch_text(&s, "t.xml", cases[i].text);
    scratch_expect(pags_kitti_tracklets_read(s.path, &t), PAGS_ERROR_FORMAT, cases[i].part);
  }
  scratch_end(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(object_boxes_hold_the_lidar_points),
      cmocka_unit_test(sweeps_have_their_points),
      cmocka_unit_test(projections_give_the_stereo_pair),
      cmocka_unit_test(tracking_labels_count),
      cmocka_unit_test(odometry_clips_parse),
      cmocka_unit_test(raw_sweeps_fit_their_pictures),
      cmocka_unit_test(oxts_follow_the_development_kit),
      cmocka_unit_test(times_parse),
      cmocka_unit_test(bad_rows_are_refused_with_their_line),
      cmocka_unit_test(forms_of_sweeps_are_recognised),
      cmocka_unit_test(bad_labels_are_refused_with_their_line),
      cmocka_unit_test(bad_calibrations_are_refused),
      cmocka_unit_test(tracklets_parse),
      cmocka_unit_test(bad_tracklets_are_refused_with_their_line),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
