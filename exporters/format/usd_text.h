/* SPDX-License-Identifier: Apache-2.0 */
/* A writer of USD's text format (.usda, or .usdz: that text as the only member of a zip archive): indented lines,
 * blocks in braces, arrays of numbers. The first failure (of the file or of memory) is kept in `result` and returned by
 * pags_usd_end; after a failure nothing more is written. */
#ifndef PAGS_FORMAT_USD_TEXT_H
#define PAGS_FORMAT_USD_TEXT_H

#include "base/file.h"

typedef struct pags_usd {
  pags_file_writer file;
  pags_result result;
  int depth;
  bool archive;  /* .usdz */
  uint64_t size; /* bytes of text written, and their CRC */
  uint32_t crc;
} pags_usd;

void pags_usd_begin(pags_usd *usd, const char *path); /* chosen by the extension, in any case */
pags_result pags_usd_end(pags_usd *usd); /* commits the file; after a failure discards it and returns the failure */

/* Writes one formatted line, indented by the present depth of blocks. */
void pags_usd_line(pags_usd *usd, const char *format, ...) PAGS_PRINTF(2, 3);
/* pags_usd_open writes a line, then a line `{`, and indents by one level more; pags_usd_close takes that level back and
 * writes `}`. */
void pags_usd_open(pags_usd *usd, const char *line);
void pags_usd_close(pags_usd *usd);

/* Writes an array attribute `head = [(a, b, c), ...]` of `count` tuples of `width` numbers each (width 1: numbers
 * without brackets). `interpolation` (may be NULL) is written as the attribute's metadata of that name. */
void pags_usd_floats(pags_usd *usd, const char *head, const float *values, int64_t count, int width,
                     const char *interpolation);
/* Writes an array attribute of integers; `values` NULL: `count` times `value`. */
void pags_usd_integers(pags_usd *usd, const char *head, const uint32_t *values, uint32_t value, int64_t count);

/* Makes a valid USD identifier of `text`: every character but letters, digits and '_' becomes '_', and a '_' is put
 * before a leading digit. */
void pags_usd_name(const char *text, char *out, size_t size);

#endif
