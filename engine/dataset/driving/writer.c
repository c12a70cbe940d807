/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the files of single frames in drivestudio's processed layout and begins an import (writer.h). A file of a
 * frame that exists is not written again, so that an interrupted import can be continued. */
#include "dataset/driving/writer.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/json.h"
#include "base/lock.h"
#include "base/memory.h"
#include "base/text.h"

static const char *const folders[] = {"images",        "ego_pose",  "extrinsics", "intrinsics", "lidar",
                                      "dynamic_masks", "sky_masks", "semantic",   "panoptic",   "instances"};
/* dataset.json marks a finished set. It is first in the list because an import removes the files in this order: an
 * interrupted removal then never leaves an incomplete set that opens. */
static const char *const files[] = {"dataset.json", "timestamps.json", "import.json"};
enum { FOLDERS = sizeof folders / sizeof folders[0], FILES = sizeof files / sizeof files[0] };

pags_layout_exposure pags_layout_exposure_unknown(void) {
  const double unknown = (double)NAN;
  pags_layout_exposure e = {
      .time = unknown, .shutter = unknown, .trigger = unknown, .readout = unknown, .pose_time = unknown};
  for (int i = 0; i < 6; i++)
    e.velocity[i] = unknown;
  for (int i = 0; i < 12; i++)
    e.pose[i] = unknown;
  return e;
}

void pags_layout_track_destroy(pags_layout_track *track) {
  pags_object_destroy(&track->object);
  free(track->sizes);
  *track = (pags_layout_track){0};
}

/* ---- File names ---- */

static pags_result join(const pags_layout *layout, const char *name, char **out) {
  *out = pags_path_join(layout->folder, name);
  return *out ? PAGS_OK : pags_out_of_memory("%s", layout->folder);
}

/* Makes the path folder/TTT_C.extension; folder/TTT.extension if camera is -1, folder/C.extension if frame is -1. */
static pags_result file_path(const pags_layout *layout, const char *folder, int64_t frame, int camera,
                             const char *extension, char **out) {
  char name[128];
  assert(frame >= 0 || camera >= 0);
  if (frame < 0)
    snprintf(name, sizeof name, "%s/%d%s", folder, camera, extension);
  else if (camera < 0)
    snprintf(name, sizeof name, "%s/%03lld%s", folder, (long long)frame, extension);
  else
    snprintf(name, sizeof name, "%s/%03lld_%d%s", folder, (long long)frame, camera, extension);
  return join(layout, name, out);
}

bool pags_layout_has(const pags_layout *layout, const char *folder, int64_t frame, int camera, const char *extension) {
  static const char *const pictures[] = {".png", ".jpg", ".jpeg"};
  bool found = false;
  for (int i = 0; i < 3 && !found; i++) {
    char *path = NULL;
    if (file_path(layout, folder, frame, camera, extension ? extension : pictures[i], &path) == PAGS_OK)
      found = pags_file_exists(path);
    free(path);
    if (extension)
      break;
  }
  return found;
}

bool pags_layout_is_finished(const pags_layout *layout) {
  char *path = pags_path_join(layout->folder, ("dataset.json"));
  const bool found = path && pags_file_exists(path);
  free(path);
  return found;
}

/* ---- Beginning an import ---- */

/* What import.json in the folder says: missing; equal to the one of this import; of another import. */
typedef enum work_state { WORK_NONE, WORK_SAME, WORK_OTHER } work_state;

/* Compares the file `marker` with the import.json that this import would write, which may go on with a result. */
static pags_result compare_work(const char *marker, const pags_json_writer *writer, work_state *out) {
  static const char end[] = "\n}\n", result[] = ",\n  \"result\": ";
  const size_t common = writer->size - (sizeof end - 1);
  uint8_t *bytes = NULL;
  size_t size = 0;
  *out = WORK_NONE;
  if (!pags_file_exists(marker))
    return PAGS_OK;
  PAGS_TRY(pags_file_read(marker, &bytes, &size));
  const bool whole = size == writer->size && !memcmp(bytes, writer->data, size);
  const bool ended = size > common + sizeof result && !memcmp(bytes, writer->data, common) &&
                     !memcmp(bytes + common, result, sizeof result - 1);
  *out = whole || ended ? WORK_SAME : WORK_OTHER;
  free(bytes);
  return PAGS_OK;
}

/* Begins import.json, which lists everything that the content of the files depends on. */
static void begin_marker(const pags_layout_info *info, pags_json_writer *writer) {
  pags_json_writer_init(writer, 2);
  pags_json_begin_object(writer, NULL);
  pags_json_put_string(writer, "kind", info->kind);
  pags_json_put_string(writer, "source", info->source);
  pags_json_put_integer(writer, "first_frame", info->first_frame);
  pags_json_put_integer(writer, "frames", info->frame_count);
  pags_json_begin_array(writer, "cameras");
  for (int i = 0; i < info->camera_count; i++)
    pags_json_put_integer(writer, NULL, info->cameras[i].number);
  pags_json_end_array(writer);
  pags_json_put_string(writer, "version", PAGS_VERSION_STRING);
}

/* Whether a folder has nothing, or nothing but what a process has left that was killed while it wrote import.json. */
static pags_result is_unused(const char *folder, bool *unused) {
  pags_dir_list list;
  PAGS_TRY(pags_dir_list_read(folder, &list));
  *unused = list.count == 0 || (list.count == 1 && strcmp(list.names[0], "import.json.part") == 0);
  pags_dir_list_destroy(&list);
  return PAGS_OK;
}

/* Prepares the folder: continues unfinished work of the same import; otherwise the folder must be empty, or
 * `overwrite` set, in which case the files of the layout are removed. Then writes import.json. */
static pags_result claim(const pags_layout *layout, const char *marker, const pags_json_writer *writer,
                         bool overwrite) {
  work_state state = WORK_NONE;
  bool unused = false;
  PAGS_TRY(compare_work(marker, writer, &state));
  PAGS_TRY(is_unused(layout->folder, &unused));
  if (state == WORK_SAME && !(overwrite && pags_layout_is_finished(layout)))
    return PAGS_OK;
  if (!unused && !overwrite)
    return pags_fail(PAGS_ERROR_IO, "%s: %s; another folder is wanted, or --overwrite", layout->folder,
                     state == WORK_OTHER ? "was begun from another source or with other options (see its import.json)"
                                         : "holds something else already");

  /* Remove the files of an earlier import. */
  pags_result result = PAGS_OK;
  for (int i = 0; i < FILES + FOLDERS && result == PAGS_OK; i++) {
    char *path = NULL;
    result = join(layout, i < FILES ? files[i] : folders[i - FILES], &path);
    if (result == PAGS_OK)
      result = pags_remove_tree(path);
    free(path);
  }
  PAGS_TRY(result);
  return pags_file_write(marker, writer->data, writer->size);
}

pags_result pags_layout_begin(pags_layout *layout, const char *folder, const pags_layout_info *info, bool overwrite) {
  pags_json_writer writer;
  char *marker = NULL;
  assert(info->frame_count > 0 && info->camera_count > 0 && info->camera_count <= PAGS_LAYOUT_CAMERAS);
  *layout = (pags_layout){.folder = pags_text_copy(folder), .info = info};
  if (!layout->folder)
    return pags_out_of_memory("%s", folder);

  begin_marker(info, &writer);
  pags_json_end_object(&writer);
  pags_result result = pags_json_writer_finish(&writer);

  if (result == PAGS_OK)
    result = pags_lock_folder(folder, &layout->lock);
  if (result == PAGS_OK)
    result = join(layout, "import.json", &marker);
  if (result == PAGS_OK)
    result = claim(layout, marker, &writer, overwrite);
  free(marker);
  pags_json_writer_destroy(&writer);
  if (result != PAGS_OK)
    pags_layout_destroy(layout);
  return result;
}

pags_result pags_layout_put_account(const pags_layout *layout, const pags_account *account,
                                    const pags_layout_track *tracks, int64_t track_count) {
  const pags_layout_info *info = layout->info;
  pags_account_counts counts = {.steps = info->frame_count,
                                .cameras = info->camera_count,
                                .photographs = info->frame_count * info->camera_count,
                                .objects = track_count};
  for (int64_t frame = 0; frame < info->frame_count; frame++)
    counts.sweeps += pags_layout_has(layout, "lidar", frame, -1, ".bin");
  for (int64_t i = 0; i < track_count; i++)
    counts.boxes += tracks[i].object.keyframe_count;
  pags_json_writer writer;
  char *marker = NULL;
  begin_marker(info, &writer);
  pags_account_put(account, &counts, "result", &writer);
  pags_json_end_object(&writer);
  pags_result result = join(layout, "import.json", &marker);
  if (result == PAGS_OK)
    result = pags_json_writer_save(&writer, marker);
  pags_json_writer_destroy(&writer);
  free(marker);
  return result;
}

void pags_layout_destroy(pags_layout *layout) {
  pags_lock_release(layout->lock);
  free(layout->folder);
  *layout = (pags_layout){0};
}

/* ---- Files of a frame ---- */

pags_result pags_layout_make_folder(const char *path) {
  char *parent = pags_path_folder(path);
  const pags_result result = parent ? pags_make_dirs(parent) : pags_out_of_memory("%s", path);
  free(parent);
  return result;
}

static pags_result write_file(const char *path, const void *bytes, size_t size) {
  PAGS_TRY(pags_layout_make_folder(path));
  return pags_file_write(path, bytes, size);
}

static pags_result put_file(const pags_layout *layout, const char *folder, int64_t frame, int camera,
                            const char *extension, const void *bytes, size_t size) {
  char *path = NULL;
  PAGS_TRY(file_path(layout, folder, frame, camera, extension, &path));
  const pags_result result = pags_file_exists(path) ? PAGS_OK : write_file(path, bytes, size);
  free(path);
  return result;
}

pags_result pags_layout_put_image(const pags_layout *layout, int64_t frame, int camera, const char *extension,
                                  const void *bytes, size_t size) {
  return put_file(layout, "images", frame, camera, extension, bytes, size);
}

pags_result pags_layout_put_picture(const pags_layout *layout, const char *folder, int64_t frame, int camera,
                                    const char *extension, const void *bytes, size_t size) {
  return put_file(layout, folder, frame, camera, extension, bytes, size);
}

pags_result pags_layout_copy_image(const pags_layout *layout, int64_t frame, int camera, const char *path) {
  uint8_t *bytes = NULL;
  size_t size = 0;
  if (pags_layout_has(layout, "images", frame, camera, pags_path_extension(path)))
    return PAGS_OK;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  const pags_result result = pags_layout_put_image(layout, frame, camera, pags_path_extension(path), bytes, size);
  free(bytes);
  return result;
}

/* Writes a rigid motion as four lines of four numbers with 17 significant digits, so that doubles are read back
 * bit-identical. */
static pags_result put_matrix(const pags_layout *layout, const char *folder, int64_t frame, int camera,
                              const double m[12]) {
  char text[16 * 32];
  int at = 0;
  for (int i = 0; i < 16; i++) {
    const double value = i < 12 ? m[i] : i == 15;
    at += snprintf(text + at, sizeof text - (size_t)at, "%.17g%c", value, i % 4 == 3 ? '\n' : ' ');
  }
  return put_file(layout, folder, frame, camera, ".txt", text, (size_t)at);
}

pags_result pags_layout_put_ego_pose(const pags_layout *layout, int64_t frame, const double world_from_ego[12]) {
  return put_matrix(layout, "ego_pose", frame, -1, world_from_ego);
}

pags_result pags_layout_put_extrinsics(const pags_layout *layout, int64_t frame, int camera, const double m[12]) {
  assert(frame < 0 || layout->info->extrinsics_per_frame);
  return put_matrix(layout, "extrinsics", frame, camera, m);
}

pags_result pags_layout_put_lidar(const pags_layout *layout, int64_t frame, int64_t rows, const float *values) {
  size_t columns = 0;
  while (layout->info->lidar_columns[columns])
    columns++;
  if (rows < 0 || (uint64_t)rows > SIZE_MAX / (4 * columns))
    return pags_fail(PAGS_ERROR_LIMIT, "%s: a sweep of %lld points is too large", layout->folder, (long long)rows);
  if (pags_layout_has(layout, "lidar", frame, -1, ".bin"))
    return PAGS_OK;
  const size_t count = (size_t)rows * columns;
  uint8_t *bytes = malloc(count ? 4 * count : 1);
  if (!bytes)
    return pags_out_of_memory("%s: a sweep of %lld points", layout->folder, (long long)rows);
  for (size_t i = 0; i < count; i++)
    pags_store_f32(bytes + 4 * i, values[i]);
  const pags_result result = put_file(layout, "lidar", frame, -1, ".bin", bytes, 4 * count);
  free(bytes);
  return result;
}
