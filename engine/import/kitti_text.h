/* SPDX-License-Identifier: Apache-2.0 */
/* Lines of a text file and the words in them, for strict readers. */
#ifndef PAGS_IMPORT_KITTI_TEXT_H
#define PAGS_IMPORT_KITTI_TEXT_H

#include <pags/base.h>
#include <stdbool.h>

typedef struct pags_lines {
  const char *path;
  char *text; /* the whole file; newlines become ends of strings as lines are taken */
  char *at, *end;
  int line; /* of the last one taken, from 1 */
} pags_lines;

/* Refuses files with zero bytes in them. */
pags_result pags_lines_open(pags_lines *lines, const char *path);
void pags_lines_close(pags_lines *lines);
/* The next line without its end, or NULL. */
char *pags_lines_next(pags_lines *lines);

/* Takes the next word, ended by blanks, off `*text`: NULL at the end. */
char *pags_take_word(char **text);
/* A whole word as a finite number. */
bool pags_word_number(const char *word, double *out);
bool pags_word_integer(const char *word, int64_t lo, int64_t hi, int64_t *out);

/* "path:line: " and what was expected. */
pags_result pags_lines_fail(const pags_lines *lines, const char *format, ...) PAGS_PRINTF(2, 3);

#endif
