/* SPDX-License-Identifier: Apache-2.0 */
/* Implements report.h: gathers a report's facts as text lines and JSON members at the same time. */
#include "cli/common/report.h"

#include <math.h>
#include <stdarg.h>

enum { KEY_WIDTH = 16, INDENT = 2 };

static void append(pags_report *report, const char *text, size_t length) {
  if (!pags_grow(&report->text, (int64_t)(report->size + length + 1), &report->capacity, 1)) {
    report->failed = true;
    return;
  }
  memcpy(report->text + report->size, text, length);
  report->size += length;
  report->text[report->size] = 0;
}

PAGS_PRINTF(3, 0)
static void line_of(pags_report *report, const char *name, const char *format, va_list list) {
  char buffer[1280], value[1100];
  vsnprintf(value, sizeof value, format, list);
  int length = *value ? snprintf(buffer, sizeof buffer, "%*s%-*s %s\n", report->indent, "", KEY_WIDTH, name, value)
                      : snprintf(buffer, sizeof buffer, "%*s%s\n", report->indent, "", name);
  append(report, buffer, (size_t)(length < (int)sizeof buffer ? length : (int)sizeof buffer - 1));
}

void pags_report_line(pags_report *report, const char *key, const char *format, ...) {
  char words[64];
  va_list list;
  snprintf(words, sizeof words, "%s", key);
  for (char *c = words; *c; c++)
    if (*c == '_')
      *c = ' ';
  va_start(list, format);
  line_of(report, words, format, list);
  va_end(list);
}

void pags_report_named(pags_report *report, const char *name, const char *format, ...) {
  va_list list;
  va_start(list, format);
  line_of(report, name, format, list);
  va_end(list);
}

pags_report pags_report_begin(void) {
  return (pags_report){.json = pags_session_json_begin()};
}

void pags_report_destroy(pags_report *report) {
  pags_json_writer_destroy(&report->json);
  free(report->text);
}

pags_result pags_report_end(pags_report *report, const pags_session *session) {
  PAGS_CHECK_MEMORY(!report->failed, NULL);
  const bool json_instead = session->json && !strcmp(session->json, "-");
  if (report->text && !json_instead)
    pags_say(session, "%s", report->text);
  return pags_session_json(session, &report->json);
}

void pags_report_text(pags_report *report, const char *key, const char *value) {
  pags_report_line(report, key, "%s", value);
  pags_json_put_string(&report->json, key, value);
}

void pags_report_count(pags_report *report, const char *key, int64_t value) {
  pags_report_line(report, key, "%lld", (long long)value);
  pags_json_put_integer(&report->json, key, value);
}

void pags_report_number(pags_report *report, const char *key, double value) {
  if (isnan(value))
    pags_report_line(report, key, "-");
  else
    pags_report_line(report, key, "%.6g", value);
  pags_json_put_number(&report->json, key, value);
}

void pags_report_bytes(pags_report *report, const char *key, double value) {
  char text[32];
  pags_report_line(report, key, "%.0f (%s)", value, pags_format_bytes(value, text, sizeof text));
  pags_json_put_integer(&report->json, key, (int64_t)value);
}

void pags_report_flag(pags_report *report, const char *key, bool value) {
  pags_report_line(report, key, "%s", value ? "yes" : "no");
  pags_json_put_bool(&report->json, key, value);
}

void pags_report_vector(pags_report *report, const char *key, const double *values, int count) {
  char text[256];
  size_t used = 0;
  for (int i = 0; i < count && used < sizeof text; i++)
    used += (size_t)snprintf(text + used, sizeof text - used, "%s%.9g", i ? " " : "", values[i]);
  pags_report_line(report, key, "%s", text);
  pags_json_put_numbers(&report->json, key, values, count);
}

void pags_report_place(pags_report *report, const pags_place *place) {
  if (place->known)
    pags_report_vector(report, "geographic_origin", (double[]){place->latitude, place->longitude, place->altitude}, 3);
}

void pags_report_begin_group(pags_report *report, const char *key) {
  pags_report_line(report, key, "%s", "");
  report->indent += INDENT;
  pags_json_begin_object(&report->json, key);
}

void pags_report_end_group(pags_report *report) {
  report->indent -= INDENT;
  pags_json_end_object(&report->json);
}

void pags_report_begin_list(pags_report *report, const char *key) {
  pags_report_line(report, key, "%s", "");
  report->indent += INDENT;
  pags_json_begin_array(&report->json, key);
}

void pags_report_sentence(pags_report *report, const char *text) {
  char indent[32];
  append(report, indent, (size_t)snprintf(indent, sizeof indent, "%*s", report->indent % 16, ""));
  append(report, text, strlen(text));
  append(report, "\n", 1);
  pags_json_put_string(&report->json, NULL, text);
}

void pags_report_begin_item(pags_report *report, const char *name) {
  pags_report_named(report, name, "%s", "");
  report->indent += INDENT;
  pags_json_begin_object(&report->json, NULL);
  pags_json_put_string(&report->json, "name", name);
}

void pags_report_end_item(pags_report *report) {
  pags_report_end_group(report);
}

void pags_report_end_list(pags_report *report) {
  report->indent -= INDENT;
  pags_json_end_array(&report->json);
}
