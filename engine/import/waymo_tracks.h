/* SPDX-License-Identifier: Apache-2.0 */
/* Collects Waymo's 3D boxes frame by frame and makes them into tracks. */
#ifndef PAGS_IMPORT_WAYMO_TRACKS_H
#define PAGS_IMPORT_WAYMO_TRACKS_H

#include "base/log.h"
#include "dataset/driving/writer.h"
#include "import/waymo_message.h"

typedef struct pags_waymo_box pags_waymo_box;

typedef struct pags_waymo_boxes {
  int64_t count, capacity;
  pags_waymo_box *boxes;
  pags_tally unusable; /* labels left out: no id, no size, or numbers that are not finite */
  pags_tally renamed;  /* ids of several classes, counted by pags_waymo_boxes_tracks */
} pags_waymo_boxes;

/* Appends the 3D (LiDAR) labels of a frame, transformed to the world by the pose of the frame. `time` must increase
 * from call to call. */
pags_result pags_waymo_boxes_add(pags_waymo_boxes *boxes, const pags_waymo_frame *message, int64_t frame, double time,
                                 const double world_from_vehicle[12], const char *where);

/* Makes one track per id, in the order of their first labels, with the class "Vehicle", "Pedestrian", "Sign",
 * "Cyclist" or "Unknown". The size of the object is the mean size of its labels. Whether the object moves is decided
 * from its poses, as the reader of data sets does, and not from the speeds in the labels, so that masks and models
 * agree. An id of several classes becomes an object of each, the second named "ID-Class". The caller destroys each
 * track and frees the array, also after a failure. Two labels of one id in one frame are PAGS_ERROR_FORMAT; `where`
 * begins the message. */
pags_result pags_waymo_boxes_tracks(pags_waymo_boxes *boxes, const char *where, pags_layout_track **tracks,
                                    int64_t *count);

void pags_waymo_boxes_destroy(pags_waymo_boxes *boxes); /* frees and zeroes */

#endif
