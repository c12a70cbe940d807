/* SPDX-License-Identifier: Apache-2.0 */
/* Writes a tiny driving data set with known truth in the file conventions of any supported kind: five frames, two
 * cameras, two boxes, two LiDAR points. */
#ifndef PAGS_TESTS_UNIT_DRIVING_TREE_H
#define PAGS_TESTS_UNIT_DRIVING_TREE_H

#include <math.h>

#include <pags/camera.h>
#include <pags/dataset.h>

#include "shared_data.h"
#include "unit/scratch.h"

enum { TREE_FRAMES = 5, TREE_CAMERAS = 2, TREE_WIDTH = 48, TREE_HEIGHT = 32 };

typedef struct tree_kind {
  const char *name;
  int waymo_axes, per_frame, lidar_frame, forward_y, columns, first; /* first: index of the column that holds x */
} tree_kind;

static const tree_kind tree_kinds[] = {{"waymo", 1, 0, 0, 0, 14, 3},     {"pandaset", 0, 1, 0, 1, 5, 0},
                                       {"kitti", 0, 0, 0, 0, 4, 0},      {"nuscenes", 0, 1, 1, 0, 4, 0},
                                       {"argoverse2", 0, 0, 0, 0, 4, 0}, {"nuplan", 0, 0, 0, 0, 6, 0}};
enum { TREE_KINDS = sizeof tree_kinds / sizeof *tree_kinds };

static inline void tree_turn(double yaw, double x, double y, double z, double out[12]) {
  const double m[12] = {cos(yaw), -sin(yaw), 0, x, sin(yaw), cos(yaw), 0, y, 0, 0, 1, z};
  memcpy(out, m, sizeof m);
}

/* Writes a small file without the fsync of scratch_write, as there are hundreds of files. */
static inline void tree_bytes(scratch *s, const char *name, const void *bytes, size_t size) {
  char *folder = pags_path_folder(scratch_path(s, name));
  scratch_ok(pags_make_dirs(folder));
  free(folder);
  FILE *file = fopen(scratch_path(s, name), "wb");
  assert_non_null(file);
  assert_int_equal(fwrite(bytes, 1, size, file), size);
  assert_int_equal(fclose(file), 0);
}

static inline void tree_text(scratch *s, const char *name, const char *text) {
  tree_bytes(s, name, text, strlen(text));
}

/* Copies a file of the scratch folder to another name. */
static inline void tree_copy(scratch *s, const char *from, const char *name) {
  uint8_t *bytes;
  size_t size;
  scratch_ok(pags_file_read(scratch_path(s, from), &bytes, &size));
  tree_bytes(s, name, bytes, size);
  free(bytes);
}

/* ---- The true poses, boxes and points ---- */

static inline void tree_ego(int frame, double out[12]) {
  tree_turn(0.1 * frame, 2 * frame, 0.5 * frame, 0.1, out);
}

/* A camera's pose on the ego vehicle (camera-to-ego, OpenCV axes). */
static inline void tree_camera(int camera, double out[12]) {
  static const double axes[12] = {0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0};
  double place[12];
  tree_turn(0.5 * camera, 1.5, 0.3 - 0.6 * camera, 1.6, place);
  pags_rigid_multiply(place, axes, out);
}

static inline void tree_view(int frame, int camera, double out[12]) {
  double ego[12], inside[12];
  tree_ego(frame, ego);
  tree_camera(camera, inside);
  pags_rigid_multiply(ego, inside, out);
}

/* Pose of a box at a frame: object 0 is a car ahead that drives off, object 1 is a pedestrian who stands. */
static inline void tree_box(int object, int frame, double out[12]) {
  if (object == 0)
    tree_turn(0.2 + 0.05 * frame, 12 + 3 * frame, 2, 0.8, out);
  else
    tree_turn(-1, 14, -1, 0.9, out);
}

static const double tree_sizes[2][3] = {{4.5, 2, 1.6}, {0.6, 0.7, 1.8}};
static const double tree_points[2][3] = {{9, 1, 0.5}, {20, -3, 2}}; /* in the ego frame, the same at every frame */

static inline void tree_lidar(double out[12]) {
  tree_turn(-1.5, 0.9, 0.1, 1.8, out);
}

/* ---- Writing the files ---- */

static inline void tree_write_matrix(scratch *s, const char *name, const double m[12]) {
  char text[1024];
  int length = 0;
  for (int i = 0; i < 3; i++)
    length += snprintf(text + length, sizeof text - (size_t)length, "%.18e %.18e %.18e %.18e\n", m[4 * i], m[4 * i + 1],
                       m[4 * i + 2], m[4 * i + 3]);
  snprintf(text + length, sizeof text - (size_t)length, "0 0 0 1\n");
  tree_text(s, name, text);
}

static uint8_t tree_paint(int x, int y, int c) {
  return (uint8_t)(x * 5 + y * 3 + c * 40);
}

static inline void tree_write_cameras(scratch *s, const tree_kind *kind) {
  static const double waymo_from_opencv[12] = {0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 0};
  double inverse[12], pose[12];
  char name[64];
  pags_rigid_inverse(waymo_from_opencv, inverse);
  for (int c = 0; c < TREE_CAMERAS; c++) {
    snprintf(name, sizeof name, "intrinsics/%d.txt", c);
    tree_text(s, name, c == 0 ? "40\n41\n24.5\n15.5\n0\n0\n0\n0\n0\n" : "42 0 24\n0 43 16\n0 0 1\n");
    for (int t = 0; t < TREE_FRAMES; t++) {
      snprintf(name, sizeof name, "images/%03d_%d.png", t, c);
      if (c + t == 0)
        scratch_picture(s, name, TREE_WIDTH, TREE_HEIGHT, tree_paint);
      else
        tree_copy(s, "images/000_0.png", name);
      snprintf(name, sizeof name, "extrinsics/%03d_%d.txt", t, c);
      tree_view(t, c, pose);
      if (kind->per_frame)
        tree_write_matrix(s, name, pose);
    }
    snprintf(name, sizeof name, "extrinsics/%d.txt", c);
    tree_camera(c, pose);
    if (kind->waymo_axes)
      pags_rigid_multiply(pose, inverse, pose);
    if (!kind->per_frame)
      tree_write_matrix(s, name, pose);
  }
}

static inline void tree_write_sweeps(scratch *s, const tree_kind *kind) {
  double ego[12], laser[12], inverse[12], pose[12];
  char name[64];
  tree_lidar(laser);
  pags_rigid_inverse(laser, inverse);
  for (int t = 0; t < TREE_FRAMES; t++) {
    float rows[2 * 14] = {0};
    for (int i = 0; i < 2; i++)
      for (int k = 0; k < 3; k++) {
        const double *p = tree_points[i], *m = inverse + 4 * k;
        double there = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3];
        rows[i * kind->columns + kind->first + k] = (float)(kind->lidar_frame ? there : p[k]);
      }
    snprintf(name, sizeof name, "lidar/%03d.bin", t);
    tree_bytes(s, name, rows, (size_t)(2 * kind->columns) * sizeof *rows);
    tree_ego(t, ego);
    pags_rigid_multiply(ego, laser, pose);
    snprintf(name, sizeof name, kind->lidar_frame ? "lidar_pose/%03d.txt" : "ego_pose/%03d.txt", t);
    tree_write_matrix(s, name, kind->lidar_frame ? pose : ego);
  }
}

static inline int tree_write_box(char *text, size_t size, const tree_kind *kind, int object, int first, int last) {
  static const double turn[12] = {0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0};
  double inverse[12], pose[12];
  const double *extents = tree_sizes[object];
  int length = 0;
  pags_rigid_inverse(turn, inverse);
  for (int t = first; t <= last; t++)
    length += snprintf(text + length, size - (size_t)length, "%s%d", t > first ? "," : "{\"frame_idx\":[", t);
  for (int t = first; t <= last; t++) {
    tree_box(object, t, pose);
    if (kind->forward_y)
      pags_rigid_multiply(pose, inverse, pose);
    length += snprintf(text + length, size - (size_t)length, "%s[", t > first ? "," : "],\n\"obj_to_world\":[");
    for (int i = 0; i < 3; i++)
      length += snprintf(text + length, size - (size_t)length, "[%.17g,%.17g,%.17g,%.17g],", pose[4 * i],
                         pose[4 * i + 1], pose[4 * i + 2], pose[4 * i + 3]);
    length += snprintf(text + length, size - (size_t)length, "[0,0,0,1]]");
  }
  for (int t = first; t <= last; t++)
    length += snprintf(text + length, size - (size_t)length, "%s[%g,%g,%g]", t > first ? "," : "],\n\"box_size\":[",
                       extents[kind->forward_y], extents[!kind->forward_y], extents[2]);
  return length + snprintf(text + length, size - (size_t)length, "]}");
}

/* Writes the annotations: object 0 has a box in all frames, object 1 in frames 1 to 3. */
static inline void tree_write_boxes(scratch *s, const tree_kind *kind) {
  static char text[16384];
  int length = snprintf(text, sizeof text, "{\"0\":{\"id\":\"a\",\"class_name\":\"Car\",\n\"frame_annotations\":");
  length += tree_write_box(text + length, sizeof text - (size_t)length, kind, 0, 0, TREE_FRAMES - 1);
  length += snprintf(text + length, sizeof text - (size_t)length,
                     "},\n\"1\":{\"id\":7,\"class_name\":\"Pedestrian\",\n\"frame_annotations\":");
  length += tree_write_box(text + length, sizeof text - (size_t)length, kind, 1, 1, 3);
  snprintf(text + length, sizeof text - (size_t)length, "}}\n");
  tree_text(s, "instances/instances_info.json", text);
  tree_text(s, "instances/frame_instances.json", "{\"0\":[0],\"1\":[0,1],\"2\":[0,1],\"3\":[1,0],\"4\":[0]}");
}

static inline void tree_write(scratch *s, const tree_kind *kind) {
  tree_write_cameras(s, kind);
  tree_write_sweeps(s, kind);
  tree_write_boxes(s, kind);
  tree_text(s, "timestamps.json",
            "{\"frames\": [100, 100.5, 101, 101.5, 102],\n"
            "\"cameras\": {\"0\": [99.9, 100.4, 100.9, 101.4, 101.9], \"1\": [99.8, 100.3, 100.8, 101.3, null]}}");
}

/* Options that open the set as the given kind; NULL leaves the kind to dataset.json. */
static inline pags_dataset_options tree_options(const char *kind) {
  pags_dataset_options options = pags_dataset_options_default();
  options.kind = kind;
  return options;
}

/* Opens the set and closes it again; returns the result of opening. */
static inline pags_result tree_open(scratch *s, const pags_dataset_options *options) {
  pags_dataset *dataset;
  pags_result result = pags_dataset_open(s->folder, options, &dataset);
  pags_dataset_close(dataset);
  return result;
}

static inline bool tree_has_note(const pags_dataset *dataset, const char *part) {
  for (int64_t i = 0; i < pags_dataset_note_count(dataset); i++)
    if (strstr(pags_dataset_note(dataset, i), part))
      return true;
  return false;
}

/* Writes a grey picture of TREE_WIDTH x TREE_HEIGHT whose samples are paint(x, y). */
static inline void tree_write_grey(scratch *s, const char *name, uint8_t (*paint)(int x, int y)) {
  pags_image image;
  scratch_ok(pags_image_create(&image, TREE_WIDTH, TREE_HEIGHT, 1, PAGS_U8));
  for (int i = 0; i < TREE_WIDTH * TREE_HEIGHT; i++)
    ((uint8_t *)image.data)[i] = paint(i % TREE_WIDTH, i / TREE_WIDTH);
  scratch_image(s, name, &image);
}

/* Opens scene 002 of PandaSet from the shared test data; returns NULL where that data isn't installed. */
static inline pags_dataset *tree_pandaset(void) {
  char path[1024];
  pags_dataset *dataset;
  if (!pags_shared_data("pandaset-002", path, sizeof path))
    return NULL;
  scratch_ok(pags_dataset_open(path, NULL, &dataset));
  return dataset;
}

#endif
