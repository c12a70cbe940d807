/* SPDX-License-Identifier: Apache-2.0 */
/* Writing USD's text form (.usda): indentation, values, arrays. The first failure is remembered and reported by the
 * end. */
#ifndef PAGS_FORMAT_USD_TEXT_H
#define PAGS_FORMAT_USD_TEXT_H

#include "base/file.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_usd {
  pags_file_writer file;
  pags_result result;
  int depth;
} pags_usd;

void pags_usd_begin(pags_usd *usd, const char *path);
pags_result pags_usd_end(pags_usd *usd); /* commits, or aborts after a failure */

/* A line at the depth reached. */
void pags_usd_line(pags_usd *usd, const char *format, ...) PAGS_PRINTF(2, 3);
/* A line, then `{` and one step in; close: one step out and `}`. */
void pags_usd_open(pags_usd *usd, const char *format, ...) PAGS_PRINTF(2, 3);
void pags_usd_close(pags_usd *usd);

/* `head = [(a, b, c), ...]`, `width` numbers a tuple (1: bare). With `interpolation` (may be NULL) as the attribute's
 * metadata. */
void pags_usd_floats(pags_usd *usd, const char *head, const float *values, int64_t count, int width,
                     const char *interpolation);
void pags_usd_integers(pags_usd *usd, const char *head, const uint32_t *values, int64_t count);
/* The same `value` so many times. */
void pags_usd_repeat(pags_usd *usd, const char *head, int value, int64_t count);

/* Letters, digits and '_' stay, the rest becomes '_'; a leading digit gets one in front. */
void pags_usd_name(const char *text, char *out, size_t size);

#ifdef __cplusplus
}
#endif
#endif
