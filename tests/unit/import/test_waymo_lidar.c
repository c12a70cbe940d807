/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the conversion of Waymo's range images to points, with directions computed by hand, and with a synthetic
 * world of a floor and a round wall scanned from a moving car. */
#include "unit/scratch.h"

#include <math.h>

#include <pags/camera.h>
#include "import/waymo_lidar.h"
#include "raw_waymo.h"

#define PI 3.14159265358979323846

static raw_waymo memory;

static Pags__Waymo__Frame *new_frame(const double pose[12]) {
  Pags__Waymo__Frame *f = raw_waymo_alloc(&memory, 1, sizeof *f);
  pags__waymo__frame__init(f);
  f->context = raw_waymo_alloc(&memory, 1, sizeof *f->context);
  pags__waymo__context__init(f->context);
  f->context->laser_calibrations = raw_waymo_alloc(&memory, 8, sizeof *f->context->laser_calibrations);
  f->lasers = raw_waymo_alloc(&memory, 8, sizeof *f->lasers);
  f->pose = raw_transform(&memory, pose);
  return f;
}

/* Packs the frame and unpacks it again, as from a file. */
static pags_waymo_frame *reread(const Pags__Waymo__Frame *frame) {
  size_t size;
  pags_waymo_frame *out;
  const uint8_t *bytes = raw_frame_pack(&memory, frame, &size);
  scratch_ok(pags_waymo_unpack_frame(bytes, size, "test", &out));
  return out;
}

static void decode(const Pags__Waymo__Frame *frame, pags_waymo_points *points) {
  pags_waymo_frame *read = reread(frame);
  *points = (pags_waymo_points){0};
  scratch_ok(pags_waymo_lidar_points(read, "test", points));
  pags_waymo_free_frame(read);
}

static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

static float two_metres(void *user, const double origin[3], const double direction[3], int which) {
  (void)user;
  (void)origin;
  (void)direction;
  return which == 0 ? 2 : 0;
}

/* Four columns look at 135, 45, -45 and -135 degrees from the vehicle's x axis, in this order, for any yaw of the
 * LiDAR. The first row is the highest beam. */
static void test_directions_by_hand(void **state) {
  (void)state;
  static const double beams[2] = {-PI / 6, 0};
  static const double turns[] = {0, 0.7, 2.5, -3};
  for (size_t k = 0; k < sizeof turns / sizeof *turns; k++) {
    const double c = cos(turns[k]), s = sin(turns[k]);
    const raw_lidar l = {.name = 1,
                         .rows = 2,
                         .columns = 4,
                         .inclinations = beams,
                         .vehicle_from_laser = {c, -s, 0, 10, s, c, 0, 20, 0, 0, 1, 30},
                         .range = two_metres};
    Pags__Waymo__Frame *f = new_frame(identity);
    pags_waymo_points p;
    raw_lidar_add(&memory, f, &l);
    decode(f, &p);
    assert_int_equal(p.count, 8);
    for (int i = 0; i < 8; i++) {
      const double angle = (135 - 90 * (i % 4)) * PI / 180, flat = i < 4 ? 2 : 2 * cos(PI / 6);
      const double expected[4] = {10 + flat * cos(angle), 20 + flat * sin(angle), i < 4 ? 30 : 29, i / 4};
      for (int j = 0; j < 4; j++)
        assert_true(fabs((double)p.rows[4 * i + j] - expected[j]) < 1e-5);
    }
    pags_waymo_points_destroy(&p);
  }
}

/* ---- A moving car ---- */

#define FLOOR (-2.5)
#define RADIUS 35.0

typedef struct world {
  double middle[3]; /* centre of the round wall, in the world */
  double start[3];  /* the car's position in the middle of the sweep */
  int columns;
} world;

/* Returns the distance to the floor or the round wall, whichever is nearer. Only rising rays have a second return,
 * which lies on a wall of 4/5 of the radius. */
static float see(void *user, const double origin[3], const double direction[3], int which) {
  const world *w = user;
  const double x = origin[0] - w->middle[0], y = origin[1] - w->middle[1], z = origin[2] - w->middle[2];
  const double radius = which ? 0.8 * RADIUS : RADIUS;
  const double a = direction[0] * direction[0] + direction[1] * direction[1];
  const double b = x * direction[0] + y * direction[1], c = x * x + y * y - radius * radius;
  const double wall = (-b + sqrt(b * b - a * c)) / a;
  const double down = direction[2] < 0 ? (FLOOR - z) / direction[2] : 1e9;
  if (which)
    return direction[2] > 0.01 ? (float)wall : 0;
  return (float)fmin(wall, down);
}

/* Returns the car's pose at a column. During a sweep of 0.1 s it drives at 15 m/s and turns at 0.3 rad/s, with pitch
 * and roll. */
static void drive(void *user, int column, float out[6]) {
  const world *w = user;
  const double t = 0.1 * ((double)column / w->columns - 0.5);
  const double pose[6] = {
      0.02,       -0.03 + 0.1 * t, 0.9 + 0.3 * t, w->start[0] + 15 * t * cos(0.9), w->start[1] + 15 * t * sin(0.9),
      w->start[2]};
  for (int i = 0; i < 6; i++)
    out[i] = (float)pose[i];
}

static void pose_in_the_middle(const world *w, double out[12]) {
  const double cy = cos(0.9), sy = sin(0.9), cp = cos(-0.03), sp = sin(-0.03), cr = cos(0.02), sr = sin(0.02);
  const double rows[3][4] = {{cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, w->start[0]},
                             {sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, w->start[1]},
                             {-sp, cp * sr, cp * cr, w->start[2]}};
  memcpy(out, rows, sizeof rows);
}

/* Returns the distance of a point, given in the vehicle's frame, from the nearest surface. */
static double miss(const world *w, const double m[12], const float *p) {
  double q[3];
  for (int i = 0; i < 3; i++)
    q[i] = m[4 * i] * (double)p[0] + m[4 * i + 1] * (double)p[1] + m[4 * i + 2] * (double)p[2] + m[4 * i + 3] -
           w->middle[i];
  const double out = sqrt(q[0] * q[0] + q[1] * q[1]);
  const double wall = fmin(fabs(out - RADIUS), fabs(out - 0.8 * RADIUS));
  return fmin(wall, fabs(q[2] - FLOOR));
}

static double worst_miss(const world *w, const double pose[12], const pags_waymo_points *p) {
  double worst = 0;
  for (int64_t i = 0; i < p->count; i++)
    worst = fmax(worst, miss(w, pose, p->rows + 4 * i));
  return worst;
}

/* Decodes two LiDARs: one on the roof with a list of beam inclinations and a pose for each column, and a tilted
 * front one without either. Every point must lie within `allowed` metres of a surface. */
static void drive_through(double far_away, double allowed) {
  enum { ROWS = 24, COLUMNS = 180 };
  world w = {
      .middle = {far_away, -0.6 * far_away, 5}, .start = {far_away + 4, -0.6 * far_away + 3, 5}, .columns = COLUMNS};
  double pose[12], beams[ROWS];
  for (int i = 0; i < ROWS; i++)
    beams[i] = -0.4 + 0.5 * i / ROWS + 0.0003 * i * i;
  pose_in_the_middle(&w, pose);
  const double c = cos(2.58), s = sin(2.58), ct = cos(0.1), st = sin(0.1);
  const raw_lidar roof = {.name = 1,
                          .rows = ROWS,
                          .columns = COLUMNS,
                          .inclinations = beams,
                          .vehicle_from_laser = {c, -s, 0, 1.43, s, c, 0, 0.1, 0, 0, 1, 2.18},
                          .pose = drive,
                          .range = see,
                          .user = &w};
  const raw_lidar front = {.name = 2,
                           .rows = 40,
                           .columns = 100,
                           .low = -1.5,
                           .high = 0.5,
                           .vehicle_from_laser = {ct, 0, st, 4, 0, 1, 0, 0, -st, 0, ct, 0.7},
                           .range = see,
                           .user = &w};
  Pags__Waymo__Frame *f = new_frame(pose);
  pags_waymo_points p;
  raw_lidar_add(&memory, f, &roof);
  raw_lidar_add(&memory, f, &front);
  decode(f, &p);
  assert_true(p.count > ROWS * COLUMNS + 4000); /* all first returns and some second returns */
  const double worst = worst_miss(&w, pose, &p);
  if (worst > allowed)
    fail_msg("a point lies %g m from all surfaces", worst);
  pags_waymo_points_destroy(&p);
}

static void test_points_of_a_moving_car_lie_on_surfaces(void **state) {
  (void)state;
  drive_through(0, 1e-4);
  drive_through(40000, 0.02); /* poses are float32, with steps of 4 mm in x and y at this distance */
}

/* ---- Refused input ---- */

static Pags__Waymo__Frame *frame_to_spoil(void) {
  const raw_lidar l = {.name = 1,
                       .rows = 3,
                       .columns = 5,
                       .low = -0.2,
                       .high = 0.2,
                       .vehicle_from_laser = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                       .range = two_metres};
  Pags__Waymo__Frame *f = new_frame(identity);
  raw_lidar_add(&memory, f, &l);
  return f;
}

static void expect_refusal(const Pags__Waymo__Frame *frame, pags_result code, const char *part) {
  pags_waymo_points p = {0};
  pags_waymo_frame *read = reread(frame);
  const pags_result result = pags_waymo_lidar_points(read, "file: record 7 at byte 8", &p);
  scratch_expect(result, code, part);
  assert_non_null(strstr(pags_error_message(), "file: record 7 at byte 8: "));
  pags_waymo_points_destroy(&p);
  pags_waymo_free_frame(read);
}

static void test_refuses_what_does_not_fit(void **state) {
  (void)state;
  static double beams[2] = {0, 0.1};
  const float numbers[15 * 6] = {0};
  Pags__Waymo__Frame *f = frame_to_spoil();
  f->context->laser_calibrations[0]->beam_inclinations = beams;
  f->context->laser_calibrations[0]->n_beam_inclinations = 2;
  expect_refusal(f, PAGS_ERROR_FORMAT, "LiDAR TOP has 2 beam inclinations, its range image 3 rows");
  f = frame_to_spoil();
  f->context->n_laser_calibrations = 0;
  expect_refusal(f, PAGS_ERROR_FORMAT, "no calibration");
  f = frame_to_spoil();
  f->lasers[0]->ri_return1->range_image_compressed = raw_matrix(&memory, numbers, 3, 5, 6);
  expect_refusal(f, PAGS_ERROR_FORMAT, "rows x columns x 4");
  f = frame_to_spoil();
  f->lasers[0]->ri_return1->has_range_image_pose_compressed = 1;
  f->lasers[0]->ri_return1->range_image_pose_compressed = raw_matrix(&memory, numbers, 5, 3, 6);
  expect_refusal(f, PAGS_ERROR_FORMAT, "poses of 5 x 3 pixels for a range image of 3 x 5");
  f = frame_to_spoil();
  f->lasers[0]->ri_return2->range_image_compressed.len /= 2;
  expect_refusal(f, PAGS_ERROR_FORMAT, "can't be inflated");
  f = frame_to_spoil();
  f->lasers[0]->ri_return1->range_image_compressed.data[4] ^= 0x55;
  expect_refusal(f, PAGS_ERROR_FORMAT, "range image of LiDAR TOP");
  f = frame_to_spoil();
  f->context->laser_calibrations[0]->extrinsic->transform[0] = 2;
  expect_refusal(f, PAGS_ERROR_FORMAT, "expected a rotation");
}

/* A stream of a few hundred KiB that inflates to 80 MiB of zeros, more than the stated size. */
static void test_inflates_no_more_than_stated(void **state) {
  (void)state;
  enum { SIDE = 2290 };
  Pags__Waymo__Frame *f = frame_to_spoil();
  const float *zeros = raw_waymo_alloc(&memory, (size_t)SIDE * SIDE, 4 * sizeof *zeros);
  f->lasers[0]->ri_return1->range_image_compressed = raw_matrix(&memory, zeros, SIDE, SIDE, 4);
  expect_refusal(f, PAGS_ERROR_LIMIT, "larger than 64 MiB");
}

/* No pixel value, finite or not, gives a point that isn't finite. */
static void test_leaves_out_what_is_not_finite(void **state) {
  (void)state;
  const float n = NAN, i = INFINITY;
  const float pixels[15 * 4] = {n, 0, 0, 0, i, 0, 0, 0, -i, 0, 0, 0, -1,    0, 0, 0,
                                0, 0, 0, 0, 1, n, 0, 0, 2,  9, 0, 0, 3e38f, 1, 0, 0};
  Pags__Waymo__Frame *f = frame_to_spoil();
  pags_waymo_points p;
  f->lasers[0]->ri_return1->range_image_compressed = raw_matrix(&memory, pixels, 3, 5, 4);
  decode(f, &p);
  assert_int_equal(p.count, 2);
  assert_true(p.rows[3] == 9.0f);
  for (int k = 0; k < 8; k++)
    assert_true(isfinite(p.rows[k]));
  pags_waymo_points_destroy(&p);
}

static void test_empty_lidars_give_no_points(void **state) {
  (void)state;
  Pags__Waymo__Frame *f = new_frame(identity);
  for (f->n_lasers = 0; f->n_lasers < 5; f->n_lasers++) {
    f->lasers[f->n_lasers] = raw_waymo_alloc(&memory, 1, sizeof **f->lasers);
    pags__waymo__laser__init(f->lasers[f->n_lasers]);
  }
  pags_waymo_points p;
  decode(f, &p);
  assert_int_equal(p.count, 0);
  pags_waymo_points_destroy(&p);
}

/* A message of four million bytes, two million empty labels, is refused: unpacked it would take 300 MB. */
static void test_messages_keep_to_a_budget(void **state) {
  (void)state;
  const size_t size = 4000000;
  uint8_t *bytes = raw_waymo_alloc(&memory, size, 1);
  pags_waymo_frame *frame;
  for (size_t i = 0; i < size; i += 2)
    bytes[i] = 6 << 3 | 2;
  scratch_expect(pags_waymo_unpack_frame(bytes, size, "file: record 0 at byte 0", &frame), PAGS_ERROR_LIMIT,
                 "more parts");
  assert_null(frame);
}

static int tear_down(void **state) {
  (void)state;
  raw_waymo_free(&memory);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_teardown(test_directions_by_hand, tear_down),
      cmocka_unit_test_teardown(test_points_of_a_moving_car_lie_on_surfaces, tear_down),
      cmocka_unit_test_teardown(test_refuses_what_does_not_fit, tear_down),
      cmocka_unit_test_teardown(test_inflates_no_more_than_stated, tear_down),
      cmocka_unit_test_teardown(test_leaves_out_what_is_not_finite, tear_down),
      cmocka_unit_test_teardown(test_empty_lidars_give_no_points, tear_down),
      cmocka_unit_test_teardown(test_messages_keep_to_a_budget, tear_down),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
