/* SPDX-License-Identifier: Apache-2.0 */
/* Numbers to and from text, the same in every locale. */
#ifndef PAGS_BASE_TEXT_H
#define PAGS_BASE_TEXT_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* strtod as the C locale does it; `end` may be NULL. */
double pags_text_to_double(const char *text, char **end);

enum { PAGS_DOUBLE_TEXT = 32 };
/* The shortest of %.15g, %.16g and %.17g that reads back to the same bits: "0.1", "1e-07", "nan"; returns its length */
int pags_text_from_double(double value, char out[PAGS_DOUBLE_TEXT]);

/* A copy on the heap, NULL when memory is out or `text` is NULL. */
char *pags_text_copy(const char *text);
/* As printf would print it, on the heap; NULL when memory is out. */
char *pags_text_format(const char *format, ...) PAGS_PRINTF(1, 2);

#ifdef __cplusplus
}
#endif
#endif
