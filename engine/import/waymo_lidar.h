/* SPDX-License-Identifier: Apache-2.0 */
/* Range images to points.
 *
 * Row r of H looks up at the inclination I(H - 1 - r), I ascending: the calibration's list, or evenly spaced middles
 * min + (i + 1/2) (max - min) / H. Column c of W looks in the direction (1 - (2 c + 1) / W) pi - yaw, with the yaw
 * atan2(E10, E00) of the extrinsic E taken off, so that columns begin behind the *vehicle*. A range d > 0 is the point
 *   d (cos i cos a, cos i sin a, sin i)
 * of the laser's frame, which E takes to the vehicle's. Where the first return has poses (the turning laser on the
 * roof), each pixel was seen from a vehicle of its own: its pose (roll, pitch, yaw, x, y, z; R = Rz Ry Rx) takes the
 * point to the world, and the inverse of the frame's pose back to the vehicle of the frame, which undoes the motion of
 * the car. Both returns use the poses of the first.
 *
 * The poses are float32 in the source: at 40 km from the world's origin they are in steps of 4 mm. */
#ifndef PAGS_IMPORT_WAYMO_LIDAR_H
#define PAGS_IMPORT_WAYMO_LIDAR_H

#include "import/waymo_message.h"

enum {
  PAGS_WAYMO_LIDAR_COLUMNS = 4
}; /* x y z, metres in the vehicle's frame, intensity as Waymo gives it (not bounded) */

typedef struct pags_waymo_points {
  int64_t count, capacity;
  float *rows; /* PAGS_WAYMO_LIDAR_COLUMNS floats each */
} pags_waymo_points;

void pags_waymo_points_destroy(pags_waymo_points *points); /* frees and zeroes */

/* Appends all returns of all lasers of the frame, in the order of lasers, returns, rows, columns. A laser without range
 * images gives none. `where` begins messages. */
pags_result pags_waymo_lidar_points(const pags_waymo_frame *frame, const char *where, pags_waymo_points *points);

#endif
