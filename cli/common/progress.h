/* SPDX-License-Identifier: Apache-2.0 */
/* Progress output of a verb: one line rewritten in place on a terminal; elsewhere plain lines, the first after one
 * second, later at most every ten seconds. Errors are never printed this way. Also interrupts (the first Ctrl-C stops
 * cleanly, another more than 0.3 s later exits), and the check that standard output took everything. */
#ifndef PAGS_CLI_PROGRESS_H
#define PAGS_CLI_PROGRESS_H

#include <pags/base.h>
#include <pags/tasks.h>
#include <stdbool.h>
#include <stdio.h>

typedef struct pags_progress {
  FILE *stream; /* NULL: silent */
  bool terminal;
  double created, shown_at; /* pags_seconds() of the start and of the last line */
  int length;               /* length of the line now shown on the terminal, characters */
  /* of pags_progress_watch: when the current phase began (0: not yet), and at which fraction of the work */
  double begun, from;
  double fraction; /* share of the work done, 0..1 */
} pags_progress;

/* As fflush; on failure for standard output, stores the reason for pags_output_end. */
void pags_output_flush(FILE *stream);
/* Returns the exit code: `code`, but 1 instead of 0, with a message, if part of the output couldn't be written to
 * standard output. */
int pags_output_end(int code);

pags_progress pags_progress_begin(FILE *stream);
/* Whether the next line is due; callers ask before they build a line, which may cost time. */
bool pags_progress_due(const pags_progress *progress);
/* Shows the status line: rewritten in place on a terminal, a new line elsewhere. */
void pags_progress_show(pags_progress *progress, const char *format, ...) PAGS_PRINTF(2, 3);
/* A pags_progress_fn whose user pointer is a pags_progress: shows `what`, the per cent done and the time left. Returns
 * 0, which cancels the work, after an interrupt. The time left is extrapolated from the first call, so that work done
 * earlier (resumed runs) doesn't count; a smaller fraction starts a new phase. */
int pags_progress_watch(void *progress, double fraction, const char *what);
/* Clears the status line on the terminal. */
void pags_progress_end(pags_progress *progress);

/* Returns the seconds of a monotonic clock. */
double pags_seconds(void);

/* Formats a duration as "1 h 05 min", "3 min 20 s" or "12 s" into `text`, which it returns. */
const char *pags_format_duration(double seconds, char *text, size_t size);
/* Formats a size as "12.3 MB" into `text`, which it returns; units are decimal, as in file managers. */
const char *pags_format_bytes(double bytes, char *text, size_t size);

/* ---- Interrupts: the first Ctrl-C, SIGTERM, SIGHUP, SIGUSR1, SIGUSR2 or SIGXCPU stops cleanly ---- */

/* Installs the signal handlers. A signal sets the flag and, unless `tasks` is NULL, cancels its parallel loops. Pass
 * NULL for work that polls the flag and finishes its step before it stops. Must be called again with NULL before the
 * tasks are destroyed. */
void pags_interrupt_install(pags_tasks *tasks);

/* Has the effect of one Ctrl-C, also if called repeatedly. */
void pags_interrupt_ask(void);

bool pags_interrupted(void);

/* Returns the flag itself, for work that polls it; non-zero after a signal. */
const volatile int *pags_interrupt_flag(void);

#endif
