/* SPDX-License-Identifier: Apache-2.0 */
/* Waymo's panoptic labels to masks: semantic/ in Cityscapes train ids, sky_masks/, and panoptic/ with the PNG as it
 * came.
 *
 *   Waymo                                     train id        Waymo                               train id
 *    2 car                                    13 car          15 pole                             5 pole
 *    3 truck, 5 other large vehicle,          14 truck        17 sign                             7 traffic sign
 *    8 trailer                                                18 traffic light                    6 traffic light
 *    4 bus                                    15 bus          19 building (walls, fences too)     2 building
 *    6 bicycle                                18 bicycle      20 road, 21 lane marker,            0 road
 *    7 motorcycle                             17 motorcycle   22 road marker
 *    9 pedestrian, 16 what one carries,       11 person       23 sidewalk                         1 sidewalk
 *      pushes or drags: it moves along                        24 vegetation                       8 vegetation
 *   10 cyclist, 11 motorcyclist               12 rider        25 sky                              10 sky
 *    0 undefined, 1 the recording car, 12 bird, 13 animal, 14 cone, 26 ground (manhole covers; Cityscapes'
 *    ground has no train id either), 27 dynamic, 28 static, others: 255 unknown */
#ifndef PAGS_IMPORT_WAYMO_SEMANTIC_H
#define PAGS_IMPORT_WAYMO_SEMANTIC_H

#include "dataset/driving/writer.h"
#include "import/waymo_message.h"

/* Cityscapes train id of one of Waymo's classes. */
uint8_t pags_waymo_train_id(int waymo_class);

/* Writes the three pictures of an image that has labels, `width` x `height` as its calibration says; *labelled = 0
 * where it has none. `camera` is the layout's number. */
pags_result pags_waymo_put_semantic(const pags_layout *layout, const Pags__Waymo__CameraImage *image, int64_t frame,
                                    int camera, int width, int height, const char *where, int *labelled);

#endif
