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

/* Makes the path folder/TTT_C.extension; folder/TTT.extension if camera is -1, folder/C.extension if frame is -1. NULL
 * if out of memory. */
static char *file_path(const pags_layout *layout, const char *folder, int64_t frame, int camera,
                       const char *extension) {
  assert(frame >= 0 || camera >= 0);
  const char *root = layout->folder;
  if (frame < 0)
    return pags_text_format("%s/%s/%d%s", root, folder, camera, extension);
  if (camera < 0)
    return pags_text_format("%s/%s/%03lld%s", root, folder, (long long)frame, extension);
  return pags_text_format("%s/%s/%03lld_%d%s", root, folder, (long long)frame, camera, extension);
}

bool pags_layout_has(const pags_layout *layout, const char *folder, int64_t frame, int camera, const char *extension) {
  static const char *const pictures[] = {".png", ".jpg", ".jpeg"};
  for (int i = 0; i < (extension ? 1 : 3); i++) {
    PAGS_AUTOFREE char *path = file_path(layout, folder, frame, camera, extension ? extension : pictures[i]);
    if (path && pags_file_exists(path))
      return true;
  }
  return false;
}

bool pags_layout_is_finished(const pags_layout *layout) {
  return pags_folder_has(layout->folder, "dataset.json");
}

/* ---- Beginning an import ---- */

/* What import.json in the folder says: missing; equal to the one of this import; of another import. */
typedef enum work_state { WORK_NONE, WORK_SAME, WORK_OTHER } work_state;

/* Compares the file `marker` with the import.json that this import would write, which may go on with a result. */
static pags_result compare_work(const char *marker, const pags_json_writer *writer, work_state *out) {
  static const char end[] = "\n}\n", result[] = ",\n  \"result\": ";
  const size_t common = writer->size - (sizeof end - 1);
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size = 0;
  *out = WORK_NONE;
  if (!pags_file_exists(marker))
    return PAGS_OK;
  PAGS_TRY(pags_file_read(marker, &bytes, &size));
  const bool whole = size == writer->size && !memcmp(bytes, writer->data, size);
  const bool ended = size > common + sizeof result && !memcmp(bytes, writer->data, common) &&
                     !memcmp(bytes + common, result, sizeof result - 1);
  *out = whole || ended ? WORK_SAME : WORK_OTHER;
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

/* Prepares the folder: continues unfinished work of the same import; otherwise the folder must be empty, or
 * `overwrite` set, in which case the files of the layout are removed. Then writes import.json. */
static pags_result claim(const pags_layout *layout, const pags_json_writer *writer, bool overwrite) {
  PAGS_AUTOFREE char *marker = pags_path_join(layout->folder, "import.json");
  PAGS_CHECK_MEMORY(marker, "%s", layout->folder);
  work_state state = WORK_NONE;
  PAGS_TRY(compare_work(marker, writer, &state));
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(pags_dir_list_read(layout->folder, &list));
  /* Nothing, or nothing but what a process has left that was killed while it wrote import.json. */
  const bool unused = list.count == 0 || (list.count == 1 && strcmp(list.names[0], "import.json.part") == 0);
  if (state == WORK_SAME && !(overwrite && pags_layout_is_finished(layout)))
    return PAGS_OK;
  if (!unused && !overwrite)
    return pags_fail(PAGS_ERROR_IO, "%s: %s; another folder is wanted, or --overwrite", layout->folder,
                     state == WORK_OTHER ? "was begun from another source or with other options (see its import.json)"
                                         : "holds something else already");

  /* Remove the files of an earlier import. */
  for (int i = 0; i < FILES + FOLDERS; i++) {
    PAGS_AUTOFREE char *path = pags_path_join(layout->folder, i < FILES ? files[i] : folders[i - FILES]);
    PAGS_CHECK_MEMORY(path, "%s", layout->folder);
    PAGS_TRY(pags_remove_tree(path));
  }
  return pags_file_write(marker, writer->data, writer->size);
}

pags_result pags_layout_begin(pags_layout *layout, const char *folder, const pags_layout_info *info, bool overwrite) {
  assert(info->frame_count > 0 && info->camera_count > 0 && info->camera_count <= PAGS_LAYOUT_CAMERAS);
  *layout = (pags_layout){0};
  PAGS_AUTO(pags_layout_destroy) pags_layout begun = {.folder = pags_text_copy(folder), .info = info};
  PAGS_CHECK_MEMORY(begun.folder, "%s", folder);
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {0};
  begin_marker(info, &writer);
  pags_json_end_object(&writer);
  PAGS_TRY(pags_json_writer_finish(&writer));
  PAGS_TRY(pags_lock_folder(folder, &begun.lock));
  PAGS_TRY(claim(&begun, &writer, overwrite));
  *layout = begun;
  begun = (pags_layout){0};
  return PAGS_OK;
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
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {0};
  begin_marker(info, &writer);
  pags_account_put(account, &counts, "result", &writer);
  pags_json_end_object(&writer);
  return pags_json_writer_save_in_folder(&writer, layout->folder, "import.json");
}

void pags_layout_destroy(pags_layout *layout) {
  pags_lock_release(layout->lock);
  free(layout->folder);
  *layout = (pags_layout){0};
}

/* ---- Files of a frame ---- */

pags_result pags_layout_make_folder(const char *path) {
  PAGS_AUTOFREE char *parent = pags_path_folder(path);
  PAGS_CHECK_MEMORY(parent, "%s", path);
  return pags_make_dirs(parent);
}

pags_result pags_layout_put_file(const pags_layout *layout, const char *folder, int64_t frame, int camera,
                                 const char *extension, const void *bytes, size_t size) {
  PAGS_AUTOFREE char *path = file_path(layout, folder, frame, camera, extension);
  PAGS_CHECK_MEMORY(path, "%s", layout->folder);
  if (pags_file_exists(path))
    return PAGS_OK;
  PAGS_TRY(pags_layout_make_folder(path));
  return pags_file_write(path, bytes, size);
}

pags_result pags_layout_copy_image(const pags_layout *layout, int64_t frame, int camera, const char *path) {
  const char *extension = pags_path_extension(path);
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size = 0;
  if (pags_layout_has(layout, "images", frame, camera, extension))
    return PAGS_OK;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  return pags_layout_put_file(layout, "images", frame, camera, extension, bytes, size);
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
  return pags_layout_put_file(layout, folder, frame, camera, ".txt", text, (size_t)at);
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
  PAGS_AUTOFREE uint8_t *bytes = malloc(count ? 4 * count : 1);
  PAGS_CHECK_MEMORY(bytes, "%s: a sweep of %lld points", layout->folder, (long long)rows);
  for (size_t i = 0; i < count; i++)
    pags_store_f32(bytes + 4 * i, values[i]);
  return pags_layout_put_file(layout, "lidar", frame, -1, ".bin", bytes, 4 * count);
}
