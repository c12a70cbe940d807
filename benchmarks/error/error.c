/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench error: measures the error of each approximation of the engine and what it saves; prints a table, writes
 * JSON and Markdown.
 *
 * Errors are against the double-precision oracle (tests/reference), or against the engine without the approximation
 * where it can be switched off. Gains are ratios of processor time, as medians over pairs of frames that were timed
 * alternately; next to them are counts of work and bytes. */
#include "benchmarks/error/error.h"

#include <math.h>
#include <string.h>
#include "base/file.h"
#include "simd/kernels.h"

/* ---- Rows as JSON and text ---- */

static void put_optional(pags_json_writer *json, const char *key, double value) {
  if (isfinite(value))
    pags_json_put_number(json, key, value);
  else
    pags_json_put_null(json, key); /* NaN: not applicable; infinite: equal pictures */
}

static void put_row(pags_json_writer *json, const error_row *row) {
  pags_json_begin_object(json, NULL);
  pags_json_put_string(json, "name", row->name);
  pags_json_put_string(json, "against", row->exact);
  pags_json_put_string(json, "unit", row->unit);
  pags_json_put_number(json, "max", row->largest);
  pags_json_put_number(json, "mean", row->mean);
  put_optional(json, "psnr", row->psnr);
  put_optional(json, "gain", row->gain);
  pags_json_put_string(json, "gain_of", row->gain_of);
  pags_json_begin_array(json, "counts");
  for (int i = 0; i < ERROR_COUNTS && row->counts[i].what; i++) {
    pags_json_begin_object(json, NULL);
    pags_json_put_string(json, "what", row->counts[i].what);
    pags_json_put_number(json, "exact", row->counts[i].exact);
    pags_json_put_number(json, "used", row->counts[i].used);
    pags_json_end_object(json);
  }
  pags_json_end_array(json);
  pags_json_end_object(json);
}

/* Formats a count with three digits and a unit: 12345678 gives "12.3 M". Returns its length. */
static int write_amount(char *out, size_t size, double value) {
  const char *unit = "";
  if (value >= 1e6)
    value *= 1e-6, unit = " M";
  else if (value >= 1e4)
    value *= 1e-3, unit = " k";
  return snprintf(out, size, "%.*f%s",
                  value < 10 && value != floor(value)    ? 2
                  : value < 100 && value != floor(value) ? 1
                                                         : 0,
                  value, unit);
}

typedef struct row_text {
  char largest[24], mean[24], psnr[24], gain[48], counts[160];
} row_text;

/* Formats an error with two significant digits. */
static void write_error(char *out, size_t size, double value) {
  snprintf(out, size, value < 99.5 ? "%.2g" : "%.0f", value);
}

static row_text write_row(const error_row *row) {
  row_text t = {"", "", "", "", ""};
  write_error(t.largest, sizeof t.largest, row->largest);
  write_error(t.mean, sizeof t.mean, row->mean);
  if (!isnan(row->psnr))
    snprintf(t.psnr, sizeof t.psnr, isinf(row->psnr) ? "equal" : "%.1f", row->psnr);
  if (!isnan(row->gain))
    snprintf(t.gain, sizeof t.gain, "%.*f, %s", row->gain < 10 ? 2 : 0, row->gain, row->gain_of);
  int at = 0;
  for (int i = 0; i < ERROR_COUNTS && row->counts[i].what; i++) {
    char exact[24], used[24];
    write_amount(exact, sizeof exact, row->counts[i].exact);
    write_amount(used, sizeof used, row->counts[i].used);
    at += snprintf(t.counts + at, sizeof t.counts - (size_t)at, "%s%s %s -> %s", i ? "; " : "", row->counts[i].what,
                   exact, used);
  }
  return t;
}

/* ---- Markdown ---- */

static pags_result put_line(pags_file_writer *file, const char *line) {
  return pags_file_writer_put(file, line, strlen(line));
}

static pags_result write_markdown(const char *path, const char *head, const error_table *table) {
  pags_file_writer file;
  char line[1024];
  PAGS_TRY(pags_file_writer_begin(&file, path));
  snprintf(line, sizeof line, "%s\n\n", head);
  PAGS_TRY(put_line(&file, line));
  PAGS_TRY(put_line(
      &file,
      "| approximation | against | unit | largest | mean | PSNR, dB | times as fast | counts, exact -> used |\n"
      "|---|---|---|---|---|---|---|---|\n"));
  for (int i = 0; i < table->count; i++) {
    const error_row *row = &table->rows[i];
    const row_text t = write_row(row);
    snprintf(line, sizeof line, "| %s | %s | %s | %s | %s | %s | %s | %s |\n", row->name, row->exact, row->unit,
             t.largest, t.mean, t.psnr, t.gain, t.counts);
    PAGS_TRY(put_line(&file, line));
  }
  return pags_file_writer_commit(&file);
}

/* ---- The benchmark ---- */

pags_result pags_bench_error(const pags_bench_view *view, FILE *people, pags_json_writer *json) {
  if (view->part_count > PAGS_BENCH_ERROR_PARTS)
    return pags_fail(PAGS_ERROR_LIMIT, "%d models; the error bench takes at most %d", view->part_count,
                     PAGS_BENCH_ERROR_PARTS);
  error_table table = {.count = 0};
  char head[512];
  PAGS_TRY(error_rows_of_oracle(view, &table));
  PAGS_TRY(error_rows_of_drawing(view, &table));
  PAGS_TRY(error_rows_of_training(view, &table));
  PAGS_TRY(error_go_on(view, 1, "done"));

  /* Write the heading: scene, views, kernels and threads. */
  size_t size = sizeof head;
  char gaussians[24];
  double all = 0;
  for (int p = 0; p < view->part_count; p++)
    all += (double)view->parts[p].gaussians->count;
  write_amount(gaussians, sizeof gaussians, all);
  const pags_kernels *kernels = pags_kernels_get(NULL);
  snprintf(head, size, "%s: %s Gaussians, %d view%s of %dx%d, %s, %d thread%s", view->name, gaussians,
           view->camera_count, view->camera_count == 1 ? "" : "s", view->cameras[0].width, view->cameras[0].height,
           kernels ? kernels->name : "", pags_tasks_workers(view->tasks),
           pags_tasks_workers(view->tasks) == 1 ? "" : "s");

  if (people) {
    /* Print the table. */
    fprintf(people, "%s\n%-28s %-36s %-12s %9s %9s %7s  %-24s %s\n", head, "approximation", "against", "unit",
            "largest", "mean", "PSNR", "times as fast", "counts, exact -> used");
    for (int i = 0; i < table.count; i++) {
      const error_row *row = &table.rows[i];
      const row_text t = write_row(row);
      fprintf(people, "%-28s %-36s %-12s %9s %9s %7s  %-24s %s\n", row->name, row->exact, row->unit, t.largest, t.mean,
              t.psnr, t.gain, t.counts);
    }
  }
  pags_json_put_string(json, "scene", view->name);
  pags_json_put_integer(json, "views", view->camera_count);
  pags_json_put_integer(json, "width", view->cameras[0].width);
  pags_json_put_integer(json, "height", view->cameras[0].height);
  pags_json_put_integer(json, "threads", pags_tasks_workers(view->tasks));
  pags_json_begin_array(json, "rows");
  for (int i = 0; i < table.count; i++)
    put_row(json, &table.rows[i]);
  pags_json_end_array(json);
  return view->markdown ? write_markdown(view->markdown, head, &table) : PAGS_OK;
}
