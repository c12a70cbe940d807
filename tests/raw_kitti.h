/* SPDX-License-Identifier: Apache-2.0 */
/* Writes KITTI's own files from a driving set, for the importer to read back: the tracking benchmark's tree, and a
 * raw recording's.
 *
 * The set's world axes become east, north, up. Its ego frame becomes the Velodyne, with an inertial unit at KITTI's
 * place behind it. KITTI's two cameras look the same way: image_02 is one camera of the set, image_03 stands
 * `baseline` to its right and gets another camera's pictures. */
#ifndef PAGS_TESTS_RAW_KITTI_H
#define PAGS_TESTS_RAW_KITTI_H

#include <pags/dataset.h>

typedef struct raw_kitti {
  const pags_dataset *dataset; /* PNG pictures; a sweep in every frame */
  int sensor;                  /* becomes image_02 */
  int right;                   /* whose pictures become image_03's */
  double baseline;             /* metres */
  int kitti_digits;            /* 1: as many digits as KITTI's files have; 0: all */
} raw_kitti;

/* Numbers of the trees. */
#define RAW_KITTI_DRIVE "2011_09_26/2011_09_26_drive_0001_sync"
static const double raw_kitti_time = 1317042145.0; /* of frame 0 of a raw recording: 2011-09-26 13:02:25 */

/* folder/{image_02,image_03,velodyne}/0000, folder/{calib,oxts,label_02}/0000.txt. Labels have no tilt: a box keeps
 * its middle and its heading only. */
pags_result raw_kitti_write_tracking(const raw_kitti *source, const char *folder);
/* folder/2011_09_26/calib_*.txt and RAW_KITTI_DRIVE. A track with gaps becomes several tracklets. */
pags_result raw_kitti_write_drive(const raw_kitti *source, const char *folder);

#endif
