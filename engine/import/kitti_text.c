/* SPDX-License-Identifier: Apache-2.0 */
/* Splits KITTI's text files into lines and words and parses numbers strictly (kitti_text.h). */
#include "import/kitti_text.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/text.h"

pags_result pags_lines_open(pags_lines *lines, const char *path) {
  uint8_t *bytes = NULL;
  size_t size = 0;
  *lines = (pags_lines){.path = path};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  const uint8_t *zero = memchr(bytes, 0, size);
  if (zero) {
    const long long at = zero - bytes;
    free(bytes);
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected text, found a zero byte at byte %lld", path, at);
  }
  lines->text = lines->at = (char *)bytes;
  if (size >= 3 && memcmp(bytes, "\xef\xbb\xbf", 3) == 0)
    lines->at += 3; /* a byte order mark, as some editors write it */
  lines->end = lines->text + size;
  return PAGS_OK;
}

void pags_lines_close(pags_lines *lines) {
  free(lines->text);
  *lines = (pags_lines){0};
}

char *pags_lines_next(pags_lines *lines) {
  if (lines->at >= lines->end || lines->line == INT_MAX)
    return NULL;
  char *line = lines->at;
  char *newline = memchr(line, '\n', (size_t)(lines->end - line));
  char *stop = newline ? newline : lines->end;
  lines->at = newline ? newline + 1 : lines->end;
  lines->line++;
  if (stop > line && stop[-1] == '\r')
    stop--;
  *stop = 0; /* at the end of the file, this is the extra zero byte of pags_file_read */
  return line;
}

char *pags_take_word(char **text) {
  char *word = *text + strspn(*text, " \t,");
  if (!*word)
    return NULL;
  char *stop = word + strcspn(word, " \t,");
  *text = *stop ? stop + 1 : stop;
  *stop = 0;
  return word;
}

bool pags_word_number(const char *word, double *out) {
  char *end = NULL;
  *out = pags_text_to_double(word, &end);
  return end != word && !*end && isfinite(*out);
}

bool pags_word_integer(const char *word, int64_t lo, int64_t hi, int64_t *out) {
  char *end = NULL;
  errno = 0;
  const long long value = strtoll(word, &end, 10);
  *out = value;
  return end != word && !*end && errno == 0 && value >= lo && value <= hi;
}

pags_result pags_lines_fail(const pags_lines *lines, const char *format, ...) {
  char text[512];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: %s", lines->path, lines->line, text);
}
