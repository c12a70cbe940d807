/* SPDX-License-Identifier: Apache-2.0 */
/* Converts numbers to and from text in the C locale, whatever locale the host program has set; copies and formats
 * strings. */
#include "base/text.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "port/port.h"

/* The host program may have called setlocale, by which strtod may stop at the point of "0.5". */
double pags_text_to_double(const char *text, char **end) {
  const pags_port_locale scope = pags_port_enter_c_locale();
  double value = strtod(text, end);
  pags_port_leave_c_locale(scope);
  return value;
}

int pags_text_from_double(double value, char out[PAGS_DOUBLE_TEXT]) {
  const pags_port_locale scope = pags_port_enter_c_locale();
  int length = 0;
  for (int digits = 15; digits <= 17; digits++) {
    length = snprintf(out, PAGS_DOUBLE_TEXT, "%.*g", digits, value);
    double back = strtod(out, NULL);
    if (memcmp(&back, &value, sizeof back) == 0)
      break;
  }
  pags_port_leave_c_locale(scope);
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
