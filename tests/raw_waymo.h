/* SPDX-License-Identifier: Apache-2.0 */
/* Writes Waymo segments for tests: TFRecord files of frames. Their CRC and serialiser share no code with the reader. */
#ifndef PAGS_TESTS_RAW_WAYMO_H
#define PAGS_TESTS_RAW_WAYMO_H

#include <stdio.h>

#include <waymo.pb-c.h>

/* Owner of memory blocks that live until raw_waymo_free; if memory runs out the program ends. */
typedef struct raw_waymo {
  void **blocks;
  size_t count, capacity;
} raw_waymo;

void *raw_waymo_alloc(raw_waymo *w, size_t count, size_t size); /* zeroed */
char *raw_waymo_text(raw_waymo *w, const char *text);
void raw_waymo_free(raw_waymo *w);

/* CRC-32C computed bit by bit, and its masked form as in TFRecord files. */
uint32_t raw_crc32c(const uint8_t *bytes, size_t size);
uint32_t raw_masked_crc(const uint8_t *bytes, size_t size);
void raw_record_write(FILE *stream, const uint8_t *bytes, size_t size);

/* Serialises the frame; returns *size bytes owned by w. */
uint8_t *raw_frame_pack(raw_waymo *w, const Pags__Waymo__Frame *frame, size_t *size);

Pags__Waymo__Transform *raw_transform(raw_waymo *w, const double m[12]);
/* A zlib stream of the serialised matrix of rows x columns x depth values. */
ProtobufCBinaryData raw_matrix(raw_waymo *w, const float *values, int rows, int columns, int depth);

/* A spinning LiDAR. Its range images are filled by the callback `range`, which receives a pixel's ray in the world
 * (origin and unit direction) and the number of the return (0, 1), and returns the distance, 0 for none. */
typedef struct raw_lidar {
  int name, rows, columns;
  const double *inclinations; /* `rows` inclinations, ascending; NULL: spaced evenly between low and high */
  double low, high;           /* radians, used without `inclinations` */
  double vehicle_from_laser[12];
  /* Returns the vehicle's pose (roll, pitch, yaw, x, y, z) at the time of a column. NULL: the frame's pose for all
   * columns, and no per-pixel poses are written. */
  void (*pose)(void *user, int column, float out[6]);
  float (*range)(void *user, const double origin[3], const double direction[3], int which);
  void *user;
} raw_lidar;

/* Appends calibration and both returns to the frame, whose pose must be set and whose two lists must have room for
 * them. */
void raw_lidar_add(raw_waymo *w, Pags__Waymo__Frame *frame, const raw_lidar *laser);

/* Writes the data set in drivestudio's layout in `folder` (constant extrinsics in OpenCV axes, boxes that face +x,
 * LiDAR rows that begin with x y z) as a segment: photographs unchanged (those that aren't JPEG are encoded), poses,
 * times, boxes, semantic masks as panoptic labels. Each LiDAR point goes into the range image pixel of the roof LiDAR's
 * nearest beam, with its exact range; a second point of the same pixel becomes the second return, and further ones are
 * lost. Ends the program with a message if a file is missing. */
void raw_waymo_write(const char *folder, const char *path);

#endif
