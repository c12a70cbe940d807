/* SPDX-License-Identifier: Apache-2.0 */
/* Writes OpenEXR files. Writing needs no library but zlib: a header, a table of places and blocks of 16 rows. */
#include "image/exr.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include <zlib.h>

#include "base/bytes.h"
#include "base/memory.h"

enum { BLOCK_ROWS = 16, LEVEL = 4 }; /* rows of a ZIP block; of compression */

/* A sink, and whether all puts have succeeded. Numbers are little-endian. */
typedef struct exr_output {
  pags_sink *sink;
  bool ok;
} exr_output;

static void put(exr_output *out, const void *bytes, size_t size) {
  out->ok = out->ok && pags_sink_put(out->sink, bytes, size);
}

static void put_u32(exr_output *out, uint32_t value) {
  uint8_t bytes[4];
  pags_store_u32(bytes, value);
  put(out, bytes, sizeof bytes);
}

static void put_float(exr_output *out, float value) {
  uint8_t bytes[4];
  pags_store_f32(bytes, value);
  put(out, bytes, sizeof bytes);
}

static void put_text(exr_output *out, const char *text) {
  put(out, text, strlen(text) + 1);
}

static void put_attribute(exr_output *out, const char *name, const char *type, size_t size) {
  put_text(out, name);
  put_text(out, type);
  put_u32(out, (uint32_t)size);
}

static void put_window(exr_output *out, const char *name, const pags_exr_planes *picture) {
  put_attribute(out, name, "box2i", 16);
  put_u32(out, 0);
  put_u32(out, 0);
  put_u32(out, (uint32_t)picture->width - 1);
  put_u32(out, (uint32_t)picture->height - 1);
}

/* Writes magic number, version and attributes. The date is always the same, so that the same picture is the same
 * bytes. `order` lists the channels by name. */
static void put_header(exr_output *out, const pags_exr_planes *picture, const int *order) {
  static const char date[] = "1970:01:01 00:00:00";
  static const uint8_t zip = 3, increasing = 0, end = 0;
  enum { FLOAT = 2 };
  size_t list = 1, longest = 0;
  for (int c = 0; c < picture->channels; c++) {
    const size_t length = strlen(picture->names[c]);
    list += length + 17;
    longest = length > longest ? length : longest;
  }
  put_u32(out, 20000630);
  put_u32(out, longest > 31 ? 0x402 : 2); /* version 2, and whether names are long */
  put_attribute(out, "capDate", "string", sizeof date - 1);
  put(out, date, sizeof date - 1);
  put_attribute(out, "channels", "chlist", list);
  for (int c = 0; c < picture->channels; c++) {
    put_text(out, picture->names[order[c]]);
    put_u32(out, FLOAT);
    put_u32(out, 0); /* not perceptually linear */
    put_u32(out, 1); /* a sample for each pixel, across and down */
    put_u32(out, 1);
  }
  put(out, &end, 1);
  put_attribute(out, "compression", "compression", 1);
  put(out, &zip, 1);
  put_window(out, "dataWindow", picture);
  put_window(out, "displayWindow", picture);
  put_attribute(out, "lineOrder", "lineOrder", 1);
  put(out, &increasing, 1);
  put_attribute(out, "pixelAspectRatio", "float", 4);
  put_float(out, 1);
  put_attribute(out, "screenWindowCenter", "v2f", 8);
  put_float(out, 0);
  put_float(out, 0);
  put_attribute(out, "screenWindowWidth", "float", 4);
  put_float(out, 1);
  for (const char *const *text = picture->texts; text && *text; text += 2) {
    put_attribute(out, text[0], "string", strlen(text[1]));
    put(out, text[1], strlen(text[1]));
  }
  put(out, &end, 1);
}

/* Copies rows [begin, end) to `raw`, row by row and in each channel by channel; returns their bytes. */
static size_t gather(const pags_exr_planes *picture, const int *order, int begin, int end, uint8_t *raw) {
  size_t size = 0;
  for (int y = begin; y < end; y++)
    for (int c = 0; c < picture->channels; c++) {
      const float *const row = picture->planes[order[c]] + (size_t)y * picture->row_step;
      for (int x = 0; x < picture->width; x++, size += 4)
        pags_store_f32(raw + size, row[(size_t)x * picture->pixel_step]);
    }
  return size;
}

/* Splits the bytes into those at even and at odd places, and replaces each but the first by its difference from the
 * one before, plus 128: what ZIP blocks hold, compressed. */
static void predict(const uint8_t *raw, size_t size, uint8_t *out) {
  const size_t half = (size + 1) / 2;
  for (size_t i = 0; i < size; i++)
    out[i % 2 == 0 ? i / 2 : half + i / 2] = raw[i];
  for (size_t i = size - 1; i > 0; i--)
    out[i] = (uint8_t)(out[i] - out[i - 1] + 128);
}

/* Writes the blocks and, into the table at byte `table` of the sink, where each begins. `work` holds three times
 * `most` bytes, those of a block and what it may be compressed to. */
static void put_blocks(exr_output *out, const pags_exr_planes *picture, const int *order, uint8_t *work, size_t most) {
  const size_t table = out->sink->size;
  uint8_t *const raw = work, *const predicted = work + most, *const packed = work + 2 * most;
  const int blocks = (picture->height + BLOCK_ROWS - 1) / BLOCK_ROWS;
  for (int i = 0; i < 2 * blocks; i++)
    put_u32(out, 0);
  for (int i = 0; out->ok && i < blocks; i++) {
    const int begin = i * BLOCK_ROWS;
    const int end = begin + BLOCK_ROWS < picture->height ? begin + BLOCK_ROWS : picture->height;
    pags_store_u64(out->sink->bytes + table + 8 * (size_t)i, out->sink->size);
    const size_t size = gather(picture, order, begin, end, raw);
    uLongf length = (uLongf)most;
    predict(raw, size, predicted);
    /* A block that zlib can't make shorter is stored as it is. */
    const bool shorter = compress2(packed, &length, predicted, (uLong)size, LEVEL) == Z_OK && length < size;
    put_u32(out, (uint32_t)begin);
    put_u32(out, (uint32_t)(shorter ? length : size));
    put(out, shorter ? packed : raw, shorter ? length : size);
  }
}

pags_result pags_exr_encode(const char *path, const pags_exr_planes *picture, pags_sink *out) {
  assert(picture->channels >= 1 && picture->channels <= 64);
  int order[64];
  for (int c = 0; c < picture->channels; c++) { /* by insertion */
    int at = c;
    for (; at > 0 && strcmp(picture->names[order[at - 1]], picture->names[c]) > 0; at--)
      order[at] = order[at - 1];
    order[at] = c;
  }
  exr_output output = {.sink = out, .ok = true};
  const size_t most = 4 * (size_t)picture->width * (size_t)picture->channels * BLOCK_ROWS;
  uint8_t *const work = malloc(3 * most);
  if (work) {
    put_header(&output, picture, order);
    put_blocks(&output, picture, order, work, most);
  }
  free(work);
  return work && output.ok ? PAGS_OK : pags_out_of_memory("%s", path);
}
