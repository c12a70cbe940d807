/* SPDX-License-Identifier: Apache-2.0 */
/* Lines of a text file and the words in them, for readers that reject malformed input. */
#ifndef PAGS_IMPORT_KITTI_TEXT_H
#define PAGS_IMPORT_KITTI_TEXT_H

#include <pags/base.h>
#include <stdbool.h>

typedef struct pags_lines {
  const char *path;
  char *text; /* the whole file; the newline of each line taken is replaced by a zero byte */
  char *at, *end;
  int line; /* number of the last line taken, from 1 */
} pags_lines;

/* Reads a text file; fails if it contains a zero byte. */
pags_result pags_lines_open(pags_lines *lines, const char *path);
void pags_lines_close(pags_lines *lines);
/* Returns the next line without its line end; NULL at the end of the file. */
char *pags_lines_next(pags_lines *lines);

/* Takes the next word, ended by blanks or commas, from *text and moves *text behind it; NULL at the end. */
char *pags_take_word(char **text);
/* Parse a whole word as a finite number, or as an integer of lo..hi; false if it is not. */
bool pags_word_number(const char *word, double *out);
bool pags_word_integer(const char *word, int64_t lo, int64_t hi, int64_t *out);

/* Fails with the message "path:line: " followed by the formatted text. */
pags_result pags_lines_fail(const pags_lines *lines, const char *format, ...) PAGS_PRINTF(2, 3);

#endif
