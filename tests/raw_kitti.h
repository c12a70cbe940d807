/* SPDX-License-Identifier: Apache-2.0 */
/* Writes KITTI's files from a driving set, for the importer to read: the directory tree of the tracking benchmark,
 * and that of a raw recording.
 *
 * The set's world axes become east, north, up. Its ego frame becomes the Velodyne's frame; the inertial unit is placed
 * behind it as in KITTI's car. KITTI's two cameras have the same orientation: image_02 is one camera of the set,
 * image_03 is `baseline` to its right and has another camera's pictures. */
#ifndef PAGS_TESTS_RAW_KITTI_H
#define PAGS_TESTS_RAW_KITTI_H

#include <pags/dataset.h>

typedef struct raw_kitti {
  const pags_dataset *dataset; /* its pictures must be PNG, and every frame must have a sweep */
  int sensor;                  /* the camera that becomes image_02 */
  int right;                   /* the camera whose pictures become those of image_03 */
  double baseline;             /* distance of the two cameras in metres */
  int kitti_digits;            /* 1: numbers have as many digits as in KITTI's files; 0: all digits of a double */
} raw_kitti;

/* The date and number of the written raw recording. */
#define RAW_KITTI_DRIVE "2011_09_26/2011_09_26_drive_0001_sync"
/* Unix time of frame 0 of a raw recording: 2011-09-26 13:02:25. */
static const double raw_kitti_time = 1317042145.0;

/* Writes folder/{image_02,image_03,velodyne}/0000, folder/{calib,oxts,label_02}/0000.txt. Labels have no tilt: a box
 * keeps only its centre and its heading. */
pags_result raw_kitti_write_tracking(const raw_kitti *source, const char *folder);
/* Writes folder/2011_09_26/calib_*.txt and RAW_KITTI_DRIVE. A track with gaps becomes several tracklets. */
pags_result raw_kitti_write_drive(const raw_kitti *source, const char *folder);

#endif
