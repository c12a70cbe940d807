/* SPDX-License-Identifier: Apache-2.0 */
/* Formats log lines and hands them to the one receiver of the process (base/log.h). */
#include "base/log.h"

#include <stdarg.h>
#include <stdio.h>

static pags_log_fn *log_receiver;
static void *log_user;

void pags_log_set(pags_log_fn *receiver, void *user) {
  log_receiver = receiver;
  log_user = user;
}

void pags_log_message(pags_log_level level, const char *format, ...) {
  if (!log_receiver)
    return;
  char line[1024];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  log_receiver(log_user, level, line);
}

void pags_tally_add(pags_tally *tally, const char *format, ...) {
  if (tally->count++ > 0)
    return;
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(tally->first, sizeof tally->first, format, arguments);
  va_end(arguments);
}
