/* SPDX-License-Identifier: Apache-2.0 */
/* Converts Waymo's panoptic labels to masks: semantic/ in Cityscapes train ids and sky_masks/; the original PNG is
 * copied to panoptic/.
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
#ifndef PAGS_IMPORT_WAYMO_SEMANTIC_H
#define PAGS_IMPORT_WAYMO_SEMANTIC_H

#include "dataset/driving/writer.h"
#include "import/waymo_message.h"

/* Returns the Cityscapes train id of one of Waymo's classes; 255 if the class has none. */
uint8_t pags_waymo_train_id(int waymo_class);

/* Writes the three pictures of a labelled image and checks that the label has `width` x `height` pixels, the size in
 * the calibration. *labelled = 0 if the image has no label. `camera` is the camera's number in the layout. */
pags_result pags_waymo_put_semantic(const pags_layout *layout, const Pags__Waymo__CameraImage *image, int64_t frame,
                                    int camera, int width, int height, const char *where, int *labelled);

#endif
