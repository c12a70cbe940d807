/* SPDX-License-Identifier: Apache-2.0 */
/* Conversion between numbers and text that doesn't depend on the locale, and strings on the heap. */
#ifndef PAGS_BASE_TEXT_H
#define PAGS_BASE_TEXT_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* strtod in the C locale. `end` may be NULL. */
double pags_text_to_double(const char *text, char **end);

enum { PAGS_DOUBLE_TEXT = 32 };
/* Writes the shortest of %.15g, %.16g and %.17g that reads back to the same bits ("0.1", "1e-07", "nan"). Returns its
 * length. */
int pags_text_from_double(double value, char out[PAGS_DOUBLE_TEXT]);

/* Returns a copy of `text` that the caller frees; NULL if out of memory or if `text` is NULL. */
char *pags_text_copy(const char *text);
/* Formats as printf does into a string that the caller frees; NULL if out of memory. */
char *pags_text_format(const char *format, ...) PAGS_PRINTF(1, 2);

#ifdef __cplusplus
}
#endif
#endif
