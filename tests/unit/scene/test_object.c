/* SPDX-License-Identifier: Apache-2.0 */
/* Tests objects: categories, classification of motion, poses between labelled keyframes, and optimised pose
 * increments. */
#include <pags/object.h>

#include <pags/camera.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"

#include <cmocka.h>

static void turn_about_z(double angle, double x, double y, double z, double out[12]) {
  const double m[12] = {cos(angle), -sin(angle), 0, x, sin(angle), cos(angle), 0, y, 0, 0, 1, z};
  memcpy(out, m, sizeof m);
}

/* A car on an arc: `count` keyframes at the times 1000 + 0.1 i with heading 0.1 i, all of them trained. */
static pags_object sample(int count) {
  pags_object object = {.category = PAGS_CATEGORY_VEHICLE, .size = {4, 2, 1.5}, .keyframe_count = count};
  object.keyframes = calloc((size_t)count, sizeof *object.keyframes);
  assert_non_null(object.keyframes);
  for (int i = 0; i < count; i++) {
    object.keyframes[i].frame = i;
    object.keyframes[i].trained = 1;
    object.keyframes[i].time = 1000 + 0.1 * i;
    turn_about_z(0.1 * i, i, 2 * i, 0, object.keyframes[i].world_from_object);
  }
  return object;
}

static double difference(const double *a, const double *b) {
  double largest = 0;
  for (int i = 0; i < 12; i++)
    largest = fmax(largest, fabs(a[i] - b[i]));
  return largest;
}

static void names_become_categories(void **state) {
  (void)state;
  static const struct {
    const char *name;
    pags_category category;
  } known[] = {
      {"Car", PAGS_CATEGORY_VEHICLE},
      {"Bus/RV/Caravan", PAGS_CATEGORY_VEHICLE},
      {"walker.pedestrian.0001", PAGS_CATEGORY_PEDESTRIAN},
      {"Motorbike", PAGS_CATEGORY_CYCLIST},
      {"REGULAR_VEHICLE", PAGS_CATEGORY_VEHICLE},
      {"Van", PAGS_CATEGORY_VEHICLE},
      {"Tram", PAGS_CATEGORY_VEHICLE},
      {"Medium-sized Truck", PAGS_CATEGORY_VEHICLE},
      {"Semi-truck", PAGS_CATEGORY_VEHICLE},
      {"Tram / Subway", PAGS_CATEGORY_VEHICLE},
      {"Other Vehicle - Construction Vehicle", PAGS_CATEGORY_VEHICLE},
      {"vehicle.bus.bendy", PAGS_CATEGORY_VEHICLE},
      {"vehicle", PAGS_CATEGORY_VEHICLE},
      {"TYPE_VEHICLE", PAGS_CATEGORY_VEHICLE},
      {"Pedestrian", PAGS_CATEGORY_PEDESTRIAN},
      {"Pedestrian with Object", PAGS_CATEGORY_PEDESTRIAN},
      {"Person_sitting", PAGS_CATEGORY_PEDESTRIAN},
      {"Person (sitting)", PAGS_CATEGORY_PEDESTRIAN},
      {"human.pedestrian.construction_worker", PAGS_CATEGORY_PEDESTRIAN},
      {"Cyclist", PAGS_CATEGORY_CYCLIST},
      {"vehicle.bicycle", PAGS_CATEGORY_CYCLIST},
      {"vehicle.motorcycle", PAGS_CATEGORY_CYCLIST},
      {"Motorcycle", PAGS_CATEGORY_CYCLIST},
      {"BICYCLIST", PAGS_CATEGORY_CYCLIST},
      {"Sign", PAGS_CATEGORY_OTHER},
      {"DontCare", PAGS_CATEGORY_OTHER},
      {"Misc", PAGS_CATEGORY_OTHER},
      {"Animals - Other", PAGS_CATEGORY_OTHER},
      {"movable_object.trafficcone", PAGS_CATEGORY_OTHER},
      {"Carpet", PAGS_CATEGORY_OTHER},
      {"", PAGS_CATEGORY_OTHER},
  };
  for (size_t i = 0; i < sizeof known / sizeof *known; i++)
    if (pags_category_of(known[i].name) != known[i].category)
      fail_msg("%s became %s", known[i].name, pags_category_name(pags_category_of(known[i].name)));
  assert_string_equal(pags_category_name(PAGS_CATEGORY_CYCLIST), "cyclist");
  assert_false(pags_category_is_critical(PAGS_CATEGORY_OTHER));
}

static int moves(const double (*positions)[3], int count) {
  pags_object object = sample(count);
  for (int i = 0; i < count; i++)
    turn_about_z(0, 1e6 + positions[i][0], -2e6 + positions[i][1], positions[i][2],
                 object.keyframes[i].world_from_object);
  object.moving = -1;
  pags_object_classify_motion(&object);
  int moving = object.moving;
  pags_object_destroy(&object);
  return moving;
}

static void objects_move_by_travel_or_spread(void **state) {
  (void)state;
  /* The spread of two positions is half their distance, so the threshold here is 1 m. */
  assert_false(moves((const double[][3]){{0, 0, 0}}, 1));
  assert_false(moves((const double[][3]){{0, 0, 0}, {0.99, 0, 0}}, 2));
  assert_true(moves((const double[][3]){{0, 0, 0}, {1.01, 0, 0}}, 2));
  assert_true(moves((const double[][3]){{0, 0, 0}, {0, 4, 0}, {0, 0, 0}}, 3));
  /* Ten keyframes on a path with a bend and a stop: the spread on each axis is below 0.5 m, so the travelled
   * distance decides. */
  double way[10][3];
  for (int far = 0; far < 2; far++) {
    for (int i = 0; i < 10; i++) {
      way[i][0] = 1.25 / 3 * fmin(i, 3);
      way[i][1] = 1.25 / 3 * fmax(i - 6, 0);
      way[i][2] = (far ? 1.0 : 0.9) / 3 * fmax(i - 6, 0);
    }
    assert_int_equal(moves((const double(*)[3])way, 10), far);
  }
}

/* Six or more labels around one place belong to a parked object, whatever their distances. */
static void jitter_does_not_count_as_motion(void **state) {
  (void)state;
  double labels[40][3] = {{0}};
  labels[9][0] = 5; /* only the last label is displaced */
  assert_false(moves((const double(*)[3])labels, 10));
  assert_true(moves((const double(*)[3])(labels + 7), 3)); /* too few labels to call the object parked */
  for (int i = 0; i < 12; i++)
    labels[i][i % 2] = i % 3 ? 1.2 : -1.2;
  assert_false(moves((const double(*)[3])labels, 12));
  for (int i = 0; i < 12; i++)
    labels[i][0] += 0.5 * i; /* despite the jitter it drives */
  assert_true(moves((const double(*)[3])labels, 12));
  memset(labels, 0, sizeof labels);
  for (int i = 20; i < 40; i++)
    labels[i][1] = 0.01 * (i - 20) * (i - 20); /* the object stands and then drives off */
  assert_true(moves((const double(*)[3])labels, 40));
}

/* Returns whether an object counts as moving that moves by `metres` in `count` equal steps of 0.1 s, with every
 * other label shifted sideways by `jitter`. */
static int walks(pags_category category, double metres, int count, double jitter) {
  pags_object object = sample(count);
  object.category = category;
  for (int i = 0; i < count; i++) {
    object.keyframes[i].time = 50 + 0.1 * i;
    turn_about_z(0, metres * i / (count - 1), i % 2 ? jitter : 0, 0, object.keyframes[i].world_from_object);
  }
  pags_object_classify_motion(&object);
  int moving = object.moving;
  pags_object_destroy(&object);
  return moving;
}

static void pedestrians_in_short_clips_move(void **state) {
  (void)state;
  assert_true(walks(PAGS_CATEGORY_PEDESTRIAN, 1.4, 12, 0.05));
  assert_true(walks(PAGS_CATEGORY_CYCLIST, 0.81, 6, 0));
  assert_false(walks(PAGS_CATEGORY_PEDESTRIAN, 0.79, 6, 0));
  assert_false(walks(PAGS_CATEGORY_PEDESTRIAN, 0.9, 21, 0));    /* too slow: 0.45 m/s */
  assert_false(walks(PAGS_CATEGORY_PEDESTRIAN, 1.4, 12, 0.45)); /* labels with jitter */
  assert_false(walks(PAGS_CATEGORY_PEDESTRIAN, 0.9, 2, 0));     /* only two labels */
  assert_true(walks(PAGS_CATEGORY_VEHICLE, 1.25, 12, 0));
  assert_false(walks(PAGS_CATEGORY_VEHICLE, 1.15, 12, 0));
  assert_false(walks(PAGS_CATEGORY_VEHICLE, 1.5, 17, 0)); /* too slow: 0.94 m/s may be drift of the label */
  assert_false(walks(PAGS_CATEGORY_OTHER, 1.5, 12, 0));
}

static void keyframes_keep_their_pose(void **state) {
  (void)state;
  pags_object object = sample(5);
  double pose[12];
  for (int i = 0; i < 5; i++) {
    assert_true(pags_object_pose(&object, object.keyframes[i].time + (i % 2 ? 4e-7 : -4e-7), pose));
    assert_memory_equal(pose, object.keyframes[i].world_from_object, sizeof pose);
  }
  pags_object_destroy(&object);
}

static void between_keyframes_labels_are_interpolated(void **state) {
  (void)state;
  pags_object object = sample(5);
  double pose[12], expected[12];
  turn_about_z(0.125, 1.25, 2.5, 0, expected);
  assert_true(pags_object_pose(&object, 1000.125, pose));
  assert_true(difference(pose, expected) < 1e-9);
  /* Between headings on either side of half a turn the interpolation takes the shorter arc. */
  turn_about_z(3.0, 0, 0, 0, object.keyframes[1].world_from_object);
  turn_about_z(-3.0, 0, 0, 0, object.keyframes[2].world_from_object);
  turn_about_z(acos(-1.0), 0, 0, 0, expected);
  assert_true(pags_object_pose(&object, 1000.15, pose));
  assert_true(difference(pose, expected) < 1e-6);
  pags_object_destroy(&object);
}

static void tracks_extend_by_half_a_spacing(void **state) {
  (void)state;
  pags_object object = sample(7);
  const double untouched[12] = {7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7};
  double pose[12];
  for (int i = 4; i < 7; i++)
    object.keyframes[i].time += 0.1; /* a gap from 1000.3 to 1000.5, twice the median, isn't bridged */
  memcpy(pose, untouched, sizeof pose);
  assert_true(pags_object_pose(&object, 999.951, pose));
  assert_memory_equal(pose, object.keyframes[0].world_from_object, sizeof pose);
  assert_true(pags_object_pose(&object, 1000.34, pose));
  assert_memory_equal(pose, object.keyframes[3].world_from_object, sizeof pose);
  assert_true(pags_object_pose(&object, 1000.46, pose));
  assert_memory_equal(pose, object.keyframes[4].world_from_object, sizeof pose);
  memcpy(pose, untouched, sizeof pose);
  assert_false(pags_object_pose(&object, 999.9, pose));
  assert_false(pags_object_pose(&object, 1000.76, pose));
  assert_false(pags_object_pose(&object, (double)NAN, pose));
  assert_false(pags_object_pose(&object, (double)INFINITY, pose));
  assert_memory_equal(pose, untouched, sizeof pose);
  for (int i = 4; i < 7; i++)
    object.keyframes[i].time -= 0.06; /* a gap of 1.4 times the median is bridged */
  assert_true(pags_object_pose(&object, 1000.37, pose));
  assert_true(fabs(pose[3] - 3.5) < 1e-6);
  object.keyframe_count = 1; /* a track of one keyframe lasts a time step */
  object.time_step = 0.1;
  assert_true(pags_object_pose(&object, 1000, pose));
  assert_true(pags_object_pose(&object, 999.951, pose));
  assert_true(pags_object_pose(&object, 1000.049, pose));
  assert_false(pags_object_pose(&object, 1000.051, pose));
  pags_object_destroy(&object);
}

/* The true pose of a car that accelerates and turns at constant rates. */
static void true_pose(double time, double out[12]) {
  double s = time - 1000;
  turn_about_z(2.9 + 0.7 * s + 0.4 * s * s, 12 * s + 3 * s * s, 5 - 2 * s * s, 0.3 * s, out);
}

/* Labels of the car with errors of up to 0.5 m and 0.2 rad, and increments that correct them exactly at trained
 * keyframes. The keyframes in `held_out` aren't trained, and their increments must not be used. */
static pags_object trained_sample(int count, const int *held_out, int held_out_count) {
  pags_object object = sample(count);
  for (int i = 0; i < count; i++) {
    pags_keyframe *k = &object.keyframes[i];
    double truth[12], back[12], off[12], random[4];
    k->time += 0.02 * sin(2.0 * i); /* uneven time steps */
    pags_rng_normal2(1, 0, (uint64_t)i, random);
    pags_rng_normal2(1, 1, (uint64_t)i, random + 2);
    for (int j = 0; j < 3; j++) {
      k->rotation[j] = 0.1 * tanh(random[j]);
      k->translation[j] = 0.25 * tanh(random[(j + 1) % 4]);
    }
    true_pose(k->time, truth);
    pags_increment_matrix(k->rotation, k->translation, off);
    pags_rigid_inverse(off, back);
    pags_rigid_multiply(truth, back, k->world_from_object);
  }
  for (int i = 0; i < held_out_count; i++) {
    object.keyframes[held_out[i]].trained = 0;
    object.keyframes[held_out[i]].translation[0] = 1e9;
  }
  return object;
}

/* A track with constant accelerations is reproduced to rounding: at trained keyframes, between them, and at single
 * held-out keyframes. */
static void a_trained_track_follows_its_trained_keyframes(void **state) {
  (void)state;
  const int held_out[] = {2, 4, 8};
  pags_object object = trained_sample(12, held_out, 3);
  double pose[12], truth[12];
  for (double time = object.keyframes[0].time; time <= object.keyframes[11].time; time += 0.003) {
    true_pose(time, truth);
    assert_true(pags_object_pose(&object, time, pose));
    assert_true(difference(pose, truth) < 1e-8);
  }
  for (int i = 0; i < 12; i++) {
    true_pose(object.keyframes[i].time, truth);
    assert_true(pags_object_pose(&object, object.keyframes[i].time, pose));
    assert_true(difference(pose, truth) < 1e-8);
  }
  /* Without increments the pose at a keyframe is its label, whether held out or not. */
  for (int i = 0; i < 12; i++)
    memset(object.keyframes[i].rotation, 0, 6 * sizeof(double));
  for (int i = 0; i < 12; i++) {
    assert_true(pags_object_pose(&object, object.keyframes[i].time, pose));
    assert_memory_equal(pose, object.keyframes[i].world_from_object, sizeof pose);
  }
  pags_object_destroy(&object);
}

/* Neither position nor velocity jumps between keyframes, however irregular the keyframes are. */
static void a_trained_track_has_no_corners(void **state) {
  (void)state;
  const int held_out[] = {5};
  pags_object object = trained_sample(9, held_out, 1);
  const double h = 1e-4;
  for (int i = 0; i < 9; i++)
    for (int j = 0; j < 3; j++)
      object.keyframes[i].translation[j] += 0.3 * sin(5.0 * i + j);
  for (int i = 1; i < 8; i++) {
    double p[5][12], largest = 0;
    for (int j = 0; j < 5; j++)
      assert_true(pags_object_pose(&object, object.keyframes[i].time + (j - 2) * h, p[j]));
    /* One-sided differences of second order: a jump of the velocity by 1 m/s would give 1. */
    for (int k = 0; k < 12; k++)
      largest =
          fmax(largest, fabs((-3 * p[2][k] + 4 * p[3][k] - p[4][k]) - (3 * p[2][k] - 4 * p[1][k] + p[0][k])) / (2 * h));
    assert_true(largest < 0.01);
  }
  pags_object_destroy(&object);
}

/* Before the first and after the last trained keyframe, and in gaps of several held-out keyframes, the pose is the
 * label with the increments of the neighbouring trained keyframes. */
static void labels_are_corrected_by_neighbours(void **state) {
  (void)state;
  const int held_out[] = {0, 3, 4, 7};
  pags_object object = trained_sample(8, held_out, 4);
  double pose[12], motion[12], expected[12], rotation[3], translation[3];
  for (int n = 0; n < 4; n++) {
    const pags_keyframe *k = &object.keyframes[held_out[n]], *a = &object.keyframes[n == 0 ? 1 : n == 3 ? 6 : 2];
    const pags_keyframe *b = &object.keyframes[n == 0 ? 1 : n == 3 ? 6 : 5];
    const double share = b > a ? (k->time - a->time) / (b->time - a->time) : 0;
    for (int i = 0; i < 3; i++) {
      rotation[i] = (1 - share) * a->rotation[i] + share * b->rotation[i];
      translation[i] = (1 - share) * a->translation[i] + share * b->translation[i];
    }
    pags_increment_matrix(rotation, translation, motion);
    pags_rigid_multiply(k->world_from_object, motion, expected);
    assert_true(pags_object_pose(&object, k->time, pose));
    assert_true(difference(pose, expected) < 1e-9);
  }
  for (int i = 0; i < 8; i++)
    object.keyframes[i].trained = 0;
  assert_true(pags_object_pose(&object, object.keyframes[1].time, pose));
  assert_memory_equal(pose, object.keyframes[1].world_from_object, sizeof pose);
  pags_object_destroy(&object);
}

/* Rotation matrix of a rotation vector by the power series of the matrix exponential in long double. */
static void series(const double rotation[3], double out[9]) {
  const long double w[9] = {0, -rotation[2], rotation[1], rotation[2], 0, -rotation[0], -rotation[1], rotation[0], 0};
  long double term[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, sum[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, next[9];
  for (int n = 1; n < 60; n++) {
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        next[3 * i + j] =
            (term[3 * i] * w[j] + term[3 * i + 1] * w[3 + j] + term[3 * i + 2] * w[6 + j]) / (long double)n;
    memcpy(term, next, sizeof term);
    for (int i = 0; i < 9; i++)
      sum[i] += term[i];
  }
  for (int i = 0; i < 9; i++)
    out[i] = (double)sum[i];
}

static void the_exponential_is_exact(void **state) {
  (void)state;
  const double lengths[] = {0, 1e-12, 1e-5, 0.9e-4, 1.1e-4, 0.01, 1, 3.1, 6};
  for (uint64_t i = 0; i < 9; i++)
    for (uint64_t seed = 0; seed < 20; seed++) {
      double q[4], m[12], expected[9], norm;
      pags_rng_normal2(seed, 0, i, q);
      pags_rng_normal2(seed, 1, i, q + 2);
      norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
      const double rotation[3] = {q[0] / norm * lengths[i], q[1] / norm * lengths[i], q[2] / norm * lengths[i]};
      const double translation[3] = {1, -2, q[3]};
      pags_increment_matrix(rotation, translation, m);
      series(rotation, expected);
      for (int r = 0; r < 3; r++) {
        assert_true(m[4 * r + 3] == translation[r]);
        for (int c = 0; c < 3; c++)
          assert_true(fabs(m[4 * r + c] - expected[3 * r + c]) < 1e-14);
      }
      double back[3]; /* the rotation vector of length <= pi of the same rotation */
      const double turns = lengths[i] > 3.141592653589793 ? 1 - 6.283185307179586 / lengths[i] : 1;
      pags_increment_rotation(m, back);
      for (int r = 0; r < 3; r++)
        assert_true(fabs(back[r] - turns * rotation[r]) < 1e-13);
    }
}

static void destroying_zeroes(void **state) {
  (void)state;
  pags_object object = sample(3), zero;
  pags_object_destroy(&object);
  memset(&zero, 0, sizeof zero);
  assert_memory_equal(&object, &zero, sizeof zero);
  pags_object_destroy(&object);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(names_become_categories),
      cmocka_unit_test(objects_move_by_travel_or_spread),
      cmocka_unit_test(jitter_does_not_count_as_motion),
      cmocka_unit_test(pedestrians_in_short_clips_move),
      cmocka_unit_test(keyframes_keep_their_pose),
      cmocka_unit_test(between_keyframes_labels_are_interpolated),
      cmocka_unit_test(tracks_extend_by_half_a_spacing),
      cmocka_unit_test(a_trained_track_follows_its_trained_keyframes),
      cmocka_unit_test(a_trained_track_has_no_corners),
      cmocka_unit_test(labels_are_corrected_by_neighbours),
      cmocka_unit_test(the_exponential_is_exact),
      cmocka_unit_test(destroying_zeroes),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
