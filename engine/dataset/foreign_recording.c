/* SPDX-License-Identifier: Apache-2.0 */
/* Recognises recordings of other formats by the files they hold (foreign_recording.h). */
#include "dataset/foreign_recording.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/file.h"
#include "base/memory.h"

#define PARQUET \
  "of Waymo Open v2, pags import waymo2 reads the folder that has camera_image and the other components in it"
#define LAYOUT "docs/dataset-layout.md describes the files to write from it"
#define DRIVESTUDIO "drivestudio's datasets/preprocess.py makes of it the data set that is read"

/* ---- Folders ---- */

/* Files or folders that tell a format. A name that begins with '*' matches any file with this ending. */
static const struct sign {
  const char *names[3]; /* all of them; NULL: fewer */
  bool importable;
  const char *text;
} signs[] = {
    {{"city_SE3_egovehicle.feather"}, false, "a log of Argoverse 2; pags import argoverse2 reads it"},
    {{"annotations.feather", "sensors"}, false, "a log of Argoverse 2; pags import argoverse2 reads it"},
    {{"samples", "sweeps"}, false, "nuScenes; pags import nuscenes reads it"},
    {{"v1.0-mini"}, false, "nuScenes; pags import nuscenes reads it"},
    {{"v1.0-trainval"}, false, "nuScenes; pags import nuscenes reads it"},
    {{"camera/front_camera", "lidar"}, false, "a raw sequence of PandaSet; pags import pandaset reads it"},
    {{"annotations/cuboids", "lidar"}, false, "a raw sequence of PandaSet; pags import pandaset reads it"},
    {{"camera_image", "vehicle_pose"}, false, "Waymo Open v2; pags import waymo2 reads a segment of it"},
    {{"nuplan-v1.1"}, false, "nuPlan; " DRIVESTUDIO ", then with --kind nuplan"},
    {{"data_2d_raw"}, false, "KITTI-360; pags import kitti360 reads a drive of it"},
    {{"data_3d_raw"}, false, "KITTI-360; pags import kitti360 reads a drive of it"},
    {{"calibration/perspective.txt"}, false, "KITTI-360; pags import kitti360 reads a drive of it"},
    {{"image_2", "label_2"},
     false,
     "KITTI's object benchmark: single photographs, no drive; the tracking benchmark or "
     "a raw recording is needed"},
    {{"training/image_2"},
     false,
     "KITTI's object benchmark: single photographs, no drive; the tracking benchmark or a "
     "raw recording is needed"},
    {{"sequences", "poses"},
     false,
     "KITTI's odometry benchmark, which isn't imported; the raw recording of the same "
     "drive is (pags import kitti)"},
    {{"calib.txt", "image_2"},
     false,
     "a sequence of KITTI's odometry benchmark, which isn't imported; the raw recording "
     "of the same drive is (pags import kitti)"},
    {{"calib.txt", "image_0"},
     false,
     "a sequence of KITTI's odometry benchmark, which isn't imported; the raw recording "
     "of the same drive is (pags import kitti)"},
    {{"image_02", "calib"}, true, "KITTI's tracking benchmark: 'pags import kitti' makes a data set of it"},
    {{"training/image_02"},
     true,
     "KITTI's tracking benchmark: 'pags import kitti' makes a data set of its folder training"},
    {{"image_02/data", "oxts"}, true, "a raw recording of KITTI: 'pags import kitti' makes a data set of it"},
    {{"calib_cam_to_cam.txt"},
     true,
     "a day of KITTI's raw recordings: 'pags import kitti' makes a data set of a drive"},
    {{"*.tfrecord"}, true, "a folder of Waymo Open v1 segments: 'pags import waymo FILE' makes a data set of one"},
    {{"*.parquet"}, false, "parquet files; " PARQUET},
    {{"*/*.parquet"}, false, "parquet files; " PARQUET},
    {{"metadata.yaml", "*.db3"}, false, "a ROS 2 bag, which isn't read; " LAYOUT},
    {{"metadata.yaml", "*.mcap"}, false, "a ROS 2 bag, which isn't read; " LAYOUT},
    {{"*.bag"}, false, "a folder of ROS bags, which aren't read; " LAYOUT}};

/* Whether a folder has a file with the ending; with `deep`, one of its folders. */
static bool has_ending(const char *folder, const char *ending, bool deep) {
  pags_dir_list list;
  bool found = false;
  if (pags_dir_list_read(folder, &list) != PAGS_OK)
    return false;
  for (int64_t i = 0; i < list.count && !found; i++) {
    if (!deep) {
      found = strcasecmp(pags_path_extension(list.names[i]), ending) == 0;
      continue;
    }
    char *inner = pags_path_join(folder, list.names[i]);
    found = inner && pags_dir_exists(inner) && has_ending(inner, ending, false);
    free(inner);
  }
  pags_dir_list_destroy(&list);
  return found;
}

static bool has(const char *folder, const char *name) {
  if (*name == '*')
    return has_ending(folder, strrchr(name, '.'), strchr(name, '/') != NULL);
  char *path = pags_path_join(folder, name);
  const bool found = path && pags_path_exists(path);
  free(path);
  return found;
}

static const char *name_folder(const char *folder, bool importers) {
  for (size_t i = 0; i < sizeof signs / sizeof *signs; i++) {
    bool all = importers || !signs[i].importable;
    for (int k = 0; k < 3 && all && signs[i].names[k]; k++)
      all = has(folder, signs[i].names[k]);
    if (all)
      return signs[i].text;
  }
  return NULL;
}

/* ---- Files ---- */

static const struct {
  const char *magic;
  const char *text;
} files[] = {{"PAR1", "a parquet file; " PARQUET},
             {"ARROW1", "a feather file, as of Argoverse 2; pags import argoverse2 reads the log's folder"},
             {"#ROSBAG", "a ROS bag, which isn't read; " LAYOUT},
             {"\x89MCAP", "an MCAP recording, which isn't read; " LAYOUT},
             {"SQLite format 3", "a database, as of nuPlan or ROS 2, which isn't read; " LAYOUT},
             {"version https://git-lfs", "a pointer of Git LFS; 'git lfs pull' fetches the file it stands for"},
             {"\x1f\x8b", "compressed by gzip; gunzip it first"},
             {"BZh", "compressed by bzip2; bunzip2 it first"},
             {"(\xb5/\xfd", "compressed by zstd; unzstd it first"},
             {"\xfd"
              "7zXZ",
              "compressed by xz; unxz it first"},
             {"<!DOCTYPE", "a web page, not a recording: the download failed"},
             {"<html", "a web page, not a recording: the download failed"}};

static const char *name_file(const char *path) {
  uint8_t head[32];
  if (pags_file_head(path, head, sizeof head) < 8)
    return NULL;
  for (size_t i = 0; i < sizeof files / sizeof *files; i++)
    if (memcmp(head, files[i].magic, strlen(files[i].magic)) == 0)
      return files[i].text;
  return memcmp(head, "PK\3\4", 4) == 0 ? "an archive (zip); unpack it first" : NULL;
}

pags_result pags_foreign_recording_check(const char *path, bool importers) {
  const char *text = pags_dir_exists(path) ? name_folder(path, importers) : name_file(path);
  if (!text && importers && strcasecmp(pags_path_extension(path), ".tfrecord") == 0)
    text = "a segment of Waymo Open: 'pags import waymo' makes a data set of it";
  return text ? pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: is %s", path, text) : PAGS_OK;
}
