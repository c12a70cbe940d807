/* SPDX-License-Identifier: Apache-2.0 */
/* Conversion between numbers and text that doesn't depend on the locale, UTF-8, and strings on the heap. */
#ifndef PAGS_BASE_TEXT_H
#define PAGS_BASE_TEXT_H

#include <stdbool.h>

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

/* Length in bytes of the UTF-8 character at `text`, 1 for an ASCII character; 0 at the end and for invalid bytes: at a
 * stray byte, an overlong form, a surrogate, or a code beyond U+10FFFF. */
size_t pags_text_utf8(const char *text);
/* Returns a copy of `text` in valid UTF-8, for people to read, that the caller frees: a byte that isn't UTF-8, as in a
 * file name of an old disk, becomes \xDF (its value). NULL if out of memory. */
char *pags_text_readable(const char *text);

bool pags_text_starts(const char *text, const char *prefix);
bool pags_text_ends(const char *text, const char *suffix);
/* Whether the first `length` bytes of `text` are `word`. */
bool pags_text_is(const char *text, size_t length, const char *word);
/* Returns the index of `text` in a table of names; -1 if it isn't there. */
int pags_text_find(const char *text, const char *const *names, int count);
/* For pags_sort and bsearch over arrays of char *, by bytes. */
int pags_text_compare(const void *a, const void *b);

/* Returns a copy of `text` that the caller frees; NULL if out of memory or if `text` is NULL. */
char *pags_text_copy(const char *text);
/* Formats as printf does into a string that the caller frees; NULL if out of memory. */
char *pags_text_format(const char *format, ...) PAGS_PRINTF(1, 2);

#ifdef __cplusplus
}
#endif
#endif
