/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians as glTF, .glb or .gltf, with KHR_gaussian_splatting. A build without tinygltf fails with
 * PAGS_ERROR_UNSUPPORTED. */
#ifndef PAGS_FORMAT_GLTF_SPLATS_H
#define PAGS_FORMAT_GLTF_SPLATS_H

#include <pags/compose.h>
#include <pags/export.h>

/* Saves one set of Gaussians as one node; origin, up axis and whether the Gaussians are antialiased, of the scene that
 * they are of, and what converted_from of pags_splat_facts says, are extras of the asset. */
pags_result pags_gltf_splats_save(const char *path, const pags_scene *scene, const pags_gaussians *g,
                                  float converted_from);

/* Saves a node for each object, in the object's own frame, with its track as animation, and a node `background` of the
 * Gaussians of no object. `count` receives the number of Gaussians written. */
pags_result pags_gltf_tracks_save(const char *path, pags_composition *composition, const pags_splat_options *options,
                                  int64_t *count);

#endif
