/* SPDX-License-Identifier: Apache-2.0 */
/* Waymo's messages in memory, and the checks that everything past them relies on. The generated types are
 * waymo.proto's. */
#ifndef PAGS_IMPORT_WAYMO_MESSAGE_H
#define PAGS_IMPORT_WAYMO_MESSAGE_H

#include <pags/base.h>

#include <waymo.pb-c.h>

typedef Pags__Waymo__Frame pags_waymo_frame;
typedef Pags__Waymo__Matrix pags_waymo_matrix;

/* Names as Waymo numbers them; drivestudio's camera numbers are these less one. */
enum { PAGS_WAYMO_CAMERAS = 5, PAGS_WAYMO_LASERS = 5 };

/* A message is unpacked within a budget of 64 MiB and eight times its size: a small one can otherwise hold millions of
 * empty parts. `where` begins messages. PAGS_ERROR_FORMAT, _LIMIT. */
pags_result pags_waymo_unpack_frame(const void *bytes, size_t size, const char *where, pags_waymo_frame **out);
void pags_waymo_free_frame(pags_waymo_frame *frame); /* NULL is allowed */

/* A matrix of height x width x `depth` floats out of a zlib stream; at most 64 MiB, serialised. `what` names it. */
pags_result pags_waymo_unpack_matrix(const ProtobufCBinaryData *stream, int depth, const char *where, const char *what,
                                     pags_waymo_matrix **out);
void pags_waymo_free_matrix(pags_waymo_matrix *matrix); /* NULL is allowed */

/* The upper three rows of a 4x4 rigid motion. Fails unless all numbers are finite, the rotation is orthonormal to
 * within 1e-3 and the last row is 0 0 0 1. The numbers are copied, not orthonormalised. */
pags_result pags_waymo_transform(const Pags__Waymo__Transform *transform, const char *where, const char *what,
                                 double out[12]);

/* The calibration of that name (1..5), NULL where there is none. */
const Pags__Waymo__CameraCalibration *pags_waymo_camera(const pags_waymo_frame *frame, int name);
const Pags__Waymo__LaserCalibration *pags_waymo_laser(const pags_waymo_frame *frame, int name);
const Pags__Waymo__CameraImage *pags_waymo_image(const pags_waymo_frame *frame, int name);

/* "front", "front_left", ... of a camera's name; NULL for others. Static. */
const char *pags_waymo_camera_name(int name);

#endif
