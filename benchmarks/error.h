/* SPDX-License-Identifier: Apache-2.0 */
/* What `pags-bench error` finds out: a row for each approximation of the engine. Internal to benchmarks/. */
#ifndef PAGS_BENCHMARKS_ERROR_H
#define PAGS_BENCHMARKS_ERROR_H

#include "benchmarks/bench.h"

enum { ERROR_MOST_ROWS = 40, ERROR_COUNTS = 2 };

/* Work or memory without and with the approximation. No machine's load changes it. */
typedef struct error_count {
  const char *what; /* NULL: none */
  double exact, used;
} error_count;

typedef struct error_row {
  const char *name;  /* the approximation */
  const char *exact; /* what it is held against */
  const char *unit;  /* of the errors */
  double largest, mean;
  double psnr;         /* of pictures; NaN: not a picture */
  double gain;         /* times as fast as what it is held against; NaN: has none or can't be run without */
  const char *gain_of; /* what was timed; "" without a gain */
  error_count counts[ERROR_COUNTS];
} error_row;

typedef struct error_table {
  error_row rows[ERROR_MOST_ROWS];
  int count;
} error_table;

/* A row with errors of 0 and neither PSNR nor gain. */
error_row *error_table_add(error_table *table, const char *name, const char *exact, const char *unit);

/* Sums over samples. */
typedef struct error_sum {
  double largest, absolute, square, samples;
} error_sum;

void error_sum_add(error_sum *sum, double difference);
/* Largest and mean to the row, times `scale`; of pictures (0..1, scale 255) the PSNR as well. */
void error_sum_put(const error_sum *sum, double scale, error_row *row);

/* Three planes of width x height, contiguous. Out of memory: NULL. */
double *error_picture_copy(const pags_picture *picture);
void error_picture_compare(const double *a, const double *b, int64_t samples, error_sum *sum);

/* Processor time of all threads of this process, ms. */
double error_clock_ms(void);
/* Of ratios, which are sorted; NaN of none. */
double error_median(double *values, int64_t count);
/* 0: go on; else cancelled, and the error is set. `part` is what has begun. */
pags_result error_go_on(const pags_bench_view *view, double fraction, const char *part);

/* Each adds its rows. */
pags_result error_rows_of_oracle(const pags_bench_view *view,
                                 error_table *table); /* float, limits of blending, gradients */
pags_result error_rows_of_drawing(const pags_bench_view *view, error_table *table);  /* engine against engine */
pags_result error_rows_of_training(const pags_bench_view *view, error_table *table); /* Adam, scores */

#endif
