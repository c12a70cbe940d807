/* SPDX-License-Identifier: Apache-2.0 */
/* Writes each fact of a report in two forms from one call: as a line of text for people and as a JSON member for
 * programs. */
#ifndef PAGS_CLI_REPORT_H
#define PAGS_CLI_REPORT_H

#include "cli/common/session.h"

#include <pags/place.h>

typedef struct pags_report {
  pags_json_writer json;
  char *text; /* lines, printed only at the end, so that a failure prints none of them */
  size_t size;
  int64_t capacity;
  int indent;
  bool failed;
} pags_report;

pags_report pags_report_begin(void);
/* Prints the gathered lines and writes the JSON. */
pags_result pags_report_end(pags_report *report, const pags_session *session);
void pags_report_destroy(pags_report *report);

/* Each adds one fact. `key` is the JSON key; in the printed line its underscores become spaces. */
void pags_report_text(pags_report *report, const char *key, const char *value);
void pags_report_count(pags_report *report, const char *key, int64_t value);
void pags_report_number(pags_report *report, const char *key, double value); /* NaN: "-", null in JSON */
void pags_report_bytes(pags_report *report, const char *key, double value);
void pags_report_flag(pags_report *report, const char *key, bool value);
void pags_report_vector(pags_report *report, const char *key, const double *values, int count);
/* Vector "geographic_origin": latitude and longitude in degrees, altitude in metres; nothing if the place is unknown.
 */
void pags_report_place(pags_report *report, const pags_place *place);

/* Adds a printed line only; the caller writes the JSON counterpart to `json` itself. */
void pags_report_line(pags_report *report, const char *key, const char *format, ...) PAGS_PRINTF(3, 4);
/* The same with a name from the data, such as an object's id, printed in the form that options take. */
void pags_report_named(pags_report *report, const char *name, const char *format, ...) PAGS_PRINTF(3, 4);

void pags_report_begin_group(pags_report *report, const char *key); /* opens a JSON object */
void pags_report_end_group(pags_report *report);
void pags_report_begin_list(pags_report *report, const char *key);  /* opens a JSON array */
void pags_report_sentence(pags_report *report, const char *text);   /* adds a string to the list */
void pags_report_begin_item(pags_report *report, const char *name); /* opens a JSON object with that "name" */
void pags_report_end_item(pags_report *report);
void pags_report_end_list(pags_report *report);

#endif
