/* SPDX-License-Identifier: Apache-2.0 */
/* Compares a driving set with the set imported from its Waymo segment. */
#ifndef PAGS_TESTS_UNIT_WAYMO_CHECK_H
#define PAGS_TESTS_UNIT_WAYMO_CHECK_H

#include "unit/scratch.h"

#include <math.h>

#include <pags/dataset.h>

static inline void check_same_pose(const double a[12], const double b[12], double place, double turn) {
  for (int k = 0; k < 12; k++)
    if (!(fabs(a[k] - b[k]) <= (k % 4 == 3 ? place : turn)))
      fail_msg("number %d of a pose is %.12g, expected %.12g", k, b[k], a[k]);
}

static inline void check_same_views(const pags_dataset *a, const pags_dataset *b, double place, double turn) {
  assert_int_equal(pags_dataset_view_count(a), pags_dataset_view_count(b));
  for (int64_t i = 0; i < pags_dataset_view_count(a); i++) {
    const pags_view *v = pags_dataset_view(a, i), *w = pags_dataset_view(b, i);
    assert_int_equal(v->frame, w->frame);
    assert_int_equal(v->sensor, w->sensor);
    assert_int_equal(v->camera.width, w->camera.width);
    assert_true(v->camera.fx == w->camera.fx && v->camera.cx == w->camera.cx);
    assert_true(fabs(v->camera.time - w->camera.time) < 1e-6);
    check_same_pose(v->camera.world_from_camera, w->camera.world_from_camera, place, turn);
  }
}

static inline const pags_object *object_of(const pags_dataset *set, const char *id) {
  for (int64_t i = 0; i < pags_dataset_object_count(set); i++)
    if (strcmp(pags_dataset_object(set, i)->id, id) == 0)
      return pags_dataset_object(set, i);
  fail_msg("there is no object '%s'", id);
  return NULL;
}

static inline void check_same_objects(const pags_dataset *a, const pags_dataset *b, double place, double turn) {
  assert_int_equal(pags_dataset_object_count(a), pags_dataset_object_count(b));
  for (int64_t i = 0; i < pags_dataset_object_count(a); i++) {
    const pags_object *o = pags_dataset_object(a, i), *p = object_of(b, o->id);
    assert_int_equal(o->category, p->category);
    assert_int_equal(o->moving, p->moving);
    assert_int_equal(o->keyframe_count, p->keyframe_count);
    for (int k = 0; k < 3; k++)
      assert_true(fabs(o->size[k] - p->size[k]) < 1e-12);
    for (int64_t t = 0; t < o->keyframe_count; t++) {
      assert_int_equal(o->keyframes[t].frame, p->keyframes[t].frame);
      check_same_pose(o->keyframes[t].world_from_object, p->keyframes[t].world_from_object, place, turn);
    }
  }
}

static inline double point_distance(const float *p, const float *q) {
  const double x = (double)(p[0] - q[0]), y = (double)(p[1] - q[1]), z = (double)(p[2] - q[2]);
  return sqrt(x * x + y * y + z * z);
}

/* Returns the distance of a point from the position of the roof LiDAR that raw_waymo.c writes. */
static inline double point_range(const float *p) {
  const float roof[3] = {1.43f, 0, 2.18f};
  return point_distance(p, roof);
}

/* Every imported point lies within half a beam's spacing of a source point, and at least `share` of the source
 * points are imported. */
static inline void check_same_points(const pags_dataset *a, const pags_dataset *b, int64_t sweep, double share,
                                     double poses) {
  int64_t given, got;
  float *p, *q;
  scratch_ok(pags_dataset_sweep_load(a, sweep, &given, &p));
  scratch_ok(pags_dataset_sweep_load(b, sweep, &got, &q));
  if (!((double)got >= share * (double)given && got <= given))
    fail_msg("sweep %lld has %lld points, expected %lld", (long long)sweep, (long long)got, (long long)given);
  const double beam = hypot(0.5 * 1.4 / 192, 3.15 / 2048);
  for (int64_t i = 0; i < got; i++) {
    double least = 1e9;
    for (int64_t k = 0; k < given && least > 0; k++)
      least = fmin(least, point_distance(p + 3 * k, q + 3 * i) - beam * point_range(p + 3 * k) - poses);
    if (least > 0)
      fail_msg("point %lld of sweep %lld is %g m off", (long long)i, (long long)sweep, least);
  }
  free(p);
  free(q);
}

#endif
