/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the Gaussians and views in the folders of other programs: the output of INRIA's train.py (Kerbl et al. 2023)
 * and of programs that write the same (point_cloud/iteration_N/point_cloud.ply, cameras.json, cfg_args), one
 * iteration's folder of it, and a SOG (meta.json and its pictures). */
#include "scene/other_formats.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"

/* ---- Iterations ---- */

/* The number N of a name "iteration_N"; -1 for other names. */
static int64_t iteration_of(const char *name) {
  char *end;
  if (!pags_text_starts(name, "iteration_") || name[10] < '0' || name[10] > '9')
    return -1;
  const long long number = strtoll(name + 10, &end, 10);
  return *end || number > INT32_MAX ? -1 : number;
}

/* Returns whether the folder has iterations; false if it can't be read. */
static bool has_iterations(const char *folder) {
  PAGS_AUTOFREE char *path = pags_path_join(folder, "point_cloud");
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  bool found = false;
  if (path && pags_dir_exists(path) && pags_dir_list_read(path, &list) == PAGS_OK)
    for (int64_t i = 0; i < list.count; i++)
      found = found || iteration_of(list.names[i]) >= 0;
  return found;
}

/* Returns whether the folder has the meta.json of a SOG, told by its pictures or its content, or the list of a streamed
 * one. */
static bool is_sog(const char *folder) {
  enum { MOST_BYTES = 1 << 20 };
  static const char *const signs[] = {"lod-meta.json", "quats.webp", "means_l.webp"};
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  uint64_t size;
  if (!pags_folder_has(folder, "meta.json"))
    return pags_folder_has(folder, signs[0]);
  for (int i = 0; i < 3; i++)
    if (pags_folder_has(folder, signs[i]))
      return true;
  PAGS_AUTOFREE char *path = pags_path_join(folder, "meta.json");
  return path && pags_file_size(path, &size) == PAGS_OK && size <= MOST_BYTES &&
         pags_json_parse_file(path, &json) == PAGS_OK && pags_json_member(pags_json_root(json), "means") &&
         pags_json_member(pags_json_root(json), "quats");
}

const char *pags_other_folder_kind(const char *folder) {
  return is_sog(folder)                                                         ? "SOG"
         : pags_folder_has(folder, "point_cloud.ply") || has_iterations(folder) ? "training output"
                                                                                : NULL;
}

/* Chooses the newest of the iterations that have a point_cloud.ply. */
static pags_result find_iteration(const char *folder, char **file) {
  PAGS_AUTOFREE char *clouds = pags_path_join(folder, "point_cloud");
  PAGS_AUTO(pags_dir_list_destroy) pags_dir_list list = {0};
  char name[128];
  int64_t best = -1, newest = -1, count = 0;
  PAGS_CHECK_MEMORY(clouds, "%s: a path", folder);
  PAGS_TRY(pags_dir_list_read(clouds, &list));
  for (int64_t i = 0; i < list.count; i++) {
    const int64_t number = iteration_of(list.names[i]);
    if (number < 0)
      continue;
    count++;
    newest = number > newest ? number : newest;
    snprintf(name, sizeof name, "%.100s/point_cloud.ply", list.names[i]);
    if (number > best && pags_folder_has(clouds, name)) {
      best = number;
      snprintf(name, sizeof name, "point_cloud/%.80s/point_cloud.ply", list.names[i]);
      free(*file);
      *file = pags_text_copy(name);
      PAGS_CHECK_MEMORY(*file, "%s: a path", folder);
    }
  }
  if (best < 0)
    return pags_fail_at(
        clouds, "expected iteration_N/point_cloud.ply, as training writes it, found %lld iterations without one",
        (long long)count);
  if (best < newest)
    PAGS_WARN("%s: iteration_%lld, the newest, has no point_cloud.ply; iteration_%lld is taken", clouds,
              (long long)newest, (long long)best);
  else if (count > 1)
    pags_log_message(PAGS_LOG_INFO, "%s: iteration_%lld is taken, the newest of %lld", clouds, (long long)best,
                     (long long)count);
  return PAGS_OK;
}

pags_result pags_other_folder_find(const char *folder, char **file) {
  *file = NULL;
  const char *const direct = is_sog(folder) ? (pags_folder_has(folder, "meta.json") ? "meta.json" : "lod-meta.json")
                             : pags_folder_has(folder, "point_cloud.ply") ? "point_cloud.ply"
                                                                          : NULL;
  PAGS_AUTOFREE char *found = direct ? pags_text_copy(direct) : NULL;
  if (!direct)
    PAGS_TRY(find_iteration(folder, &found));
  PAGS_CHECK_MEMORY(found, "%s: a path", folder);
  *file = pags_take(&found);
  return PAGS_OK;
}

/* ---- Views and background ---- */

static pags_result read_views(const char *path, pags_scene *scene) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  PAGS_TRY(pags_json_parse_file(path, &json));
  const pags_json_value *root = pags_json_root(json);
  if (!pags_cameras_are_inria(root))
    return pags_json_fail(json, root, "expected an array of cameras with 'position' and 'rotation'");
  scene->views = calloc((size_t)root->count, sizeof *scene->views);
  PAGS_CHECK_MEMORY(scene->views, "%s: its cameras", path);
  for (const pags_json_value *v = root->first; v; v = v->next) {
    char number[32];
    snprintf(number, sizeof number, "%05lld", (long long)scene->view_count);
    pags_scene_view *view = &scene->views[scene->view_count++];
    const char *name;
    *view = (pags_scene_view){.sensor = -1, .frame = -1, .gain = {1, 1, 1}};
    PAGS_TRY(pags_camera_from_inria(json, v, &view->camera));
    PAGS_TRY(pags_json_string_or(json, v, "img_name", number, &name));
    view->name = pags_text_copy(*name ? name : number);
    PAGS_CHECK_MEMORY(view->name, "%s: a name", path);
  }
  return PAGS_OK;
}

/* cfg_args is the text of a Python Namespace. */
static pags_result read_background(const char *path, pags_scene *scene) {
  PAGS_AUTOFREE uint8_t *text = NULL;
  size_t size;
  PAGS_TRY(pags_file_read(path, &text, &size));
  for (int k = 0; k < 3 && strstr((const char *)text, "white_background=True"); k++)
    scene->background[k] = 1;
  return PAGS_OK;
}

pags_result pags_other_folder_views(const char *folder, pags_scene *scene) {
  typedef pags_result reader(const char *path, pags_scene *scene);
  static const char *const names[] = {"cameras.json", "cfg_args"};
  reader *const readers[] = {read_views, read_background};
  for (int i = 0; i < 2; i++) {
    if (!pags_folder_has(folder, names[i]))
      continue;
    PAGS_AUTOFREE char *path = pags_path_join(folder, names[i]);
    PAGS_CHECK_MEMORY(path, "%s: a path", folder);
    PAGS_TRY(readers[i](path, scene));
  }
  return PAGS_OK;
}
