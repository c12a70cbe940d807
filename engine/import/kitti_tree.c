/* SPDX-License-Identifier: Apache-2.0 */
/* Recognises the kind of a KITTI folder tree, chooses the sequence and the frames, and lists the files that are
 * missing. */
#include "import/kitti_tree.h"

#include <stdarg.h>
#include <stdio.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "dataset/unsupported_formats.h"
#include "import/importer.h"

/* ---- Paths ---- */

static char *join_format(const char *folder, const char *format, ...) PAGS_PRINTF(2, 3);
static char *join_format(const char *folder, const char *format, ...) {
  char name[512];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(name, sizeof name, format, arguments);
  va_end(arguments);
  return pags_path_join(folder, name);
}

/* Extensions of photographs: KITTI's own first, then those of copies that were made to save room. */
static const char *const extensions[] = {".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG"};
enum { EXTENSIONS = sizeof extensions / sizeof extensions[0] };

/* Returns the path of the photograph that is there; with KITTI's own extension if none exists. */
char *pags_kitti_image_path(const pags_kitti_tree *tree, int camera, int64_t frame) {
  for (int i = 0; i <= EXTENSIONS; i++) {
    const char *extension = extensions[i % EXTENSIONS];
    char *path = tree->raw
                     ? join_format(tree->root, "image_%02d/data/%010lld%s", camera + 2, (long long)frame, extension)
                     : join_format(tree->root, "image_%02d/%s/%06lld%s", camera + 2, tree->sequence, (long long)frame,
                                   extension);
    if (!path || i == EXTENSIONS || pags_file_exists(path))
      return path;
    free(path);
  }
  return NULL;
}

char *pags_kitti_points_path(const pags_kitti_tree *tree, int64_t frame) {
  return tree->raw ? join_format(tree->root, "velodyne_points/data/%010lld.bin", (long long)frame)
                   : join_format(tree->root, "velodyne/%s/%06lld.bin", tree->sequence, (long long)frame);
}

char *pags_kitti_oxts_path(const pags_kitti_tree *tree, int64_t frame) {
  return tree->raw ? join_format(tree->root, "oxts/data/%010lld.txt", (long long)frame)
                   : join_format(tree->root, "oxts/%s.txt", tree->sequence);
}

char *pags_kitti_calib_path(const pags_kitti_tree *tree) {
  return tree->raw ? join_format(tree->root, "..") : join_format(tree->root, "calib/%s.txt", tree->sequence);
}

char *pags_kitti_labels_path(const pags_kitti_tree *tree) {
  return tree->raw ? join_format(tree->root, "tracklet_labels.xml")
                   : join_format(tree->root, "label_02/%s.txt", tree->sequence);
}

/* The folder of a camera's photographs, freed by the caller; NULL when out of memory. */
static char *picture_folder(const pags_kitti_tree *tree, int camera) {
  return tree->raw ? join_format(tree->root, "image_%02d/data", camera + 2)
                   : join_format(tree->root, "image_%02d/%s", camera + 2, tree->sequence);
}

void pags_kitti_tree_close(pags_kitti_tree *tree) {
  free(tree->root);
  free(tree->sequence);
  *tree = (pags_kitti_tree){0};
}

/* ---- Missing files ---- */

typedef struct missing {
  const char *root;
  char text[640]; /* names of missing files; shorter than a message (1,023 bytes), which also has the path */
  size_t length;
  int64_t count, left_out;
} missing;

static void add_missing(missing *m, const char *name) {
  m->count++;
  const size_t room = sizeof m->text - m->length;
  const int length = snprintf(m->text + m->length, room, "%s%s", m->length ? ", " : "", name);
  if (length < 0 || (size_t)length >= room) {
    m->text[m->length] = 0;
    m->left_out++;
  } else
    m->length += (size_t)length;
}

static void want_file(missing *m, const char *path) {
  if (path && !pags_file_exists(path))
    add_missing(m, path + strlen(m->root) + 1);
}

typedef bool exists_fn(const char *path);

/* Whether root/name exists; if it does not, the name is added to the missing files. */
static bool want(missing *m, exists_fn *exists, const char *format, ...) PAGS_PRINTF(3, 4);
static bool want(missing *m, exists_fn *exists, const char *format, ...) {
  char name[512];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(name, sizeof name, format, arguments);
  va_end(arguments);
  PAGS_AUTOFREE char *path = pags_path_join(m->root, name);
  const bool there = path && exists(path);
  if (!there)
    add_missing(m, name);
  return there;
}

/* Fails with a list of the missing files and, if cameras are among them, a remedy. */
static pags_result report(const pags_kitti_tree *tree, const missing *m, const missing *optional) {
  const char *what = tree->raw ? "KITTI's raw recording" : "KITTI's tracking tree";
  char more[64] = "", also[128] = "";
  if (m->left_out)
    snprintf(more, sizeof more, " and %lld more", (long long)m->left_out);
  if (optional->count)
    snprintf(also, sizeof also, "; also missing, but not needed: %.60s", optional->text);
  const char *hint = "";
  if (strstr(m->text, "image_") && pags_folder_has_entry(tree->root, "image_00") &&
      !pags_folder_has_entry(tree->root, "image_02"))
    hint = "; image_00 and image_01 are grey and aren't imported";
  else if (strstr(m->text, "image_") && tree->camera_count > 1)
    hint = "; --cameras chooses among 0 (image_02) and 1 (image_03), --frames among the frames";
  return pags_fail(PAGS_ERROR_IO, "%s: %s lacks %s%s%s%s", m->root, what, m->text, more, also, hint);
}

/* ---- Kind of the tree ---- */

/* Entries of a drive of a raw recording, and of a tracking tree; any one of them tells. */
static const char *const drive_signs[] = {"image_02/data", "image_03/data",       "velodyne_points",
                                          "oxts/data",     "tracklet_labels.xml", NULL};
static const char *const tracking_signs[] = {"image_02", "image_03", "velodyne", "oxts", "calib", "label_02", NULL};

static bool has_any(const char *folder, const char *const *names) {
  while (*names && !pags_folder_has_entry(folder, *names))
    names++;
  return *names;
}

/* Candidates found: the first one, their number, and their names as a list for a message. */
typedef struct choice {
  char *first;
  int64_t count;
  char names[400];
  size_t length;
} choice;

static void forget_choice(choice *c) {
  free(c->first);
}

static pags_result add_choice(choice *c, const char *name) {
  const size_t room = sizeof c->names - c->length;
  const int length = snprintf(c->names + c->length, room, "%s%s", c->count ? ", " : "", name);
  if (length >= 0 && (size_t)length < room)
    c->length += (size_t)length;
  else
    memcpy(c->names + sizeof c->names - 4, "...", 4);
  if (c->count++ == 0)
    c->first = pags_text_copy(name);
  return c->first ? PAGS_OK : pags_out_of_memory(NULL);
}

/* Whether a folder name is a synchronised drive that --sequence selects by its whole name or by its number; NULL: any
 * drive. */
static bool is_wanted_drive(const char *name, const char *sequence) {
  const char *number = strstr(name, "_drive_");
  const size_t length = strlen(name);
  if (!number || length < 5 || strcmp(name + length - 5, "_sync") != 0)
    return false;
  number += strlen("_drive_");
  const size_t digits = strcspn(number, "_");
  return !sequence || !strcmp(name, sequence) || (strlen(sequence) == digits && !strncmp(number, sequence, digits));
}

/* Collects the drives below `path` and, with `deeper`, one level further down. */
static pags_result find_drives(const char *path, const char *sequence, bool deeper, choice *found) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_TRY(pags_dir_list_read(path, &list));
  for (int64_t i = 0; i < list.count; i++) {
    PAGS_AUTOFREE char *inner = pags_path_join(path, list.names[i]);
    PAGS_CHECK_MEMORY(inner, "%s", path);
    if (!pags_dir_exists(inner))
      continue;
    if (is_wanted_drive(list.names[i], sequence))
      PAGS_TRY(add_choice(found, inner));
    else if (deeper)
      PAGS_TRY(find_drives(inner, sequence, false, found));
  }
  return PAGS_OK;
}

static pags_result set_root(pags_kitti_tree *tree, const char *path) {
  size_t length = strlen(path);
  tree->root = pags_text_copy(path);
  PAGS_CHECK_MEMORY(tree->root, "%s", path);
  while (length > 1 && tree->root[length - 1] == '/')
    tree->root[--length] = 0;
  return PAGS_OK;
}

static pags_result set_drive(pags_kitti_tree *tree, const char *path) {
  PAGS_TRY(set_root(tree, path));
  tree->raw = true;
  tree->sequence = pags_text_copy(pags_path_name(tree->root));
  PAGS_CHECK_MEMORY(tree->sequence, "%s", path);
  if (strstr(tree->sequence, "_extract"))
    return pags_fail(PAGS_ERROR_UNSUPPORTED,
                     "%s: is neither synchronised nor rectified; the recording's _sync folder is needed", path);
  return PAGS_OK;
}

static pags_result find_root(pags_kitti_tree *tree, const char *path, const char *sequence) {
  PAGS_AUTO(forget_choice) choice drives = {0};
  if (!pags_dir_exists(path))
    return pags_fail(PAGS_ERROR_IO, "%s: no such folder", path);
  if (has_any(path, drive_signs))
    return set_drive(tree, path);
  PAGS_TRY(pags_unsupported_recording_check(path, false));
  if (has_any(path, tracking_signs))
    return set_root(tree, path);
  PAGS_TRY(find_drives(path, sequence, true, &drives));
  if (drives.count == 1)
    return set_drive(tree, drives.first);
  if (drives.count > 1)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: holds %lld drives (%s); choose one by --sequence", path,
                     (long long)drives.count, drives.names);
  return pags_fail(PAGS_ERROR_IO,
                   "%s: is no KITTI tree%s%s: of the tracking benchmark it lacks image_02, image_03, calib, oxts, "
                   "velodyne, label_02; of raw recordings it lacks DATE_drive_NNNN_sync with image_02/data, "
                   "image_03/data, oxts/data, velodyne_points/data, tracklet_labels.xml and calib_cam_to_cam.txt, "
                   "calib_velo_to_cam.txt, calib_imu_to_velo.txt next to it",
                   path, sequence ? " with the sequence " : "", sequence ? sequence : "");
}

/* Returns the number of a photograph's file, "000012.png"; -1 if it is no photograph. */
static int64_t number_of_picture(const char *name) {
  char *end = NULL;
  const long long number = *name >= '0' && *name <= '9' ? strtoll(name, &end, 10) : -1;
  for (int i = 0; i < EXTENSIONS && number >= 0 && number < 1000000; i++)
    if (!strcmp(end, extensions[i]))
      return number;
  return -1;
}

/* ---- Sequence of the tracking benchmark ---- */

/* Collects candidates for the sequence: the one that the caller named, else all sequences in the first of these
 * folders that has any. */
static pags_result find_sequence(const pags_kitti_tree *tree, const char *wanted, choice *found) {
  static const struct {
    const char *folder, *extension;
  } places[] = {{"image_02", ""}, {"image_03", ""}, {"label_02", ".txt"}, {"oxts", ".txt"}, {"calib", ".txt"}};
  if (wanted)
    return pags_path_is_inside(wanted) && !strchr(wanted, '/')
               ? add_choice(found, wanted)
               : pags_fail(PAGS_ERROR_ARGUMENT, "sequence: expected a name such as 0000, got '%s'", wanted);
  for (size_t p = 0; p < sizeof places / sizeof places[0] && found->count == 0; p++) {
    PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
    PAGS_AUTOFREE char *path = pags_path_join(tree->root, places[p].folder);
    PAGS_CHECK_MEMORY(path, "%s", tree->root);
    if (pags_dir_exists(path))
      PAGS_TRY(pags_dir_list_read(path, &list));
    for (int64_t i = 0; i < list.count; i++) {
      char *dot = strrchr(list.names[i], '.');
      if (strcmp(dot ? dot : "", places[p].extension) != 0)
        continue;
      if (dot)
        *dot = 0;
      PAGS_TRY(add_choice(found, list.names[i]));
    }
  }
  return PAGS_OK;
}

static pags_result check_tracking(pags_kitti_tree *tree, const choice *found) {
  missing needed = {.root = tree->root}, optional = {.root = tree->root};
  const bool one = found->count == 1;
  const char *slash = one ? "/" : "", *s = one ? tree->sequence : "", *ending = one ? ".txt" : "";
  exists_fn *exists = one ? pags_file_exists : pags_dir_exists;
  for (int c = 0; c < tree->camera_count; c++)
    want(&needed, pags_dir_exists, "image_%02d%s%s", tree->cameras[c] + 2, slash, s);
  want(&needed, exists, "calib%s%s%s", slash, s, ending);
  want(&needed, exists, "oxts%s%s%s", slash, s, ending);
  tree->has_points = want(&optional, pags_dir_exists, "velodyne%s%s", slash, s);
  tree->has_labels = want(&optional, exists, "label_02%s%s%s", slash, s, ending);
  if (needed.count)
    return report(tree, &needed, &optional);
  return one ? PAGS_OK
             : pags_fail(PAGS_ERROR_ARGUMENT, "%s: holds %lld sequences (%s); choose one by --sequence", tree->root,
                         (long long)found->count, found->names);
}

/* Whether the camera has a folder with photographs of the drive or the sequence. */
static bool has_pictures(const pags_kitti_tree *tree, int camera) {
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  PAGS_AUTOFREE char *folder = picture_folder(tree, camera);
  if (folder && pags_dir_exists(folder) && pags_dir_list_read(folder, &list) == PAGS_OK)
    for (int64_t i = 0; i < list.count; i++)
      if (number_of_picture(list.names[i]) >= 0)
        return true;
  return false;
}

/* Drops the cameras without photographs, unless the caller chose the cameras or none would be left. */
static void keep_cameras_with_pictures(pags_kitti_tree *tree) {
  pags_tally without = {0};
  int kept = 0, numbers[16];
  for (int c = 0; c < tree->camera_count; c++)
    if (has_pictures(tree, tree->cameras[c]))
      numbers[kept++] = tree->cameras[c];
  if (kept == 0 || kept == tree->camera_count)
    return;
  for (int c = 0; c < tree->camera_count; c++)
    if (!has_pictures(tree, tree->cameras[c])) {
      pags_tally_add(&without, "image_%02d", tree->cameras[c] + 2);
      PAGS_WARN("%s: camera %d is left out: image_%02d has no photographs (--cameras %d says that it isn't wanted)",
                tree->root, tree->cameras[c], tree->cameras[c] + 2, numbers[0]);
    }
  pags_account_leave_out(&tree->account, "cameras", &without, "no photographs");
  memcpy(tree->cameras, numbers, (size_t)kept * sizeof *numbers);
  tree->camera_count = kept;
}

static pags_result check_raw(pags_kitti_tree *tree) {
  missing needed = {.root = tree->root}, optional = {.root = tree->root};
  for (int c = 0; c < tree->camera_count; c++) {
    want(&needed, pags_dir_exists, "image_%02d/data", tree->cameras[c] + 2);
    want(&needed, pags_file_exists, "image_%02d/timestamps.txt", tree->cameras[c] + 2);
  }
  want(&needed, pags_dir_exists, "oxts/data");
  want(&needed, pags_file_exists, "../calib_cam_to_cam.txt");
  want(&needed, pags_file_exists, "../calib_velo_to_cam.txt");
  want(&needed, pags_file_exists, "../calib_imu_to_velo.txt");
  tree->has_points = want(&optional, pags_dir_exists, "velodyne_points/data");
  tree->has_labels = want(&optional, pags_file_exists, "tracklet_labels.xml");
  return needed.count ? report(tree, &needed, &optional) : PAGS_OK;
}

/* ---- Frames ---- */

/* Sets tree->frames to 1 + the highest number of a photograph of the first camera, and counts the photographs of the
 * other cameras past it. */
static pags_result count_frames(pags_kitti_tree *tree) {
  pags_tally late = {0};
  for (int c = 0; c < tree->camera_count; c++) {
    PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
    PAGS_AUTOFREE char *folder = picture_folder(tree, tree->cameras[c]);
    PAGS_CHECK_MEMORY(folder, "%s", tree->root);
    PAGS_TRY(pags_dir_list_read(folder, &list));
    for (int64_t i = 0; i < list.count; i++) {
      const int64_t number = number_of_picture(list.names[i]);
      if (number >= tree->frames && c == 0)
        tree->frames = number + 1;
      else if (number >= tree->frames)
        pags_tally_add(&late, "%s/%s", folder, list.names[i]);
    }
    if (tree->frames == 0)
      return pags_fail(PAGS_ERROR_IO, "%s: expected photographs, %s (or .jpg)", folder,
                       tree->raw ? "0000000000.png ..." : "000000.png ...");
  }
  if (late.count)
    PAGS_WARN("%s: %lld photographs are left out, as image_%02d ends before them; the first is %s", tree->root,
              (long long)late.count, tree->cameras[0] + 2, late.first);
  pags_account_leave_out(&tree->account, "photographs", &late, "image_%02d ends before them", tree->cameras[0] + 2);
  return PAGS_OK;
}

/* Reports why there is no LiDAR; sweeps in a form other than KITTI's are an error. */
static pags_result explain_no_sweeps(pags_kitti_tree *tree) {
  const char *velodyne = tree->raw ? "velodyne_points" : "velodyne";
  PAGS_AUTOFREE char *all = pags_path_join(tree->root, velodyne);
  PAGS_AUTOFREE char *folder = all ? pags_path_join(all, tree->raw ? "data" : tree->sequence) : NULL;
  PAGS_CHECK_MEMORY(folder, "%s", tree->root);
  PAGS_TRY(pags_other_files_check(folder, ".bin", "sweeps"));
  PAGS_TRY(pags_other_form_check(tree->root, velodyne, "sweeps"));
  if (!tree->raw)
    PAGS_TRY(pags_other_form_check(all, tree->sequence, "sweeps"));
  PAGS_WARN("%s: no LiDAR: %s is missing or empty", tree->root, velodyne);
  pags_account_lacks(&tree->account, "sweeps", "%s is missing or empty", velodyne);
  return PAGS_OK;
}

static pags_result explain_no_labels(pags_kitti_tree *tree) {
  const char *name = tree->raw ? "tracklet_labels.xml" : "label_02";
  PAGS_AUTOFREE char *path = pags_kitti_labels_path(tree);
  PAGS_AUTOFREE char *folder = path ? pags_path_folder(path) : NULL;
  PAGS_CHECK_MEMORY(folder, "%s", tree->root);
  PAGS_TRY(pags_other_form_check(folder, pags_path_name(path), "boxes"));
  if (!tree->raw)
    PAGS_TRY(pags_other_form_check(tree->root, name, "boxes"));
  PAGS_WARN("%s: no boxes: %s is missing", tree->root, name);
  pags_account_lacks(&tree->account, "boxes", "%s is missing", name);
  return PAGS_OK;
}

static pags_result check_frames(pags_kitti_tree *tree) {
  missing needed = {.root = tree->root}, sweeps = {.root = tree->root};
  for (int64_t frame = tree->first; frame <= tree->last; frame++) {
    for (int c = 0; c < tree->camera_count; c++) {
      PAGS_AUTOFREE char *image = pags_kitti_image_path(tree, tree->cameras[c], frame);
      want_file(&needed, image);
    }
    PAGS_AUTOFREE char *oxts = tree->raw ? pags_kitti_oxts_path(tree, frame) : NULL;
    PAGS_AUTOFREE char *points = tree->has_points ? pags_kitti_points_path(tree, frame) : NULL;
    want_file(&needed, oxts);
    want_file(&sweeps, points);
  }
  /* Frame 0 defines the world's origin. */
  PAGS_AUTOFREE char *first = tree->raw && tree->first > 0 ? pags_kitti_oxts_path(tree, 0) : NULL;
  want_file(&needed, first);
  if (needed.count)
    return report(tree, &needed, &(missing){0});
  const int64_t count = tree->last - tree->first + 1;
  if (sweeps.count == count)
    tree->has_points = false;
  if (!tree->has_points)
    PAGS_TRY(explain_no_sweeps(tree));
  else if (sweeps.count) {
    pags_tally lost = {.count = sweeps.count};
    PAGS_WARN("%s: %lld of %lld sweeps are missing: %.400s", tree->root, (long long)sweeps.count, (long long)count,
              sweeps.text);
    snprintf(lost.first, sizeof lost.first, "%.*s", (int)strcspn(sweeps.text, ","), sweeps.text);
    pags_account_leave_out(&tree->account, "sweeps", &lost, "the files are missing");
  }
  return tree->has_labels ? PAGS_OK : explain_no_labels(tree);
}

/* The grey cameras, and a colour camera with photographs that the caller didn't choose. */
static void tell_other_cameras(pags_kitti_tree *tree) {
  pags_tally grey = {0}, others = {0};
  for (int number = 0; number < 2; number++) {
    char name[16];
    snprintf(name, sizeof name, "image_%02d", number);
    if (pags_folder_has_entry(tree->root, name))
      pags_tally_add(&grey, "%s", name);
    bool chosen = false;
    for (int c = 0; c < tree->camera_count; c++)
      chosen = chosen || tree->cameras[c] == number;
    if (!chosen && has_pictures(tree, number))
      pags_tally_add(&others, "image_%02d", number + 2);
  }
  pags_account_leave_out(&tree->account, "cameras", &grey, "grey");
  pags_account_leave_out(&tree->account, "cameras", &others, "--cameras chose others");
}

pags_result pags_kitti_tree_open(const char *path, const pags_import_options *options, pags_kitti_tree *tree) {
  PAGS_AUTO(forget_choice) choice found = {0};
  *tree = (pags_kitti_tree){0};
  PAGS_TRY(pags_import_cameras(options->cameras, 2, 2, tree->cameras, &tree->camera_count));
  PAGS_TRY(find_root(tree, path, options->sequence));
  if (!tree->raw) {
    PAGS_TRY(find_sequence(tree, options->sequence, &found));
    tree->sequence = found.count == 1 ? pags_take(&found.first) : NULL;
  }
  if (!options->cameras && tree->sequence)
    keep_cameras_with_pictures(tree);
  PAGS_TRY(tree->raw ? check_raw(tree) : check_tracking(tree, &found));
  tell_other_cameras(tree);
  PAGS_TRY(count_frames(tree));
  PAGS_TRY(pags_import_frames(options, tree->frames, &tree->first, &tree->last));
  const pags_tally others = {.count = tree->frames - (tree->last - tree->first + 1)};
  pags_account_leave_out(&tree->account, "time steps", &others, "--frames chose others");
  return check_frames(tree);
}
