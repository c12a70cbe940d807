/* SPDX-License-Identifier: Apache-2.0 */
/* Converts Waymo's range images to points in the vehicle frame.
 *
 * Row r of H has the inclination I(H - 1 - r), with I ascending: the list of the calibration, or the evenly spaced
 * values
 *     I(i) = min + (i + 1/2) (max - min) / H
 * Column c of W has the azimuth
 *     a = (1 - (2 c + 1) / W) pi - yaw
 * The yaw atan2(E10, E00) of the extrinsic E is subtracted because the first column points to the back of the
 * *vehicle*, not of the LiDAR. A range d > 0 at inclination i and azimuth a is the point
 *     d (cos i cos a, cos i sin a, sin i)
 * in the frame of the LiDAR, which E transforms to the vehicle frame. If the first return has poses (the spinning
 * LiDAR on the roof), each pixel has its own pose of the vehicle (roll, pitch, yaw, x, y, z; R = Rz Ry Rx). That pose
 * transforms the point to the world, and the inverse of the frame's pose transforms it back to the vehicle frame at
 * the time of the frame, which compensates the motion of the car. Both returns use the poses of the first.
 *
 * The poses are float32 in the source: at 40 km from the world's origin their resolution is 4 mm. */
#ifndef PAGS_IMPORT_WAYMO_LIDAR_H
#define PAGS_IMPORT_WAYMO_LIDAR_H

#include "import/waymo_message.h"

/* Columns of a point: x y z in metres in the vehicle frame, intensity as Waymo gives it (not bounded). */
enum { PAGS_WAYMO_LIDAR_COLUMNS = 4 };

typedef struct pags_waymo_points {
  int64_t count, capacity;
  float *rows; /* PAGS_WAYMO_LIDAR_COLUMNS floats per point */
} pags_waymo_points;

void pags_waymo_points_destroy(pags_waymo_points *points); /* frees and zeroes */

/* Appends all returns of all LiDARs of the frame, ordered by LiDAR, return, row, column. A LiDAR without range images
 * adds none. `where` begins error messages. */
pags_result pags_waymo_lidar_points(const pags_waymo_frame *frame, const char *where, pags_waymo_points *points);

#endif
