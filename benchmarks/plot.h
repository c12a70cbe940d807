/* SPDX-License-Identifier: Apache-2.0 */
/* Writes line charts as SVG without any library: panels of lines, arranged in columns. */
#ifndef PAGS_BENCHMARKS_PLOT_H
#define PAGS_BENCHMARKS_PLOT_H

#include <pags/base.h>
#include <stdbool.h>

typedef struct pags_plot {
  char *text;
  size_t size, capacity;
  bool failed; /* out of memory */
  int columns, panels;
} pags_plot;

/* A line through points; a NaN in x or y breaks the line. */
typedef struct pags_plot_line {
  const char *name;
  int count;
  const double *x, *y;
} pags_plot_line;

void pags_plot_begin(pags_plot *plot, int columns);

/* Adds a panel of lines, with ticks at round numbers and a legend below. Line number i has the same colour in every
 * panel. */
void pags_plot_lines(pags_plot *plot, const char *title, const char *x_name, const char *y_name,
                     const pags_plot_line *lines, int count);

/* Writes the file and frees the plot. */
pags_result pags_plot_save(pags_plot *plot, const char *path);

#endif
