/* SPDX-License-Identifier: Apache-2.0 */
/* Implements progress.h: the progress line with the estimated time left, the check of standard output, and formatting
 * of durations and sizes. */
#include "cli/common/progress.h"
#include "cli/common/options.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <string.h>

#include "base/clock.h"
#include "port/port.h"

static const double terminal_seconds = 0.2, least_plain_seconds = 1, most_plain_seconds = 10;

double pags_seconds(void) {
  return 1e-3 * pags_clock_ms();
}

/* The first error of standard output; later calls no longer know it. */
static int output_error;

void pags_output_flush(FILE *stream) {
  errno = 0;
  if (fflush(stream) != 0 && stream == stdout && !output_error)
    output_error = errno;
}

int pags_output_end(int code) {
  pags_output_flush(stdout);
  if ((!output_error && !ferror(stdout)) || code != PAGS_EXIT_OK) /* another failure has printed its message */
    return code;
  fprintf(stderr, "%s: standard output: %s\n", pags_program_name,
          output_error ? strerror(output_error) : "part of it couldn't be written");
  return PAGS_EXIT_FAILED;
}

pags_progress pags_progress_begin(FILE *stream) {
  const double now = pags_seconds();
  return (pags_progress){
      .stream = stream, .terminal = stream && pags_port_is_terminal(stream), .created = now, .shown_at = now};
}

bool pags_progress_due(const pags_progress *progress) {
  const double now = pags_seconds(), tenth = (now - progress->created) / 10;
  const double plain = fmin(fmax(tenth, least_plain_seconds), most_plain_seconds);
  return progress->stream && now - progress->shown_at >= (progress->terminal ? terminal_seconds : plain);
}

static void clear_line(pags_progress *progress) {
  if (progress->length > 0)
    fprintf(progress->stream, "\r%*s\r", progress->length, "");
  progress->length = 0;
}

void pags_progress_show(pags_progress *progress, const char *format, ...) {
  char line[512];
  va_list list;
  if (!progress->stream)
    return;
  va_start(list, format);
  vsnprintf(line, sizeof line, format, list);
  va_end(list);
  clear_line(progress);
  const int length = fprintf(progress->stream, "%s%s", line, progress->terminal ? "" : "\n");
  progress->length = progress->terminal ? length : 0;
  pags_output_flush(progress->stream);
  progress->shown_at = pags_seconds();
}

int pags_progress_watch(void *user, double fraction, const char *what) {
  pags_progress *progress = user;
  const double now = pags_seconds();
  if (progress->begun == 0 || fraction < progress->fraction) {
    progress->begun = now;
    progress->from = fraction;
  }
  progress->fraction = fraction;
  if (pags_progress_due(progress)) {
    const double done = fraction - progress->from, seconds = now - progress->begun;
    char left[32];
    if (done > 0 && seconds > 1)
      pags_progress_show(progress, "%s: %.0f %%, %s left", what, 100 * fraction,
                         pags_format_duration(seconds * (1 - fraction) / done, left, sizeof left));
    else
      pags_progress_show(progress, "%s: %.0f %%", what, 100 * fraction);
  }
  return !pags_interrupted();
}

void pags_progress_end(pags_progress *progress) {
  if (!progress->stream)
    return;
  clear_line(progress);
  pags_output_flush(progress->stream);
}

const char *pags_format_duration(double seconds, char *text, size_t size) {
  long whole = seconds > 0 ? (long)(seconds + 0.5) : 0;
  if (whole >= 3600)
    snprintf(text, size, "%ld h %02ld min", whole / 3600, whole / 60 % 60);
  else if (whole >= 60)
    snprintf(text, size, "%ld min %02ld s", whole / 60, whole % 60);
  else
    snprintf(text, size, "%ld s", whole);
  return text;
}

const char *pags_format_bytes(double bytes, char *text, size_t size) {
  static const char *const units[] = {"B", "kB", "MB", "GB", "TB"};
  int unit = 0;
  while (bytes >= 1000 && unit < 4) {
    bytes /= 1000;
    unit++;
  }
  snprintf(text, size, unit ? "%.1f %s" : "%.0f %s", bytes, units[unit]);
  return text;
}
