/* SPDX-License-Identifier: Apache-2.0 */
/* Progress output of a verb: one line rewritten in place on a terminal, plain lines elsewhere: after a second,
 * then more and more rarely, at last every ten seconds. Errors are never printed this way. Also whether standard output
 * took everything. */
#ifndef PAGS_CLI_PROGRESS_H
#define PAGS_CLI_PROGRESS_H

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
  double fraction; /* of the work done so far, 0..1 */
} pags_progress;

#if defined(__GNUC__)
#define PAGS_CLI_PRINTF __attribute__((format(printf, 2, 3)))
#else
#define PAGS_CLI_PRINTF
#endif

/* As fflush; keeps the reason for pags_output_end if this is standard output and can't be written. */
void pags_output_flush(FILE *stream);
/* The exit code of a program that has done all else with `code`: in place of 0 it is 1, and a message is printed, if
 * part of what was printed couldn't be written to standard output. */
int pags_output_end(int code);

pags_progress pags_progress_begin(FILE *stream);
/* Whether it is time for another line; callers ask first, since building a line may cost something. */
bool pags_progress_due(const pags_progress *progress);
/* Shows the status line: rewritten in place on a terminal, a new line elsewhere. */
void pags_progress_show(pags_progress *progress, const char *format, ...) PAGS_CLI_PRINTF;
/* Prints a line that stays, above the status line. */
void pags_progress_say(pags_progress *progress, const char *format, ...) PAGS_CLI_PRINTF;
/* A pags_progress_fn whose user pointer is a pags_progress: shows `what`, the per cent done and the time left.
 * Returns 0, which cancels the work, once it was interrupted. The time left is extrapolated from the first call on,
 * so that work done before (as of a resumed run) doesn't count; a fraction smaller than the last one begins a new
 * phase. */
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

/* Does as if Ctrl-C had been pressed, but any number of times. */
void pags_interrupt_ask(void);

bool pags_interrupted(void);

/* Returns the flag itself, for work that polls it; non-zero after a signal. */
const volatile int *pags_interrupt_flag(void);

#endif
