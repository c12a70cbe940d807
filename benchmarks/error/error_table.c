/* SPDX-License-Identifier: Apache-2.0 */
/* Functions shared by the parts of pags-bench error: table rows, error sums, picture copies and processor time. */
#include "benchmarks/error/error.h"

#include <math.h>
#include <stdlib.h>
#include <time.h>
#include "base/sort.h"
#include "maths/maths.h"

error_row *error_table_add(error_table *table, const char *name, const char *exact, const char *unit) {
  error_row *row = &table->rows[table->count < ERROR_MOST_ROWS ? table->count++ : ERROR_MOST_ROWS - 1];
  *row = (error_row){.name = name, .exact = exact, .unit = unit, .psnr = NAN, .gain = NAN, .gain_of = ""};
  return row;
}

void error_sum_add(error_sum *sum, double difference) {
  const double off = fabs(difference);
  sum->largest = off > sum->largest ? off : sum->largest;
  sum->absolute += off;
  sum->square += off * off;
  sum->samples += 1;
}

void error_sum_put(const error_sum *sum, double scale, error_row *row) {
  row->largest = scale * sum->largest;
  row->mean = sum->samples > 0 ? scale * sum->absolute / sum->samples : 0;
  if (scale == 255.0)
    row->psnr = sum->square > 0 ? -10 * pags_log10(sum->square / sum->samples) : (double)INFINITY;
}

double *error_picture_copy(const pags_picture *picture) {
  const int64_t size = (int64_t)picture->width * picture->height;
  double *const out = malloc(3 * (size_t)size * sizeof *out);
  for (int c = 0; out && c < 3; c++)
    for (int y = 0; y < picture->height; y++)
      for (int x = 0; x < picture->width; x++)
        out[c * size + (int64_t)y * picture->width + x] = (double)picture->rgb[c][(int64_t)y * picture->stride + x];
  return out;
}

void error_picture_compare(const double *a, const double *b, int64_t samples, error_sum *sum) {
  for (int64_t i = 0; i < samples; i++)
    error_sum_add(sum, a[i] - b[i]);
}

double error_clock_ms(void) {
  return 1e3 * (double)clock() / CLOCKS_PER_SEC;
}

double error_median(double *values, int64_t count) {
  pags_sort_doubles(values, count);
  return count > 0 ? 0.5 * (values[(count - 1) / 2] + values[count / 2]) : (double)NAN;
}

pags_result error_go_on(const pags_bench_view *view, double fraction, const char *part) {
  if (view->progress && !view->progress(view->progress_user, fraction, part))
    return pags_fail(PAGS_CANCELLED, "cancelled");
  return PAGS_OK;
}
