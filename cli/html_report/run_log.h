/* SPDX-License-Identifier: Apache-2.0 */
/* Logs of a training in the scene's folder: log.jsonl as curves, and report.json. */
#ifndef PAGS_CLI_HTML_REPORT_RUN_LOG_H
#define PAGS_CLI_HTML_REPORT_RUN_LOG_H

#include "base/json.h"
#include "cli/html_report/chart.h"

/* A member of the log's lines that is drawn over the steps where lines have it. */
typedef struct pags_log_curve {
  const char *key, *title, *y_name;
  bool from_zero;
} pags_log_curve;

enum { PAGS_LOG_CURVES = 4 };
extern const pags_log_curve pags_log_curves[PAGS_LOG_CURVES];

typedef struct pags_run_log {
  struct {
    double *step, *value;
    int64_t count, capacity;
  } curves[PAGS_LOG_CURVES];
  int64_t lines, unread; /* lines of the log; of these not readable, as the last one of a run that was killed */
  pags_json *report;     /* report.json; NULL: missing */
  char *fault;           /* why a file that is there couldn't be read; NULL: all that are there were */
} pags_run_log;

/* Reads what `folder` has; none of it is needed. PAGS_ERROR_MEMORY; `out` must be destroyed then, too. */
pags_result pags_run_log_read(const char *folder, pags_run_log *out);
void pags_run_log_destroy(pags_run_log *log); /* a zeroed struct is allowed */

/* A number of report.json, NaN where it has none; `group` (may be NULL) names the object that it is in. */
double pags_run_log_number(const pags_run_log *log, const char *group, const char *key);
/* A string of report.json; NULL where it has none. */
const char *pags_run_log_text(const pags_run_log *log, const char *key);

#endif
