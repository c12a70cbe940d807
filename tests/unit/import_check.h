/* SPDX-License-Identifier: Apache-2.0 */
/* Compares an imported KITTI set with the driving set from which its raw files were written. */
#ifndef PAGS_TESTS_UNIT_IMPORT_CHECK_H
#define PAGS_TESTS_UNIT_IMPORT_CHECK_H

#include <math.h>
#include <pags/dataset.h>
#include <pags/import.h>

#include "raw_kitti.h"
#include "same_file.h"
#include "unit/scratch.h"

/* Largest differences between the poses of the imported set and the source: positions in metres, rotations in
 * radians. */
typedef struct import_error {
  double view_place, view_turn;
  double sweep_place, sweep_turn;
  double box_place, box_turn;
} import_error;

static inline double turn_between(const double a[12], const double b[12]) {
  double sum = 0; /* |A - B|_F = 2 sqrt(2) sin(angle / 2) */
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      sum += (a[4 * i + j] - b[4 * i + j]) * (a[4 * i + j] - b[4 * i + j]);
  return 2 * asin(fmin(1, sqrt(sum / 8)));
}

/* Compares two poses. `expected` is in the source's world, `found` in the import's world, whose origin is the
 * source's `origin`. */
static inline void compare_pose(const double found[12], const double expected[12], const double origin[12],
                                double *place, double *turn) {
  double sum = 0;
  for (int i = 3; i < 12; i += 4)
    sum += (found[i] - expected[i] + origin[i]) * (found[i] - expected[i] + origin[i]);
  *place = fmax(*place, sqrt(sum));
  *turn = fmax(*turn, turn_between(found, expected));
}

static inline const pags_view *view_of(const pags_dataset *dataset, int sensor, int frame) {
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++)
    if (pags_dataset_view(dataset, i)->sensor == sensor && pags_dataset_view(dataset, i)->frame == frame)
      return pags_dataset_view(dataset, i);
  fail_msg("no view of camera %d in frame %d", sensor, frame);
  return NULL;
}

static inline void check_import_views(const raw_kitti *raw, const pags_dataset *imported, const double origin[12],
                                      import_error *error) {
  const int frames = (int)pags_dataset_sweep_count(raw->dataset);
  assert_int_equal(pags_dataset_view_count(imported), 2 * frames);
  for (int t = 0; t < frames; t++) {
    const pags_view *source = view_of(raw->dataset, raw->sensor, t), *other = view_of(raw->dataset, raw->right, t);
    const pags_view *left = view_of(imported, 0, t), *right = view_of(imported, 1, t);
    double pose[12];
    memcpy(pose, source->camera.world_from_camera, sizeof pose);
    compare_pose(left->camera.world_from_camera, pose, origin, &error->view_place, &error->view_turn);
    for (int i = 0; i < 12; i += 4)
      pose[i + 3] += raw->baseline * pose[i];
    compare_pose(right->camera.world_from_camera, pose, origin, &error->view_place, &error->view_turn);
    for (int c = 0; c < 2; c++) {
      const pags_camera *a = &source->camera, *b = c ? &right->camera : &left->camera;
      assert_true(a->width == b->width && a->height == b->height);
      assert_true(fabs(a->fx - b->fx) < 1e-9 && fabs(a->fy - b->fy) < 1e-9 && fabs(a->cx - b->cx) < 1e-9 &&
                  fabs(a->cy - b->cy) < 1e-9);
    }
    assert_same_file(source->image_path, left->image_path);
    assert_same_file(other->image_path, right->image_path);
  }
}

static inline void check_import_sweeps(const raw_kitti *raw, const pags_dataset *imported, const double origin[12],
                                       import_error *error) {
  assert_int_equal(pags_dataset_sweep_count(imported), pags_dataset_sweep_count(raw->dataset));
  for (int64_t t = 0; t < pags_dataset_sweep_count(imported); t++) {
    int64_t m, n;
    float *x, *y;
    compare_pose(pags_dataset_sweep(imported, t)->world_from_sweep,
                 pags_dataset_sweep(raw->dataset, t)->world_from_sweep, origin, &error->sweep_place,
                 &error->sweep_turn);
    scratch_ok(pags_dataset_sweep_load(raw->dataset, t, &m, &x));
    scratch_ok(pags_dataset_sweep_load(imported, t, &n, &y));
    assert_int_equal(m, n);
    assert_memory_equal(x, y, (size_t)m * 3 * sizeof *x);
    free(x);
    free(y);
  }
}

/* Compares the objects; an imported object's id is its index in the source set. */
static inline void check_import_objects(const raw_kitti *raw, const pags_dataset *imported, const double origin[12],
                                        double size_slack, import_error *error) {
  assert_int_equal(pags_dataset_object_count(imported), pags_dataset_object_count(raw->dataset));
  for (int64_t i = 0; i < pags_dataset_object_count(imported); i++) {
    const pags_object *a = pags_dataset_object(raw->dataset, i), *b = pags_dataset_object(imported, i);
    assert_int_equal(strtol(b->id, NULL, 10), i);
    assert_string_equal(a->class_name, b->class_name);
    assert_int_equal(a->category, b->category);
    assert_int_equal(a->moving, b->moving);
    assert_int_equal(a->keyframe_count, b->keyframe_count);
    for (int k = 0; k < 3; k++)
      assert_true(fabs(a->size[k] - b->size[k]) <= size_slack);
    for (int64_t k = 0; k < a->keyframe_count; k++) {
      assert_int_equal(a->keyframes[k].frame, b->keyframes[k].frame);
      compare_pose(b->keyframes[k].world_from_object, a->keyframes[k].world_from_object, origin, &error->box_place,
                   &error->box_turn);
    }
  }
}

/* Compares an imported dynamic mask with the outlines of the source's moving boxes, drawn with the source's camera.
 * Up to `share` of the pixels, and four more whose centres lie on an outline, may differ. */
static inline void check_import_mask(const raw_kitti *raw, const char *folder, int frame, double share) {
  const pags_camera *camera = &view_of(raw->dataset, raw->sensor, frame)->camera;
  char path[512];
  pags_image mask;
  int64_t differ = 0;
  uint8_t *plane = calloc((size_t)camera->width, (size_t)camera->height);
  assert_non_null(plane);
  for (int64_t i = 0; i < pags_dataset_object_count(raw->dataset); i++) {
    const pags_object *object = pags_dataset_object(raw->dataset, i);
    for (int64_t k = 0; object->moving && k < object->keyframe_count; k++) {
      double corners[32];
      if (object->keyframes[k].frame != frame)
        continue;
      const int count = pags_box_outline(camera, object->keyframes[k].world_from_object, object->size, corners);
      pags_outline_fill(corners, count, camera->width, camera->height, camera->width, 255, plane);
    }
  }
  snprintf(path, sizeof path, "%s/dynamic_masks/all/%03d_0.png", folder, frame);
  scratch_ok(pags_image_load(path, PAGS_U8, 1, &mask));
  assert_true(mask.width == camera->width && mask.height == camera->height);
  for (int64_t i = 0; i < (int64_t)camera->width * camera->height; i++)
    differ += plane[i] != ((const uint8_t *)mask.data)[i];
  if ((double)differ > 4 + share * camera->width * camera->height)
    fail_msg("%s: %lld pixels differ from the boxes' outlines", path, (long long)differ);
  pags_image_destroy(&mask);
  free(plane);
}

/* Opens the imported set in `folder`, compares everything with the source and returns the largest differences of
 * poses. */
static inline import_error check_import(const raw_kitti *raw, const char *folder, double size_slack,
                                        double mask_share) {
  pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *imported;
  import_error error = {0};
  scratch_ok(pags_dataset_open(folder, &options, &imported));
  assert_string_equal(pags_dataset_kind(imported), "kitti");
  const double *origin = pags_dataset_sweep(raw->dataset, 0)->world_from_sweep;
  check_import_views(raw, imported, origin, &error);
  check_import_sweeps(raw, imported, origin, &error);
  check_import_objects(raw, imported, origin, size_slack, &error);
  for (int t = 0; t < pags_dataset_sweep_count(raw->dataset); t++)
    check_import_mask(raw, folder, t, mask_share);
  pags_dataset_close(imported);
  return error;
}

#endif
