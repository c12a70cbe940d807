/* SPDX-License-Identifier: Apache-2.0 */
/* Masks of Waymo's photographs: maps the photographs, which have lens distortion, to pinhole cameras in which dynamic
 * masks are drawn, and converts panoptic labels.
 *
 * Panoptic labels become semantic/ in Cityscapes train ids and sky_masks/; the original PNG is copied to panoptic/.
 *
 *   Waymo                                     train id        Waymo                               train id
 *    2 car                                    13 car          15 pole                             5 pole
 *    3 truck, 5 other large vehicle,          14 truck        17 sign                             7 traffic sign
 *    8 trailer                                                18 traffic light                    6 traffic light
 *    4 bus                                    15 bus          19 building (walls, fences too)     2 building
 *    6 bicycle                                18 bicycle      20 road, 21 lane marker,            0 road
 *    7 motorcycle                             17 motorcycle   22 road marker
 *    9 pedestrian, 16 object carried,         11 person       23 sidewalk                         1 sidewalk
 *      pushed or dragged: it moves along                      24 vegetation                       8 vegetation
 *   10 cyclist, 11 motorcyclist               12 rider        25 sky                              10 sky
 *    0 undefined, 1 ego vehicle, 12 bird, 13 animal, 14 cone, 26 ground (manhole covers; Cityscapes'
 *    ground has no train id either), 27 dynamic, 28 static, others: 255 unknown */
#ifndef PAGS_IMPORT_WAYMO_MASKS_H
#define PAGS_IMPORT_WAYMO_MASKS_H

#include <pags/tasks.h>

#include "dataset/driving/writer.h"
#include "import/waymo_message.h"

/* A pinhole camera that covers the field of view of a photograph, and the pinhole pixel that each pixel of the
 * photograph shows. */
typedef struct pags_waymo_lens {
  pags_camera pinhole; /* the caller sets world_from_camera */
  pags_layout_lens lens;
  int32_t *source; /* owns lens.source; NULL: no distortion, the photograph is the pinhole picture */
} pags_waymo_lens;

/* `out` is zeroed; the caller destroys it, also after a failure. */
pags_result pags_waymo_lens_make(const pags_layout_camera *camera, const char *where, pags_tasks *tasks,
                                 pags_waymo_lens *out);
void pags_waymo_lens_destroy(pags_waymo_lens *lens); /* frees and zeroes */

/* Returns the Cityscapes train id of one of Waymo's classes; 255 if the class has none. */
uint8_t pags_waymo_train_id(int waymo_class);

/* Writes the three pictures of a labelled image and checks that the label has the size of `camera`. *labelled: whether
 * the image has a label. */
pags_result pags_waymo_put_semantic(const pags_layout *layout, const Pags__Waymo__CameraImage *image, int64_t frame,
                                    const pags_layout_camera *camera, const char *where, bool *labelled);

#endif
