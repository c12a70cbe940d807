/* SPDX-License-Identifier: Apache-2.0 */
/* Facts said twice from one call: as lines for people and as JSON for machines. */
#ifndef PAGS_CLI_REPORT_H
#define PAGS_CLI_REPORT_H

#include "cli/session.h"

#include <pags/place.h>

typedef struct pags_report {
  pags_json_writer json;
  char *text; /* lines gathered so far, so that a failure half way prints nothing */
  size_t size, capacity;
  int indent;
  bool failed;
} pags_report;

void pags_report_begin(pags_report *report);
/* When `result` is PAGS_OK prints the lines and writes the JSON; frees everything. Returns the first failure. */
pags_result pags_report_end(pags_report *report, const pags_session *session, pags_result result);

/* `key` is the JSON key; people read it with spaces for underscores. */
void pags_report_text(pags_report *report, const char *key, const char *value);
void pags_report_count(pags_report *report, const char *key, int64_t value);
void pags_report_number(pags_report *report, const char *key, double value); /* NaN: "-" and null */
void pags_report_bytes(pags_report *report, const char *key, double value);
void pags_report_flag(pags_report *report, const char *key, bool value);
void pags_report_vector(pags_report *report, const char *key, const double *values, int count);
void pags_report_place(
    pags_report *report,
    const pags_place *place); /* "geographic_origin": latitude, longitude, altitude; nothing where unknown */

/* A line for people alone; what machines read of it goes to `json` by the caller. */
void pags_report_line(pags_report *report, const char *key, const char *format, ...) PAGS_PRINTF(3, 4);

void pags_report_begin_group(pags_report *report, const char *key); /* an object */
void pags_report_end_group(pags_report *report);
void pags_report_begin_list(pags_report *report, const char *key);  /* an array of items */
void pags_report_sentence(pags_report *report, const char *text);   /* in a list: a string, printed as it is */
void pags_report_begin_item(pags_report *report, const char *name); /* an object with that "name" */
void pags_report_end_item(pags_report *report);
void pags_report_end_list(pags_report *report);

#endif
