/* SPDX-License-Identifier: Apache-2.0 */
/* Writes USD's text format (.usda). Arrays of floats are formatted in pieces of 64 KiB. A float is written with the
 * fewest digits, 6 to 9, that read back as the same float.
 *
 * A .usdz (openusd.org, "Usdz File Format Specification") is a zip archive of stored members whose data begin at
 * multiples of 64 bytes. Its text is written after a record that is filled in at the end, when size and CRC are
 * known. */
#include "exporters/format/usd_text.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <zlib.h>

#include "base/memory.h"
#include "base/text.h"
#include "base/zip.h"

enum { INDENT = 4, PIECE = 1 << 16, USDZ_ALIGNMENT = 64 };

static const char member[] = "scene.usda";

static void put(pags_usd *usd, const char *text, size_t size) {
  if (usd->archive) {
    usd->crc = (uint32_t)crc32(usd->crc, (const Bytef *)text, (uInt)size);
    usd->size += size;
  }
  if (usd->result == PAGS_OK)
    usd->result = pags_file_writer_put(&usd->file, text, size);
}

static void put_text(pags_usd *usd, const char *text) {
  put(usd, text, strlen(text));
}

static void indent(pags_usd *usd) {
  for (int i = 0; i < usd->depth * INDENT; i++)
    put(usd, " ", 1);
}

/* Begins an array attribute. */
static void put_attribute(pags_usd *usd, const char *name) {
  indent(usd);
  put_text(usd, name);
  put_text(usd, " = [");
}

void pags_usd_begin(pags_usd *usd, const char *path) {
  *usd = (pags_usd){0};
  usd->result = pags_file_writer_begin(&usd->file, path);
  if (!strcasecmp(pags_path_extension(path), ".usdz")) {
    const uint8_t space[USDZ_ALIGNMENT] = {0};
    if (usd->result == PAGS_OK && !usd->file.part)
      usd->result =
          pags_fail(PAGS_ERROR_UNSUPPORTED,
                    "%s: the first bytes of a .usdz are written last: expected a regular file, or .usda", path);
    if (usd->result == PAGS_OK)
      usd->result = pags_file_writer_put(&usd->file, space, sizeof space);
    usd->archive = true;
  }
  put_text(usd, "#usda 1.0\n");
}

/* Writes the directory of a .usdz and fills in the record at its begin. */
static pags_result end_archive(pags_usd *usd) {
  uint8_t record[USDZ_ALIGNMENT], directory[PAGS_ZIP_CENTRAL + sizeof member + PAGS_ZIP_END];
  const pags_zip_item item = {.name = member,
                              .crc = usd->crc,
                              .size = (uint32_t)usd->size,
                              .padding = USDZ_ALIGNMENT - PAGS_ZIP_LOCAL - (sizeof member - 1)};
  if (usd->size > 0xfff00000u)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: more than 4 GB, which a .usdz can't have: write a .usda", usd->file.path);
  pags_zip_put_local(record, &item);
  size_t used = pags_zip_put_central(directory, &item);
  used += pags_zip_put_end(directory + used, 1, USDZ_ALIGNMENT + (size_t)usd->size, used);
  PAGS_TRY(pags_file_writer_put(&usd->file, directory, used));
  return pags_file_writer_put_first(&usd->file, record, sizeof record);
}

pags_result pags_usd_end(pags_usd *usd) {
  if (usd->result == PAGS_OK && usd->archive)
    usd->result = end_archive(usd);
  if (usd->result == PAGS_OK)
    return pags_file_writer_commit(&usd->file);
  pags_file_writer_abort(&usd->file);
  return usd->result;
}

void pags_usd_line(pags_usd *usd, const char *format, ...) {
  char line[1024];
  va_list arguments;
  va_start(arguments, format);
  const int length = vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  indent(usd);
  if (length < 0 || (size_t)length >= sizeof line)
    usd->result = pags_fail(PAGS_ERROR_LIMIT, "a line of more than %zu characters", sizeof line);
  else
    put(usd, line, (size_t)length);
  put_text(usd, "\n");
}

void pags_usd_open(pags_usd *usd, const char *line) {
  pags_usd_line(usd, "%s", line);
  pags_usd_line(usd, "{");
  usd->depth++;
}

void pags_usd_close(pags_usd *usd) {
  usd->depth--;
  pags_usd_line(usd, "}");
}

/* Formats a float with the fewest digits (6 to 9) that read back as the same value; at most 24 characters, no
 * terminating zero. Returns the length. */
static size_t put_float(float value, char *out) {
  char text[PAGS_DOUBLE_TEXT];
  int length = 0;
  for (int digits = 6; digits <= 9; digits++) {
    length = snprintf(text, sizeof text, "%.*g", digits, (double)value);
    char *comma = strchr(text, ','); /* the decimal separator of some locales */
    if (comma)
      *comma = '.';
    if ((float)pags_text_to_double(text, NULL) == value)
      break;
  }
  memcpy(out, text, (size_t)length);
  return (size_t)length;
}

void pags_usd_floats(pags_usd *usd, const char *head, const float *values, int64_t count, int width,
                     const char *interpolation) {
  PAGS_AUTOFREE char *piece = malloc(PIECE);
  size_t used = 0;
  if (!piece) {
    usd->result = pags_out_of_memory("writing numbers");
    return;
  }
  put_attribute(usd, head);
  for (int64_t i = 0; i < count; i++) {
    if (used + 32 * (size_t)width + 8 > PIECE) {
      put(usd, piece, used);
      used = 0;
    }
    if (i)
      used += (size_t)snprintf(piece + used, 3, ", ");
    for (int k = 0; k < width; k++) {
      if (width > 1)
        used += (size_t)snprintf(piece + used, 3, k ? ", " : "(");
      used += put_float(values[i * width + k], piece + used);
    }
    if (width > 1)
      piece[used++] = ')';
  }
  put(usd, piece, used);
  put_text(usd, interpolation ? "] (\n" : "]\n");
  if (interpolation) {
    pags_usd_line(usd, "    interpolation = \"%s\"", interpolation);
    pags_usd_line(usd, ")");
  }
}

void pags_usd_integers(pags_usd *usd, const char *head, const uint32_t *values, uint32_t value, int64_t count) {
  char text[16];
  put_attribute(usd, head);
  for (int64_t i = 0; i < count; i++) {
    int length = snprintf(text, sizeof text, "%s%u", i ? ", " : "", values ? values[i] : value);
    put(usd, text, (size_t)length);
  }
  put_text(usd, "]\n");
}

void pags_usd_name(const char *text, char *out, size_t size) {
  size_t used = 0;
  if (*text >= '0' && *text <= '9' && size > 1)
    out[used++] = '_';
  for (; *text && used + 1 < size; text++) {
    char c = *text;
    out[used++] = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ? c : '_';
  }
  if (!used && size > 1)
    out[used++] = '_';
  out[used] = 0;
}
