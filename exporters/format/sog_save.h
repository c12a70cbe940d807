/* SPDX-License-Identifier: Apache-2.0 */
/* Saves Gaussians as SOG version 2. */
#ifndef PAGS_FORMAT_SOG_SAVE_H
#define PAGS_FORMAT_SOG_SAVE_H

#include <pags/scene.h>

/* Whether the path names a SOG: one that ends in .sog, or a file called meta.json. */
int pags_sog_is_path(const char *path);

/* Writes `path`, .sog (a zip archive) or meta.json with its pictures in the same folder. meta.json also holds the
 * scene's origin and up axis, which PAGS reads back. PAGS_ERROR_ARGUMENT (no Gaussian), _LIMIT, _UNSUPPORTED (a build
 * without libwebp), _IO or _MEMORY. */
pags_result pags_sog_save(const char *path, const pags_scene *scene, const pags_gaussians *g);

#endif
