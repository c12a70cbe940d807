/* SPDX-License-Identifier: Apache-2.0 */
/* The captures and recordings of other programs that can't be opened, in one table: how each is recognised, and a
 * remedy. */
#include "dataset/unsupported_formats.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <pags/scene.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "dataset/find_file.h"
#include "scene/other_formats.h"

#define OPENSFM "OpenSfM's or ODM's", "`opensfm export_colmap FOLDER` writes a COLMAP model of it"
#define OPENMVG "OpenMVG's", "`openMVG_main_openMVG2Colmap -i sfm_data.json -o FOLDER` writes a COLMAP model of it"
#define ALICEVISION \
  "Meshroom's (AliceVision's)", "`aliceVision_exportColmap -i FILE -o FOLDER` writes a COLMAP model of it"
#define METASHAPE                                                                                   \
  "Metashape's",                                                                                    \
      "export the cameras as COLMAP there (File, Export, Export Cameras), or use `ns-process-data " \
      "metashape`"
#define REALITY_NAME "RealityScan's"
#define REALITY_WAY "export the registration as COLMAP there, with undistorted pictures"
#define REALITY REALITY_NAME, REALITY_WAY
#define SDFSTUDIO "SDFStudio's", "give the COLMAP model or the transforms.json that it was made of"
#define NEUS "of IDR or NeuS", PICTURES
#define PICTURES "`pags import photos FOLDER -o DATASET` finds the cameras of the pictures by COLMAP"
#define INRIA                                                                       \
  "the cameras.json of a trained scene (INRIA's), without intrinsics of a capture", \
      "give the data set that it was trained on; `pags render --path` takes it as a camera path"

#define PARQUET \
  "of Waymo Open v2, pags import waymo2 reads the folder that has camera_image and the other components in it"
#define LAYOUT "docs/dataset-layout.md describes the files to write from it"
#define ARGOVERSE "a log of Argoverse 2", "pags import argoverse2 reads it"
#define NUSCENES "nuScenes", "pags import nuscenes reads it"
#define KITTI_OBJECTS \
  "KITTI's object benchmark: single photographs, no drive", "the tracking benchmark or a raw recording is needed"
#define KITTI_ODOMETRY \
  "KITTI's odometry benchmark, which isn't imported", "the raw recording of the same drive is (pags import kitti)"
#define WEB_PAGE "a web page, not a recording: the download failed", NULL

/* How a format is recognised. The first row that fits counts. */
typedef enum sign {
  RECORDING,  /* a folder that has one of these files or folders and, unless it is NULL, `other` */
  IMPORTABLE, /* the same, and an importer reads the folder itself */
  BYTES,      /* a file that begins so */
  FILE_ONLY,  /* a file of one of these names */
  SPLAT_FILE, /* the same, of splats */
  ENTRY,      /* a file of one of these names, or a folder that has such a file or folder */
  KEY         /* a JSON file with one of these keys in its root or, where that is an array, in its first element */
} sign;

static const struct unsupported_format {
  sign sign;
  const char *names, *other; /* several names are separated by blanks; "*.psx": any of this ending */
  const char *what, *remedy;
} formats[] = {
    {RECORDING, "city_SE3_egovehicle.feather", NULL, ARGOVERSE},
    {RECORDING, "annotations.feather", "sensors", ARGOVERSE},
    {RECORDING, "samples", "sweeps", NUSCENES},
    {RECORDING, "v1.0-mini v1.0-trainval", NULL, NUSCENES},
    {RECORDING, "camera/front_camera annotations/cuboids", "lidar", "a raw sequence of PandaSet",
     "pags import pandaset reads it"},
    {RECORDING, "camera_image", "vehicle_pose", "Waymo Open v2", "pags import waymo2 reads a segment of it"},
    {RECORDING, "nuplan-v1.1", NULL, "nuPlan",
     "drivestudio's datasets/preprocess.py makes of it the data set that is read, then with --kind nuplan"},
    {RECORDING, "data_2d_raw data_3d_raw calibration/perspective.txt", NULL, "KITTI-360",
     "pags import kitti360 reads a drive of it"},
    {RECORDING, "image_2", "label_2", KITTI_OBJECTS},
    {RECORDING, "training/image_2", NULL, KITTI_OBJECTS},
    {RECORDING, "sequences", "poses", KITTI_ODOMETRY},
    {RECORDING, "image_2 image_0", "calib.txt", "a sequence of " KITTI_ODOMETRY},
    {IMPORTABLE, "image_02", "calib", "KITTI's tracking benchmark: 'pags import kitti' makes a data set of it", NULL},
    {IMPORTABLE, "training/image_02", NULL,
     "KITTI's tracking benchmark: 'pags import kitti' makes a data set of its folder training", NULL},
    {IMPORTABLE, "image_02/data", "oxts", "a raw recording of KITTI: 'pags import kitti' makes a data set of it", NULL},
    {IMPORTABLE, "calib_cam_to_cam.txt", NULL,
     "a day of KITTI's raw recordings: 'pags import kitti' makes a data set of a drive", NULL},
    {IMPORTABLE, "*.tfrecord", NULL,
     "a folder of Waymo Open v1 segments: 'pags import waymo FILE' makes a data set of one", NULL},
    {RECORDING, "*.parquet */*.parquet", NULL, "parquet files", PARQUET},
    {RECORDING, "*.db3 *.mcap", "metadata.yaml", "a ROS 2 bag, which isn't read", LAYOUT},
    {RECORDING, "*.bag", NULL, "a folder of ROS bags, which aren't read", LAYOUT},

    {BYTES, "PAR1", NULL, "a parquet file", PARQUET},
    {BYTES, "ARROW1", NULL, "a feather file, as of Argoverse 2", "pags import argoverse2 reads the log's folder"},
    {BYTES, "#ROSBAG", NULL, "a ROS bag, which isn't read", LAYOUT},
    {BYTES, "\x89MCAP", NULL, "an MCAP recording, which isn't read", LAYOUT},
    {BYTES, "SQLite format 3", NULL, "a database, as of nuPlan or ROS 2, which isn't read", LAYOUT},
    {BYTES, "version https://git-lfs", NULL, "a pointer of Git LFS", "'git lfs pull' fetches the file it stands for"},
    {BYTES, "\x1f\x8b", NULL, "compressed by gzip", "gunzip it first"},
    {BYTES, "BZh", NULL, "compressed by bzip2", "bunzip2 it first"},
    {BYTES, "(\xb5/\xfd", NULL, "compressed by zstd", "unzstd it first"},
    {BYTES, "\3757zXZ", NULL, "compressed by xz", "unxz it first"},
    {BYTES, "<!DOCTYPE", NULL, WEB_PAGE},
    {BYTES, "<html", NULL, WEB_PAGE},
    {BYTES, "PK\3\4", NULL, "an archive (zip)", "unpack it first"},

    {FILE_ONLY,
     "cameras.txt cameras.bin images.txt images.bin points3d.txt points3d.bin rigs.txt rigs.bin frames.txt frames.bin",
     NULL, "a file of a COLMAP model", "give the folder of the data set, or the model's by --colmap"},
    {FILE_ONLY, "cfg_args", NULL, "of a training's output (INRIA's)", "give its folder to info, render or export"},
    {FILE_ONLY, "*.csv", NULL, "a table, perhaps " REALITY_NAME " cameras", REALITY_WAY},
    {FILE_ONLY, "*.out", NULL, "Bundler's", PICTURES},
    {SPLAT_FILE, "*.ply", NULL, "a file of points or splats", "a data set has photographs: give their folder"},
    {SPLAT_FILE, "*.splat *.spz *.sog *.pagsz *.glb", NULL, "a file of splats",
     "a data set has photographs: give their folder"},

    {ENTRY, "reconstruction.json opensfm/reconstruction.json", NULL, OPENSFM},
    {ENTRY, "sfm_data.json sfm_data.bin matches/sfm_data.json reconstruction/sfm_data.json reconstruction/sfm_data.bin",
     NULL, OPENMVG},
    {ENTRY, "*.sfm", NULL, ALICEVISION},
    {ENTRY, "*.psx *.psz cameras.xml", NULL, METASHAPE},
    {ENTRY, "*.rcproj *.rsproj *.rcalign", NULL, REALITY},
    {ENTRY, "keyframes", NULL, "Polycam's raw export",
     "`ns-process-data polycam --data FOLDER --output-dir OUT` writes a transforms.json"},
    {ENTRY, "meta_data.json", NULL, SDFSTUDIO},
    {ENTRY, "poses_bounds.npy", NULL, "of LLFF", PICTURES},
    {ENTRY, "cameras.npz cameras_sphere.npz", NULL, NEUS},
    {ENTRY, "cams", NULL, "of MVSNet", PICTURES},
    {ENTRY, "*.nvm", NULL, "VisualSFM's", PICTURES},
    {ENTRY, "bundle.out", NULL, "Bundler's", PICTURES},
    {ENTRY, "*.log", NULL, "a trajectory (.log, of Open3D or Tanks and Temples)", "it has no intrinsics: " PICTURES},
    {ENTRY, "*.e57", NULL, "a scan (E57)", "a scan is no capture: " PICTURES},
    {ENTRY, "*.las *.laz", NULL, "a point cloud (LAS)", "points are no capture: " PICTURES},
    {ENTRY, "database.db", NULL, "COLMAP's database, without a model",
     "`colmap mapper --database_path database.db --image_path images --output_path sparse` makes the model"},
    {ENTRY, "*.mp4 *.mov", NULL, "a video",
     "`pags import photos VIDEO -o DATASET` takes pictures out of it and finds their cameras by COLMAP"},
    {ENTRY, "*.insv", NULL, "a 360-degree video", "its pictures are panoramas, which can't be used yet"},
    {ENTRY, "*.xml", NULL, METASHAPE},
    {ENTRY, "*.p4d", NULL, "Pix4D's", PICTURES},
    {ENTRY,
     "cameras.bin cameras.txt images.bin images.txt sparse/0/cameras.bin sparse/0/cameras.txt sparse/0/images.bin "
     "sparse/0/images.txt",
     NULL, "of a COLMAP model that lacks files", "expected cameras and images there, both .bin or both .txt"},

    {KEY, "sfm_data_version", NULL, OPENMVG},
    {KEY, "shots", NULL, OPENSFM},
    {KEY, "featuresFolders poses", NULL, ALICEVISION},
    {KEY, "img_name", NULL, INRIA},
    {KEY, "camera_path", NULL, "nerfstudio's camera path", "`pags render --path` takes it; a data set has photographs"},
    {KEY, "camtoworld", NULL, SDFSTUDIO},
    {KEY, "worldMat0", NULL, NEUS},
};

typedef struct unsupported_format unsupported_format;
static const unsupported_format *const formats_end = formats + sizeof formats / sizeof *formats;

/* ---- Recordings ---- */

/* Whether a folder has a file or folder of this name; "*.db3": any of this ending, below any folder with another star
 * before it. */
static bool has(const char *folder, const char *name) {
  if (*name != '*')
    return pags_folder_has_entry(folder, name);
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  if (pags_dir_list_read(folder, &list) != PAGS_OK)
    return false;
  for (int64_t i = 0; i < list.count; i++) {
    PAGS_AUTOFREE char *inner = pags_path_join(folder, list.names[i]);
    if (name[1] == '/' ? inner && pags_dir_exists(inner) && has(inner, name + 2)
                       : strcasecmp(pags_path_extension(list.names[i]), name + 1) == 0)
      return true;
  }
  return false;
}

/* Returns the first of a row's names that the folder has, in `out`; NULL if it has none. */
static const char *find_name(const char *folder, const char *names, char out[64]) {
  while (pags_words_next(&names, out))
    if (has(folder, out))
      return out;
  return NULL;
}

pags_result pags_unsupported_recording_check(const char *path, bool importers) {
  const bool folder = pags_dir_exists(path);
  uint8_t head[32];
  char name[64];
  const bool has_head = !folder && pags_file_head(path, head, sizeof head) >= 8;
  for (const unsupported_format *f = formats; f < formats_end; f++)
    if (folder ? (f->sign == RECORDING || (f->sign == IMPORTABLE && importers)) && (!f->other || has(path, f->other)) &&
                     find_name(path, f->names, name)
               : has_head && f->sign == BYTES && memcmp(head, f->names, strlen(f->names)) == 0)
      return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: is %s%s%s", path, f->what, f->remedy ? "; " : "",
                       f->remedy ? f->remedy : "");
  if (importers && strcasecmp(pags_path_extension(path), ".tfrecord") == 0)
    return pags_fail(PAGS_ERROR_UNSUPPORTED,
                     "%s: is a segment of Waymo Open: 'pags import waymo' makes a data set of it", path);
  return PAGS_OK;
}

/* ---- Captures ---- */

/* Whether `file`, without folders, has this name, whatever its letter case. */
static bool fits(const char *name, const char *file) {
  return *name == '*' ? strcasecmp(name + 1, pags_path_extension(file)) == 0 : strcasecmp(name, file) == 0;
}

static bool fits_any(const unsupported_format *f, const char *file) {
  char name[64];
  for (const char *names = f->names; pags_words_next(&names, name);)
    if (fits(name, file))
      return true;
  return false;
}

static pags_result refuse(const char *path, const char *file, const unsupported_format *f) {
  return pags_fail_at(path, "not a data set that can be read: %s is %s; %s", file, f->what, f->remedy);
}

/* Refuses a folder one of whose folders is a recording, a scene or a data set, by the name of the first. */
static pags_result refuse_children(const char *path, const pags_dir_list *list) {
  for (int64_t i = 0; i < list->count; i++) {
    PAGS_AUTOFREE char *child = list->names[i][0] == '.' ? NULL : pags_path_join(path, list->names[i]);
    if (!child || !pags_dir_exists(child))
      continue;
    const char *kind = pags_folder_is_data_set(child) ? "data set" : pags_scene_folder_kind(child);
    if (kind)
      return pags_fail_at(path, "not a data set, but its folder %s is a %s: give that one", list->names[i], kind);
    PAGS_TRY(pags_unsupported_recording_check(child, true));
  }
  return PAGS_OK;
}

/* Refuses a folder by a file of another program that it has, or by a transforms file of another name. */
static pags_result refuse_entries(const char *path, const pags_dir_list *list) {
  for (int64_t i = 0; i < list->count; i++)
    if (pags_text_starts(list->names[i], "transforms") && strcmp(pags_path_extension(list->names[i]), ".json") == 0)
      return pags_fail_at(
          path, "not a data set: it has no transforms.json and no transforms_train.json, but %s: give that file itself",
          list->names[i]);
  for (const unsupported_format *f = formats; f < formats_end; f++) {
    char name[64];
    for (const char *names = f->names; f->sign == ENTRY && pags_words_next(&names, name);) {
      if (strchr(name, '/') && has(path, name))
        return refuse(path, name, f);
      for (int64_t i = 0; i < list->count; i++)
        if (fits(name, list->names[i]))
          return refuse(path, list->names[i], f);
    }
  }
  return PAGS_OK;
}

static int64_t count_pictures(const pags_dir_list *list) {
  int64_t count = 0;
  for (int64_t i = 0; i < list->count; i++)
    count += pags_is_picture_name(list->names[i]);
  return count;
}

static pags_result refuse_folder(const char *path) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(pags_dir_list_read(path, &list));
  PAGS_TRY(refuse_entries(path, &list));
  PAGS_AUTOFREE char *images = pags_path_join(path, "images");
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list below = {0};
  int64_t splats = 0;
  const char *const kind = pags_scene_folder_kind(path), *splat = NULL;
  for (int64_t i = 0; i < list.count; i++)
    for (const unsupported_format *f = formats; f < formats_end; f++)
      if (f->sign == SPLAT_FILE && fits_any(f, list.names[i])) {
        splat = splat ? splat : list.names[i];
        splats++;
      }
  const bool has_images = images && pags_dir_exists(images) && pags_dir_list_read(images, &below) == PAGS_OK;
  const int64_t pictures = count_pictures(&list), inside = has_images ? count_pictures(&below) : 0;
  const int64_t found = inside ? inside : pictures;
  if (kind && !inside)
    return pags_fail_at(path,
                        "not a data set but a %s without photographs: info, render and export take it; expected the "
                        "data set that it was made of",
                        kind);
  if (splats > pictures / 2 && !inside)
    return pags_fail_at(path,
                        "not a data set: it holds %lld splat file%s, such as %s: give one of them to info, render or "
                        "export; a data set has photographs",
                        (long long)splats, splats == 1 ? "" : "s", splat);
  if (found)
    return pags_fail_at(
        path, "not a data set: %lld picture%s without cameras; `pags import photos %s -o DATASET` finds them by COLMAP",
        (long long)found, found == 1 ? "" : "s", inside ? images : path);
  PAGS_TRY(refuse_children(path, &list));
  PAGS_TRY(pags_unsupported_splats_check_folder(path));
  return pags_fail_at(
      path,
      "not a data set: it has no dataset.json, no images with ego_pose or extrinsics, no transforms.json or "
      "transforms_train.json, and no COLMAP model (cameras and images, .bin or .txt) in it, in sparse/0 or below; %s",
      PICTURES);
}

static const unsupported_format *format_of_file(const char *path) {
  for (const unsupported_format *f = formats; f < formats_end; f++)
    if ((f->sign == FILE_ONLY || f->sign == SPLAT_FILE || f->sign == ENTRY) && fits_any(f, pags_path_name(path)))
      return f;
  return NULL;
}

bool pags_unsupported_knows(const char *path) {
  const unsupported_format *f = format_of_file(path);
  return f && strcmp(f->names, "*.ply") != 0;
}

pags_result pags_unsupported_refuse(const char *path) {
  PAGS_TRY(pags_unsupported_recording_check(path, true));
  if (pags_dir_exists(path))
    return refuse_folder(path);
  PAGS_TRY(pags_unsupported_splats_check(path, NULL, 0, NULL));
  const unsupported_format *f = format_of_file(path);
  if (f)
    return refuse(path, pags_path_name(path), f);
  return pags_fail_at(path, "not a data set: expected a folder or a transforms file (.json); %s", PICTURES);
}

pags_result pags_unsupported_refuse_json(const pags_json *json) {
  const pags_json_value *root = pags_json_root(json);
  const pags_json_value *object = root->type == PAGS_JSON_ARRAY ? root->first : root;
  const char *path = pags_json_path(json);
  char key[64];
  PAGS_TRY(pags_unsupported_splats_check(path, NULL, 0, root));
  for (const unsupported_format *f = formats; f < formats_end && object; f++)
    for (const char *names = f->names; f->sign == KEY && pags_words_next(&names, key);)
      if (pags_json_member(object, key))
        return pags_json_fail(json, root, "not a data set that can be read: it is %s; %s", f->what, f->remedy);
  const unsupported_format *f = format_of_file(path);
  if (f)
    return refuse(path, pags_path_name(path), f);
  return pags_json_fail(json, root,
                        "not a data set: expected 'frames', each with 'file_path' and 'transform_matrix', as in a "
                        "transforms.json of nerfstudio or instant-ngp");
}
