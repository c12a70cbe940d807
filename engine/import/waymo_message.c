/* SPDX-License-Identifier: Apache-2.0 */
/* Unpacks and checks Waymo's protobuf messages within a memory limit (waymo_message.h). */
#include "import/waymo_message.h"

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <zlib.h>

#include "base/file.h"
#include "base/vec3.h"

/* Size limit of an unpacked message: BUDGET bytes plus BUDGET_TIMES its packed size. */
#define BUDGET ((size_t)64 << 20)
#define BUDGET_TIMES 8

/* ---- Unpacking within a size limit ---- */

/* The bytes that protobuf-c may still allocate. Bytes that it frees during unpacking are not given back. */
typedef struct budget {
  size_t left;
  bool exceeded;
} budget;

static void *budget_alloc(void *user, size_t size) {
  budget *b = user;
  if (size > b->left) {
    b->exceeded = true;
    return NULL;
  }
  void *block = malloc(size ? size : 1);
  if (block)
    b->left -= size;
  return block;
}

static void budget_free(PAGS_UNUSED void *user, void *block) {
  free(block);
}

/* Unpacks a message within the size limit. The blocks come from malloc, so that a later free_unpacked with
 * protobuf-c's default allocator (NULL) frees them correctly. */
static pags_result unpack(const ProtobufCMessageDescriptor *type, const uint8_t *bytes, size_t size, const char *where,
                          const char *what, ProtobufCMessage **out) {
  budget b = {.left = size < (SIZE_MAX - BUDGET) / BUDGET_TIMES ? BUDGET + size * BUDGET_TIMES : SIZE_MAX};
  ProtobufCAllocator allocator = {.alloc = budget_alloc, .free = budget_free, .allocator_data = &b};
  *out = protobuf_c_message_unpack(type, &allocator, size, bytes);
  if (*out)
    return PAGS_OK;
  if (b.exceeded)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: %s of %zu bytes has more parts than 64 MiB and eight times its size hold",
                     where, what, size);
  return pags_fail_at(where, "%zu bytes are no Waymo Open v1 %s", size, what);
}

pags_result pags_waymo_unpack_frame(const void *bytes, size_t size, const char *where, pags_waymo_frame **out) {
  assert(where && out);
  ProtobufCMessage *message;
  *out = NULL;
  PAGS_TRY(unpack(&pags__waymo__frame__descriptor, bytes, size, where, "frame", &message));
  *out = (pags_waymo_frame *)message;
  return PAGS_OK;
}

void pags_waymo_free_frame(pags_waymo_frame *frame) {
  if (frame)
    pags__waymo__frame__free_unpacked(frame, NULL);
}

void pags_waymo_free_matrix(pags_waymo_matrix *matrix) {
  if (matrix)
    pags__waymo__matrix__free_unpacked(matrix, NULL);
}

/* ---- Compressed matrices ---- */

static void end_stream(z_stream *z) {
  inflateEnd(z);
}

/* Inflates a zlib stream into a block that doubles up to the size limit. The caller frees *out, also after a
 * failure. */
static pags_result inflate_all(const ProtobufCBinaryData *stream, const char *where, const char *what, uint8_t **out,
                               size_t *size) {
  PAGS_AUTO(end_stream) z_stream z = {0};
  if (stream->len > UINT32_MAX)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: %s has %zu bytes", where, what, stream->len);
  PAGS_CHECK_MEMORY(inflateInit(&z) == Z_OK, "%s: %s", where, what);
  z.next_in = stream->data;
  z.avail_in = (uInt)stream->len;
  for (size_t capacity = (size_t)1 << 20;; capacity *= 2) {
    uint8_t *grown = realloc(*out, capacity);
    PAGS_CHECK_MEMORY(grown, "%s: %s", where, what);
    *out = grown;
    z.next_out = grown + *size;
    z.avail_out = (uInt)(capacity - *size);
    const int state = inflate(&z, Z_NO_FLUSH);
    *size = capacity - z.avail_out;
    if (state == Z_STREAM_END)
      return PAGS_OK;
    PAGS_CHECK_MEMORY(state != Z_MEM_ERROR, "%s: %s", where, what);
    if (state != Z_OK && state != Z_BUF_ERROR)
      return pags_fail_at(where, "%s can't be inflated: %s", what, z.msg ? z.msg : "zlib error");
    if (z.avail_out)
      return pags_fail_at(where, "%s can't be inflated: its end is missing", what);
    if (capacity >= BUDGET)
      return pags_fail(PAGS_ERROR_LIMIT, "%s: %s is larger than 64 MiB", where, what);
  }
}

static pags_result check_shape(const pags_waymo_matrix *m, int depth, const char *where, const char *what) {
  const Pags__Waymo__Shape *s = m->shape;
  if (!s || s->n_dims != 3 || s->dims[2] != depth || s->dims[0] < 1 || s->dims[1] < 1)
    return pags_fail_at(where, "%s: expected a shape of rows x columns x %d", what, depth);
  const uint64_t values = (uint64_t)s->dims[0] * (uint64_t)s->dims[1]; /* less than 2^62, so no overflow */
  if (m->n_data % (size_t)depth || values != m->n_data / (size_t)depth)
    return pags_fail_at(where, "%s: %zu values, expected %d x %d x %d", what, m->n_data, s->dims[0], s->dims[1], depth);
  return PAGS_OK;
}

pags_result pags_waymo_unpack_matrix(const ProtobufCBinaryData *stream, int depth, const char *where, const char *what,
                                     pags_waymo_matrix **out) {
  assert(stream && depth > 0 && where && what && out);
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size = 0;
  ProtobufCMessage *message;
  *out = NULL;
  PAGS_TRY(inflate_all(stream, where, what, &bytes, &size));
  PAGS_TRY(unpack(&pags__waymo__matrix__descriptor, bytes, size, where, what, &message));
  PAGS_AUTO(pags_waymo_free_matrix_auto) pags_waymo_matrix *matrix = (pags_waymo_matrix *)message;
  PAGS_TRY(check_shape(matrix, depth, where, what));
  *out = pags_take(&matrix);
  return PAGS_OK;
}

/* ---- Rigid motions ---- */

pags_result pags_waymo_transform(const Pags__Waymo__Transform *transform, const char *where, const char *what,
                                 double out[12]) {
  assert(where && what && out);
  if (!transform || transform->n_transform != 16)
    return pags_fail_at(where, "%s: %zu numbers, expected the 16 of a 4x4", what,
                        transform ? transform->n_transform : 0);
  const double *m = transform->transform;
  for (int i = 0; i < 16; i++)
    if (!isfinite(m[i]))
      return pags_fail_at(where, "%s: number %d isn't finite", what, i);
  memcpy(out, m, 12 * sizeof *out);
  double error = 0, across[3]; /* the largest absolute entry of R R^T - I; a row of the adjoint */
  for (int i = 0; i < 9; i++)
    error = fmax(error, fabs(pags_dot3(m + 4 * (i / 3), m + 4 * (i % 3)) - (i / 3 == i % 3)));
  pags_cross3(m + 4, m + 8, across);
  if (!(error <= 1e-3) || pags_dot3(m, across) < 0 || m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
    return pags_fail_at(where, "%s: expected a rotation and a translation", what);
  return PAGS_OK;
}

/* ---- Finding parts by name ---- */

const Pags__Waymo__CameraCalibration *pags_waymo_camera(const pags_waymo_frame *frame, int name) {
  const Pags__Waymo__Context *c = frame->context;
  for (size_t i = 0; c && i < c->n_camera_calibrations; i++)
    if (c->camera_calibrations[i]->name == name)
      return c->camera_calibrations[i];
  return NULL;
}

const Pags__Waymo__LaserCalibration *pags_waymo_lidar_calibration(const pags_waymo_frame *frame, int name) {
  const Pags__Waymo__Context *c = frame->context;
  for (size_t i = 0; c && i < c->n_laser_calibrations; i++)
    if (c->laser_calibrations[i]->name == name)
      return c->laser_calibrations[i];
  return NULL;
}

const Pags__Waymo__CameraImage *pags_waymo_image(const pags_waymo_frame *frame, int name) {
  for (size_t i = 0; i < frame->n_images; i++)
    if (frame->images[i]->name == name)
      return frame->images[i];
  return NULL;
}

const char *pags_waymo_camera_name(int name) {
  static const char *const names[] = {"front", "front_left", "front_right", "side_left", "side_right"};
  return name >= 1 && name <= PAGS_WAYMO_CAMERAS ? names[name - 1] : NULL;
}
