/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the synthetic street as a Waymo segment and imports it: poses, boxes, points, masks and pictures are the
 * same. */
#include <pags/import.h>
#include <pags/synth.h>

#include "raw_waymo.h"
#include "unit/waymo_check.h"

enum { FRAMES = 5, CAMERAS = 3 };

typedef struct street {
  scratch s;
  char path[3][256]; /* folders of the street, the segment and the imported set */
  pags_dataset *made, *imported;
} street;

static const char *file_in(const char *root, const char *folder, int frame, int camera, const char *extension) {
  static char path[2][384];
  static int next;
  char *out = path[next++ % 2];
  snprintf(out, sizeof path[0], "%s/%s/%03d_%d%s", root, folder, frame, camera, extension);
  return out;
}

static int begin(void **state) {
  static street st;
  static const char *const names[] = {"street", "segment.tfrecord", "imported"};
  pags_street_options options = pags_street_options_default();
  options.width = 160;
  options.height = 96;
  options.frames = FRAMES;
  options.cameras = CAMERAS;
  options.samples = 1;
  options.lidar_points = 3000;
  options.shifts = 0;
  scratch_begin(&st.s);
  for (int i = 0; i < 3; i++)
    snprintf(st.path[i], sizeof st.path[i], "%s", scratch_path(&st.s, names[i]));
  pags_tasks *tasks = pags_tasks_create(2);
  assert_non_null(tasks);
  scratch_ok(pags_synth_street(st.path[0], &options, tasks, NULL, NULL));
  raw_waymo_write(st.path[0], st.path[1]);
  scratch_ok(pags_import_waymo(st.path[1], st.path[2], NULL, tasks, NULL, NULL));
  pags_tasks_destroy(tasks);
  pags_dataset_options reading = pags_dataset_options_default();
  scratch_ok(pags_dataset_open(st.path[0], &reading, &st.made));
  scratch_ok(pags_dataset_open(st.path[2], &reading, &st.imported));
  *state = &st;
  return 0;
}

static int end(void **state) {
  street *st = *state;
  pags_dataset_close(st->made);
  pags_dataset_close(st->imported);
  scratch_end(&st->s);
  return 0;
}

/* The street's car rolls and pitches by 0.003 rad. Waymo's labels are upright in the car's frame, so that boxes lose
 * this tilt. */
static void poses_and_boxes_round_trip(void **state) {
  const street *st = *state;
  check_same_views(st->made, st->imported, 1e-9, 1e-12);
  check_same_objects(st->made, st->imported, 1e-9, 0.005);
  assert_true(pags_dataset_object_count(st->imported) > 4);
}

static void points_round_trip(void **state) {
  const street *st = *state;
  assert_int_equal(pags_dataset_sweep_count(st->imported), FRAMES);
  for (int64_t t = 0; t < FRAMES; t++)
    check_same_points(st->made, st->imported, t, 0.9, 1e-4);
}

/* Label ids for which Waymo has no class (wall, fence, terrain, train) become the nearest class. */
static void labels_round_trip(void **state) {
  const street *st = *state;
  int64_t compared = 0;
  for (int t = 0; t < FRAMES; t++)
    for (int c = 0; c < CAMERAS; c++) {
      pags_image made, imported, sky;
      scratch_ok(pags_image_load(file_in(st->path[0], "semantic", t, c, ".png"), PAGS_U8, 1, &made));
      scratch_ok(pags_image_load(file_in(st->path[2], "semantic", t, c, ".png"), PAGS_U8, 1, &imported));
      scratch_ok(pags_image_load(file_in(st->path[2], "sky_masks", t, c, ".png"), PAGS_U8, 1, &sky));
      assert_int_equal(made.width, imported.width);
      for (size_t i = 0; i < (size_t)made.width * (size_t)made.height; i++) {
        const uint8_t id = ((uint8_t *)made.data)[i];
        assert_int_equal(((uint8_t *)sky.data)[i], id == 10 ? 255 : 0);
        if (id == 3 || id == 4 || id == 9 || id == 16)
          continue;
        assert_int_equal(((uint8_t *)imported.data)[i], id);
        compared++;
      }
      pags_image_destroy(&made);
      pags_image_destroy(&imported);
      pags_image_destroy(&sky);
    }
  assert_true(compared > FRAMES * CAMERAS * 160 * 96 / 2);
}

/* The street's pictures are PNG, Waymo's are JPEG, which sets the tolerance. */
static void pictures_round_trip(void **state) {
  const street *st = *state;
  for (int t = 0; t < FRAMES; t++)
    for (int c = 0; c < CAMERAS; c++) {
      pags_image made, imported;
      double difference = 0;
      scratch_ok(pags_image_load(file_in(st->path[0], "images", t, c, ".png"), PAGS_U8, 1, &made));
      scratch_ok(pags_image_load(file_in(st->path[2], "images", t, c, ".jpg"), PAGS_U8, 1, &imported));
      for (size_t i = 0; i < (size_t)160 * 96; i++)
        difference += fabs((double)((uint8_t *)made.data)[i] - (double)((uint8_t *)imported.data)[i]);
      assert_true(difference / (160 * 96) < 4);
      pags_image_destroy(&made);
      pags_image_destroy(&imported);
    }
}

/* The street's dynamic masks are the exact outlines of visible parts. The imported masks are outlines of whole boxes
 * and must contain the exact ones. */
static void dynamic_masks_round_trip(void **state) {
  const street *st = *state;
  int64_t exact = 0, boxes = 0, both = 0;
  for (int t = 0; t < FRAMES; t++)
    for (int c = 0; c < CAMERAS; c++) {
      pags_image made, imported;
      scratch_ok(pags_image_load(file_in(st->path[0], "dynamic_masks/vehicle", t, c, ".png"), PAGS_U8, 1, &made));
      scratch_ok(pags_image_load(file_in(st->path[2], "dynamic_masks/vehicle", t, c, ".png"), PAGS_U8, 1, &imported));
      for (size_t i = 0; i < (size_t)160 * 96; i++) {
        const int seen = ((uint8_t *)made.data)[i] != 0, drawn = ((uint8_t *)imported.data)[i] != 0;
        exact += seen;
        boxes += drawn;
        both += seen && drawn;
      }
      pags_image_destroy(&made);
      pags_image_destroy(&imported);
    }
  assert_true(exact > 1000);
  assert_true((double)both > 0.99 * (double)exact && boxes < 3 * exact);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(poses_and_boxes_round_trip), cmocka_unit_test(points_round_trip),
      cmocka_unit_test(labels_round_trip),          cmocka_unit_test(pictures_round_trip),
      cmocka_unit_test(dynamic_masks_round_trip),
  };
  return cmocka_run_group_tests(tests, begin, end);
}
