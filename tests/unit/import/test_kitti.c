/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the KITTI importer: raw recordings written from a driving set give the same set; an import can be stopped
 * and resumed; bad input is refused. */
#include "unit/import_check.h"

#include "base/json.h"
#include "base/log.h"
#include "shared_data.h"
#include "unit/driving_tree.h"

static scratch s;
static pags_dataset *dataset;
static pags_tasks *tasks;

static char *path_of(const char *name) {
  char *path = pags_path_join(s.folder, name);
  assert_non_null(path);
  return path;
}

static raw_kitti source(int digits) {
  return (raw_kitti){.dataset = dataset, .sensor = 0, .right = 1, .baseline = 0.5327, .kitti_digits = digits};
}

static pags_result import(const char *from, const char *to, const pags_import_options *options) {
  char *source_path = path_of(from), *folder = path_of(to);
  const pags_result result = pags_import_kitti(source_path, folder, options, tasks, NULL, NULL);
  free(source_path);
  free(folder);
  return result;
}

static import_error check(const raw_kitti *raw, const char *name, double size_slack) {
  char *folder = path_of(name);
  const import_error error = check_import(raw, folder, size_slack, 0);
  free(folder);
  return error;
}

static int begin(void **state) {
  const pags_dataset_options options = pags_dataset_options_default();
  (void)state;
  tasks = pags_tasks_create(2);
  scratch_begin(&s);
  scratch set = s;
  snprintf(set.folder + strlen(set.folder), sizeof set.folder - strlen(set.folder), "/set");
  tree_write(&set, &tree_kinds[2]);
  char *folder = path_of("set");
  scratch_ok(pags_dataset_open(
      folder,
      &(pags_dataset_options){
          .downscale = 1, .split_every = 0, .kind = "kitti", .frame_last = -1, .random_points = options.random_points},
      &dataset));
  free(folder);
  char *all = path_of("all"), *few = path_of("few");
  raw_kitti raw = source(0);
  scratch_ok(raw_kitti_write_tracking(&raw, all));
  scratch_ok(raw_kitti_write_drive(&raw, all));
  raw = source(1);
  scratch_ok(raw_kitti_write_tracking(&raw, few));
  scratch_ok(raw_kitti_write_drive(&raw, few));
  free(all);
  free(few);
  return 0;
}

static int end(void **state) {
  (void)state;
  pags_dataset_close(dataset);
  pags_tasks_destroy(tasks);
  scratch_end(&s);
  return 0;
}

/* ---- The imported data ---- */

/* If the raw files have all digits, the only error is the rounding of Mercator coordinates, which are scaled by the
 * Earth's radius of 6,378 km: 1e-9 m. */
static void check_all_digits(const char *from, const char *to) {
  const raw_kitti raw = source(0);
  scratch_ok(import(from, to, NULL));
  const import_error e = check(&raw, to, 0);
  assert_true(e.view_place < 1e-7 && e.sweep_place < 1e-7 && e.box_place < 1e-7);
  assert_true(e.view_turn < 1e-9 && e.sweep_turn < 1e-9 && e.box_turn < 1e-9);
}

static void a_tracking_sequence_round_trips(void **state) {
  (void)state;
  check_all_digits("all", "tracking");
}

static void a_raw_drive_round_trips(void **state) {
  (void)state;
  check_all_digits("all/2011_09_26", "drive");
}

/* With as few digits as in KITTI's files: latitude to 1e-12 degrees (1e-7 m), roll and pitch to 1e-6, labels to 1e-6
 * m and 1e-6 rad. Measured errors: sweeps 1.5e-7 m; cameras 0.9e-6 m, as they are 1.6 m from the inertial unit; boxes
 * 20 m away 3e-6 m; all turns 0.6e-6 rad. */
static void kittis_digits_bound_the_error(void **state) {
  static const char *const names[2][2] = {{"few", "tracking_few"}, {"few/2011_09_26", "drive_few"}};
  const raw_kitti raw = source(1);
  (void)state;
  for (int i = 0; i < 2; i++) {
    scratch_ok(import(names[i][0], names[i][1], NULL));
    const import_error e = check(&raw, names[i][1], 1e-6);
    assert_true(e.view_place < 2e-6 && e.sweep_place < 1e-6 && e.box_place < 2e-5);
    assert_true(e.view_turn < 1e-6 && e.sweep_turn < 1e-6 && e.box_turn < 2e-6);
    assert_true(e.view_turn > 1e-9); /* the raw files really were written with fewer digits */
  }
}

static void read_numbers(const pags_json *json, const char *key, const char *camera, int count, double *out) {
  const pags_json_value *value = pags_json_root(json);
  if (camera)
    scratch_ok(pags_json_object(json, value, key, &value));
  scratch_ok(pags_json_numbers(json, value, camera ? camera : key, count, out));
}

static void a_drive_has_times_and_velocities(void **state) {
  pags_json *json;
  double frames[TREE_FRAMES], left[TREE_FRAMES], right[TREE_FRAMES], lidar[2 * TREE_FRAMES], velocity[6 * TREE_FRAMES];
  char *path = path_of("drive/timestamps.json");
  (void)state;
  scratch_ok(pags_json_parse_file(path, &json));
  free(path);
  read_numbers(json, "frames", NULL, TREE_FRAMES, frames);
  read_numbers(json, "cameras", "0", TREE_FRAMES, left);
  read_numbers(json, "cameras", "1", TREE_FRAMES, right);
  read_numbers(json, "lidar", NULL, 2 * TREE_FRAMES, lidar);
  read_numbers(json, "velocity", "1", 6 * TREE_FRAMES, velocity);
  for (int t = 0; t < TREE_FRAMES; t++) {
    assert_true(fabs(frames[t] - raw_kitti_time - 0.5 * t) < 1e-6 && left[t] == frames[t] &&
                fabs(right[t] - left[t] - 0.001) < 1e-6);
    assert_true(fabs(lidar[2 * t] - left[t] + 0.053) < 1e-6 && fabs(lidar[2 * t + 1] - left[t] - 0.047) < 1e-6);
  }
  /* The ego vehicle drives at 4 m/s along x and 1 m/s along y and turns at 0.2 rad/s. The imported velocity is that
   * of the Velodyne. Because of the turn the inertial unit moves relative to it at 0.17 m/s, which the writer's
   * differences over a second give to 1 %. */
  const double *v = velocity + 6 * 2;
  assert_true(fabs(v[0] - 4) < 0.003 && fabs(v[1] - 1) < 0.003 && fabs(v[2]) < 1e-6);
  assert_true(fabs(v[3]) < 1e-6 && fabs(v[4]) < 1e-6 && fabs(v[5] - 0.2) < 1e-6);
  pags_json_destroy(json);
}

static void a_tracking_set_has_no_exposure_times(void **state) {
  pags_json *json;
  double frames[TREE_FRAMES];
  char *path = path_of("tracking/timestamps.json");
  (void)state;
  scratch_ok(pags_json_parse_file(path, &json));
  free(path);
  read_numbers(json, "frames", NULL, TREE_FRAMES, frames);
  assert_true(frames[0] == 0 && frames[3] == 0.3);
  assert_null(pags_json_member(pags_json_root(json), "cameras"));
  assert_non_null(pags_json_member(pags_json_root(json), "velocity"));
  pags_json_destroy(json);
}

/* ---- Options ---- */

static void frames_and_cameras_are_chosen(void **state) {
  pags_import_options options = pags_import_options_default();
  const pags_dataset_options reading = pags_dataset_options_default();
  pags_dataset *part;
  (void)state;
  options.frame_first = 1;
  options.frame_last = 3;
  options.cameras = "1";
  options.sequence = "0000";
  scratch_ok(import("all", "part", &options));
  char *folder = path_of("part");
  scratch_ok(pags_dataset_open(folder, &reading, &part));
  free(folder);
  assert_int_equal(pags_dataset_view_count(part), 3);
  assert_string_equal(pags_dataset_view(part, 0)->name, "000_1.png");
  assert_same_file(pags_dataset_view(part, 0)->image_path, view_of(dataset, 1, 1)->image_path);
  /* The frames of a part have the same world coordinates as the whole sequence. */
  double place = 0, turn = 0;
  compare_pose(pags_dataset_sweep(part, 0)->world_from_sweep, pags_dataset_sweep(dataset, 1)->world_from_sweep,
               pags_dataset_sweep(dataset, 0)->world_from_sweep, &place, &turn);
  assert_true(place < 1e-7 && turn < 1e-9);
  const pags_place where = pags_dataset_place(part);
  assert_true(where.known && fabs(where.latitude - 49.015) < 1e-4 && fabs(where.longitude - 8.4343) < 1e-4);
  assert_int_equal(pags_dataset_object(part, 1)->keyframe_count, 3);
  assert_int_equal(pags_dataset_object(part, 1)->keyframes[0].frame, 0);
  pags_dataset_close(part);
}

static void options_out_of_range_are_refused(void **state) {
  static const struct {
    const char *cameras;
    int64_t first, last;
    const char *sequence, *part;
  } cases[] = {{"0,2", 0, -1, NULL, "cameras: expected numbers of 0..1"},
               {"1,1", 0, -1, NULL, "named twice"},
               {"", 0, -1, NULL, "cameras: expected"},
               {"0,", 0, -1, NULL, "cameras: expected"},
               {NULL, 5, -1, NULL, "frames: nothing is left"},
               {NULL, 3, 2, NULL, "frames: nothing is left"},
               {NULL, 0, -1, "0007", "lacks image_02/0007, image_03/0007, calib/0007.txt, oxts/0007.txt"},
               {NULL, 0, -1, "../0000", "sequence: expected a name"}};
  (void)state;
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    pags_import_options options = pags_import_options_default();
    options.cameras = cases[i].cameras;
    options.frame_first = cases[i].first;
    options.frame_last = cases[i].last;
    options.sequence = cases[i].sequence;
    const pags_result result = import("all", "none", &options);
    scratch_expect(result, result == PAGS_ERROR_IO ? PAGS_ERROR_IO : PAGS_ERROR_ARGUMENT, cases[i].part);
  }
  char *none = path_of("none");
  assert_false(pags_path_exists(none));
  free(none);
}

/* ---- Stopping and resuming ---- */

static void compare_trees(const char *a, const char *b) {
  pags_dir_list x, y;
  scratch_ok(pags_dir_list_read(a, &x));
  scratch_ok(pags_dir_list_read(b, &y));
  assert_int_equal(x.count, y.count);
  for (int64_t i = 0; i < x.count; i++) {
    char *p = pags_path_join(a, x.names[i]), *q = pags_path_join(b, y.names[i]);
    assert_string_equal(x.names[i], y.names[i]);
    if (pags_dir_exists(p))
      compare_trees(p, q);
    else
      assert_same_file(p, q);
    free(p);
    free(q);
  }
  pags_dir_list_destroy(&x);
  pags_dir_list_destroy(&y);
}

static void compare_imports(const char *a, const char *b) {
  char *x = path_of(a), *y = path_of(b);
  compare_trees(x, y);
  free(x);
  free(y);
}

static int stop(void *user, double fraction, const char *what) {
  (void)fraction, (void)what;
  return --*(int *)user > 0;
}

static void a_stopped_import_resumes(void **state) {
  char *from = path_of("all"), *folder = path_of("stopped"), *path;
  int calls = 1;
  (void)state;
  scratch_expect(pags_import_kitti(from, folder, NULL, tasks, stop, &calls), PAGS_CANCELLED, "cancel");
  path = pags_path_join(folder, "dataset.json");
  assert_false(pags_file_exists(path));
  free(path);
  scratch_ok(import("all", "stopped", NULL));
  compare_imports("stopped", "tracking");
  /* An existing file is kept, whatever its contents; a missing one is written again; an unfinished ".part" file
   * doesn't count. */
  path = pags_path_join(folder, "ego_pose/001.txt");
  scratch_ok(pags_file_write(path, "kept", 4));
  free(path);
  path = pags_path_join(folder, "dataset.json");
  assert_true(pags_port_remove_file(path));
  free(path);
  path = pags_path_join(folder, "lidar/002.bin");
  char *part = pags_path_join(folder, "lidar/002.bin.part");
  assert_int_equal(rename(path, part), 0);
  free(path);
  free(part);
  scratch_ok(import("all", "stopped", NULL));
  path = pags_path_join(folder, "ego_pose/001.txt");
  uint8_t *bytes;
  size_t size;
  scratch_ok(pags_file_read(path, &bytes, &size));
  assert_true(size == 4 && !memcmp(bytes, "kept", 4));
  free(bytes);
  free(path);
  char *expected = path_of("tracking/lidar/002.bin");
  path = pags_path_join(folder, "lidar/002.bin");
  assert_same_file(path, expected);
  free(path);
  free(expected);
  free(from);
  free(folder);
}

static void any_number_of_threads_gives_the_same_bytes(void **state) {
  pags_tasks *one = pags_tasks_create(1);
  char *from = path_of("all"), *folder = path_of("one");
  (void)state;
  scratch_ok(pags_import_kitti(from, folder, NULL, one, NULL, NULL));
  compare_imports("one", "tracking");
  pags_tasks_destroy(one);
  free(from);
  free(folder);
}

static void foreign_folders_are_refused(void **state) {
  pags_import_options options = pags_import_options_default();
  (void)state;
  scratch_text(&s, "taken/notes.txt", "mine");
  scratch_text(&s, "taken/images/000_7.png", "old");
  scratch_expect(import("all", "taken", NULL), PAGS_ERROR_IO, "holds something else already");
  options.overwrite = 1;
  scratch_ok(import("all", "taken", &options));
  char *mine = path_of("taken/notes.txt"), *old = path_of("taken/images/000_7.png");
  assert_true(pags_file_exists(mine));
  assert_false(pags_file_exists(old));
  free(mine);
  free(old);
  scratch_ok(import("all", "taken", NULL));
  options.overwrite = 0;
  options.frame_last = 2;
  scratch_expect(import("all", "taken", &options), PAGS_ERROR_IO, "begun from another source or with other options");
  options.overwrite = 1;
  scratch_ok(import("all", "taken", &options));
  old = path_of("taken/images/003_0.png");
  assert_false(pags_file_exists(old));
  free(old);
}

/* ---- Missing and damaged files ---- */

static void missing_parts_of_samples_are_named(void **state) {
  static const struct {
    const char *name;
    pags_result code;
    const char *parts[3];
  } cases[] = {
      {"kitti/object", PAGS_ERROR_UNSUPPORTED, {"object benchmark", "single photographs", "raw recording is needed"}},
      {"kitti/raw_2011_09_26", PAGS_ERROR_IO, {"oxts/data", "image_02/timestamps.txt", "calib_imu_to_velo.txt"}},
      {"kitti/tracking", PAGS_ERROR_IO, {"image_02/0000", "calib/0000.txt", "oxts/0000.txt"}},
      {"kitti/odometry_clip_1", PAGS_ERROR_UNSUPPORTED, {"odometry benchmark", "isn't imported", "raw recording"}}};
  char path[512];
  (void)state;
  for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
    if (!pags_shared_data(cases[i].name, path, sizeof path))
      skip();
    char *folder = path_of("none");
    const pags_result result = pags_import_kitti(path, folder, NULL, tasks, NULL, NULL);
    for (int k = 0; k < 3; k++)
      scratch_expect(result, cases[i].code, cases[i].parts[k]);
    assert_false(pags_path_exists(folder));
    free(folder);
  }
}

/* Imports while the file is renamed away, then puts it back. */
static pags_result import_without(const char *file, const char *from) {
  char *path = path_of(file), *away = path_of("away");
  assert_int_equal(rename(path, away), 0);
  const pags_result result = import(from, "none", NULL);
  assert_true(pags_port_rename(away, path));
  free(path);
  free(away);
  return result;
}

static void missing_files_are_named(void **state) {
  (void)state;
  scratch_expect(import_without("all/image_03/0000/000002.png", "all"), PAGS_ERROR_IO,
                 "lacks image_03/0000/000002.png");
  scratch_expect(import_without("all/oxts/0000.txt", "all"), PAGS_ERROR_IO, "lacks oxts/0000.txt");
  scratch_expect(import_without("all/" RAW_KITTI_DRIVE "/oxts/data/0000000003.txt", "all/2011_09_26"), PAGS_ERROR_IO,
                 "lacks oxts/data/0000000003.txt");
  scratch_expect(import_without("all/2011_09_26/calib_velo_to_cam.txt", "all/2011_09_26"), PAGS_ERROR_IO,
                 "calib_velo_to_cam.txt");
  scratch_expect(import("nowhere", "none", NULL), PAGS_ERROR_IO, "nowhere: no such folder");
}

/* Imports while the file has other contents, then restores it. */
static pags_result import_with(const char *file, const char *text, const char *from, const char *to) {
  char *path = path_of(file), *away = path_of("away");
  assert_int_equal(rename(path, away), 0);
  scratch_ok(pags_file_write(path, text, strlen(text)));
  const pags_result result = import(from, to, NULL);
  assert_true(pags_port_rename(away, path));
  free(path);
  free(away);
  return result;
}

/* Counts the warnings and keeps the last one. */
static int warnings;
static char last_warning[1024];

static void take_warning(void *user, pags_log_level level, const char *line) {
  (void)user;
  if (level != PAGS_LOG_WARNING)
    return;
  warnings++;
  snprintf(last_warning, sizeof last_warning, "%s", line);
}

static void faults_of_raw_drives_cause_warnings(void **state) {
#define AT(s) "2011-09-26 13:02:" s "\n"
#define TRACKLET(height, first)                                                            \
  "<item><objectType>Car</objectType><h>" height "</h><w>2</w><l>4</l><first_frame>" first \
  "</first_frame><poses><item><tx>9</tx><ty>0</ty><tz>0</tz><rx>0</rx><ry>0</ry><rz>0</rz></item></poses></item>"
#define TRACKLETS(items) "<boost_serialization><tracklets>" items "</tracklets></boost_serialization>"
  static const struct {
    const char *file, *text, *warning; /* NULL: no warning */
  } cases[] = {
      {"/image_02/timestamps.txt", "\n" AT("01.1") AT("01.2") "\n" AT("01.4"),
       "2 of 5 times are empty lines and were filled in; the first is frame 0's"},
      {"/velodyne_points/timestamps_start.txt", AT("01.0") "\n" AT("01.2") "\n", NULL},
      {"/tracklet_labels.xml", TRACKLETS(TRACKLET("2", "4")), NULL},
      {"/tracklet_labels.xml", TRACKLETS(TRACKLET("2", "5")),
       "the boxes of 1 of 1 tracklets past frame 4, the last photograph's, are left out; the first is tracklet "
       "0, a Car of frames 5 to 5"},
      {"/tracklet_labels.xml", TRACKLETS(TRACKLET("0", "2") TRACKLET("2", "2")),
       "1 of 2 tracklets are left out, having no poses or no size; the first is tracklet 0, a Car of frame 2"}};
  (void)state;
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    char file[256], to[32];
    snprintf(file, sizeof file, "all/" RAW_KITTI_DRIVE "%s", cases[i].file);
    snprintf(to, sizeof to, "told_%d", (int)i);
    warnings = 0;
    pags_log_set(take_warning, NULL);
    const pags_result result = import_with(file, cases[i].text, "all/2011_09_26", to);
    pags_log_set(NULL, NULL);
    scratch_ok(result);
    assert_int_equal(warnings, cases[i].warning != NULL);
    if (cases[i].warning && !strstr(last_warning, cases[i].warning))
      fail_msg("%s", last_warning);
  }
  scratch_expect(import_with("all/" RAW_KITTI_DRIVE "/tracklet_labels.xml", TRACKLETS(TRACKLET("0", "2")),
                             "all/2011_09_26", "flat"),
                 PAGS_ERROR_FORMAT, "1 tracklets, but none has a size; the first is tracklet 0, a Car of frame 2");
}

static void damaged_files_are_named(void **state) {
  (void)state;
  scratch_expect(import_with("all/oxts/0000.txt", "1 2 3\n", "all", "damaged"), PAGS_ERROR_FORMAT,
                 "oxts/0000.txt:1: expected 30 numbers");
  scratch_ok(import_with("all/label_02/0000.txt", "99 1 Car 0 0 0 0 0 0 0 1 1 1 0 0 9 0\n", "all", "late"));
  scratch_expect(import_with("all/label_02/0000.txt",
                             "1 1 Car 0 0 0 0 0 0 0 1 1 1 0 0 9 0\n0 1 Car 0 0 0 0 0 0 0 1 1 1 0 0 9 0\n1 1 Car 0 0 0 "
                             "0 0 0 0 1 1 1 0 0 9 0\n",
                             "all", "damaged"),
                 PAGS_ERROR_FORMAT, "track 1 has a box of frame 1 in line");
  scratch_expect(import_with("all/velodyne/0000/000001.bin", "odd", "all", "damaged"), PAGS_ERROR_FORMAT,
                 "velodyne/0000/000001.bin");
  scratch_expect(import_with("all/" RAW_KITTI_DRIVE "/image_02/timestamps.txt", "2011-09-26 13:02:25.1\n",
                             "all/2011_09_26", "damaged_raw"),
                 PAGS_ERROR_FORMAT, "timestamps.txt: expected a time for each of 5 frames, found 1");
  scratch_expect(import_with("all/" RAW_KITTI_DRIVE "/tracklet_labels.xml", "<a>", "all/2011_09_26", "damaged_raw"),
                 PAGS_ERROR_FORMAT, "tracklet_labels.xml:1:");
}

/* Sweeps and labels are optional: without them the imported set has none. */
static void sweeps_and_labels_are_optional(void **state) {
  const pags_dataset_options reading = pags_dataset_options_default();
  pags_dataset *part;
  char *velodyne = path_of("all/velodyne"), *away = path_of("velodyne"), *folder = path_of("bare");
  (void)state;
  assert_int_equal(rename(velodyne, away), 0);
  char *labels = path_of("all/label_02/0000.txt"), *hidden = path_of("labels");
  assert_int_equal(rename(labels, hidden), 0);
  const pags_result result = import("all", "bare", NULL);
  assert_int_equal(rename(away, velodyne), 0);
  assert_int_equal(rename(hidden, labels), 0);
  scratch_ok(result);
  scratch_ok(pags_dataset_open(folder, &reading, &part));
  assert_int_equal(pags_dataset_provides(part), 0);
  assert_int_equal(pags_dataset_view_count(part), 2 * TREE_FRAMES);
  pags_dataset_close(part);
  free(velodyne);
  free(away);
  free(labels);
  free(hidden);
  free(folder);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_tracking_sequence_round_trips),
      cmocka_unit_test(a_raw_drive_round_trips),
      cmocka_unit_test(kittis_digits_bound_the_error),
      cmocka_unit_test(a_drive_has_times_and_velocities),
      cmocka_unit_test(a_tracking_set_has_no_exposure_times),
      cmocka_unit_test(frames_and_cameras_are_chosen),
      cmocka_unit_test(options_out_of_range_are_refused),
      cmocka_unit_test(a_stopped_import_resumes),
      cmocka_unit_test(any_number_of_threads_gives_the_same_bytes),
      cmocka_unit_test(foreign_folders_are_refused),
      cmocka_unit_test(missing_parts_of_samples_are_named),
      cmocka_unit_test(missing_files_are_named),
      cmocka_unit_test(faults_of_raw_drives_cause_warnings),
      cmocka_unit_test(damaged_files_are_named),
      cmocka_unit_test(sweeps_and_labels_are_optional),
  };
  return cmocka_run_group_tests(tests, begin, end);
}
