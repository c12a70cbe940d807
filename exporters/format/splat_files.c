/* SPDX-License-Identifier: Apache-2.0 */
/* pags_export_splats: bakes a scene at one time into one set of Gaussians and saves it as .ply, .spz, .sog, .splat,
 * .pagsz or glTF with KHR_gaussian_splatting; with `tracks`, glTF with one animated node for each object. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include <pags/compose.h>
#include <pags/export.h>
#include <pags/packed.h>

#include "base/file.h"
#include "base/log.h"
#include "base/text.h"
#include "base/vec3.h"
#include "exporters/format/bake.h"
#include "exporters/format/splat_save.h"
#include "frame/owners.h"
#include "scene/axes.h"
#include "scene/splat_formats.h"

pags_splat_options pags_splat_options_default(void) {
  return (pags_splat_options){.time = (double)NAN, .sh_degree = 3, .spz_version = 3, .spz_axes = PAGS_AXES_RUB};
}

static bool has_extension(const char *path, const char *extension) {
  return strcasecmp(pags_path_extension(path), extension) == 0;
}

int pags_export_is_splat(const char *path) {
  static const char *const extensions[] = {".ply", ".spz", ".splat", ".pagsz"};
  for (size_t i = 0; i < sizeof extensions / sizeof *extensions; i++)
    if (has_extension(path, extensions[i]))
      return 1;
  return pags_sog_is_path(path);
}

/* ---- What a format can't hold ---- */

/* Appends one item to a list in `text`, separated by commas. */
static void put_item(char text[512], const char *item) {
  const size_t length = strlen(text);
  snprintf(text + length, 512 - length, "%s%s", length ? ", " : "", item);
}

/* Says in a line each what of the scene the file lacks, and where positions are relative to an origin that other
 * programs won't know. `scene_degree` is the degree of harmonics of the scene, `options->sh_degree` what was asked for.
 */
static void say_lost(const char *path, const pags_scene *scene, const pags_splat_options *options, int scene_degree,
                     bool priorities) {
  const bool splat = has_extension(path, ".splat"), spz = has_extension(path, ".spz"),
             ply = has_extension(path, ".ply"), pagsz = has_extension(path, ".pagsz");
  const bool moved = scene->origin[0] != 0 || scene->origin[1] != 0 || scene->origin[2] != 0;
  char lost[512] = "", aside[512] = "", item[160];
  snprintf(item, sizeof item, "the origin %.12g %.12g %.12g that positions are relative to", scene->origin[0],
           scene->origin[1], scene->origin[2]);
  if (splat && scene->antialiased)
    put_item(lost, "that the Gaussians are antialiased");
  if (splat && moved)
    put_item(lost, item);
  if (splat && (scene->up == PAGS_UP_Z || scene->up == PAGS_UP_Y)) {
    char up[32];
    snprintf(up, sizeof up, "the up axis %s", pags_up_code(scene->up));
    put_item(lost, up);
  }
  if (splat && scene_degree > 0 && options->sh_degree > 0)
    put_item(lost, "colours that change with the view");
  if (lost[0])
    pags_log_message(PAGS_LOG_WARNING, "%s: .splat can't hold %s", path, lost);
  if (moved && !splat && !pagsz)
    pags_log_message(PAGS_LOG_INFO, "%s: %s is in %s", path, item,
                     ply   ? "the comment 'offset', which few programs read"
                     : spz ? "a record that only PAGS reads"
                           : "its asset, which only PAGS reads");
  if (scene->sky.size > 0)
    put_item(aside, "the sky");
  if (priorities && !ply && !pagsz)
    put_item(aside, "priorities");
  if (aside[0])
    pags_log_message(PAGS_LOG_INFO, "%s: %s can't hold %s", path,
                     pags_sog_is_path(path) ? "SOG" : pags_path_extension(path), aside);
}

/* ---- Saving ---- */

/* Saves the baked Gaussians in the format that the path's extension names. */
static pags_result save(const char *path, const pags_scene *scene, const pags_splat_options *options,
                        const pags_gaussians *g, float converted_from) {
  pags_splat_facts facts = {.antialiased = scene->antialiased, .up = scene->up, .converted_from = converted_from};
  pags_copy3(scene->origin, facts.origin);
  if (has_extension(path, ".ply"))
    return pags_ply_save_facts(path, g, &facts);
  if (has_extension(path, ".splat"))
    return pags_splat_save(path, g);
  if (has_extension(path, ".spz"))
    return pags_spz_save(path, g, &(pags_spz_options){options->spz_version, options->spz_axes, &facts});
  if (has_extension(path, ".pagsz")) {
    /* PAGS's packed form, with the scene's up axis, origin and background colour in its head. */
    pags_packed head = {.up = (int)scene->up, .antialiased = scene->antialiased};
    pags_copy3(scene->origin, head.origin);
    pags_copy3f(scene->background, head.background);
    return pags_packed_export(path, g, &head);
  }
  if (pags_sog_is_path(path))
    return pags_sog_save(path, scene, g);
  return pags_gltf_splats_save(path, scene, g, converted_from);
}

pags_result pags_export_splats(pags_scene *scene, const char *path, const pags_splat_options *options, int64_t *count) {
  PAGS_AUTO(pags_composition_destroy_auto) pags_composition *composition = NULL;
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians baked = {0};
  const pags_part *parts;
  int part_count, degree = 0;
  int64_t written = 0;
  count = count ? count : &written;
  PAGS_TRY(pags_ply_check_name(path));
  PAGS_TRY(pags_composition_create(scene, &composition));
  const pags_scene *composed = pags_composition_scene(composition);
  if (options->tracks) {
    PAGS_TRY(pags_gltf_tracks_save(path, composition, options, count));
    say_lost(path, composed, options, 0, false);
    return PAGS_OK;
  }
  pags_compose(composition, options->time, &parts, &part_count);
  const bool keep_cut = has_extension(path, ".pagsz");
  const float converted_from = keep_cut ? 0.0f : pags_splats_alpha_min(parts, part_count);
  double alpha_min = 0;
  for (int i = 0; i < part_count; i++) {
    degree = parts[i].gaussians->sh_degree > degree ? parts[i].gaussians->sh_degree : degree;
    alpha_min = fmax(alpha_min, (double)parts[i].gaussians->alpha_min);
  }
  const bool turned_back = has_extension(path, ".ply") || has_extension(path, ".spz") || has_extension(path, ".glb");
  if (alpha_min > 0 && !keep_cut)
    pags_log_message(PAGS_LOG_INFO,
                     "%s: other programs cut alpha at 1/255, this scene at %.2g: opacities and sizes are those that "
                     "look alike there (.pagsz keeps them%s)",
                     path, alpha_min,
                     converted_from > 0.0f && turned_back ? "; PAGS changes this file's back when it reads it" : "");
  PAGS_TRY(
      pags_splats_bake(parts, part_count, degree < options->sh_degree ? degree : options->sh_degree, keep_cut, &baked));
  *count = baked.count;
  PAGS_TRY(save(path, composed, options, &baked, converted_from));
  say_lost(path, composed, options, degree, baked.s_sem != NULL);
  return PAGS_OK;
}
