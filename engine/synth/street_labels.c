/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the labels of the synthetic street: ids, classes and boxes of the objects in each frame, times, cameras. The
 * JSON files are written by dataset/driving/writer_json.c. */

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/rng.h"
#include "base/text.h"
#include "base/vec3.h"
#include "dataset/driving/writer.h"
#include "maths/maths.h"
#include "synth/faults.h"

enum { STREAM_POSE_NOISE = 1 << 28 };
#define REACH 90.0 /* metres from the ego vehicle within which boxes are labelled */

static double frame_time(const pags_street *street, int frame) {
  return frame / street->options->fps;
}

static bool labelled(const pags_street *street, const pags_actor *actor, int frame) {
  double box[12], ego[12];
  pags_actor_pose(actor, frame_time(street, frame), box);
  pags_street_ego(street->options, frame_time(street, frame), ego);
  return pags_hypot(box[3] - ego[3], box[7] - ego[7]) <= REACH;
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

/* Makes the track of a labelled actor: its box in each frame in which it is near the ego vehicle. Unless `exact`, the
 * boxes of moving actors get the noise of the options; parked cars get none, since an annotator draws one box for all
 * frames. */
static pags_result make_track(const pags_street *street, const pags_actor *actor, bool exact, pags_layout_track *out) {
  static const char *const classes[] = {"Car", "Pedestrian", "Cyclist"};
  static const char *const words[] = {"car", "pedestrian", "cyclist"};
  const pags_street_options *o = street->options;
  pags_object *object = &out->object;
  object->id = pags_text_format("%s_%s_%03d", actor->moving ? "moving" : "parked", words[actor->role], actor->number);
  object->class_name = pags_text_copy(classes[actor->role]);
  object->keyframes = calloc((size_t)o->frames, sizeof *object->keyframes);
  PAGS_CHECK_MEMORY(object->id && object->class_name && object->keyframes, "the tracks of a street");
  pags_widen3(actor->size, object->size);
  for (int f = 0; f < o->frames; f++) {
    if (!labelled(street, actor, f))
      continue;
    pags_keyframe *keyframe = &object->keyframes[object->keyframe_count++];
    keyframe->frame = f;
    double *box = keyframe->world_from_object;
    pags_actor_pose(actor, frame_time(street, f), box);
    if (!exact && actor->moving && (o->pose_noise > 0.0 || o->yaw_noise > 0.0)) {
      /* Label noise of a box: normal errors of x, y and yaw, independent from frame to frame. */
      double move[2], turn[2];
      const uint64_t stream = STREAM_POSE_NOISE + 2 * (uint64_t)actor->number;
      pags_rng_normal2(o->seed, stream, (uint64_t)f, move);
      pags_rng_normal2(o->seed, stream + 1, (uint64_t)f, turn);
      const double yaw = pags_atan2(box[4], box[0]) + turn[0] * o->yaw_noise * 0.017453292519943295;
      const double c = pags_cos(yaw), s = pags_sin(yaw);
      const double turned[9] = {c, -s, 0, s, c, 0, 0, 0, 1};
      const double at[3] = {box[3] + o->pose_noise * move[0], box[7] + o->pose_noise * move[1], box[11]};
      pags_pose_make(turned, at, box);
    }
  }
  return PAGS_OK;
}

typedef struct track_list {
  pags_layout_track *items;
  int64_t count;
} track_list;

static void destroy_tracks(track_list *list) {
  for (int64_t i = 0; i < list->count; i++)
    pags_layout_track_destroy(&list->items[i]);
  free(list->items);
}

/* Writes instances_info.json to a folder, with the tracks of all labelled actors in the order of their numbers, and
 * frame_instances.json, if `frames`, which has no noise. */
static pags_result write_instances(const pags_street *street, const char *folder, bool exact, bool frames) {
  PAGS_AUTO(destroy_tracks) track_list list = {.items = calloc((size_t)street->actor_count + 1, sizeof *list.items)};
  PAGS_CHECK_MEMORY(list.items, "the tracks of a street");
  for (int i = 0; i < street->actor_count; i++)
    if (street->actors[i].number >= 0)
      PAGS_TRY(make_track(street, &street->actors[i], exact, &list.items[list.count++]));
  PAGS_AUTOFREE char *info = pags_path_join(folder, "instances_info.json");
  PAGS_AUTOFREE char *by_frame = pags_path_join(folder, "frame_instances.json");
  PAGS_CHECK_MEMORY(info && by_frame, "%s", folder);
  PAGS_TRY(pags_layout_write_instances(info, list.items, list.count));
  return frames ? pags_layout_write_frame_instances(by_frame, list.items, list.count, street->options->frames)
                : PAGS_OK;
}

pags_result pags_street_write_instances(const pags_street *street, const char *folder) {
  PAGS_AUTOFREE char *labelled = pags_path_join(folder, "instances");
  PAGS_AUTOFREE char *exact = pags_path_join(folder, "truth/instances");
  PAGS_CHECK_MEMORY(labelled && exact, "%s", folder);
  PAGS_TRY(write_instances(street, labelled, false, true));
  return write_instances(street, exact, true, false);
}

/* Describes the street (cameras, frames, LiDAR columns) for the writer of the driving data set layout. */
static pags_layout_info info_of(const pags_street *street, pags_layout_camera cameras[3]) {
  static const char *const names[] = {"front", "front_left", "front_right"};
  static const char *const columns[] = {"x", "y", "z", "intensity", NULL};
  static const char *const words[] = {[PAGS_READ_DOWN] = "top_to_bottom",
                                      [PAGS_READ_UP] = "bottom_to_top",
                                      [PAGS_READ_RIGHT] = "left_to_right",
                                      [PAGS_READ_LEFT] = "right_to_left"};
  const pags_street_faults *faults = &street->options->faults;
  for (int c = 0; c < 3; c++)
    cameras[c] = (pags_layout_camera){.number = c,
                                      .name = names[c],
                                      .rolling_shutter = faults->rolling > 0.0 ? words[faults->read_out] : NULL,
                                      .lens = pags_faults_camera(street->options, 0, c, -1).lens};
  return (pags_layout_info){.kind = "pags",
                            .fps = street->options->fps,
                            .frame_count = street->options->frames,
                            .camera_count = street->options->cameras,
                            .cameras = cameras,
                            .lidar_columns = columns};
}

/* All exposures of a frame have the frame's time: nobody knows of a camera's delay. With a rolling shutter, the begin
 * and the end of the read-out are known; a line is exposed for no time. */
pags_result pags_street_write_timestamps(const pags_street *street, const char *path) {
  pags_layout_camera cameras[3];
  const pags_layout_info info = info_of(street, cameras);
  const int64_t exposures = info.frame_count * info.camera_count;
  PAGS_AUTOFREE double *frames = malloc((size_t)info.frame_count * sizeof *frames);
  PAGS_AUTOFREE pags_layout_exposure *exposure = malloc((size_t)exposures * sizeof *exposure);
  PAGS_CHECK_MEMORY(frames && exposure, "the times of a street");
  for (int64_t i = 0; i < exposures; i++) {
    exposure[i] = pags_layout_exposure_unknown();
    exposure[i].time = frame_time(street, (int)(i / info.camera_count));
    if (street->options->faults.rolling > 0.0) {
      exposure[i].trigger = exposure[i].time - 0.5 * street->options->faults.rolling;
      exposure[i].readout = exposure[i].time + 0.5 * street->options->faults.rolling;
      exposure[i].shutter = 0.0;
    }
  }
  for (int64_t f = 0; f < info.frame_count; f++)
    frames[f] = frame_time(street, (int)f);
  return pags_layout_write_times(path, &info, &(pags_layout_times){.frames = frames, .exposures = exposure});
}

pags_result pags_street_write_description(const pags_street *street, const char *path) {
  pags_layout_camera cameras[3];
  const pags_layout_info info = info_of(street, cameras);
  return pags_layout_write_description(path, &info, 1);
}

/* Writes a text file of `count` numbers, `across` of them on each line. */
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

pags_result pags_street_write_intrinsics(const char *path, const pags_camera *camera, double k1) {
  const double numbers[9] = {camera->fx, camera->fy, camera->cx, camera->cy, k1};
  return write_numbers(path, numbers, pags_camera_bends(camera) ? 4 : 9, 1);
}
