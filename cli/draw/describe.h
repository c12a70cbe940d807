/* SPDX-License-Identifier: Apache-2.0 */
/* Description of a scene for pages: scene.json of pags view, and the header of scene.html. */
#ifndef PAGS_CLI_VIEW_DESCRIBE_H
#define PAGS_CLI_VIEW_DESCRIBE_H

#include <pags/compose.h>
#include "base/json.h"

/* Start camera of a page; found while the scene still has its Gaussians. */
typedef struct pags_view_start {
  pags_camera camera;
  double up[3];    /* unit, world */
  double distance; /* metres from the camera to its subject */
} pags_view_start;

/* The first recorded camera of a drive, or the first of an orbit. Errors of pags_camera_path_orbit. */
pags_result pags_view_start_find(const pags_scene *scene, pags_view_start *out);

/* Writes the description; the text is out->data, and the caller destroys the writer. `name`: name of the scene; `live`:
 * it belongs to a running training and changes. PAGS_ERROR_MEMORY. */
pags_result pags_view_describe(const pags_composition *composition, const pags_view_start *start, const char *name,
                               bool live, pags_json_writer *out);

#endif
