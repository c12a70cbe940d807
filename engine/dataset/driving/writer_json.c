/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the files of the layout that describe the whole set: instances, intrinsics, times and dataset.json. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "dataset/driving/writer.h"
#include "scene/scene_json.h"

/* Makes the path of a file of the layout and creates its folder. */
static pags_result make_path(const pags_layout *layout, const char *name, char **out) {
  *out = pags_path_join(layout->folder, name);
  PAGS_CHECK_MEMORY(*out, "%s", layout->folder);
  return pags_layout_make_folder(*out);
}

/* Begins an object or an array whose key is a number. */
static const char *number_key(char key[24], int64_t number) {
  snprintf(key, 24, "%lld", (long long)number);
  return key;
}

/* ---- Instances ---- */

static void put_annotations(pags_json_writer *writer, const pags_layout_track *track) {
  static const double last[4] = {0, 0, 0, 1};
  const pags_object *object = &track->object;
  pags_json_begin_object(writer, "frame_annotations");
  pags_json_begin_array(writer, "frame_idx");
  for (int64_t i = 0; i < object->keyframe_count; i++)
    pags_json_put_integer(writer, NULL, object->keyframes[i].frame);
  pags_json_end_array(writer);
  pags_json_begin_array(writer, "obj_to_world");
  for (int64_t i = 0; i < object->keyframe_count; i++) {
    pags_json_begin_array(writer, NULL);
    for (int row = 0; row < 4; row++)
      pags_json_put_numbers(writer, NULL, row < 3 ? object->keyframes[i].world_from_object + 4 * row : last, 4);
    pags_json_end_array(writer);
  }
  pags_json_end_array(writer);
  pags_json_begin_array(writer, "box_size");
  for (int64_t i = 0; i < object->keyframe_count; i++)
    pags_json_put_numbers(writer, NULL, track->sizes ? track->sizes + 3 * i : object->size, 3);
  pags_json_end_array(writer);
  pags_json_end_object(writer);
}

pags_result pags_layout_write_instances(const char *path, const pags_layout_track *tracks, int64_t count) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {0};
  char key[24];
  pags_json_begin_object(&writer, NULL);
  for (int64_t i = 0; i < count; i++) {
    pags_json_begin_object(&writer, number_key(key, i));
    pags_json_put_string(&writer, "id", tracks[i].object.id);
    pags_json_put_string(&writer, "class_name", tracks[i].object.class_name);
    put_annotations(&writer, &tracks[i]);
    pags_json_end_object(&writer);
  }
  pags_json_end_object(&writer);
  return pags_json_writer_save(&writer, path);
}

pags_result pags_layout_write_frame_instances(const char *path, const pags_layout_track *tracks, int64_t count,
                                              int64_t frame_count) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {0};
  char key[24];
  pags_json_begin_object(&writer, NULL);
  for (int64_t frame = 0; frame < frame_count; frame++) {
    pags_json_begin_array(&writer, number_key(key, frame));
    for (int64_t i = 0; i < count; i++)
      if (pags_object_keyframe(&tracks[i].object, frame))
        pags_json_put_integer(&writer, NULL, i);
    pags_json_end_array(&writer);
  }
  pags_json_end_object(&writer);
  return pags_json_writer_save(&writer, path);
}

pags_result pags_layout_put_instances(const pags_layout *layout, const pags_layout_track *tracks, int64_t count) {
  PAGS_AUTOFREE char *infos = NULL;
  PAGS_AUTOFREE char *frames = NULL;
  PAGS_TRY(make_path(layout, "instances/instances_info.json", &infos));
  PAGS_TRY(make_path(layout, "instances/frame_instances.json", &frames));
  PAGS_TRY(pags_layout_write_instances(infos, tracks, count));
  return pags_layout_write_frame_instances(frames, tracks, count, layout->info->frame_count);
}

/* ---- Intrinsics ---- */

static pags_result put_intrinsics(const pags_layout *layout) {
  const pags_layout_info *info = layout->info;
  for (int c = 0; c < info->camera_count; c++) {
    char text[9 * 32], name[48];
    int at = 0;
    const int numbers = pags_lens_model_is_plain(&info->cameras[c].lens) ? 9 : 4;
    for (int i = 0; i < numbers; i++)
      at += snprintf(text + at, sizeof text - (size_t)at, "%.17g\n", info->cameras[c].intrinsics[i]);
    snprintf(name, sizeof name, "intrinsics/%d.txt", info->cameras[c].number);
    PAGS_AUTOFREE char *path = NULL;
    PAGS_TRY(make_path(layout, name, &path));
    PAGS_TRY(pags_file_write(path, text, (size_t)at));
  }
  return PAGS_OK;
}

/* ---- Times ---- */

/* The members of pags_layout_exposure by their keys in timestamps.json. The value of a key has the form {"C": [one
 * value per frame]}. */
static const struct column {
  const char *key;
  size_t offset;
  int count;
} columns[] = {{"cameras", offsetof(pags_layout_exposure, time), 1},
               {"shutter", offsetof(pags_layout_exposure, shutter), 1},
               {"trigger", offsetof(pags_layout_exposure, trigger), 1},
               {"readout", offsetof(pags_layout_exposure, readout), 1},
               {"velocity", offsetof(pags_layout_exposure, velocity), 6},
               {"pose_time", offsetof(pags_layout_exposure, pose_time), 1},
               {"pose", offsetof(pags_layout_exposure, pose), 12}};

static const double *column_value(const pags_layout_exposure *exposure, const struct column *column) {
  return (const double *)(const void *)((const char *)exposure + column->offset);
}

static bool is_known(const pags_layout_times *times, int64_t count, const struct column *column) {
  for (int64_t i = 0; times->exposures && i < count; i++)
    if (!isnan(*column_value(&times->exposures[i], column)))
      return true;
  return false;
}

pags_result pags_layout_write_times(const char *path, const pags_layout_info *info, const pags_layout_times *times) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {0};
  pags_json_writer_init(&writer, 1);
  pags_json_begin_object(&writer, NULL);
  pags_json_begin_array(&writer, "frames");
  for (int64_t t = 0; t < info->frame_count; t++)
    pags_json_put_number(&writer, NULL, times->frames[t]);
  pags_json_end_array(&writer);
  for (size_t i = 0; i < sizeof columns / sizeof columns[0]; i++)
    if (is_known(times, info->frame_count * info->camera_count, &columns[i])) {
      char key[24];
      pags_json_begin_object(&writer, columns[i].key);
      for (int c = 0; c < info->camera_count; c++) {
        pags_json_begin_array(&writer, number_key(key, info->cameras[c].number));
        for (int64_t t = 0; t < info->frame_count; t++) {
          const double *value = column_value(&times->exposures[t * info->camera_count + c], &columns[i]);
          if (columns[i].count == 1)
            pags_json_put_number(&writer, NULL, *value);
          else
            pags_json_put_numbers(&writer, NULL, value, columns[i].count);
        }
        pags_json_end_array(&writer);
      }
      pags_json_end_object(&writer);
    }
  if (times->lidar) {
    pags_json_begin_array(&writer, "lidar");
    for (int64_t t = 0; t < info->frame_count; t++)
      pags_json_put_numbers(&writer, NULL, times->lidar + 2 * t, 2);
    pags_json_end_array(&writer);
  }
  pags_json_end_object(&writer);
  return pags_json_writer_save(&writer, path);
}

/* ---- dataset.json ---- */

static void put_cameras(pags_json_writer *writer, const pags_layout_info *info) {
  char key[24];
  bool rolling = false, bends = false;
  pags_json_begin_object(writer, "cameras");
  for (int c = 0; c < info->camera_count; c++) {
    pags_json_put_string(writer, number_key(key, info->cameras[c].number), info->cameras[c].name);
    rolling = rolling || info->cameras[c].rolling_shutter;
    bends = bends || !pags_lens_model_is_plain(&info->cameras[c].lens);
  }
  pags_json_end_object(writer);
  if (rolling) {
    pags_json_begin_object(writer, "rolling_shutter");
    for (int c = 0; c < info->camera_count; c++)
      pags_json_put_string(writer, number_key(key, info->cameras[c].number), info->cameras[c].rolling_shutter);
    pags_json_end_object(writer);
  }
  if (!bends)
    return;
  pags_json_begin_object(writer, "lenses");
  for (int c = 0; c < info->camera_count; c++)
    if (!pags_lens_model_is_plain(&info->cameras[c].lens))
      pags_lens_to_json(writer, number_key(key, info->cameras[c].number), &info->cameras[c].lens);
  pags_json_end_object(writer);
}

pags_result pags_layout_write_description(const char *path, const pags_layout_info *info, int indent) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {0};
  pags_json_writer_init(&writer, indent);
  pags_json_begin_object(&writer, NULL);
  pags_json_put_string(&writer, "kind", info->kind);
  pags_json_put_string(&writer, "camera_axes", "opencv");
  pags_json_put_string(&writer, "extrinsics",
                       !info->extrinsics_per_frame   ? "constant camera-to-ego (C.txt)"
                       : info->extrinsics_from_world ? "per-frame camera-to-world (TTT_C.txt)"
                                                     : "per-frame camera-to-ego (TTT_C.txt)");
  if (info->lidar_columns) {
    pags_json_begin_array(&writer, "lidar_columns");
    for (int i = 0; info->lidar_columns[i]; i++)
      pags_json_put_string(&writer, NULL, info->lidar_columns[i]);
    pags_json_end_array(&writer);
    pags_json_put_string(&writer, "lidar_frame", "ego");
  }
  pags_json_put_string(&writer, "object_forward", "+x");
  pags_json_put_number(&writer, "fps", info->fps);
  pags_place_to_json(&writer, &info->place);
  put_cameras(&writer, info);
  if (info->source) {
    pags_json_put_string(&writer, "source", info->source);
    pags_json_put_integer(&writer, "first_frame", info->first_frame);
  }
  pags_json_end_object(&writer);
  return pags_json_writer_save(&writer, path);
}

pags_result pags_layout_finish(const pags_layout *layout, const pags_layout_times *times) {
  if (pags_layout_is_finished(layout))
    return PAGS_OK;
  PAGS_AUTOFREE char *stamps = NULL;
  PAGS_AUTOFREE char *description = NULL;
  PAGS_TRY(put_intrinsics(layout));
  PAGS_TRY(make_path(layout, "timestamps.json", &stamps));
  PAGS_TRY(pags_layout_write_times(stamps, layout->info, times));
  PAGS_TRY(make_path(layout, "dataset.json", &description));
  return pags_layout_write_description(description, layout->info, 2);
}
