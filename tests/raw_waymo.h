/* SPDX-License-Identifier: Apache-2.0 */
/* Writes Waymo segments for tests: TFRecord files of frames, with a CRC and a serialiser that share nothing with the
 * reader. */
#ifndef PAGS_TESTS_RAW_WAYMO_H
#define PAGS_TESTS_RAW_WAYMO_H

#include <stdio.h>

#include <waymo.pb-c.h>

/* Blocks that live until raw_waymo_free; running out of memory ends the program. */
typedef struct raw_waymo {
  void **blocks;
  size_t count, capacity;
} raw_waymo;

void *raw_waymo_alloc(raw_waymo *w, size_t count, size_t size); /* cleared */
char *raw_waymo_text(raw_waymo *w, const char *text);
void raw_waymo_free(raw_waymo *w);

/* CRC-32C bit by bit, and as TFRecord masks it. */
uint32_t raw_crc32c(const uint8_t *bytes, size_t size);
uint32_t raw_masked_crc(const uint8_t *bytes, size_t size);
void raw_record_write(FILE *stream, const uint8_t *bytes, size_t size);

/* Serialised; *size bytes that belong to w. */
uint8_t *raw_frame_pack(raw_waymo *w, const Pags__Waymo__Frame *frame, size_t *size);

Pags__Waymo__Transform *raw_transform(raw_waymo *w, const double m[12]);
/* A zlib stream of the serialised rows x columns x depth matrix. */
ProtobufCBinaryData raw_matrix(raw_waymo *w, const float *values, int rows, int columns, int depth);

/* A laser that turns: its range images are filled through `range`, which is told the ray of a pixel in the world
 * (origin and unit direction) and the number of the return (0, 1), and gives the distance, 0 for none. */
typedef struct raw_lidar {
  int name, rows, columns;
  const double *inclinations; /* `rows` of them, ascending; NULL: evenly between low and high */
  double low, high;           /* radians */
  double vehicle_from_laser[12];
  /* Vehicle's pose roll, pitch, yaw, x, y, z while a column is seen; NULL: the frame's pose for all, and no poses are
   * written. */
  void (*pose)(void *user, int column, float out[6]);
  float (*range)(void *user, const double origin[3], const double direction[3], int which);
  void *user;
} raw_lidar;

/* Appends calibration and both returns to the frame, whose pose must be set; room for both lists must be there. */
void raw_lidar_add(raw_waymo *w, Pags__Waymo__Frame *frame, const raw_lidar *laser);

/* Writes the data set in drivestudio's layout in `folder` (constant extrinsics in OpenCV axes, boxes' front +x, LiDAR
 * rows that begin with x y z) as a segment: photographs as they are (JPEGs of those that aren't), poses, times, boxes,
 * semantic masks as panoptic labels, and each LiDAR point in the pixel of a roof LiDAR whose beam is nearest, its range
 * exact; what finds its pixel taken goes to the second return, and what finds that taken is lost. Ends the program with
 * a message where a file is missing. */
void raw_waymo_write(const char *folder, const char *path);

#endif
