/* SPDX-License-Identifier: Apache-2.0 */
/* Writes OpenEXR files. Writing needs no library but zlib: a header, a table of places and blocks of 16 rows. */
#include <assert.h>

#include <zlib.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "image/formats.h"

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

static void put_text(exr_output *out, const char *text) {
  put(out, text, strlen(text) + 1);
}

/* `bytes` NULL: they are put by the caller. */
static void put_attribute(exr_output *out, const char *name, const char *type, const void *bytes, size_t size) {
  put_text(out, name);
  put_text(out, type);
  put_u32(out, (uint32_t)size);
  if (bytes)
    put(out, bytes, size);
}

/* Writes magic number, version and attributes. The date is always the same, so that the same picture is the same
 * bytes. `order` lists the channels by name. */
static void put_header(exr_output *out, const pags_exr_planes *picture, const int *order) {
  static const char date[] = "1970:01:01 00:00:00";
  static const uint8_t zip = 3, increasing = 0, end = 0, zeros[8] = {0};
  enum { FLOAT = 2 };
  uint8_t window[16] = {0}, one[4];
  size_t list = 1, longest = 0;
  for (int c = 0; c < picture->channels; c++) {
    const size_t length = strlen(picture->names[c]);
    list += length + 17;
    longest = length > longest ? length : longest;
  }
  put_u32(out, 20000630);
  put_u32(out, longest > 31 ? 0x402 : 2); /* version 2, and whether names are long */
  put_attribute(out, "capDate", "string", date, sizeof date - 1);
  put_attribute(out, "channels", "chlist", NULL, list);
  for (int c = 0; c < picture->channels; c++) {
    put_text(out, picture->names[order[c]]);
    put_u32(out, FLOAT);
    put_u32(out, 0); /* not perceptually linear */
    put_u32(out, 1); /* a sample for each pixel, across and down */
    put_u32(out, 1);
  }
  put(out, &end, 1);
  pags_store_u32(window + 8, (uint32_t)picture->width - 1);
  pags_store_u32(window + 12, (uint32_t)picture->height - 1);
  pags_store_f32(one, 1);
  put_attribute(out, "compression", "compression", &zip, 1);
  put_attribute(out, "dataWindow", "box2i", window, sizeof window);
  put_attribute(out, "displayWindow", "box2i", window, sizeof window);
  put_attribute(out, "lineOrder", "lineOrder", &increasing, 1);
  put_attribute(out, "pixelAspectRatio", "float", one, sizeof one);
  put_attribute(out, "screenWindowCenter", "v2f", zeros, sizeof zeros);
  put_attribute(out, "screenWindowWidth", "float", one, sizeof one);
  for (const char *const *text = picture->texts; text && *text; text += 2)
    put_attribute(out, text[0], "string", text[1], strlen(text[1]));
  put(out, &end, 1);
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
    size_t size = 0;
    for (int y = begin; y < end; y++) /* row by row, and in each channel by channel */
      for (int c = 0; c < picture->channels; c++) {
        const float *const row = picture->planes[order[c]] + (size_t)y * picture->row_step;
        for (int x = 0; x < picture->width; x++, size += 4)
          pags_store_f32(raw + size, row[(size_t)x * picture->pixel_step]);
      }
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
  PAGS_AUTOFREE uint8_t *work = malloc(3 * most);
  PAGS_CHECK_MEMORY(work, "%s", path);
  put_header(&output, picture, order);
  put_blocks(&output, picture, order, work, most);
  PAGS_CHECK_MEMORY(output.ok, "%s", path);
  return PAGS_OK;
}
