/* SPDX-License-Identifier: Apache-2.0 */
/* The table of pags-bench error, with a row for each approximation of the engine, and helpers of its three parts.
 * Internal to benchmarks/. */
#ifndef PAGS_BENCHMARKS_ERROR_H
#define PAGS_BENCHMARKS_ERROR_H

#include "benchmarks/bench.h"

enum { ERROR_MOST_ROWS = 40, ERROR_COUNTS = 2 };

/* Amount of work or memory without and with the approximation; unlike times, independent of the machine's load. */
typedef struct error_count {
  const char *what; /* name of the count; NULL: none */
  double exact, used;
} error_count;

typedef struct error_row {
  const char *name;  /* name of the approximation */
  const char *exact; /* what it is compared with */
  const char *unit;  /* unit of the errors */
  double largest, mean;
  double psnr;         /* dB, for pictures; NaN otherwise */
  double gain;         /* speed-up over what it is compared with; NaN: none, or the engine can't run without it */
  const char *gain_of; /* what was timed; "" if gain is NaN */
  error_count counts[ERROR_COUNTS];
} error_row;

typedef struct error_table {
  error_row rows[ERROR_MOST_ROWS];
  int count;
} error_table;

/* Adds a row with errors 0 and without PSNR and gain, and returns it. */
error_row *error_table_add(error_table *table, const char *name, const char *exact, const char *unit);

/* Error statistics over samples: maximum, and sums of absolute and squared differences. */
typedef struct error_sum {
  double largest, absolute, square, samples;
} error_sum;

void error_sum_add(error_sum *sum, double difference);
/* Writes the largest and the mean error, times `scale`, into the row; for pictures (values 0..1, scale 255) the PSNR,
 * too. */
void error_sum_put(const error_sum *sum, double scale, error_row *row);

/* Copies a picture's colour into three contiguous planes of width x height; NULL if out of memory. */
double *error_picture_copy(const pags_picture *picture);
void error_picture_compare(const double *a, const double *b, int64_t samples, error_sum *sum);

/* Processor time of all threads of this process, ms. */
double error_clock_ms(void);
/* Median of `values`, which are sorted in place; NaN without values. */
double error_median(double *values, int64_t count);
/* Reports progress: `part` is the phase that has begun. Returns PAGS_OK, or sets the error and returns
 * PAGS_CANCELLED. */
pags_result error_go_on(const pags_bench_view *view, double fraction, const char *part);

/* Each measures one part of the table and adds its rows: float arithmetic, limits of blending and gradients against
 * the oracle; approximations that the engine can switch off; Adam and scores of the training. */
pags_result error_rows_of_oracle(const pags_bench_view *view, error_table *table);
pags_result error_rows_of_drawing(const pags_bench_view *view, error_table *table);
pags_result error_rows_of_training(const pags_bench_view *view, error_table *table);

#endif
