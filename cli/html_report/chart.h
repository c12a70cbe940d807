/* SPDX-License-Identifier: Apache-2.0 */
/* Charts as inline SVG: curves and histograms of one or two scenes over shared axes. */
#ifndef PAGS_CLI_HTML_REPORT_CHART_H
#define PAGS_CLI_HTML_REPORT_CHART_H

#include "cli/html_report/html.h"

/* Points in the order of x; those whose y isn't finite are left out. */
typedef struct pags_curve {
  const double *x, *y;
  int64_t count;
} pags_curve;

typedef struct pags_chart {
  const char *title; /* of the program's own words, as the names of the axes */
  const char *x_name, *y_name;
  bool from_zero; /* the y axis begins at 0 */
  bool bins;      /* a histogram: y[i] is the height from x[i] to x[i + 1]; the last y isn't drawn */
  bool log_x;     /* x are decimal logarithms, labelled by the numbers themselves */
  bool dots;      /* points that no line connects */
} pags_chart;

/* Appends a figure with the curves, of which the second is dashed (or hollow). Curves of less than two points are left
 * out; without any, nothing is appended. Returns whether there was one. */
bool pags_chart_put(pags_html *html, const pags_chart *chart, const pags_curve *curves, int count);

#endif
