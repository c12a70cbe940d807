/* SPDX-License-Identifier: Apache-2.0 */
/* Warns of masks, sweeps, labels and poses that lie in a driving set under names that aren't read: another extension,
 * another number of digits, a number that no photograph has, a folder of another name. */
#include "dataset/driving/check/checks.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "dataset/find_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

typedef struct survey {
  const pags_driving *driving;
  const pags_driving_picture *pictures;
  int64_t count;
} survey;

/* What the names of a folder's files are made of. */
typedef enum name_form { FRAME_AND_CAMERA, FRAME, CAMERA } name_form;

typedef struct known_folder {
  const char *name;
  name_form form;
  const char *extension;
} known_folder;

/* ---- Names ---- */

/* Files that tools leave next to data: hidden ones, notes, records and films. */
static bool is_companion(const char *name) {
  return *name == '.' || strncasecmp(name, "readme", 6) == 0 || strncasecmp(name, "license", 7) == 0 ||
         pags_words_have(".json .md .mp4 .log .part .yaml .yml .db .ini", pags_path_extension(name));
}

/* Reads a number that is filled up with zeros to that number of digits, and to no more. */
static bool has_number(const char **at, int digits, int *out) {
  const char *begin = *at;
  return pags_driving_number(at, out) && (*at - begin == digits || (*at - begin > digits && *begin != '0'));
}

/* Whether a name has the form that is read in the folder; *used: whether there is a photograph that it belongs to. */
static bool has_form(const survey *s, const known_folder *folder, const char *name, bool *used) {
  const char *at = name;
  int frame = -1, camera = -1;
  *used = false;
  if (folder->form != CAMERA && !has_number(&at, s->driving->digits, &frame))
    return false;
  if (folder->form == FRAME_AND_CAMERA && *at++ != '_')
    return false;
  if (folder->form != FRAME && !has_number(&at, 1, &camera))
    return false;
  if (strcmp(at, folder->extension) != 0)
    return false;
  *used = pags_driving_has_picture(s->pictures, s->count, frame, camera);
  return true;
}

/* ---- Known folders ---- */

/* Lists FOLDER of the set, which has no files if it isn't there. */
static pags_result list_folder(const survey *s, const char *folder, char **path, pags_dir_list *list) {
  *path = pags_path_join(s->driving->root, folder);
  PAGS_CHECK_MEMORY(*path, "%s", s->driving->root);
  return pags_dir_exists(*path) ? pags_dir_list_read(*path, list) : PAGS_OK;
}

/* Warns of the files of a folder that aren't read. A folder that isn't there has none. */
static pags_result survey_folder(const survey *s, const known_folder *folder) {
  PAGS_AUTOFREE char *path = NULL;
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(list_folder(s, folder->name, &path, &list));
  int64_t files = 0, odd = 0, lone = 0;
  const char *first_odd = NULL, *first_lone = NULL;
  for (int64_t i = 0; i < list.count; i++) {
    const char *name = list.names[i];
    bool used;
    if (has_form(s, folder, name, &used)) {
      files++;
      if (!used)
        first_lone = lone++ ? first_lone : name;
    } else if (!is_companion(name) && (*pags_path_extension(name) || pags_folder_has_folder(path, name))) {
      files++;
      first_odd = odd++ ? first_odd : name;
    }
  }
  char expected[64] = "", camera[16]; /* the name that the reader opens for the first photograph */
  snprintf(camera, sizeof camera, "%d", s->pictures[0].camera);
  if (folder->form != CAMERA)
    snprintf(expected, sizeof expected, "%0*d", s->driving->digits, s->pictures[0].frame);
  snprintf(expected + strlen(expected), 32, "%s%s%s", folder->form == FRAME_AND_CAMERA ? "_" : "",
           folder->form == FRAME ? "" : camera, folder->extension);
  if (odd > 0)
    PAGS_WARN(
        "%s: %lld of %lld files aren't read, the first is %s; expected names like %s (%s, as the photographs have "
        "them)",
        path, (long long)odd, (long long)files, first_odd, expected,
        folder->form == FRAME_AND_CAMERA ? "frame_camera"
        : folder->form == FRAME          ? "frame"
                                         : "camera");
  if (lone > 0)
    PAGS_WARN("%s: %lld of %lld files aren't read, since there is no photograph of their number; the first is %s", path,
              (long long)lone, (long long)files, first_lone);
  return PAGS_OK;
}

/* Warns of files in images/ that aren't photographs of the set. */
static void survey_images(const survey *s, const pags_dir_list *list) {
  int64_t files = 0, others = 0;
  const char *first = NULL;
  for (int64_t i = 0; i < list->count; i++) {
    const char *name = list->names[i];
    pags_driving_picture picture;
    if (pags_driving_parse_picture(name, &picture)) {
      files++;
    } else if (!is_companion(name) && *pags_path_extension(name)) {
      files++;
      first = others++ ? first : name;
    }
  }
  if (others > 0)
    PAGS_WARN("%s/images: %lld of %lld files aren't read, the first is %s; expected names like %s, .jpg or .png",
              s->driving->root, (long long)others, (long long)files, first, s->pictures[0].name);
}

/* ---- Other folders and files ---- */

/* Other names under which the parts of a set are found. */
static const struct {
  const char *name, *others;
} synonyms[] = {{"sky_masks", "sky skymask sky_mask sky_masks"},
                {"semantic", "semantics semantic semantic_mask semantic_masks segmentation segmentations seg labels"},
                {"dynamic_masks/all", "dynamic dynamic_mask dynamic_masks fine_dynamic_masks"},
                {"ego_masks", "ego_mask"},
                {"lidar", "lidar lidars velodyne velodyne_points pointcloud pointclouds point_clouds points pcd"},
                {"ego_pose", "pose poses ego_poses"},
                {"lidar_pose", "lidar_poses"},
                {"instances", "instance objects tracks track"}};

/* Whether a name of the set's folder is one that the reader opens, or another tool's next to it. */
static bool is_known(const pags_driving *driving, const char *name) {
  static const char *const
      names[] = {"images",    "intrinsics", "extrinsics",    "ego_pose",  "lidar",
                 "sky_masks", "semantic",   "dynamic_masks", "ego_masks", "instances",
                 "truth",     "sparse",     "colmap",        "panoptic"}; /* panoptic: kept by 'pags import waymo' */
  return pags_text_find(name, names, sizeof names / sizeof *names) >= 0 || strcmp(name, driving->sky_folder) == 0 ||
         strcmp(name, driving->dynamic_folder) == 0 || (strcmp(name, "track") == 0 && driving->street_tracks) ||
         (strcmp(name, "lidar_pose") == 0 && driving->rules.lidar_frame);
}

/* Counts the files of a folder, and those whose names begin with the number of a frame and go on as data do. */
static pags_result count_files(const survey *s, const char *path, int64_t *files, int64_t *numbered) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  *files = *numbered = 0;
  PAGS_TRY(pags_dir_list_read(path, &list));
  for (int64_t i = 0; i < list.count; i++) {
    const char *at = list.names[i];
    int frame;
    if (*at == '.')
      continue;
    ++*files;
    *numbered += pags_driving_number(&at, &frame) && (*at == '_' || *at == '.') && at - list.names[i] >= 2 &&
                 pags_driving_has_picture(s->pictures, s->count, frame, -1);
  }
  return PAGS_OK;
}

/* Whether a file next to the folders holds data of a part of the set, by its name. */
static bool is_data_file(const char *name) {
  static const char *const words[] = {"timestamp", "instance", "track", "label", "annotation", "calib", "pose"};
  const char *extension = pags_path_extension(name);
  if (pags_words_have(".npz .npy .pkl .pcd .las .laz .bin .h5 .bag .feather .parquet .tfrecord", extension))
    return true;
  if (!pags_words_have(".json .txt .csv", extension))
    return false;
  for (size_t i = 0; i < sizeof words / sizeof *words; i++)
    for (const char *at = name; *at; at++)
      if (strncasecmp(at, words[i], strlen(words[i])) == 0)
        return true;
  return false;
}

typedef struct finds {
  int64_t folders, files;
  char first_folder[200], first_file[200];
} finds;

/* Looks at one entry of the set's folder, or of dynamic_masks/, that isn't known. */
static pags_result look_at(const survey *s, const char *path, const char *name, const char *meant, finds *found) {
  if (pags_dir_exists(path)) {
    int64_t files, numbered;
    PAGS_TRY(count_files(s, path, &files, &numbered));
    if (numbered == 0 && !(meant && files > 0))
      return PAGS_OK;
    if (found->folders++ == 0)
      snprintf(found->first_folder, sizeof found->first_folder, "%s with %lld files%s%s", name, (long long)files,
               meant ? ", expected as " : "", meant ? meant : "");
  } else if (*name != '.' && is_data_file(name)) {
    if (found->files++ == 0)
      snprintf(found->first_file, sizeof found->first_file, "%s", name);
  }
  return PAGS_OK;
}

/* Warns of unknown folders and files of the set's folder. */
static pags_result survey_root(const survey *s) {
  const char *root = s->driving->root;
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  finds found = {0};
  PAGS_TRY(pags_dir_list_read(root, &list));
  for (int64_t i = 0; i < list.count; i++) {
    const char *name = list.names[i];
    if (*name == '.' || is_known(s->driving, name) || strcmp(name, "timestamps.json") == 0 ||
        strcmp(name, "dataset.json") == 0)
      continue;
    PAGS_AUTOFREE char *path = pags_path_join(root, name);
    PAGS_CHECK_MEMORY(path, "%s", root);
    const char *meant = NULL;
    for (size_t k = 0; k < sizeof synonyms / sizeof *synonyms && !meant; k++)
      meant = pags_words_have(synonyms[k].others, name) ? synonyms[k].name : NULL;
    PAGS_TRY(look_at(s, path, name, meant, &found));
  }
  if (found.folders > 0)
    PAGS_WARN("%s: %lld folders aren't read that look like parts of the set, the first is %s", root,
              (long long)found.folders, found.first_folder);
  if (found.files > 0)
    PAGS_WARN(
        "%s: %lld files aren't read that look like parts of the set, the first is %s; expected names are those of "
        "docs/dataset-layout.md",
        root, (long long)found.files, found.first_file);
  return PAGS_OK;
}

/* Warns of entries of `folder` that have none of the `count` names which are read there. If not `all`, only where none
 * of these is there. */
static pags_result survey_names(const survey *s, const char *folder, const char *const *names, int count, bool all,
                                const char *expected) {
  PAGS_AUTOFREE char *path = NULL;
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(list_folder(s, folder, &path, &list));
  int64_t others = 0, read = 0;
  const char *first = NULL;
  for (int64_t i = 0; i < list.count; i++) {
    const bool known = pags_text_find(list.names[i], names, count) >= 0;
    read += known;
    if (!known && *list.names[i] != '.')
      first = others++ ? first : list.names[i];
  }
  if (others > 0 && (all || read == 0))
    PAGS_WARN("%s: %lld of %lld entries aren't read, the first is %s; expected %s", path, (long long)others,
              (long long)(others + read), first, expected);
  return PAGS_OK;
}

pags_result pags_driving_say_unread(const pags_driving *driving, const pags_dir_list *list,
                                    const pags_driving_picture *pictures, int64_t count) {
  const survey s = {driving, pictures, count};
  const known_folder folders[] = {{driving->sky_folder, FRAME_AND_CAMERA, ".png"},
                                  {"semantic", FRAME_AND_CAMERA, ".png"},
                                  {driving->dynamic_folder, FRAME_AND_CAMERA, ".png"},
                                  {"dynamic_masks/vehicle", FRAME_AND_CAMERA, ".png"},
                                  {"dynamic_masks/human", FRAME_AND_CAMERA, ".png"},
                                  {"ego_masks", CAMERA, ".png"},
                                  {"lidar", FRAME, ".bin"}};
  for (size_t i = 0; i < sizeof folders / sizeof *folders; i++)
    PAGS_TRY(survey_folder(&s, &folders[i]));
  survey_images(&s, list);

  /* Masks that lie in dynamic_masks itself, and boxes under other names. */
  static const char *const parts[] = {"all", "vehicle", "human"};
  static const char *const labels[] = {"instances_info.json", "frame_instances.json"};
  PAGS_TRY(survey_names(&s, "dynamic_masks", parts, 3, true, "all, vehicle and human with a mask each"));
  PAGS_TRY(survey_names(&s, "instances", labels, 2, false, labels[0]));
  return survey_root(&s);
}
