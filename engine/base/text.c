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

size_t pags_text_utf8(const char *text) {
  const unsigned char *const s = (const unsigned char *)text;
  const size_t length = s[0] >= 0x01 && s[0] <= 0x7F   ? 1
                        : s[0] >= 0xC2 && s[0] <= 0xDF ? 2
                        : s[0] >= 0xE0 && s[0] <= 0xEF ? 3
                        : s[0] >= 0xF0 && s[0] <= 0xF4 ? 4
                                                       : 0;
  for (size_t i = 1; i < length; i++)
    if ((s[i] & 0xC0) != 0x80)
      return 0;
  const bool bad = (s[0] == 0xE0 && s[1] < 0xA0) || (s[0] == 0xED && s[1] > 0x9F) || (s[0] == 0xF0 && s[1] < 0x90) ||
                   (s[0] == 0xF4 && s[1] > 0x8F);
  return bad ? 0 : length;
}

char *pags_text_readable(const char *text) {
  char *const copy = malloc(4 * strlen(text) + 1), *to = copy;
  while (copy && *text) {
    const size_t length = pags_text_utf8(text);
    if (length)
      memcpy(to, text, length);
    to += length ? length : (size_t)sprintf(to, "\\x%02X", (unsigned char)*text);
    text += length ? length : 1;
  }
  if (copy)
    *to = 0;
  return copy;
}

bool pags_text_starts(const char *text, const char *prefix) {
  return strncmp(text, prefix, strlen(prefix)) == 0;
}

bool pags_text_ends(const char *text, const char *suffix) {
  const size_t length = strlen(text), ending = strlen(suffix);
  return length >= ending && strcmp(text + length - ending, suffix) == 0;
}

bool pags_text_is(const char *text, size_t length, const char *word) {
  return strlen(word) == length && strncmp(text, word, length) == 0;
}

int pags_text_find(const char *text, const char *const *names, int count) {
  for (int i = 0; i < count; i++)
    if (strcmp(text, names[i]) == 0)
      return i;
  return -1;
}

int pags_text_compare(const void *a, const void *b) {
  return strcmp(*(const char *const *)a, *(const char *const *)b);
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
