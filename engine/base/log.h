/* SPDX-License-Identifier: Apache-2.0 */
/* Log lines: messages for the user that are not errors ("12 views left out: image missing"). Without a receiver they
 * are dropped. */
#ifndef PAGS_BASE_LOG_H
#define PAGS_BASE_LOG_H

#include <pags/base.h>

typedef enum pags_log_level { PAGS_LOG_DEBUG, PAGS_LOG_INFO, PAGS_LOG_WARNING } pags_log_level;

/* Receives one line, without a line break and valid during the call only. Called on the thread that logs, possibly on
 * several threads at once. */
typedef void pags_log_fn(void *user, pags_log_level level, const char *line);

/* Sets the receiver of the whole process; NULL: none. Must not be called while other threads may log. */
PAGS_API void pags_log_set(pags_log_fn *receiver, void *user);

/* Logs one line, formatted as by printf and cut off after 1023 bytes. */
void pags_log_message(pags_log_level level, const char *format, ...) PAGS_PRINTF(2, 3);
#define PAGS_WARN(...) pags_log_message(PAGS_LOG_WARNING, __VA_ARGS__)

/* Counts findings of one kind, for one line with their number and the name of the first. */
typedef struct pags_tally {
  int64_t count;
  char first[320]; /* name of the first finding, cut off if it is longer */
} pags_tally;

/* Adds a finding; `format` gives its name, as printf does. */
void pags_tally_add(pags_tally *tally, const char *format, ...) PAGS_PRINTF(2, 3);

#endif
