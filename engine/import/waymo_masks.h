/* SPDX-License-Identifier: Apache-2.0 */
/* Dynamic masks of Waymo's photographs, whose lenses distort. */
#ifndef PAGS_IMPORT_WAYMO_MASKS_H
#define PAGS_IMPORT_WAYMO_MASKS_H

#include <pags/tasks.h>

#include "dataset/driving/writer.h"

/* A camera's pinhole that sees all that the photograph sees, and which of its pixels each pixel of the photograph
 * shows. */
typedef struct pags_waymo_lens {
  pags_camera pinhole; /* world_from_camera is the caller's */
  pags_layout_lens lens;
  int32_t *source; /* lens.source; NULL: no distortion, the pinhole is the photograph's */
} pags_waymo_lens;

pags_result pags_waymo_lens_make(const pags_layout_camera *camera, const char *where, pags_tasks *tasks,
                                 pags_waymo_lens *out);
void pags_waymo_lens_destroy(pags_waymo_lens *lens); /* frees and zeroes */

#endif
