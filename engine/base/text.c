/* SPDX-License-Identifier: Apache-2.0 */
/* Converts numbers to and from text in the C locale, whatever locale the host program has set; copies and formats
 * strings. */
#include "base/text.h"

#include <locale.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The C locale for the calling thread, entered and left. The host program may have called setlocale, by which strtod
 * may stop at the point of "0.5"; uselocale changes the calling thread only. If newlocale fails, the host's locale
 * stays. */
typedef struct c_locale {
  locale_t c, previous;
} c_locale;

static c_locale c_locale_enter(void) {
  c_locale scope = {newlocale(LC_ALL_MASK, "C", (locale_t)0), (locale_t)0};
  if (scope.c != (locale_t)0)
    scope.previous = uselocale(scope.c);
  return scope;
}

static void c_locale_leave(c_locale scope) {
  if (scope.c == (locale_t)0)
    return;
  uselocale(scope.previous);
  freelocale(scope.c);
}

double pags_text_to_double(const char *text, char **end) {
  c_locale scope = c_locale_enter();
  double value = strtod(text, end);
  c_locale_leave(scope);
  return value;
}

int pags_text_from_double(double value, char out[PAGS_DOUBLE_TEXT]) {
  c_locale scope = c_locale_enter();
  int length = 0;
  for (int digits = 15; digits <= 17; digits++) {
    length = snprintf(out, PAGS_DOUBLE_TEXT, "%.*g", digits, value);
    double back = strtod(out, NULL);
    if (memcmp(&back, &value, sizeof back) == 0)
      break;
  }
  c_locale_leave(scope);
  return length;
}

char *pags_text_copy(const char *text) {
  if (!text)
    return NULL;
  size_t size = strlen(text) + 1;
  char *copy = malloc(size);
  if (copy)
    memcpy(copy, text, size);
  return copy;
}

char *pags_text_format(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  int length = vsnprintf(NULL, 0, format, arguments);
  va_end(arguments);
  char *text = length >= 0 ? malloc((size_t)length + 1) : NULL;
  if (!text)
    return NULL;
  va_start(arguments, format);
  vsnprintf(text, (size_t)length + 1, format, arguments);
  va_end(arguments);
  return text;
}
