/* SPDX-License-Identifier: Apache-2.0 */
/* Unpacks Waymo's protobuf messages and makes the checks that all later code relies on. The message types are
 * generated from waymo.proto. */
#ifndef PAGS_IMPORT_WAYMO_MESSAGE_H
#define PAGS_IMPORT_WAYMO_MESSAGE_H

#include <pags/base.h>

#include <waymo.pb-c.h>

#include "base/memory.h"

typedef Pags__Waymo__Frame pags_waymo_frame;
typedef Pags__Waymo__Matrix pags_waymo_matrix;

/* Numbers of cameras and LiDARs. Waymo's names of cameras are 1..5; drivestudio's camera numbers are these minus
 * one. */
enum { PAGS_WAYMO_CAMERAS = 5, PAGS_WAYMO_LASERS = 5 };

/* Unpacks a frame within a size limit of 64 MiB plus eight times its packed size, because even a small message can
 * hold millions of empty parts. `where` begins error messages. Fails with PAGS_ERROR_FORMAT or PAGS_ERROR_LIMIT. */
pags_result pags_waymo_unpack_frame(const void *bytes, size_t size, const char *where, pags_waymo_frame **out);
void pags_waymo_free_frame(pags_waymo_frame *frame); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_waymo_frame, pags_waymo_free_frame)

/* Unpacks a matrix of rows x columns x `depth` floats from a zlib stream of at most 64 MiB uncompressed. `what` names
 * the matrix in error messages. */
pags_result pags_waymo_unpack_matrix(const ProtobufCBinaryData *stream, int depth, const char *where, const char *what,
                                     pags_waymo_matrix **out);
void pags_waymo_free_matrix(pags_waymo_matrix *matrix); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_waymo_matrix, pags_waymo_free_matrix)

/* Copies the upper three rows of a 4x4 rigid motion. Fails unless all numbers are finite, the rotation is orthonormal
 * to within 1e-3 with a positive determinant, and the last row is 0 0 0 1. The rotation is not made exactly
 * orthonormal. */
pags_result pags_waymo_transform(const Pags__Waymo__Transform *transform, const char *where, const char *what,
                                 double out[12]);

/* Return the calibration or the image with Waymo's name `name` (1..5); NULL if not found. */
const Pags__Waymo__CameraCalibration *pags_waymo_camera(const pags_waymo_frame *frame, int name);
const Pags__Waymo__LaserCalibration *pags_waymo_lidar_calibration(const pags_waymo_frame *frame, int name);
const Pags__Waymo__CameraImage *pags_waymo_image(const pags_waymo_frame *frame, int name);

/* Returns "front", "front_left", ... for a Waymo camera name, a string constant; NULL for any other number. */
const char *pags_waymo_camera_name(int name);

#endif
