/* Charts as SVG, which needs no package: panels of lines or of coloured cells, side by side in columns. */
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

/* A panel of rows x columns cells, row after row, each with its value (`decimals`) written on a colour from the least
 * (dark) to the largest (light); NaN: an empty cell. */
void pags_plot_cells(pags_plot *plot, const char *title, const char *row_name, const char *const *row_labels, int rows,
                     const char *column_name, const char *const *column_labels, int columns, const double *values,
                     int decimals);

/* Writes the file and frees the plot. */
pags_result pags_plot_save(pags_plot *plot, const char *path);

#endif
