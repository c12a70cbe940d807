/* SPDX-License-Identifier: Apache-2.0 */
/* The synthetic data set; see waymo_set.h. */
#include "unit/waymo_set.h"

#include <math.h>

#include "base/rng.h"
#include "dataset/driving/writer.h"
#include "unit/scratch.h"

void waymo_set_ego(int t, double out[12]) {
  const float angles[3] = {0.02f, -0.03f, (float)(0.9 + 0.01 * t)};
  const double cr = cos((double)angles[0]), sr = sin((double)angles[0]), cp = cos((double)angles[1]),
               sp = sin((double)angles[1]), cy = cos((double)angles[2]), sy = sin((double)angles[2]);
  const double rows[3][4] = {{cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, -25211.258 + t},
                             {sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, 42391.081 + 1.3 * t},
                             {-sp, cp * sr, cp * cr, -160.618}};
  memcpy(out, rows, sizeof rows);
}

static const double headings[CAMERAS] = {0, 0.8, -0.8};

void waymo_set_camera(int c, double out[12]) {
  const double cy = cos(headings[c]), sy = sin(headings[c]);
  const double m[12] = {sy, 0, cy, 1.5, -cy, 0, sy, 0.1 * c, 0, -1, 0, 2.1};
  memcpy(out, m, sizeof m);
}

/* Box poses in the vehicle's frame: a car that drives ahead, a parked car, a pedestrian, a sign. */
static void box_at(int track, int t, double out[12]) {
  static const double places[TRACKS][3] = {{14, 1, 0.8}, {9, -6, 0.7}, {8, 6, 0.9}, {20, -3, 2}};
  const double yaw = 0.3 * track - 0.2, c = cos(yaw), sn = sin(yaw);
  const double m[12] = {c, -sn, 0, places[track][0], sn, c, 0, places[track][1], 0, 0, 1, places[track][2]};
  double world[12], ego[12], start[12], back[12];
  /* The first box keeps its place ahead of the ego vehicle, the others stand still in the world. */
  waymo_set_ego(track ? 0 : t, start);
  pags_rigid_multiply(start, m, world);
  waymo_set_ego(t, ego);
  pags_rigid_inverse(ego, back);
  pags_rigid_multiply(back, world, out);
  /* Waymo's boxes are upright in the vehicle's frame, so only the yaw is kept. */
  const double turn = atan2(out[4], out[0]);
  const double upright[12] = {cos(turn), -sin(turn), 0, out[3], sin(turn), cos(turn), 0, out[7], 0, 0, 1, out[11]};
  memcpy(out, upright, sizeof upright);
}

static const char *const class_names[TRACKS] = {"Vehicle", "Vehicle", "Pedestrian", "Sign"};

static pags_layout_track make_track(int i) {
  pags_layout_track track = {0};
  pags_object *o = &track.object;
  char id[16];
  snprintf(id, sizeof id, "track-%d", 9 - i);
  o->id = strdup(id);
  o->class_name = strdup(class_names[i]);
  o->category = pags_category_of(o->class_name);
  o->keyframes = calloc(FRAMES, sizeof *o->keyframes);
  assert_non_null(o->keyframes);
  for (int t = i; t < FRAMES; t++) { /* object i is labelled from frame i on */
    double ego[12], box[12];
    waymo_set_ego(t, ego);
    box_at(i, t, box);
    pags_keyframe *keyframe = &o->keyframes[o->keyframe_count++];
    *keyframe = (pags_keyframe){.frame = t, .time = 1553735853.462203 + 0.1 * t};
    pags_rigid_multiply(ego, box, keyframe->world_from_object);
  }
  for (int k = 0; k < 3; k++)
    o->size[k] = 1 + i + 0.3 * (2 - k);
  pags_object_classify_motion(o);
  return track;
}

static void put_photos(const pags_layout *layout, const char *path, int t, int c) {
  static const uint8_t ids[] = {0,  1,  2,  5,  6,  7,  8,  10,
                                11, 12, 13, 14, 15, 17, 18, 255}; /* only ids for which Waymo has a class */
  uint8_t mask[WIDTH * HEIGHT];
  pags_image image;
  scratch_ok(pags_image_create(&image, WIDTH, HEIGHT, 3, PAGS_U8));
  for (int i = 0; i < WIDTH * HEIGHT * 3; i++)
    ((uint8_t *)image.data)[i] = (uint8_t)(i * (3 + t) / (7 + c));
  scratch_ok(pags_image_save(path, &image));
  pags_image_destroy(&image);
  uint8_t *data;
  size_t size;
  scratch_ok(pags_file_read(path, &data, &size));
  scratch_ok(pags_layout_put_file(layout, "images", t, c, ".jpg", data, size));
  free(data);
  for (int i = 0; i < WIDTH * HEIGHT; i++)
    mask[i] = ids[(i / 11 + i / WIDTH / 7 + t) % (int)sizeof ids];
  if ((t + c) % 2 == 0)
    scratch_ok(pags_layout_put_mask(layout, "semantic", t, c, WIDTH, HEIGHT, mask));
}

static void put_points(const pags_layout *layout, int t) {
  float rows[4 * POINTS];
  for (uint64_t i = 0; i < POINTS; i++) {
    double u[2], v[2];
    pags_rng_uniform2(7, (uint64_t)(2 * t), i, u);
    pags_rng_uniform2(7, (uint64_t)(2 * t + 1), i, v);
    rows[4 * i] = (float)(80 * u[0] - 40);
    rows[4 * i + 1] = (float)(80 * u[1] - 40);
    rows[4 * i + 2] = (float)(3 * v[0] - 0.5);
    rows[4 * i + 3] = (float)v[1];
  }
  scratch_ok(pags_layout_put_lidar(layout, t, POINTS, rows));
}

void waymo_set_make(const char *folder) {
  static const char *const columns[] = {"x", "y", "z", "intensity", NULL};
  pags_layout_camera cameras[CAMERAS];
  pags_layout_track tracks[TRACKS];
  double times[FRAMES], m[12];
  char photo[512];
  snprintf(photo, sizeof photo, "%s.jpg", folder);
  for (int c = 0; c < CAMERAS; c++)
    cameras[c] = (pags_layout_camera){.number = c,
                                      .name = "a camera",
                                      .width = WIDTH,
                                      .height = HEIGHT,
                                      .intrinsics = {70.1, 70.3, 48.7, 31.9, c == 2 ? -0.1 : 0, c == 2 ? -0.02 : 0}};
  const pags_layout_info info = {.kind = "waymo",
                                 .source = "a test",
                                 .fps = 10,
                                 .frame_count = FRAMES,
                                 .camera_count = CAMERAS,
                                 .cameras = cameras,
                                 .lidar_columns = columns};
  pags_layout layout;
  scratch_ok(pags_layout_begin(&layout, folder, &info, false));
  for (int c = 0; c < CAMERAS; c++) {
    waymo_set_camera(c, m);
    scratch_ok(pags_layout_put_extrinsics(&layout, -1, c, m));
  }
  for (int t = 0; t < FRAMES; t++) {
    times[t] = 1553735853.462203 + 0.1 * t;
    waymo_set_ego(t, m);
    scratch_ok(pags_layout_put_ego_pose(&layout, t, m));
    put_points(&layout, t);
    for (int c = 0; c < CAMERAS; c++)
      put_photos(&layout, photo, t, c);
  }
  for (int i = 0; i < TRACKS; i++)
    tracks[i] = make_track(i);
  scratch_ok(pags_layout_put_instances(&layout, tracks, TRACKS));
  scratch_ok(pags_layout_finish(&layout, &(pags_layout_times){.frames = times}));
  for (int i = 0; i < TRACKS; i++)
    pags_layout_track_destroy(&tracks[i]);
  pags_layout_destroy(&layout);
}
