/* SPDX-License-Identifier: Apache-2.0 */
/* Recognises files of other programs by their names, JSON files by their keys. */
#include "dataset/foreign.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include <pags/scene.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "dataset/find_file.h"
#include "dataset/foreign_recording.h"
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
#define TRAJECTORY "a trajectory (.log, of Open3D or Tanks and Temples)", "it has no intrinsics: " PICTURES
#define POLYCAM \
  "Polycam's raw export", "`ns-process-data polycam --data FOLDER --output-dir OUT` writes a transforms.json"
#define PART "of a COLMAP model that lacks files", "expected cameras and images there, both .bin or both .txt"
#define PICTURES "`pags import photos FOLDER -o DATASET` finds the cameras of the pictures by COLMAP"

typedef struct mark {
  const char *name; /* of a file or folder below the folder; "*.psx": any of this ending */
  const char *whose, *way;
} mark;

/* The first that is there counts. */
static const mark marks[] = {
    {"reconstruction.json", OPENSFM},
    {"opensfm/reconstruction.json", OPENSFM},
    {"sfm_data.json", OPENMVG},
    {"sfm_data.bin", OPENMVG},
    {"matches/sfm_data.json", OPENMVG},
    {"reconstruction/sfm_data.json", OPENMVG},
    {"reconstruction/sfm_data.bin", OPENMVG},
    {"*.sfm", ALICEVISION},
    {"*.psx", METASHAPE},
    {"*.psz", METASHAPE},
    {"cameras.xml", METASHAPE},
    {"*.rcproj", REALITY},
    {"*.rsproj", REALITY},
    {"*.rcalign", REALITY},
    {"keyframes", POLYCAM},
    {"meta_data.json", "SDFStudio's", "give the COLMAP model or the transforms.json that it was made of"},
    {"poses_bounds.npy", "of LLFF", PICTURES},
    {"cameras.npz", "of IDR or NeuS", PICTURES},
    {"cameras_sphere.npz", "of IDR or NeuS", PICTURES},
    {"cams", "of MVSNet", PICTURES},
    {"*.nvm", "VisualSFM's", PICTURES},
    {"bundle.out", "Bundler's", PICTURES},
    {"*.log", TRAJECTORY},
    {"*.e57", "a scan (E57)", "a scan is no capture: " PICTURES},
    {"*.las", "a point cloud (LAS)", "points are no capture: " PICTURES},
    {"*.laz", "a point cloud (LAS)", "points are no capture: " PICTURES},
    {"database.db", "COLMAP's database, without a model",
     "`colmap mapper --database_path database.db --image_path images --output_path sparse` makes the model"},
    {"*.mp4", "a video",
     "`pags import photos VIDEO -o DATASET` takes pictures out of it and finds their cameras by COLMAP"},
    {"*.mov", "a video",
     "`pags import photos VIDEO -o DATASET` takes pictures out of it and finds their cameras by COLMAP"},
    {"*.insv", "a 360-degree video", "its pictures are panoramas, which can't be used yet"},
    {"*.xml", METASHAPE},
    {"*.p4d", "Pix4D's", PICTURES},
    {"cameras.bin", PART},
    {"cameras.txt", PART},
    {"images.bin", PART},
    {"images.txt", PART},
    {"sparse/0/cameras.bin", PART},
    {"sparse/0/cameras.txt", PART},
    {"sparse/0/images.bin", PART},
    {"sparse/0/images.txt", PART}};

enum { MARKS = sizeof marks / sizeof *marks };

#define SPLATS "a file of splats", "a data set has photographs: give their folder"
#define MODEL_FILE "a file of a COLMAP model", "give the folder of the data set, or the model's by --colmap"

/* Of a path that is a file, before `marks`. */
static const mark file_marks[] = {
    {"cameras.txt", MODEL_FILE},
    {"cameras.bin", MODEL_FILE},
    {"images.txt", MODEL_FILE},
    {"images.bin", MODEL_FILE},
    {"points3d.txt", MODEL_FILE},
    {"points3d.bin", MODEL_FILE},
    {"rigs.txt", MODEL_FILE},
    {"rigs.bin", MODEL_FILE},
    {"frames.txt", MODEL_FILE},
    {"frames.bin", MODEL_FILE},
    {"cfg_args", "of a training's output (INRIA's)", "give its folder to info, render or export"},
    {"*.csv", "a table, perhaps " REALITY_NAME " cameras", REALITY_WAY},
    {"*.out", "Bundler's", PICTURES},
    {"*.ply", "a file of points or splats", "a data set has photographs: give their folder"},
    {"*.splat", SPLATS},
    {"*.spz", SPLATS},
    {"*.sog", SPLATS},
    {"*.pagsz", SPLATS},
    {"*.glb", SPLATS},
};

enum { FILE_MARKS = sizeof file_marks / sizeof *file_marks };

static char lower(char c) {
  return c >= 'A' && c <= 'Z' ? (char)(c - 'A' + 'a') : c;
}

/* Whether `name` is what the mark says, whatever its letter case; for a file's own name, without folders. */
static bool fits(const mark *m, const char *name) {
  const char *wanted = m->name;
  if (*wanted == '*')
    wanted++, name = pags_path_extension(name);
  size_t i = 0;
  while (wanted[i] && wanted[i] == lower(name[i]))
    i++;
  return !wanted[i] && !name[i];
}

static pags_result refuse(const char *path, const char *what, const mark *m) {
  return pags_fail(PAGS_ERROR_FORMAT, "%s: not a data set that can be read: %s is %s; %s", path, what, m->whose,
                   m->way);
}

/* Refuses a folder that is a scene or the output of another program's training. */
static pags_result refuse_scene(const char *path, const char *kind) {
  return pags_fail(
      PAGS_ERROR_FORMAT,
      "%s: not a data set but a %s without photographs: info, render and export take it; expected the data "
      "set that it was made of",
      path, kind);
}

/* Refuses a folder one of whose folders is a recording, a scene or a data set, by the name of the first. */
static pags_result refuse_children(const char *path, const pags_dir_list *list) {
  static const char *const files[] = {"transforms.json", "transforms_train.json", "dataset.json"};
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < list->count && result == PAGS_OK; i++) {
    char *child = list->names[i][0] == '.' ? NULL : pags_path_join(path, list->names[i]);
    if (child && pags_dir_exists(child)) {
      const char *kind = pags_scene_folder_kind(child);
      for (size_t k = 0; k < sizeof files / sizeof *files; k++)
        kind = pags_folder_has(child, files[k]) ? "data set" : kind;
      result = kind ? pags_fail(PAGS_ERROR_FORMAT, "%s: not a data set, but its folder %s is a %s: give that one", path,
                                list->names[i], kind)
                    : pags_foreign_recording_check(child, true);
    }
    free(child);
  }
  return result;
}

/* The name of the first splat file; *count: how many there are. */
static const char *find_splats(const pags_dir_list *list, int64_t *count) {
  static const mark endings[] = {{"*.ply", 0, 0}, {"*.spz", 0, 0},   {"*.splat", 0, 0},
                                 {"*.sog", 0, 0}, {"*.pagsz", 0, 0}, {"*.glb", 0, 0}};
  const char *first = NULL;
  *count = 0;
  for (int64_t i = 0; i < list->count; i++)
    for (size_t k = 0; k < sizeof endings / sizeof *endings; k++)
      if (fits(&endings[k], list->names[i])) {
        first = first ? first : list->names[i];
        (*count)++;
      }
  return first;
}

static pags_result refuse_folder(const char *path) {
  pags_dir_list list;
  PAGS_TRY(pags_dir_list_read(path, &list));
  const mark *found = NULL;
  const char *name = NULL;
  for (int i = 0; i < MARKS && !found; i++) {
    char *file = strchr(marks[i].name, '/') ? pags_path_join(path, marks[i].name) : NULL;
    if (file && pags_path_exists(file))
      found = &marks[i], name = marks[i].name;
    free(file);
    for (int64_t j = 0; j < list.count && !found; j++)
      if (fits(&marks[i], list.names[j]))
        found = &marks[i], name = list.names[j];
  }
  int64_t pictures = 0, inside = 0, splats = 0;
  const char *const splat = find_splats(&list, &splats), *const kind = pags_scene_folder_kind(path);
  const char *part = NULL; /* a transforms file of another name */
  for (int64_t i = 0; i < list.count; i++) {
    if (strncmp(list.names[i], "transforms", 10) == 0 && strcmp(pags_path_extension(list.names[i]), ".json") == 0)
      part = part ? part : list.names[i];
    pictures += pags_is_picture_name(list.names[i]);
  }
  char *images = pags_path_join(path, "images");
  pags_dir_list below = {0};
  if (images && pags_dir_exists(images) && pags_dir_list_read(images, &below) == PAGS_OK)
    for (int64_t i = 0; i < below.count; i++)
      inside += pags_is_picture_name(below.names[i]);
  pags_dir_list_destroy(&below);
  pags_result result;
  if (part)
    result = pags_fail(PAGS_ERROR_FORMAT,
                       "%s: not a data set: it has no transforms.json and no transforms_train.json, but %s: give that "
                       "file itself",
                       path, part);
  else if (found)
    result = refuse(path, name, found);
  else if (kind && !inside)
    result = refuse_scene(path, kind);
  else if (splats > pictures / 2 && !inside)
    result =
        pags_fail(PAGS_ERROR_FORMAT,
                  "%s: not a data set: it holds %lld splat file%s, such as %s: give one of them to info, render or "
                  "export; a data set has photographs",
                  path, (long long)splats, splats == 1 ? "" : "s", splat);
  else if (pictures || inside)
    result = pags_fail(PAGS_ERROR_FORMAT,
                       "%s: not a data set: %lld picture%s without cameras; `pags import photos %s -o DATASET` finds "
                       "them by COLMAP",
                       path, (long long)(inside ? inside : pictures), (inside ? inside : pictures) == 1 ? "" : "s",
                       inside ? images : path);
  else if ((result = refuse_children(path, &list)) == PAGS_OK &&
           (result = pags_unsupported_splats_check_folder(path)) == PAGS_OK)
    result = pags_fail(
        PAGS_ERROR_FORMAT,
        "%s: not a data set: it has no dataset.json, no images with ego_pose or extrinsics, no transforms.json or "
        "transforms_train.json, and no COLMAP model (cameras and images, .bin or .txt) in it, in sparse/0 or below; %s",
        path, PICTURES);
  pags_dir_list_destroy(&list);
  free(images);
  return result;
}

static const mark *mark_of_file(const char *path) {
  for (int i = 0; i < FILE_MARKS; i++)
    if (fits(&file_marks[i], pags_path_name(path)))
      return &file_marks[i];
  for (int i = 0; i < MARKS; i++)
    if (fits(&marks[i], pags_path_name(path)))
      return &marks[i];
  return NULL;
}

bool pags_foreign_knows(const char *path) {
  const mark *m = mark_of_file(path);
  return m && strcmp(m->name, "*.ply") != 0;
}

pags_result pags_foreign_refuse(const char *path) {
  PAGS_TRY(pags_foreign_recording_check(path, true));
  if (pags_dir_exists(path))
    return refuse_folder(path);
  PAGS_TRY(pags_unsupported_splats_check(path, NULL, 0, NULL));
  const mark *m = mark_of_file(path);
  if (m)
    return refuse(path, pags_path_name(path), m);
  return pags_fail(PAGS_ERROR_FORMAT, "%s: not a data set: expected a folder or a transforms file (.json); %s", path,
                   PICTURES);
}

pags_result pags_foreign_refuse_json(const pags_json *json) {
  static const struct {
    const char *key; /* of the root or, where that is an array, of its first element */
    const char *whose, *way;
  } keys[] = {{"sfm_data_version", OPENMVG},
              {"shots", OPENSFM},
              {"featuresFolders", ALICEVISION},
              {"poses", ALICEVISION},
              {"img_name", "the cameras.json of a trained scene (INRIA's), without intrinsics of a capture",
               "give the data set that it was trained on; `pags render --path` takes it as a camera path"},
              {"camera_path", "nerfstudio's camera path", "`pags render --path` takes it; a data set has photographs"},
              {"camtoworld", "SDFStudio's", "give the COLMAP model or the transforms.json that it was made of"},
              {"worldMat0", "of IDR or NeuS", PICTURES}};
  const pags_json_value *root = pags_json_root(json);
  const char *path = pags_json_path(json);
  PAGS_TRY(pags_unsupported_splats_check(path, NULL, 0, root));
  const pags_json_value *object = root->type == PAGS_JSON_ARRAY ? root->first : root;
  for (size_t i = 0; object && i < sizeof keys / sizeof *keys; i++)
    if (pags_json_member(object, keys[i].key))
      return pags_json_fail(json, root, "not a data set that can be read: it is %s; %s", keys[i].whose, keys[i].way);
  const mark *m = mark_of_file(path);
  if (m)
    return refuse(path, pags_path_name(path), m);
  return pags_json_fail(json, root,
                        "not a data set: expected 'frames', each with 'file_path' and 'transform_matrix', as in a "
                        "transforms.json of nerfstudio or instant-ngp");
}
