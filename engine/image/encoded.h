/* SPDX-License-Identifier: Apache-2.0 */
/* A picture file in memory: the bytes that a decoder reads, and a growing block that an encoder writes into. */
#ifndef PAGS_IMAGE_ENCODED_H
#define PAGS_IMAGE_ENCODED_H

#include <stdbool.h>

#include <pags/base.h>

/* The largest width and height of a picture, pixels. */
#define PAGS_IMAGE_MAX_SIDE 65535

/* The bytes of a file, borrowed. */
typedef struct pags_encoded {
  const char *path; /* names the file in messages */
  const uint8_t *bytes;
  size_t size;
  int rows; /* enough rows from the top: a decoder that can stops there; 0: all are wanted */
} pags_encoded;

/* Size and samples of a picture as its decoder gives them. */
typedef struct pags_picture_info {
  int64_t width, height; /* pixels */
  int channels;
} pags_picture_info;

/* Fails with PAGS_ERROR_FORMAT if a side is not 1..PAGS_IMAGE_MAX_SIDE, or if the file is too short for the picture:
 * `least` is the fewest bytes that can hold it. Called before memory for the samples is allocated. */
pags_result pags_encoded_check(const pags_encoded *file, const pags_picture_info *info, uint64_t least);

/* Fails with PAGS_ERROR_FORMAT and "path: not a readable picture: NAME: text" for a header that can't be read, or
 * "path: can't be decoded: NAME: text" for its samples. NAME is the format's. */
pags_result pags_encoded_bad_header(const pags_encoded *file, const char *name, const char *text);
pags_result pags_encoded_bad_samples(const pags_encoded *file, const char *name, const char *text);

/* The ratio that a file states of a pixel's sides, or 1 for an invalid one: not finite, not positive, or within 1 %
 * of a square. */
static inline double pags_pixel_aspect(double stated) {
  return stated > 0.05 && stated < 20 && (stated < 0.99 || stated > 1.01) ? stated : 1;
}

/* A block that grows as it is written to. Zeros are an empty one. */
typedef struct pags_sink {
  uint8_t *bytes; /* freed by the owner */
  size_t size, capacity;
} pags_sink;

/* Appends bytes; returns false if there is no memory for them. */
bool pags_sink_put(pags_sink *sink, const void *bytes, size_t size);

#endif
