/* SPDX-License-Identifier: Apache-2.0 */
/* The two forms of each fact. */
#include "cli/report.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

enum { KEY_WIDTH = 16, INDENT = 2 };

static void append(pags_report *facts, const char *text, size_t length) {
  if (facts->size + length + 1 > facts->capacity) {
    size_t capacity = 2 * facts->capacity + length + 256;
    char *grown = realloc(facts->text, capacity);
    if (!grown) {
      facts->failed = true;
      return;
    }
    facts->text = grown;
    facts->capacity = capacity;
  }
  memcpy(facts->text + facts->size, text, length);
  facts->size += length;
  facts->text[facts->size] = 0;
}

PAGS_PRINTF(3, 0)
static void line_of(pags_report *facts, const char *key, const char *format, va_list list) {
  char buffer[1280], value[1100], name[64];
  vsnprintf(value, sizeof value, format, list);
  snprintf(name, sizeof name, "%s", key);
  for (char *c = name; *c; c++)
    if (*c == '_')
      *c = ' ';
  int length = *value ? snprintf(buffer, sizeof buffer, "%*s%-*s %s\n", facts->indent, "", KEY_WIDTH, name, value)
                      : snprintf(buffer, sizeof buffer, "%*s%s\n", facts->indent, "", name);
  append(facts, buffer, (size_t)(length < (int)sizeof buffer ? length : (int)sizeof buffer - 1));
}

PAGS_PRINTF(3, 4)
static void line(pags_report *facts, const char *key, const char *format, ...) {
  va_list list;
  va_start(list, format);
  line_of(facts, key, format, list);
  va_end(list);
}

void pags_report_line(pags_report *facts, const char *key, const char *format, ...) {
  va_list list;
  va_start(list, format);
  line_of(facts, key, format, list);
  va_end(list);
}

void pags_report_begin(pags_report *facts) {
  memset(facts, 0, sizeof *facts);
  pags_json_writer_init(&facts->json, 2);
  pags_json_begin_object(&facts->json, NULL);
}

pags_result pags_report_end(pags_report *facts, const pags_session *session, pags_result result) {
  if (result == PAGS_OK && facts->failed)
    result = pags_out_of_memory(NULL);
  if (result == PAGS_OK) {
    pags_json_end_object(&facts->json);
    bool json_instead = session->json && !strcmp(session->json, "-");
    if (facts->text && !json_instead)
      pags_say(session, "%s", facts->text);
    result = pags_session_json(session, &facts->json);
  } else {
    pags_json_writer_destroy(&facts->json);
  }
  free(facts->text);
  return result;
}

void pags_report_text(pags_report *facts, const char *key, const char *value) {
  line(facts, key, "%s", value);
  pags_json_put_string(&facts->json, key, value);
}

void pags_report_count(pags_report *facts, const char *key, int64_t value) {
  line(facts, key, "%lld", (long long)value);
  pags_json_put_integer(&facts->json, key, value);
}

void pags_report_number(pags_report *facts, const char *key, double value) {
  if (isnan(value))
    line(facts, key, "%s", "-");
  else
    line(facts, key, "%.6g", value);
  pags_json_put_number(&facts->json, key, value);
}

void pags_report_bytes(pags_report *facts, const char *key, double value) {
  char text[32];
  line(facts, key, "%.0f (%s)", value, pags_format_bytes(value, text, sizeof text));
  pags_json_put_integer(&facts->json, key, (int64_t)value);
}

void pags_report_flag(pags_report *facts, const char *key, bool value) {
  line(facts, key, "%s", value ? "yes" : "no");
  pags_json_put_bool(&facts->json, key, value);
}

void pags_report_vector(pags_report *facts, const char *key, const double *values, int count) {
  char text[256];
  size_t used = 0;
  for (int i = 0; i < count && used < sizeof text; i++)
    used += (size_t)snprintf(text + used, sizeof text - used, "%s%.9g", i ? " " : "", values[i]);
  line(facts, key, "%s", text);
  pags_json_put_numbers(&facts->json, key, values, count);
}

void pags_report_place(pags_report *facts, const pags_place *place) {
  if (place->known)
    pags_report_vector(facts, "geographic_origin", (double[]){place->latitude, place->longitude, place->altitude}, 3);
}

void pags_report_begin_group(pags_report *facts, const char *key) {
  line(facts, key, "%s", "");
  facts->indent += INDENT;
  pags_json_begin_object(&facts->json, key);
}

void pags_report_end_group(pags_report *facts) {
  facts->indent -= INDENT;
  pags_json_end_object(&facts->json);
}

void pags_report_begin_list(pags_report *facts, const char *key) {
  line(facts, key, "%s", "");
  facts->indent += INDENT;
  pags_json_begin_array(&facts->json, key);
}

void pags_report_sentence(pags_report *facts, const char *text) {
  char indent[32];
  append(facts, indent, (size_t)snprintf(indent, sizeof indent, "%*s", facts->indent % 16, ""));
  append(facts, text, strlen(text));
  append(facts, "\n", 1);
  pags_json_put_string(&facts->json, NULL, text);
}

void pags_report_begin_item(pags_report *facts, const char *name) {
  line(facts, name, "%s", "");
  facts->indent += INDENT;
  pags_json_begin_object(&facts->json, NULL);
  pags_json_put_string(&facts->json, "name", name);
}

void pags_report_end_item(pags_report *facts) {
  pags_report_end_group(facts);
}

void pags_report_end_list(pags_report *facts) {
  facts->indent -= INDENT;
  pags_json_end_array(&facts->json);
}
