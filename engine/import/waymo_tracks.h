/* SPDX-License-Identifier: Apache-2.0 */
/* Waymo's 3D boxes, gathered frame by frame, to tracks. */
#ifndef PAGS_IMPORT_WAYMO_TRACKS_H
#define PAGS_IMPORT_WAYMO_TRACKS_H

#include "dataset/driving/writer.h"
#include "import/waymo_message.h"

typedef struct pags_waymo_box pags_waymo_box;

typedef struct pags_waymo_boxes {
  int64_t count, capacity;
  pags_waymo_box *boxes;
  int64_t unusable; /* labels left out: no id, no size, or numbers that are not finite */
} pags_waymo_boxes;

/* Appends the laser labels of a frame, whose pose takes them to the world. `time` must grow from call to call. */
pags_result pags_waymo_boxes_add(pags_waymo_boxes *boxes, const pags_waymo_frame *message, int64_t frame, double time,
                                 const double world_from_vehicle[12], const char *where);

/* One track an id, in the order of their first labels; classes "Vehicle", "Pedestrian", "Sign", "Cyclist" or "Unknown".
 * Size: the mean of the labels'. Whether it moves is found as readers find it: from its poses, not from the labels'
 * speeds, so that masks and models agree. Each track is destroyed by the caller, who frees the array. Two labels of one
 * id in one frame are PAGS_ERROR_FORMAT; `where` begins the message. */
pags_result pags_waymo_boxes_tracks(pags_waymo_boxes *boxes, const char *where, pags_layout_track **tracks,
                                    int64_t *count);

void pags_waymo_boxes_destroy(pags_waymo_boxes *boxes); /* frees and zeroes */

#endif
