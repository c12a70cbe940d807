/* SPDX-License-Identifier: Apache-2.0 */
/* What a person watches while a verb works: one line rewritten in place on a terminal, a plain line every ten seconds
 * elsewhere. Errors never go this way. */
#ifndef PAGS_CLI_PROGRESS_H
#define PAGS_CLI_PROGRESS_H

#include <stdbool.h>
#include <stdio.h>

typedef struct pags_progress {
  FILE *stream; /* NULL: silent */
  bool terminal;
  double shown_at;    /* pags_seconds() of the last line */
  int length;         /* characters of the line that stands on the terminal now */
  double begun, from; /* pags_progress_watch: when this phase began (0: not yet), and at which fraction of the work */
  double fraction;    /* of the work that is done */
} pags_progress;

#if defined(__GNUC__)
#define PAGS_CLI_PRINTF __attribute__((format(printf, 2, 3)))
#else
#define PAGS_CLI_PRINTF
#endif

pags_progress pags_progress_begin(FILE *stream);
/* Whether it is time for another line: building one may cost something. */
bool pags_progress_due(const pags_progress *progress);
/* The status line: written over itself on a terminal, a new line elsewhere. */
void pags_progress_show(pags_progress *progress, const char *format, ...) PAGS_CLI_PRINTF;
/* A line that stays, above the status line. */
void pags_progress_say(pags_progress *progress, const char *format, ...) PAGS_CLI_PRINTF;
/* A pags_progress_fn over a pags_progress: what, per cent and the time that is left; returns 0, which ends the work,
 * once it is interrupted. What was done before the first call counts as done at once, and a fraction that falls begins
 * another part. */
int pags_progress_watch(void *progress, double fraction, const char *what);
/* Clears the line that stands on the terminal. */
void pags_progress_end(pags_progress *progress);

/* Seconds of a clock that only goes forward. */
double pags_seconds(void);

/* "1 h 05 min", "3 min 20 s", "12 s" into `text`, which it returns. */
const char *pags_format_duration(double seconds, char *text, size_t size);
/* "12.3 MB": decimal units, as file managers show. */
const char *pags_format_bytes(double bytes, char *text, size_t size);

#endif
