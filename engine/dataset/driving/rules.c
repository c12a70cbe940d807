/* SPDX-License-Identifier: Apache-2.0 */
/* Determines the conventions that drivestudio's layout does not fix (axes, extrinsics, columns of a sweep, ...) from
 * the defaults of the set's kind and from dataset.json.
 *
 * The defaults follow drivestudio's loaders and converters (github.com/ziyc/drivestudio, datasets/); that the front
 * of PandaSet's boxes is +y was measured. A key of dataset.json overrides the default of the kind. */
#include "dataset/driving/reader.h"

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"
#include "dataset/driving/pictures.h"
#include "scene/scene_json.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define OPENCV false
#define WAYMO true
#define CONSTANT false
#define PER_FRAME true

/* ---- Kinds and their defaults ---- */

/* Columns of a sweep. Waymo: origin (3), point (3), flow (3), flow class, ground, intensity, elongation, LiDAR id.
 * PandaSet: x y z, intensity, sensor. nuPlan: x y z, intensity, ring, LiDAR id. KITTI, nuScenes, Argoverse 2: x y z,
 * reflectance. Only nuScenes stores sweeps in the LiDAR's frame. */
static const pags_rules kinds[] = {
    {"waymo", WAYMO, CONSTANT, false, false, false, 14, .position = {3, 4, 5}, .intensity = 11},
    {"pandaset", OPENCV, PER_FRAME, false, false, true, 5, .position = {0, 1, 2}, .intensity = 3},
    {"kitti", OPENCV, CONSTANT, false, false, false, 4, .position = {0, 1, 2}, .intensity = 3},
    {"nuscenes", OPENCV, PER_FRAME, true, false, false, 4, .position = {0, 1, 2}, .intensity = 3},
    {"argoverse2", OPENCV, CONSTANT, false, false, false, 4, .position = {0, 1, 2}, .intensity = 3},
    {"nuplan", OPENCV, CONSTANT, false, false, false, 6, .position = {0, 1, 2}, .intensity = 3},
    {"street-gaussians", OPENCV, CONSTANT, false, false, false, 0, .position = {0, 1, 2}, .intensity = -1},
    {"pags", OPENCV, CONSTANT, false, false, false, 0, .position = {0, 1, 2},
     .intensity = -1}, /* dataset.json must state all of them */
};

#define KIND_NAMES "waymo, pandaset, kitti, nuscenes, argoverse2, nuplan or street-gaussians"

static const pags_rules *find_kind(const char *name) {
  for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
    if (strcmp(name, kinds[i].kind) == 0)
      return &kinds[i];
  return NULL;
}

typedef struct source {
  const pags_json *json; /* NULL if there is no dataset.json */
  const pags_json_value *root;
} source;

/* Whether dataset.json has a value for the key. */
static bool states(const source *s, const char *key) {
  const pags_json_value *value = s->json ? pags_json_member(s->root, key) : NULL;
  return value && value->type != PAGS_JSON_NULL;
}

static pags_result choose_kind(const char *root, const char *asked, bool per_frame_files, const source *s,
                               pags_rules *rules) {
  const pags_rules *kind = NULL;
  if (asked) {
    kind = find_kind(asked);
    if (!kind)
      return pags_fail(PAGS_ERROR_ARGUMENT, "kind '%s' is not known; expected " KIND_NAMES, asked);
  } else if (states(s, "kind")) {
    const char *name;
    PAGS_TRY(pags_json_string(s->json, s->root, "kind", &name));
    kind = find_kind(name);
    if (!kind)
      return pags_json_fail(s->json, pags_json_member(s->root, "kind"),
                            "kind '%s' is not known; expected " KIND_NAMES ", or pags", name);
  } else if (per_frame_files) {
    kind = find_kind("pandaset");
  } else if (pags_folder_has(root, PAGS_STREET_TRACKS)) {
    kind = find_kind("street-gaussians");
  } else {
    return pags_fail_at(root, "nothing says whose axes these files have: pass --kind " KIND_NAMES
                              ", or add a dataset.json with \"kind\" in the same folder");
  }
  *rules = *kind;
  return PAGS_OK;
}

/* ---- Keys of dataset.json ---- */

/* Reads a key whose text begins with one of two words; *second becomes whether it is the second one (`other`) and
 * stays unchanged if dataset.json lacks the key. More text may follow the word. */
static pags_result read_choice(const source *s, const char *key, const char *first, const char *other, bool *second) {
  const char *text;
  if (!states(s, key))
    return PAGS_OK;
  PAGS_TRY(pags_json_string(s->json, s->root, key, &text));
  *second = pags_text_starts(text, other);
  if (!*second && !pags_text_starts(text, first))
    return pags_json_fail(s->json, pags_json_member(s->root, key), "expected '%s' to be '%s' or '%s', found '%s'", key,
                          first, other, text);
  return PAGS_OK;
}

static pags_result read_columns(const source *s, pags_rules *rules) {
  static const char *const axes[] = {"x", "y", "z"};
  const pags_json_value *list;
  if (!states(s, "lidar_columns"))
    return PAGS_OK;
  PAGS_TRY(pags_json_array(s->json, s->root, "lidar_columns", &list));
  int found[3] = {-1, -1, -1}, intensity = -1, index = 0;
  for (const pags_json_value *item = list->first; item; item = item->next, index++) {
    const char *name;
    PAGS_TRY(pags_json_as_string(s->json, item, "a column", &name));
    const int axis = pags_text_find(name, axes, 3);
    if (axis >= 0)
      found[axis] = index;
    else if (strcmp(name, "intensity") == 0)
      intensity = index;
  }
  if (list->count > 64 || found[0] < 0 || found[1] < 0 || found[2] < 0)
    return pags_json_fail(s->json, list, "expected 'lidar_columns' to name at most 64 columns, x, y and z among them");
  memcpy(rules->position, found, sizeof found);
  rules->columns = (int)list->count;
  rules->intensity = intensity;
  return PAGS_OK;
}

/* Reads lidar_frame: "ego", "laser" or "world". */
static pags_result read_lidar_frame(const source *s, pags_rules *rules) {
  const char *text = "";
  if (states(s, "lidar_frame"))
    PAGS_TRY(pags_json_string(s->json, s->root, "lidar_frame", &text));
  rules->lidar_world = pags_text_starts(text, "world");
  if (!rules->lidar_world)
    return read_choice(s, "lidar_frame", "ego", "laser", &rules->lidar_frame);
  rules->lidar_frame = false;
  return PAGS_OK;
}

/* Reads a lens. One that states its field must see as far, since photographs show it. */
static pags_result read_lens(const source *s, const pags_json_value *value, pags_lens_model *lens) {
  char what[900];
  snprintf(what, sizeof what, "%s:%d", pags_json_path(s->json), value->line);
  PAGS_TRY(pags_lens_from_json(s->json, value, lens));
  PAGS_TRY(pags_lens_model_check(lens, what));
  const double degrees = 2 * lens->limit * 180 / 3.14159265358979323846;
  if (lens->field > degrees && degrees < 355)
    return pags_json_fail(s->json, value,
                          "its numbers show each direction once up to a field of %.1f degrees only; expected %g as "
                          "'field' says, or a lens of theta (docs/lenses.md) for more than 170",
                          degrees, lens->field);
  return PAGS_OK;
}

/* Reads a key of the form {"C": value}: the cameras' names, or their lenses. */
static pags_result read_cameras(const source *s, const char *key, bool lenses, pags_camera_fact_fn *take,
                                void *context) {
  const pags_json_value *list;
  if (!states(s, key))
    return PAGS_OK;
  PAGS_TRY(pags_json_object(s->json, s->root, key, &list));
  for (const pags_json_value *item = list->first; item; item = item->next) {
    const char *name = NULL;
    pags_lens_model lens;
    char *end;
    if (lenses)
      PAGS_TRY(read_lens(s, item, &lens));
    else
      PAGS_TRY(pags_json_as_string(s->json, item, "a camera's name", &name));
    long number = strtol(item->key, &end, 10);
    if (*end || end == item->key || number < 0 || number > 999999)
      return pags_json_fail(s->json, item, "expected the number of a camera, found '%s'", item->key);
    PAGS_TRY(take(context, (int)number, name, lenses ? &lens : NULL));
  }
  return PAGS_OK;
}

static pags_result read_labels(const source *s, pags_rules *rules) {
  const char *name;
  rules->labels = &pags_label_sets[0];
  if (!states(s, "labels"))
    return PAGS_OK;
  PAGS_TRY(pags_json_string(s->json, s->root, "labels", &name));
  rules->labels = pags_label_set_find(name);
  if (!rules->labels)
    return pags_json_fail(
        s->json, pags_json_member(s->root, "labels"),
        "expected 'labels' to be cityscapes, step, cityscapes-ids, kitti-360, waymo or pandaset, found '%s'", name);
  return PAGS_OK;
}

/* ---- Reading all rules ---- */

static pags_result read_rules(const char *root, const char *kind, bool per_frame_files, const source *s,
                              pags_rules *rules) {
  PAGS_TRY(choose_kind(root, kind, per_frame_files, s, rules));
  static const char *const required[] = {"camera_axes", "extrinsics", "object_forward"};
  for (int i = 0; i < 3 && strcmp(rules->kind, "pags") == 0; i++)
    if (!states(s, required[i]))
      return pags_fail(PAGS_ERROR_FORMAT, "%s/dataset.json: kind pags has no rules of its own: expected '%s'", root,
                       required[i]);
  bool constant = !rules->per_frame;
  PAGS_TRY(read_choice(s, "camera_axes", "opencv", "waymo", &rules->waymo_axes));
  PAGS_TRY(read_choice(s, "extrinsics", "per-frame", "constant", &constant));
  rules->per_frame = !constant;
  PAGS_TRY(read_lidar_frame(s, rules));
  PAGS_TRY(read_choice(s, "object_forward", "+x", "+y", &rules->forward_y));
  PAGS_TRY(read_columns(s, rules));
  PAGS_TRY(read_labels(s, rules));
  if (states(s, "fps")) {
    PAGS_TRY(pags_json_number(s->json, s->root, "fps", &rules->fps));
    if (!(rules->fps > 0 && rules->fps <= 10000))
      return pags_json_fail(s->json, pags_json_member(s->root, "fps"), "expected 'fps' above 0 and at most 10000");
  }
  return s->json ? pags_place_from_json(s->json, s->root, &rules->place) : PAGS_OK;
}

/* Parses dataset.json; s->json is NULL without that file. */
static pags_result open_source(const char *root, pags_json **json, source *s) {
  PAGS_TRY(pags_json_parse_in_folder(root, "dataset.json", json));
  *s = (source){*json, *json ? pags_json_root(*json) : NULL};
  return *json ? pags_json_as_object(*json, s->root, "a description of a data set") : PAGS_OK;
}

pags_result pags_rules_read(const char *root, const char *kind, bool per_frame_files, pags_rules *rules,
                            pags_camera_fact_fn *take, void *context) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  source s;
  PAGS_TRY(open_source(root, &json, &s));
  PAGS_TRY(read_rules(root, kind, per_frame_files, &s, rules));
  PAGS_TRY(read_cameras(&s, "cameras", false, take, context));
  return read_cameras(&s, "lenses", true, take, context);
}

pags_result pags_sweep_rules_read(const char *root, pags_rules *rules) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  source s;
  bool per_frame_files = false; /* extrinsics/TTT_C.txt */
  PAGS_AUTOFREE char *extrinsics = pags_path_join(root, "extrinsics");
  PAGS_CHECK_MEMORY(extrinsics, "%s", root);
  if (pags_dir_exists(extrinsics))
    PAGS_TRY(pags_dir_list_read(extrinsics, &list));
  for (int64_t i = 0; i < list.count; i++) {
    const char *at = list.names[i];
    int number;
    per_frame_files = per_frame_files || (pags_driving_number(&at, &number) && *at == '_');
  }
  PAGS_TRY(open_source(root, &json, &s));
  PAGS_TRY(read_rules(root, NULL, per_frame_files, &s, rules));
  if (rules->columns == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s/dataset.json: expected 'lidar_columns', the names of a sweep's columns",
                     root);
  return PAGS_OK;
}
