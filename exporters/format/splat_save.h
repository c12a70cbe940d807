/* SPDX-License-Identifier: Apache-2.0 */
/* Saves Gaussians as SPZ, SOG and glTF (spz_save.c, sog_save.c, gltf_splats.c). */
#ifndef PAGS_FORMAT_SPLAT_SAVE_H
#define PAGS_FORMAT_SPLAT_SAVE_H

#include <stdbool.h>

#include <pags/compose.h>
#include <pags/export.h>
#include <pags/scene.h>

typedef struct pags_spz_options {
  int version;                   /* 3 (gzip) or 4 (zstd) */
  int axes;                      /* a pags_axes of the first eight: the axes of the file */
  const pags_splat_facts *facts; /* antialiased, up and origin of the scene; NULL: unknown */
} pags_spz_options;

/* Reports values beyond the format's range in the log, one line per kind. */
pags_result pags_spz_save(const char *path, const pags_gaussians *g, const pags_spz_options *options);

/* Whether the path names a SOG: one that ends in .sog, or a file called meta.json. */
bool pags_sog_is_path(const char *path);

/* Writes `path`, .sog (version 2, a zip archive) or meta.json with its pictures in the same folder. meta.json also
 * holds the scene's origin and up axis, which PAGS reads back. PAGS_ERROR_ARGUMENT (no Gaussian), _LIMIT, _UNSUPPORTED
 * (a build without libwebp), _IO or _MEMORY. */
pags_result pags_sog_save(const char *path, const pags_scene *scene, const pags_gaussians *g);

/* The next two write .glb or .gltf with KHR_gaussian_splatting. A build without tinygltf fails with
 * PAGS_ERROR_UNSUPPORTED.
 *
 * Saves one set of Gaussians as one node. Extras of the asset: origin, up axis and antialiasing of the Gaussians'
 * scene, and converted_from of pags_splat_facts. */
pags_result pags_gltf_splats_save(const char *path, const pags_scene *scene, const pags_gaussians *g,
                                  float converted_from);

/* Saves a node for each object, in the object's own frame, with its track as animation, and a node `background` with
 * the Gaussians of no object. `count` receives the number of Gaussians written. */
pags_result pags_gltf_tracks_save(const char *path, pags_composition *composition, const pags_splat_options *options,
                                  int64_t *count);

#endif
