/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of the readers of data sets: transforms.json, COLMAP models, driving sets' texts and boxes, point
 * clouds. */
#include "fuzz/fuzz.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/text.h"
#include "dataset/colmap.h"
#include "dataset/driving/reader.h"

static void check_draft(const pags_parsed_dataset *parsed) {
  for (int64_t i = 0; i < parsed->count; i++)
    FUZZ_CHECK(parsed->views[i].image_path && parsed->views[i].where);
  for (int64_t i = 0; i < parsed->points.count; i++) {
    const pags_parsed_point *const p = &parsed->points.items[i];
    FUZZ_CHECK(isfinite(p->xyz[0]) && isfinite(p->xyz[1]) && isfinite(p->xyz[2]));
    FUZZ_CHECK(p->track_begin >= 0 && p->track_count >= 0 &&
               p->track_begin + p->track_count <= parsed->points.track_count);
  }
}

/* Opens the whole data set; it rarely opens, as all of its pictures are missing. */
static void open_dataset(const char *folder) {
  pags_dataset *dataset;
  pags_dataset_options options = pags_dataset_options_default();
  options.allow_missing = 1;
  options.random_points = 10;
  const pags_result result = pags_dataset_open(folder, &options, &dataset);
  if (result == PAGS_OK)
    pags_dataset_close(dataset);
  else
    fuzz_refused(result, "");
}

/* ---- transforms.json ---- */

static int run_transforms(const uint8_t *data, size_t size) {
  pags_parsed_dataset parsed;
  const pags_result result = pags_transforms_read(fuzz_file("set/transforms.json", data, size), false, &parsed);
  if (result != PAGS_OK) {
    pags_parsed_destroy(&parsed);
    fuzz_refused(result, ""); /* in a build without picture formats the message names no file */
    return 0;
  }
  check_draft(&parsed);
  pags_parsed_destroy(&parsed);
  char folder[1024];
  snprintf(folder, sizeof folder, "%.900s/set", fuzz_folder());
  open_dataset(folder);
  return 1;
}

static void seed_transforms(void) {
  static const char points[] =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 4 5 6\n7 8 9 1 2 3\n";
  fuzz_file("set/points.ply", points, sizeof points - 1);
  fuzz_file("set/images/b.png", "not a picture", 13);
  fuzz_seed_text(
      "{\"fl_x\": 10, \"w\": 8.0, \"h\": 6, \"k1\": 0.01, \"ply_file_path\": \"points.ply\", \"frames\": [\n"
      " {\"file_path\": \"./images/c.png\", \"transform_matrix\": [[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]},\n"
      " {\"file_path\": \"images/b\", \"fl_y\": 7, \"camera_model\": \"OPENCV_FISHEYE\", \"transform_matrix\": "
      "[[1,0,0,4],[0,1,0,2],[0,0,1,3]]}]}");
  fuzz_seed_text(
      "{\"camera_angle_x\": 1.5707963267948966, \"is_fisheye\": false, \"w\": 8, \"h\": 6, \"cx\": 4, \"cy\": 3.5, "
      "\"frames\": [\n"
      " {\"file_path\": \"images/b.png\", \"camera_model\": \"PINHOLE\", \"mask_path\": \"points.ply\", \"p1\": 0, "
      "\"transform_matrix\": [[1,0,0,4],[0,1,0,2],[0,0,1,3],[0,0,0,1]]}]}");
}

static const char *const transforms_words[] = {"\"fl_x\": ",
                                               "\"fl_y\": ",
                                               "\"camera_angle_x\": ",
                                               "\"camera_angle_y\": ",
                                               "\"w\": ",
                                               "\"h\": ",
                                               "\"k1\": ",
                                               "\"p2\": ",
                                               "\"frames\": [",
                                               "\"file_path\": ",
                                               "\"mask_path\": ",
                                               "\"transform_matrix\": [",
                                               "\"camera_model\": ",
                                               "\"SIMPLE_RADIAL\"",
                                               "\"OPENCV_FISHEYE\"",
                                               "\"ply_file_path\": ",
                                               "null",
                                               "1e300",
                                               "[]",
                                               "{}",
                                               NULL};
static const fuzz_target transforms = {.name = "transforms",
                                       .seeds = seed_transforms,
                                       .run = run_transforms,
                                       .words = transforms_words,
                                       .times = 512,
                                       .smoke = 2000};

/* ---- COLMAP: three files in one input, separated by cut lines ---- */

static int run_model(const uint8_t *data, size_t size, const char *extension) {
  static const char *const names[] = {"cameras", "images", "points3D"};
  fuzz_part parts[3];
  pags_parsed_dataset parsed;
  char model[1024], name[64];
  fuzz_parts(data, size, 3, parts);
  snprintf(model, sizeof model, "%.900s/%s", fuzz_folder(), extension);
  for (int i = 0; i < 3; i++) {
    snprintf(name, sizeof name, "%s/%s.%s", extension, names[i], extension);
    fuzz_file(name, parts[i].bytes, parts[i].size);
  }
  fuzz_parts_free(3, parts);
  const pags_result result = pags_colmap_read(model, model, &parsed);
  if (result != PAGS_OK) {
    pags_parsed_destroy(&parsed);
    fuzz_refused(result, extension);
    return 0;
  }
  check_draft(&parsed);
  pags_parsed_destroy(&parsed);
  open_dataset(model);
  return 1;
}

static int run_colmap_bin(const uint8_t *data, size_t size) {
  return run_model(data, size, "bin");
}
static int run_colmap_txt(const uint8_t *data, size_t size) {
  return run_model(data, size, "txt");
}

static void put_f64(file_bytes *out, double value) {
  bytes_put(out, &value, sizeof value);
}

static void put_cameras(file_bytes *out) {
  static const int kinds[] = {0, 1, 2, 3, 4, 5}, parameters[] = {3, 4, 4, 5, 8, 8};
  bytes_u64(out, 6);
  for (uint32_t i = 0; i < 6; i++) {
    bytes_u32(out, 4 + i);
    bytes_u32(out, (uint32_t)kinds[i]);
    bytes_u64(out, 8);
    bytes_u64(out, 6);
    for (int k = 0; k < parameters[i]; k++)
      put_f64(out, k < 2 ? 10 : k < 4 ? 3 : 0.001);
  }
  bytes_text(out, FUZZ_CUT);
}

static void seed_colmap_bin(void) {
  file_bytes out = {0};
  put_cameras(&out);
  bytes_u64(&out, 3);
  for (uint32_t i = 0; i < 3; i++) {
    bytes_u32(&out, 20 + i);
    for (int k = 0; k < 7; k++)
      put_f64(&out, k == 0 ? 1 : k > 3 ? -1.0 - i : 0);
    bytes_u32(&out, 4 + i);
    bytes_put(&out, i ? "b.png" : "a.png", 6);
    bytes_u64(&out, 1);
    put_f64(&out, 1.5);
    put_f64(&out, 2.5);
    bytes_u64(&out, UINT64_MAX);
  }
  bytes_text(&out, FUZZ_CUT);
  bytes_u64(&out, 2);
  for (uint32_t i = 0; i < 2; i++) {
    bytes_u64(&out, 99 - i);
    for (int k = 0; k < 3; k++)
      put_f64(&out, k + 1.0);
    bytes_put(&out, "\1\2\3", 3);
    put_f64(&out, 0.5);
    bytes_u64(&out, 2);
    for (uint32_t k = 0; k < 2; k++) {
      bytes_u32(&out, 20 + k);
      bytes_u32(&out, 0);
    }
  }
  fuzz_seed_bytes(out);
}

static void seed_colmap_txt(void) {
  fuzz_seed_text("# a comment\n\n4 PINHOLE 8 6 10 11 4 3\n5 OPENCV 8 6 10 11 4 3 0.01 0 0 0\n" FUZZ_CUT
                 "# more\n"
                 "10 1 0 0 0 -1 -2 -3 4 b.png\n\n"
                 "30 0.70710678118654757 0 0 0.70710678118654757 1 0 0 4 a.png\n1 2 7 3 4 -1\n"
                 "20 1e0 0 0 0 0 0 0 5 c d.png\n" FUZZ_CUT
                 "7 1 2 3 10 20 30 0.5 10 0 20 1 30 2\n# between\n5 4 5 6 1 2 3 0.5 30 0 10 1\n");
  fuzz_seed_text("1 SIMPLE_RADIAL 8 6 10 4 3 0\n" FUZZ_CUT "1 1 0 0 0 0 0 0 1 a.png\n\n" FUZZ_CUT);
}

static const char *const colmap_words[] = {"SIMPLE_PINHOLE", "PINHOLE",        "SIMPLE_RADIAL", "RADIAL",
                                           "OPENCV",         "OPENCV_FISHEYE", "FULL_OPENCV",   "\n# ",
                                           " -1 ",           " nan ",          " 1e400 ",       NULL};
static const fuzz_target colmap_bin = {
    .name = "colmap_bin", .seeds = seed_colmap_bin, .run = run_colmap_bin, .smoke = 6000};
static const fuzz_target colmap_txt = {
    .name = "colmap_txt", .seeds = seed_colmap_txt, .run = run_colmap_txt, .words = colmap_words, .smoke = 6000};

/* ---- A driving set's dataset.json, timestamps.json, instances_info.json and frame_instances.json in one input,
 * separated by cut lines; then the texts of poses and intrinsics ---- */

enum { STEPS = 4 };
static const char *const driving_files[] = {"drive/dataset.json", "drive/timestamps.json",
                                            "drive/instances/instances_info.json",
                                            "drive/instances/frame_instances.json", "drive/ego_pose/000.txt"};
enum { DRIVING_FILES = sizeof driving_files / sizeof *driving_files };

static pags_result take_fact(void *context, int number, const char *name, const pags_lens_model *lens) {
  (void)context;
  FUZZ_CHECK(number >= 0 && !name == !!lens && (!lens || lens->limit > 0));
  return PAGS_OK;
}

static pags_result read_drive(pags_parsed_dataset *parsed, pags_driving *driving) {
  PAGS_TRY(pags_rules_read(driving->root, NULL, false, &driving->rules, take_fact, NULL));
  PAGS_TRY(pags_times_read(driving, parsed));
  PAGS_TRY(pags_tracks_read(driving));
  double pose[12];
  char path[1024];
  snprintf(path, sizeof path, "%.900s/ego_pose/000.txt", driving->root);
  PAGS_TRY(pags_text_pose_read(path, pose));
  double numbers[9];
  int count;
  return pags_text_matrix_read(path, 9, numbers, &count) == PAGS_OK ? PAGS_OK : PAGS_OK;
}

static void check_drive(const pags_driving *driving) {
  for (int64_t i = 0; i < driving->step_count; i++)
    FUZZ_CHECK(isfinite(driving->steps[i].time) && (i == 0 || driving->steps[i].time > driving->steps[i - 1].time));
  FUZZ_CHECK(isfinite(driving->fps) && driving->fps > 0);
  for (int64_t i = 0; i < driving->object_count; i++) {
    const pags_object *const o = &driving->objects[i];
    FUZZ_CHECK(o->id && o->class_name && o->keyframe_count > 0);
    for (int64_t k = 0; k < o->keyframe_count; k++) {
      FUZZ_CHECK(k == 0 || o->keyframes[k].time > o->keyframes[k - 1].time);
      for (int j = 0; j < 12; j++)
        FUZZ_CHECK(isfinite(o->keyframes[k].world_from_object[j]));
    }
  }
}

/* Makes an empty set in the folder `name` with one camera and STEPS time steps. */
static void begin_drive(const char *name, pags_parsed_dataset *parsed) {
  *parsed = (pags_parsed_dataset){0};
  parsed->driving = calloc(1, sizeof *parsed->driving);
  pags_driving *const driving = parsed->driving;
  if (!driving)
    abort();
  driving->root = pags_text_format("%s/%s", fuzz_folder(), name);
  driving->sensor_count = 1;
  driving->sensors = calloc(1, sizeof *driving->sensors);
  driving->step_count = STEPS;
  driving->steps = calloc(STEPS, sizeof *driving->steps);
  for (int i = 0; i < STEPS; i++) {
    driving->steps[i] = (pags_time_step){.frame = i, .time = i};
    pags_parsed_add(parsed);
  }
}

static int run_driving(const uint8_t *data, size_t size) {
  fuzz_part parts[DRIVING_FILES];
  fuzz_parts(data, size, DRIVING_FILES, parts);
  for (int i = 0; i < DRIVING_FILES; i++)
    fuzz_file(driving_files[i], parts[i].bytes, parts[i].size);
  fuzz_parts_free(DRIVING_FILES, parts);
  pags_parsed_dataset parsed;
  begin_drive("drive", &parsed);
  pags_driving *const driving = parsed.driving;
  const pags_result result = read_drive(&parsed, driving);
  if (result == PAGS_OK)
    check_drive(driving);
  else
    fuzz_refused(result, "drive");
  pags_parsed_destroy(&parsed);
  return result == PAGS_OK;
}

#define POSE(x) "[[1,0,0," #x "],[0,1,0,2],[0,0,1,0],[0,0,0,1]]"

static void seed_driving(void) {
  static const char times[] =
      "{\"frames\": [100, 100.5, 101, 101.5],\n\"cameras\": {\"0\": [99.9, 100.4, null, 101.4]}}";
  static const char boxes[] =
      "{\"0\":{\"id\":\"a\",\"class_name\":\"Car\",\n\"frame_annotations\":{\"frame_idx\":[0,1,2],\"obj_to_world\":[" POSE(1) "," POSE(3) "," POSE(
          9) "],\n\"box_size\":[[4,2,1.5],[4,2,1.5],[4,2,1.5]]}},"
             "\"1\":{\"id\":7,\"class_name\":\"Pedestrian\",\"frame_annotations\":{\"frame_idx\":[3],\"obj_to_world\":[" POSE(
                 5) "],\"box_size\":[[0.5,0.5,1.7]]}}}";
  static const char present[] = "{\"0\":[0],\"1\":[0],\"2\":[0,1],\"3\":[1]}";
  static const char pose[] = "1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n";
  file_bytes out = {0};
  bytes_text(&out, "{\"kind\": \"pandaset\"}" FUZZ_CUT);
  bytes_put(&out, times, sizeof times - 1);
  bytes_text(&out, FUZZ_CUT);
  bytes_put(&out, boxes, sizeof boxes - 1);
  bytes_text(&out, FUZZ_CUT "%s" FUZZ_CUT "%s", present, pose);
  fuzz_seed_bytes(out);
  out = (file_bytes){0};
  bytes_text(
      &out,
      "{\"kind\": \"pags\", \"camera_axes\": \"opencv\", \"extrinsics\": \"constant\", \"object_forward\": \"+x\", "
      "\"fps\": 10, \"lidar_columns\": [\"x\", \"y\", \"z\"], \"labels\": \"kitti-360\", \"cameras\": {\"0\": "
      "\"front\"}, \"lenses\": {\"0\": {\"kind\": \"ftheta\", \"k\": [-0.02, 0, 0, 0, 0, 0], \"field\": "
      "150}}}" FUZZ_CUT);
  bytes_put(&out, times, sizeof times - 1);
  bytes_text(&out, FUZZ_CUT);
  bytes_put(&out, boxes, sizeof boxes - 1);
  bytes_text(&out, FUZZ_CUT "%s" FUZZ_CUT "%s", present, pose);
  fuzz_seed_bytes(out);
}

static const char *const driving_words[] = {"\"kind\": ",
                                            "\"waymo\"",
                                            "\"nuscenes\"",
                                            "\"camera_axes\": ",
                                            "\"extrinsics\": ",
                                            "\"object_forward\": ",
                                            "\"+y\"",
                                            "\"fps\": ",
                                            "\"lidar_columns\": [",
                                            "\"labels\": ",
                                            "\"cameras\": {",
                                            "\"lenses\": {",
                                            "\"fisheye\"",
                                            "\"frames\": [",
                                            "\"frame_idx\": [",
                                            "\"obj_to_world\": [",
                                            "\"box_size\": [",
                                            "\"id\": ",
                                            "\"class_name\": ",
                                            "null",
                                            "1e300",
                                            "-1",
                                            "{}",
                                            "[]",
                                            NULL};
static const fuzz_target driving = {.name = "instances",
                                    .seeds = seed_driving,
                                    .run = run_driving,
                                    .words = driving_words,
                                    .times = 512,
                                    .smoke = 6000};

/* ---- Boxes of Street Gaussians' converter ---- */

static int run_street(const uint8_t *data, size_t size) {
  static const char pose[] = "1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n";
  pags_parsed_dataset parsed;
  fuzz_file("street/track/track_info.txt", data, size);
  fuzz_file("street/ego_pose/0.txt", pose, sizeof pose - 1);
  fuzz_file("street/ego_pose/1.txt", pose, sizeof pose - 1);
  begin_drive("street", &parsed);
  parsed.driving->fps = 1;
  const pags_result result = pags_street_tracks_read(parsed.driving);
  if (result == PAGS_OK)
    check_drive(parsed.driving);
  else
    fuzz_refused(result, "street");
  pags_parsed_destroy(&parsed);
  return result == PAGS_OK;
}

static void seed_street(void) {
  fuzz_seed_text(
      "frame_id track_id object_class alpha box_height box_width box_length ...\n"
      "0 3 vehicle -10 1.5 1.8 4.2 10 -2 0.7 0.1 3 \n0 4 pedestrian -10 1.7 0.5 0.6 12 2 0.9 -3 0\n"
      "1 3 vehicle -10 1.5 1.8 4.2 13 -2 0.7 0.1 3 \n2 3 vehicle -10 1.5 1.8 4.2 16 -2 0.7 0.1 3 \n");
}

static const char *const street_words[] = {"frame_id", "vehicle ", "-1 ", "1e300 ", "nan ", "0 3 ", "\n", NULL};
static const fuzz_target street = {.name = "street_tracks",
                                   .seeds = seed_street,
                                   .run = run_street,
                                   .words = street_words,
                                   .times = 512,
                                   .smoke = 3000};

/* ---- Point clouds ---- */

static int run_points(const uint8_t *data, size_t size) {
  pags_parsed_dataset parsed = {0};
  const pags_result result = pags_ply_points_read(fuzz_file("points.ply", data, size), &parsed.points);
  if (result == PAGS_OK)
    check_draft(&parsed);
  else
    fuzz_refused(result, "points.ply");
  pags_parsed_destroy(&parsed);
  return result == PAGS_OK;
}

static void seed_points(void) {
  static const char head[] =
      "element vertex 2\nproperty float x\nproperty float y\nproperty double z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty short extra\nend_header\n";
  file_bytes out = {0};
  bytes_text(&out, "ply\nformat ascii 1.0\n%s1 2 3 4 5 6 7\n7 8 9 1 2 3 4\n", head);
  fuzz_seed_bytes(out);
  out = (file_bytes){0};
  bytes_text(&out, "ply\nformat binary_little_endian 1.0\n%s", head);
  for (int i = 0; i < 2; i++) {
    bytes_f32(&out, 1);
    bytes_f32(&out, 2);
    put_f64(&out, 3);
    bytes_put(&out, "\1\2\3\4\5", 5);
  }
  fuzz_seed_bytes(out);
}

static const char *const point_words[] = {"property float ",
                                          "property uchar ",
                                          "property list uchar int ",
                                          "element face ",
                                          "end_header\n",
                                          "element vertex ",
                                          NULL};
static const fuzz_target points = {.name = "ply_points", .seeds = seed_points, .run = run_points, .words = point_words};

const fuzz_target *const fuzz_targets[] = {&transforms, &colmap_bin, &colmap_txt, &driving, &street, &points, NULL};
