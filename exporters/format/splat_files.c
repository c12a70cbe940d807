/* SPDX-License-Identifier: Apache-2.0 */
/* pags_export_splats: bakes a scene at one time into one set of Gaussians and saves it as .ply, .spz, .splat, .pagsz
 * or glTF with KHR_gaussian_splatting; with `tracks`, glTF with one animated node for each object. */
#include <math.h>
#include <string.h>

#include <pags/compose.h>
#include <pags/export.h>
#include <pags/packed.h>

#include "base/file.h"
#include "exporters/format/bake.h"
#include "exporters/format/gltf_splats.h"

pags_splat_options pags_splat_options_default(void) {
  return (pags_splat_options){.time = (double)NAN, .sh_degree = 3, .spz_version = 3};
}

int pags_export_is_splat(const char *path) {
  const char *extension = pags_path_extension(path);
  return !strcmp(extension, ".ply") || !strcmp(extension, ".spz") || !strcmp(extension, ".splat") ||
         !strcmp(extension, ".pagsz");
}

/* Saves the baked Gaussians in the format that the path's extension names. */
static pags_result save(const char *path, const pags_scene *scene, const pags_splat_options *options,
                        const pags_gaussians *g) {
  const char *extension = pags_path_extension(path);
  if (!strcmp(extension, ".ply"))
    return pags_ply_save(path, g);
  if (!strcmp(extension, ".splat"))
    return pags_splat_save(path, g);
  if (!strcmp(extension, ".spz"))
    return pags_spz_save(path, g, options->spz_version, scene->antialiased);
  if (!strcmp(extension, ".pagsz")) {
    /* PAGS's packed form, with the scene's up axis, origin and background colour in its head. */
    pags_packed head = {.up = (int)scene->up, .antialiased = scene->antialiased};
    memcpy(head.origin, scene->origin, sizeof head.origin);
    for (int k = 0; k < 3; k++)
      head.background[k] = scene->background[k];
    return pags_packed_export(path, g, &head);
  }
  return pags_gltf_splats_save(path, scene->up, g);
}

pags_result pags_export_splats(pags_scene *scene, const char *path, const pags_splat_options *options, int64_t *count) {
  pags_composition *composition;
  const pags_part *parts;
  int part_count, degree = 0;
  pags_gaussians baked = {0};
  int64_t written = 0;
  PAGS_TRY(pags_composition_create(scene, &composition));
  if (options->tracks) {
    pags_result saved = pags_gltf_tracks_save(path, composition, options, count ? count : &written);
    pags_composition_destroy(composition);
    return saved;
  }
  pags_compose(composition, options->time, &parts, &part_count);
  for (int i = 0; i < part_count; i++)
    degree = parts[i].gaussians->sh_degree > degree ? parts[i].gaussians->sh_degree : degree;
  pags_result result =
      pags_splats_bake(parts, part_count, degree < options->sh_degree ? degree : options->sh_degree, &baked);
  if (result == PAGS_OK)
    result = save(path, pags_composition_scene(composition), options, &baked);
  if (count)
    *count = baked.count;
  pags_gaussians_destroy(&baked);
  pags_composition_destroy(composition);
  return result;
}
