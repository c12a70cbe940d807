/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the synthetic street as a raw recording of KITTI and imports it: poses, boxes, points and pictures are the
 * same. */
#include <pags/synth.h>

#include "unit/import_check.h"

typedef struct street {
  scratch s;
  pags_tasks *tasks;
  pags_dataset *dataset;
  raw_kitti raw;
} street;

static int begin(void **state) {
  static street st;
  pags_street_options options = pags_street_options_default();
  const pags_dataset_options reading = pags_dataset_options_default();
  options.width = 160;
  options.height = 96;
  options.frames = 6;
  options.cameras = 2;
  options.samples = 1;
  options.lidar_points = 2000;
  options.shifts = 0;
  st.tasks = pags_tasks_create(2);
  scratch_begin(&st.s);
  char *folder = pags_path_join(st.s.folder, "street"), *out = pags_path_join(st.s.folder, "raw");
  scratch_ok(pags_synth_street(folder, &options, st.tasks, NULL, NULL));
  scratch_ok(pags_dataset_open(folder, &reading, &st.dataset));
  st.raw = (raw_kitti){.dataset = st.dataset, .sensor = 0, .right = 1, .baseline = 0.5327};
  scratch_ok(raw_kitti_write_tracking(&st.raw, out));
  scratch_ok(raw_kitti_write_drive(&st.raw, out));
  free(folder);
  free(out);
  *state = &st;
  return 0;
}

static int end(void **state) {
  street *st = *state;
  pags_dataset_close(st->dataset);
  pags_tasks_destroy(st->tasks);
  scratch_end(&st->s);
  return 0;
}

static import_error import(street *st, const char *from, const char *to, double mask_share) {
  char *source = pags_path_join(st->s.folder, from), *folder = pags_path_join(st->s.folder, to);
  scratch_ok(pags_import_kitti(source, folder, NULL, st->tasks, NULL, NULL));
  const import_error error = check_import(&st->raw, folder, 0, mask_share);
  free(source);
  free(folder);
  return error;
}

static void check_poses(const import_error *e) {
  assert_true(e->view_place < 1e-6 && e->sweep_place < 1e-6 && e->box_place < 1e-6);
  assert_true(e->view_turn < 1e-8 && e->sweep_turn < 1e-8);
}

static void the_street_as_a_drive_round_trips(void **state) {
  const import_error e = import(*state, "raw/2011_09_26", "drive", 0);
  check_poses(&e);
  assert_true(e.box_turn < 1e-8);
}

/* The street's camera looks 0.02 rad down, and its car rolls and pitches by 0.003 rad. KITTI's labels have no tilt,
 * so boxes are read as upright in the camera's axes; this sets the tolerance. */
static void the_street_as_a_tracking_sequence_round_trips(void **state) {
  const import_error e = import(*state, "raw", "tracking", 0.05);
  check_poses(&e);
  assert_true(e.box_turn < 0.025 && e.box_turn > 0.015);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(the_street_as_a_drive_round_trips),
                                     cmocka_unit_test(the_street_as_a_tracking_sequence_round_trips)};
  return cmocka_run_group_tests(tests, begin, end);
}
