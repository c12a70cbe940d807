/* SPDX-License-Identifier: Apache-2.0 */
/* drivestudio's texts: ids, classes and boxes of objects by frame; matrices of poses. */
#include "synth/street_labels.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/file.h"
#include "base/json.h"
#include "base/text.h"

enum { STREAM_POSE_NOISE = 1 << 28 };
#define REACH 90.0 /* metres from the recording car within which boxes are labelled */

static double frame_time(const pags_street *street, int frame) {
  return frame / street->options->fps;
}

static bool labelled(const pags_street *street, const pags_actor *actor, int frame) {
  double box[12], ego[12];
  pags_actor_pose(actor, frame_time(street, frame), box);
  pags_street_ego(frame_time(street, frame), ego);
  return hypot(box[3] - ego[3], box[7] - ego[7]) <= REACH;
}

void pags_street_number(pags_street *street) {
  int next = 0;
  for (int i = 0; i < street->actor_count; i++) {
    pags_actor *actor = &street->actors[i];
    actor->number = -1;
    for (int f = 0; f < street->options->frames && actor->number < 0; f++)
      if (labelled(street, actor, f))
        actor->number = next++;
  }
}

/* Errors of a box, independent from frame to frame: x and y, and about z. */
static void disturb(const pags_street_options *o, const pags_actor *actor, int frame, double pose[12]) {
  double move[2], turn[2];
  const uint64_t stream = STREAM_POSE_NOISE + 2 * (uint64_t)actor->number;
  pags_rng_normal2(o->seed, stream, (uint64_t)frame, move);
  pags_rng_normal2(o->seed, stream + 1, (uint64_t)frame, turn);
  const double yaw = atan2(pose[4], pose[0]) + turn[0] * o->yaw_noise * 0.017453292519943295;
  const double c = cos(yaw), s = sin(yaw);
  memcpy(pose,
         (double[12]){c, -s, 0, pose[3] + o->pose_noise * move[0], s, c, 0, pose[7] + o->pose_noise * move[1], 0, 0, 1,
                      pose[11]},
         12 * sizeof *pose);
}

static void put_pose(pags_json_writer *json, const double pose[12]) {
  pags_json_begin_array(json, NULL);
  for (int r = 0; r < 3; r++)
    pags_json_put_numbers(json, NULL, pose + 4 * r, 4);
  pags_json_put_numbers(json, NULL, (double[]){0, 0, 0, 1}, 4);
  pags_json_end_array(json);
}

/* A parked car's label doesn't vary: whoever labels it draws one box. */
static void put_annotations(pags_json_writer *json, const pags_street *street, const pags_actor *actor, int exact) {
  const pags_street_options *o = street->options;
  const double size[3] = {(double)actor->size[0], (double)actor->size[1], (double)actor->size[2]};
  pags_json_begin_object(json, "frame_annotations");
  pags_json_begin_array(json, "frame_idx");
  for (int f = 0; f < o->frames; f++)
    if (labelled(street, actor, f))
      pags_json_put_integer(json, NULL, f);
  pags_json_end_array(json);
  pags_json_begin_array(json, "obj_to_world");
  for (int f = 0; f < o->frames; f++) {
    double pose[12];
    if (!labelled(street, actor, f))
      continue;
    pags_actor_pose(actor, frame_time(street, f), pose);
    if (!exact && actor->moving && (o->pose_noise > 0.0 || o->yaw_noise > 0.0))
      disturb(o, actor, f, pose);
    put_pose(json, pose);
  }
  pags_json_end_array(json);
  pags_json_begin_array(json, "box_size");
  for (int f = 0; f < o->frames; f++)
    if (labelled(street, actor, f))
      pags_json_put_numbers(json, NULL, size, 3);
  pags_json_end_array(json);
  pags_json_end_object(json);
}

static pags_result save(pags_json_writer *json, const char *path) {
  const pags_result result = pags_json_writer_save(json, path);
  pags_json_writer_destroy(json);
  return result;
}

pags_result pags_street_write_instances(const pags_street *street, const char *path, int exact) {
  static const char *const classes[] = {"Car", "Pedestrian", "Cyclist"};
  static const char *const words[] = {"car", "pedestrian", "cyclist"};
  pags_json_writer json;
  pags_json_writer_init(&json, 0);
  pags_json_begin_object(&json, NULL);
  for (int i = 0; i < street->actor_count; i++) {
    const pags_actor *actor = &street->actors[i];
    char key[16], id[48];
    if (actor->number < 0)
      continue;
    snprintf(key, sizeof key, "%d", actor->number);
    snprintf(id, sizeof id, "%s_%s_%03d", actor->moving ? "moving" : "parked", words[actor->role], actor->number);
    pags_json_begin_object(&json, key);
    pags_json_put_string(&json, "id", id);
    pags_json_put_string(&json, "class_name", classes[actor->role]);
    put_annotations(&json, street, actor, exact);
    pags_json_end_object(&json);
  }
  pags_json_end_object(&json);
  return save(&json, path);
}

pags_result pags_street_write_frame_instances(const pags_street *street, const char *path) {
  pags_json_writer json;
  pags_json_writer_init(&json, 0);
  pags_json_begin_object(&json, NULL);
  for (int f = 0; f < street->options->frames; f++) {
    char key[16];
    snprintf(key, sizeof key, "%d", f);
    pags_json_begin_array(&json, key);
    for (int i = 0; i < street->actor_count; i++)
      if (street->actors[i].number >= 0 && labelled(street, &street->actors[i], f))
        pags_json_put_integer(&json, NULL, street->actors[i].number);
    pags_json_end_array(&json);
  }
  pags_json_end_object(&json);
  return save(&json, path);
}

static void put_times(pags_json_writer *json, const pags_street *street, const char *key) {
  pags_json_begin_array(json, key);
  for (int f = 0; f < street->options->frames; f++)
    pags_json_put_number(json, NULL, frame_time(street, f));
  pags_json_end_array(json);
}

/* Everything happens at the frame's time: cameras have no delay and no rolling shutter. */
pags_result pags_street_write_timestamps(const pags_street *street, const char *path) {
  pags_json_writer json;
  pags_json_writer_init(&json, 1);
  pags_json_begin_object(&json, NULL);
  put_times(&json, street, "frames");
  pags_json_begin_object(&json, "cameras");
  for (int c = 0; c < street->options->cameras; c++)
    put_times(&json, street, (const char *const[]){"0", "1", "2"}[c]);
  pags_json_end_object(&json);
  pags_json_end_object(&json);
  return save(&json, path);
}

pags_result pags_street_write_description(const pags_street *street, const char *path) {
  static const char *const columns[] = {"x", "y", "z", "intensity"};
  static const char *const cameras[][2] = {{"0", "front"}, {"1", "front_left"}, {"2", "front_right"}};
  pags_json_writer json;
  pags_json_writer_init(&json, 1);
  pags_json_begin_object(&json, NULL);
  pags_json_put_string(&json, "kind", "pags");
  pags_json_put_string(&json, "camera_axes", "opencv");
  pags_json_put_string(&json, "extrinsics", "constant camera-to-ego (C.txt)");
  pags_json_begin_array(&json, "lidar_columns");
  for (int i = 0; i < 4; i++)
    pags_json_put_string(&json, NULL, columns[i]);
  pags_json_end_array(&json);
  pags_json_put_string(&json, "lidar_frame", "ego");
  pags_json_put_string(&json, "object_forward", "+x");
  pags_json_put_number(&json, "fps", street->options->fps);
  pags_json_begin_object(&json, "cameras");
  for (int c = 0; c < street->options->cameras; c++)
    pags_json_put_string(&json, cameras[c][0], cameras[c][1]);
  pags_json_end_object(&json);
  pags_json_end_object(&json);
  return save(&json, path);
}

/* Numbers one after another, `across` a line. */
static pags_result write_numbers(const char *path, const double *numbers, int count, int across) {
  char text[16 * (PAGS_DOUBLE_TEXT + 1)];
  size_t used = 0;
  for (int i = 0; i < count; i++) {
    used += (size_t)pags_text_from_double(numbers[i], text + used);
    text[used++] = (i + 1) % across ? ' ' : '\n';
  }
  return pags_file_write(path, text, used);
}

pags_result pags_street_write_pose(const char *path, const double pose[12]) {
  double whole[16] = {0};
  memcpy(whole, pose, 12 * sizeof *pose);
  whole[15] = 1.0;
  return write_numbers(path, whole, 16, 4);
}

pags_result pags_street_write_intrinsics(const char *path, const pags_camera *camera) {
  const double numbers[9] = {camera->fx, camera->fy, camera->cx, camera->cy};
  return write_numbers(path, numbers, 9, 1);
}
