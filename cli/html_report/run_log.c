/* SPDX-License-Identifier: Apache-2.0 */
/* Reads a run's log.jsonl and report.json; see run_log.h. */
#include "cli/html_report/run_log.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"

const pags_log_curve pags_log_curves[PAGS_LOG_CURVES] = {
    {"loss", "Loss, training views", "running mean", true},
    {"psnr", "PSNR, training views, dB", "running mean, dB", false},
    {"held_out_psnr", "PSNR, held-out views while training, dB", "mean of the views measured, dB", false},
    {"gaussians", "Gaussians", "Gaussians", true},
};

static bool add_point(pags_run_log *log, int curve, double step, double value) {
  const int64_t count = log->curves[curve].count;
  if (count == log->curves[curve].capacity) {
    const int64_t capacity = 2 * count + 64;
    double *steps = realloc(log->curves[curve].step, (size_t)capacity * sizeof *steps);
    if (steps)
      log->curves[curve].step = steps;
    double *values = realloc(log->curves[curve].value, (size_t)capacity * sizeof *values);
    if (values)
      log->curves[curve].value = values;
    if (!steps || !values)
      return false;
    log->curves[curve].capacity = capacity;
  }
  log->curves[curve].step[count] = step;
  log->curves[curve].value[count] = value;
  log->curves[curve].count++;
  return true;
}

static double number_of(const pags_json_value *object, const char *key) {
  const pags_json_value *value = object ? pags_json_member(object, key) : NULL;
  return value && value->type == PAGS_JSON_NUMBER ? value->number : (double)NAN;
}

static pags_result read_line(pags_run_log *log, const char *path, const char *line, size_t size) {
  pags_json *json;
  log->lines++;
  const pags_result result = pags_json_parse_text(path, line, size, &json);
  if (result == PAGS_ERROR_MEMORY)
    return result;
  const double step = result == PAGS_OK ? number_of(pags_json_root(json), "step") : (double)NAN;
  bool room = true;
  log->unread += isnan(step);
  for (int k = 0; k < PAGS_LOG_CURVES && !isnan(step) && room; k++) {
    const double value = number_of(pags_json_root(json), pags_log_curves[k].key);
    room = isnan(value) || add_point(log, k, step, value);
  }
  if (result == PAGS_OK)
    pags_json_destroy(json);
  return room ? PAGS_OK : pags_out_of_memory("%s", path);
}

static pags_result read_log(pags_run_log *log, const char *path) {
  uint8_t *bytes;
  size_t size;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  pags_result result = PAGS_OK;
  const char *line = (const char *)bytes, *end = line + size;
  while (line < end && result == PAGS_OK) {
    const char *newline = memchr(line, '\n', (size_t)(end - line));
    const char *next = newline ? newline : end;
    if (next > line)
      result = read_line(log, path, line, (size_t)(next - line));
    line = next + 1;
  }
  free(bytes);
  return result;
}

/* Stores the message about an unreadable file, which the page shows; not an error. */
static pags_result note_fault(pags_run_log *log, pags_result result) {
  if (result == PAGS_OK || result == PAGS_ERROR_MEMORY)
    return result;
  free(log->fault);
  log->fault = pags_text_copy(pags_error_message());
  return log->fault ? PAGS_OK : pags_out_of_memory(NULL);
}

pags_result pags_run_log_read(const char *folder, pags_run_log *out) {
  *out = (pags_run_log){0};
  char *log = pags_path_join(folder, "log.jsonl"), *report = pags_path_join(folder, "report.json");
  pags_result result = log && report ? PAGS_OK : pags_out_of_memory("a path");
  if (result == PAGS_OK && pags_file_exists(report))
    result = note_fault(out, pags_json_parse_file(report, &out->report));
  if (result == PAGS_OK && pags_file_exists(log))
    result = note_fault(out, read_log(out, log));
  free(log);
  free(report);
  return result;
}

void pags_run_log_destroy(pags_run_log *log) {
  for (int k = 0; k < PAGS_LOG_CURVES; k++) {
    free(log->curves[k].step);
    free(log->curves[k].value);
  }
  pags_json_destroy(log->report);
  free(log->fault);
  *log = (pags_run_log){0};
}

double pags_run_log_number(const pags_run_log *log, const char *group, const char *key) {
  const pags_json_value *root = log->report ? pags_json_root(log->report) : NULL;
  return root ? number_of(group ? pags_json_member(root, group) : root, key) : (double)NAN;
}

const char *pags_run_log_text(const pags_run_log *log, const char *key) {
  const pags_json_value *value = log->report ? pags_json_member(pags_json_root(log->report), key) : NULL;
  return value && value->type == PAGS_JSON_STRING ? value->text : NULL;
}
