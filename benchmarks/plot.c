/* SPDX-License-Identifier: Apache-2.0 */
/* Writes charts as SVG: appends text panel by panel and writes the head at the end, when the number of panels is
 * known. */
#include "benchmarks/plot.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/file.h"
#include "base/memory.h"
#include "maths/maths.h"

enum {
  PANEL_WIDTH = 560,
  PANEL_HEIGHT = 430,
  LEFT = 70, /* edges of the axes within their panel, px */
  RIGHT = 530,
  TOP = 34,
  BOTTOM = 300,
  LEGEND = 352,
  LEGEND_COLUMNS = 4,
  LEGEND_STEP = 15
};

/* The colour palette of Okabe and Ito, which colour-blind people can distinguish; beyond 7 lines the colours repeat
 * with dashes. */
static const char *const colours[] = {"#000000", "#e69f00", "#56b4e9", "#009e73", "#d55e00", "#0072b2", "#cc79a7"};
static const char *const dashes[] = {"", "6 3", "2 2", "8 2 2 2"};
enum { COLOURS = sizeof colours / sizeof colours[0], DASHES = sizeof dashes / sizeof dashes[0] };

/* ---- Text ---- */

static bool make_room(pags_plot *plot, size_t more) {
  if (plot->failed || plot->size + more + 1 <= plot->capacity)
    return !plot->failed;
  size_t capacity = 2 * plot->capacity + more + 4096;
  char *text = realloc(plot->text, capacity);
  plot->failed = text == NULL;
  if (!text)
    return false;
  plot->text = text;
  plot->capacity = capacity;
  return true;
}

static void put(pags_plot *plot, const char *format, ...) PAGS_PRINTF(2, 3);
static void put(pags_plot *plot, const char *format, ...) {
  char piece[1024];
  va_list list;
  va_start(list, format);
  int length = vsnprintf(piece, sizeof piece, format, list);
  va_end(list);
  if (length < 0 || (size_t)length >= sizeof piece || !make_room(plot, (size_t)length)) {
    plot->failed = true;
    return;
  }
  memcpy(plot->text + plot->size, piece, (size_t)length + 1);
  plot->size += (size_t)length;
}

/* Appends a text element, with the characters <, > and & escaped. `anchor`: start, middle or end; `more`: further
 * attributes. */
static void put_text(pags_plot *plot, double x, double y, const char *anchor, const char *more, const char *text) {
  put(plot, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\"%s>", x, y, anchor, more);
  for (const char *c = text; *c; c++) {
    if (*c == '<' || *c == '>' || *c == '&')
      put(plot, *c == '<' ? "&lt;" : *c == '>' ? "&gt;" : "&amp;");
    else
      put(plot, "%c", *c);
  }
  put(plot, "</text>\n");
}

/* ---- Axes and lines ---- */

typedef struct axis {
  double least, largest, step; /* least and largest value of the axis; distance of its ticks */
  double begin, end;           /* positions of the least and the largest value in the panel */
} axis;

static double place(const axis *a, double value) {
  return a->begin + (value - a->least) / (a->largest - a->least) * (a->end - a->begin);
}

/* Makes an axis with about five ticks, at multiples of 1, 2 or 5 times a power of ten; the axis is 4 % longer than
 * the values at either end. */
static axis make_axis(double least, double largest, double begin, double end) {
  if (!(largest > least)) {
    const double more = fmax(fabs(least) * 0.05, 1e-3);
    least -= more;
    largest += more;
  }
  double raw = (largest - least) / 5, power = pags_pow(10, floor(pags_log10(raw))), step = 10 * power;
  for (int i = 2; i >= 0; i--)
    if (raw <= (double[]){1, 2, 5}[i] * power)
      step = (double[]){1, 2, 5}[i] * power;
  double margin = 0.04 * (largest - least);
  return (axis){least - margin, largest + margin, step, begin, end};
}

static axis span_axis(const pags_plot_line *lines, int count, bool vertical, double begin, double end) {
  double least = HUGE_VAL, largest = -HUGE_VAL;
  for (int i = 0; i < count; i++)
    for (int k = 0; k < lines[i].count; k++) {
      if (!isfinite(lines[i].x[k]) || !isfinite(lines[i].y[k]))
        continue;
      double value = vertical ? lines[i].y[k] : lines[i].x[k];
      least = fmin(least, value);
      largest = fmax(largest, value);
    }
  return make_axis(isfinite(least) ? least : 0, isfinite(largest) ? largest : 1, begin, end);
}

static void put_ticks(pags_plot *plot, const axis *a, bool vertical) {
  int decimals = (int)fmax(0, ceil(-pags_log10(a->step) - 1e-9));
  for (double k = ceil(a->least / a->step); k * a->step <= a->largest; k++) {
    char label[32];
    double at = place(a, k * a->step);
    snprintf(label, sizeof label, "%.*f", decimals, k == 0 ? 0.0 : k * a->step); /* avoids "-0" */
    if (vertical) {
      put(plot, "<path class=\"t\" d=\"M%d %.1fH%d\"/>\n", LEFT, at, RIGHT);
      put_text(plot, LEFT - 6, at + 4, "end", "", label);
    } else {
      put(plot, "<path class=\"t\" d=\"M%.1f %dV%d\"/>\n", at, TOP, BOTTOM);
      put_text(plot, at, BOTTOM + 16, "middle", "", label);
    }
  }
}

static void put_style(pags_plot *plot, int number) {
  put(plot, " stroke=\"%s\" stroke-dasharray=\"%s\"", colours[number % COLOURS], dashes[number / COLOURS % DASHES]);
}

static void put_line(pags_plot *plot, const pags_plot_line *line, int number, const axis *x, const axis *y) {
  bool pen = false, any = false;
  for (int k = 0; k < line->count; k++) {
    bool finite = isfinite(line->x[k]) && isfinite(line->y[k]);
    if (finite && !any)
      put(plot, "<path class=\"l\" d=\"");
    any = any || finite;
    if (finite)
      put(plot, "%c%.1f %.1f", pen ? 'L' : 'M', place(x, line->x[k]), place(y, line->y[k]));
    pen = finite;
  }
  if (!any)
    return;
  put(plot, "\"");
  put_style(plot, number);
  put(plot, "/>\n");
  for (int k = 0; k < line->count; k++)
    if (isfinite(line->x[k]) && isfinite(line->y[k]))
      put(plot, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"2\" fill=\"%s\"/>\n", place(x, line->x[k]), place(y, line->y[k]),
          colours[number % COLOURS]);
}

static void put_legend(pags_plot *plot, const pags_plot_line *lines, int count) {
  for (int i = 0; i < count; i++) {
    double x = 20 + i % LEGEND_COLUMNS * (PANEL_WIDTH - 20.0) / LEGEND_COLUMNS;
    double y = LEGEND + i / LEGEND_COLUMNS * LEGEND_STEP;
    if (y > PANEL_HEIGHT - 6)
      break;
    put(plot, "<path class=\"l\" d=\"M%.1f %.1fh24\"", x, y - 4);
    put_style(plot, i);
    put(plot, "/>\n");
    put_text(plot, x + 28, y, "start", "", lines[i].name);
  }
}

/* ---- Panels and the file ---- */

void pags_plot_begin(pags_plot *plot, int columns) {
  *plot = (pags_plot){.columns = columns};
}

void pags_plot_lines(pags_plot *plot, const char *title, const char *x_name, const char *y_name,
                     const pags_plot_line *lines, int count) {
  axis x = span_axis(lines, count, false, LEFT, RIGHT), y = span_axis(lines, count, true, BOTTOM, TOP);

  /* Begin the panel: its group and title. */
  int column = plot->panels % plot->columns, row = plot->panels / plot->columns;
  put(plot, "<g transform=\"translate(%d %d)\">\n", column * PANEL_WIDTH, row * PANEL_HEIGHT);
  put_text(plot, (LEFT + RIGHT) / 2.0, 20, "middle", " class=\"h\"", title);
  plot->panels++;

  put_ticks(plot, &x, false);
  put_ticks(plot, &y, true);
  put(plot, "<path class=\"a\" d=\"M%d %dV%dH%d\"/>\n", LEFT, TOP, BOTTOM, RIGHT);

  /* Write the names of the axes. */
  put_text(plot, (LEFT + RIGHT) / 2.0, BOTTOM + 34, "middle", "", x_name);
  char turned[64];
  snprintf(turned, sizeof turned, " transform=\"rotate(-90 16 %d)\"", (TOP + BOTTOM) / 2);
  put_text(plot, 16, (TOP + BOTTOM) / 2.0, "middle", turned, y_name);

  for (int i = 0; i < count; i++)
    put_line(plot, &lines[i], i, &x, &y);
  put_legend(plot, lines, count);
  put(plot, "</g>\n");
}

pags_result pags_plot_save(pags_plot *plot, const char *path) {
  static const char style[] =
      "<style>text{font:12px "
      "sans-serif}.h{font-weight:bold}.a{fill:none;stroke:#000}.t{fill:none;stroke:#ddd}.l{fill:none;stroke-width:1.6}"
      "</style>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n";
  char head[256];
  int across = plot->panels < plot->columns ? plot->panels : plot->columns;
  int down = (plot->panels + plot->columns - 1) / plot->columns;
  put(plot, "</svg>\n");
  snprintf(head, sizeof head, "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" height=\"%d\">\n",
           across * PANEL_WIDTH, down * PANEL_HEIGHT);
  pags_file_writer writer = {0};
  pags_result result = plot->failed ? pags_out_of_memory("%s: the plot", path) : PAGS_OK;
  if (result == PAGS_OK)
    result = pags_file_writer_begin(&writer, path);
  if (result == PAGS_OK)
    result = pags_file_writer_put(&writer, head, strlen(head));
  if (result == PAGS_OK)
    result = pags_file_writer_put(&writer, style, strlen(style));
  if (result == PAGS_OK)
    result = pags_file_writer_put(&writer, plot->text, plot->size);
  if (result == PAGS_OK)
    result = pags_file_writer_commit(&writer);
  free(plot->text);
  *plot = (pags_plot){0};
  return result;
}
