/* SPDX-License-Identifier: Apache-2.0 */
/* Writes HTML into memory: markup as it is, text escaped, numbers, pictures as data URIs, and charts as inline SVG. */
#ifndef PAGS_CLI_HTML_REPORT_HTML_H
#define PAGS_CLI_HTML_REPORT_HTML_H

#include <pags/base.h>
#include <stdbool.h>

#include "image/formats.h"

enum { PAGS_HTML_TEXTS = 8 };

/* Zeros are an empty one. A failed allocation is remembered in `failed`. */
typedef struct pags_html {
  pags_sink sink;                   /* the page */
  pags_sink texts[PAGS_HTML_TEXTS]; /* results of the functions that return text, by turns */
  int next;
  bool failed;
} pags_html;

void pags_html_destroy(pags_html *html);

/* Appends markup, formatted as by printf. Strings that come from files go through pags_html_text. */
void pags_html_put(pags_html *html, const char *format, ...) PAGS_PRINTF(2, 3);

/* Arguments for pags_html_put; each remains valid until PAGS_HTML_TEXTS others have been made.
 * Text from anywhere: what HTML would read as markup is escaped, also within quotes; control characters become U+FFFD,
 * and a byte that isn't UTF-8 \xDF (its value). */
const char *pags_html_text(pags_html *html, const char *text);
/* A number, a dash if it isn't finite. */
const char *pags_html_number(pags_html *html, int decimals, double value);
/* A count with grouped thousands, "1 234 567". */
const char *pags_html_count(pags_html *html, int64_t value);

/* Begins a table in a box that scrolls sideways where it is too wide; `heads` are the texts of its head, separated by
 * '|', those of columns of numbers beginning with '#'. */
void pags_html_begin_table(pags_html *html, const char *heads);
void pags_html_end_table(pags_html *html);

/* Appends a JPEG file as a picture with a caption of the program's own words. */
void pags_html_picture(pags_html *html, const pags_sink *jpeg, int width, int height, const char *caption);

/* ---- Charts: curves and histograms of one or two scenes over shared axes ---- */

/* Points (x, y) in the order of x; those whose y isn't finite are left out. */
typedef struct pags_curve {
  double (*points)[2];
  int64_t count, capacity;
} pags_curve;

typedef struct pags_chart {
  const char *title; /* of the program's own words, as the names of the axes */
  const char *x_name, *y_name;
  bool from_zero; /* the y axis begins at 0 */
  bool bins;      /* a histogram: y of a point is the height from its x to that of the next; the last y isn't drawn */
  bool log_x;     /* x are decimal logarithms, labelled by the numbers themselves */
  bool dots;      /* points that no line connects */
} pags_chart;

/* Appends a figure with the curves, of which the second is dashed (or hollow). Curves of less than two points are left
 * out; without any, nothing is appended. Returns whether there was one. */
bool pags_chart_put(pags_html *html, const pags_chart *chart, const pags_curve *curves, int count);

#endif
