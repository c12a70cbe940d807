/* SPDX-License-Identifier: Apache-2.0 */
/* Charts as SVG, which needs no package: panels of lines, side by side in columns. */
#ifndef PAGS_BENCHMARKS_PLOT_H
#define PAGS_BENCHMARKS_PLOT_H

#include <pags/base.h>
#include <stdbool.h>

typedef struct pags_plot {
  char *text;
  size_t size, capacity;
  bool failed; /* memory ran out */
  int columns, panels;
} pags_plot;

/* Points that are joined where both are finite; a NaN breaks the line. */
typedef struct pags_plot_line {
  const char *name;
  int count;
  const double *x, *y;
} pags_plot_line;

void pags_plot_begin(pags_plot *plot, int columns);

/* A panel of lines, with ticks at round numbers and a legend below. Lines of the same number have the same colour in
 * every panel. */
void pags_plot_lines(pags_plot *plot, const char *title, const char *x_name, const char *y_name,
                     const pags_plot_line *lines, int count);

/* Writes the file and frees the plot. */
pags_result pags_plot_save(pags_plot *plot, const char *path);

#endif
