/* SPDX-License-Identifier: Apache-2.0 */
/* Reads TFRecord files and checks their CRCs (tfrecord.h). */
#include "import/tfrecord.h"

#include <assert.h>
#include <errno.h>
#include <stdio.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/text.h"
#include "port/port.h"

enum { HEADER = 12, FOOTER = 4, SLICES = 8 };

struct pags_tfrecord {
  char *path;
  FILE *stream;
  uint64_t size, offset; /* size of the file; offset of the next record */
  int64_t number;        /* number of the next record, from 0 */
  uint8_t *data;
  size_t capacity;
  /* Tables of the slicing-by-8 CRC algorithm: crc[k][b] is the CRC of byte b followed by k zero bytes, so that eight
   * bytes take eight independent look-ups. */
  uint32_t crc[SLICES][256];
};

static void fill_crc(uint32_t crc[SLICES][256]) {
  for (uint32_t byte = 0; byte < 256; byte++) {
    uint32_t value = byte;
    for (int bit = 0; bit < 8; bit++)
      value = value >> 1 ^ (value & 1 ? 0x82f63b78u : 0); /* the Castagnoli polynomial, bit-reflected */
    crc[0][byte] = value;
  }
  for (int k = 1; k < SLICES; k++)
    for (int byte = 0; byte < 256; byte++)
      crc[k][byte] = crc[k - 1][byte] >> 8 ^ crc[0][crc[k - 1][byte] & 255];
}

static uint32_t crc_masked(const pags_tfrecord *reader, const uint8_t *bytes, size_t size) {
  const uint32_t(*s)[256] = reader->crc;
  uint32_t crc = 0xffffffffu;
  for (; size >= 8; size -= 8, bytes += 8) {
    const uint32_t low = crc ^ pags_load_u32(bytes), high = pags_load_u32(bytes + 4);
    crc = s[7][low & 255] ^ s[6][low >> 8 & 255] ^ s[5][low >> 16 & 255] ^ s[4][low >> 24] ^ s[3][high & 255] ^
          s[2][high >> 8 & 255] ^ s[1][high >> 16 & 255] ^ s[0][high >> 24];
  }
  for (; size; size--)
    crc = crc >> 8 ^ s[0][(crc ^ *bytes++) & 255];
  return (~crc >> 15 | ~crc << 17) + 0xa282ead8u;
}

pags_result pags_tfrecord_open(const char *path, pags_tfrecord **out) {
  assert(path && out);
  *out = NULL;
  uint64_t size;
  PAGS_TRY(pags_file_size(path, &size));
  PAGS_AUTO(pags_tfrecord_close_auto) pags_tfrecord *reader = calloc(1, sizeof *reader);
  PAGS_CHECK_MEMORY(reader && (reader->path = pags_text_copy(path)), "%s", path);
  reader->stream = pags_port_open(path, "rb");
  if (!reader->stream)
    return pags_fail(PAGS_ERROR_IO, "%s: %s", path, strerror(errno));
  reader->size = size;
  fill_crc(reader->crc);
  *out = pags_take(&reader);
  return PAGS_OK;
}

void pags_tfrecord_close(pags_tfrecord *reader) {
  if (!reader)
    return;
  if (reader->stream)
    fclose(reader->stream);
  free(reader->path);
  free(reader->data);
  free(reader);
}

static pags_result read_bytes(pags_tfrecord *reader, uint8_t *bytes, size_t size) {
  if (fread(bytes, 1, size, reader->stream) == size)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_IO, "%s: record %lld at byte %llu: can't be read: %s", reader->path,
                   (long long)reader->number, (unsigned long long)reader->offset,
                   ferror(reader->stream) ? strerror(errno) : "the file has become shorter");
}

static pags_result damaged(const pags_tfrecord *reader, const char *what) {
  return pags_fail_at(reader->path, "record %lld at byte %llu: %s", (long long)reader->number,
                      (unsigned long long)reader->offset, what);
}

/* Reads a record's header. The length of the data is accepted only if its CRC is right and it fits into the file. */
static pags_result read_header(pags_tfrecord *reader, uint64_t *length) {
  uint8_t header[HEADER];
  const uint64_t left = reader->size - reader->offset;
  if (left < HEADER)
    return damaged(reader, "the file ends within its header");
  PAGS_TRY(read_bytes(reader, header, HEADER));
  *length = pags_load_u64(header);
  if (crc_masked(reader, header, 8) != pags_load_u32(header + 8))
    return damaged(reader, reader->number ? "the CRC of its length is wrong"
                                          : "the CRC of its length is wrong: damaged, compressed or no TFRecord file");
  const uint64_t room = left - HEADER;
  if (room >= FOOTER && *length <= room - FOOTER && *length <= SIZE_MAX)
    return PAGS_OK;
  return pags_fail(
      PAGS_ERROR_FORMAT,
      "%s: record %lld at byte %llu: %llu bytes of data and their CRC are promised, the file has %llu left",
      reader->path, (long long)reader->number, (unsigned long long)reader->offset, (unsigned long long)*length,
      (unsigned long long)room);
}

static void advance(pags_tfrecord *reader, uint64_t length) {
  reader->offset += HEADER + length + FOOTER;
  reader->number++;
}

pags_result pags_tfrecord_next(pags_tfrecord *reader, pags_tfrecord_item *item) {
  assert(reader && item);
  *item = (pags_tfrecord_item){.number = reader->number, .offset = reader->offset};
  if (reader->offset == reader->size)
    return PAGS_OK;
  uint64_t length;
  PAGS_TRY(read_header(reader, &length));
  if (length > reader->capacity || !reader->data) { /* no more than the file has left */
    free(reader->data);
    reader->capacity = 0;
    reader->data = malloc(length ? (size_t)length : 1);
    PAGS_CHECK_MEMORY(reader->data, "%s: record %lld of %zu bytes", reader->path, (long long)reader->number,
                      (size_t)length);
    reader->capacity = (size_t)length;
  }
  PAGS_TRY(read_bytes(reader, reader->data, (size_t)length));
  uint8_t footer[FOOTER];
  PAGS_TRY(read_bytes(reader, footer, FOOTER));
  if (crc_masked(reader, reader->data, (size_t)length) != pags_load_u32(footer))
    return damaged(reader, "the CRC of its data is wrong");
  item->data = reader->data;
  item->size = (size_t)length;
  advance(reader, length);
  return PAGS_OK;
}

pags_result pags_tfrecord_skip(pags_tfrecord *reader, int *end) {
  assert(reader && end);
  *end = reader->offset == reader->size;
  if (*end)
    return PAGS_OK;
  uint64_t length;
  PAGS_TRY(read_header(reader, &length));
  if (!pags_port_seek(reader->stream, (int64_t)(length + FOOTER), SEEK_CUR))
    return pags_fail(PAGS_ERROR_IO, "%s: record %lld at byte %llu: %s", reader->path, (long long)reader->number,
                     (unsigned long long)reader->offset, strerror(errno));
  advance(reader, length);
  return PAGS_OK;
}

double pags_tfrecord_fraction(const pags_tfrecord *reader) {
  return reader->size ? (double)reader->offset / (double)reader->size : 1;
}
