/* SPDX-License-Identifier: Apache-2.0 */
/* Maps Waymo's photographs, which have lens distortion, to pinhole cameras in which dynamic masks are drawn. */
#ifndef PAGS_IMPORT_WAYMO_MASKS_H
#define PAGS_IMPORT_WAYMO_MASKS_H

#include <pags/tasks.h>

#include "dataset/driving/writer.h"

/* A pinhole camera that covers the field of view of a photograph, and the pinhole pixel that each pixel of the
 * photograph shows. */
typedef struct pags_waymo_lens {
  pags_camera pinhole; /* the caller sets world_from_camera */
  pags_layout_lens lens;
  int32_t *source; /* owns lens.source; NULL: no distortion, the photograph is the pinhole picture */
} pags_waymo_lens;

pags_result pags_waymo_lens_make(const pags_layout_camera *camera, const char *where, pags_tasks *tasks,
                                 pags_waymo_lens *out);
void pags_waymo_lens_destroy(pags_waymo_lens *lens); /* frees and zeroes */

#endif
