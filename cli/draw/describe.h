/* SPDX-License-Identifier: Apache-2.0 */
/* What a page is told of a scene: scene.json of the server. */
#ifndef PAGS_CLI_VIEW_DESCRIBE_H
#define PAGS_CLI_VIEW_DESCRIBE_H

#include <pags/compose.h>
#include "base/json.h"

/* Where a page begins to look, which is found while the scene still has its Gaussians. */
typedef struct pags_view_start {
  pags_camera camera;
  double up[3];    /* unit, world */
  double distance; /* metres to what is looked at */
} pags_view_start;

/* The first recorded camera of a drive, or the first of an orbit. Errors of pags_camera_path_orbit. */
pags_result pags_view_start_find(const pags_scene *scene, pags_view_start *out);

/* Writes the description; the text is out->data, the writer is destroyed by the caller. `name` is what the scene is
 * called; `live`: it is a run's, which changes. PAGS_ERROR_MEMORY. */
pags_result pags_view_describe(const pags_composition *composition, const pags_view_start *start, const char *name,
                               bool live, pags_json_writer *out);

#endif
