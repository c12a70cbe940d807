/* SPDX-License-Identifier: Apache-2.0 */
/* Implements the charts of html.h. Colours and widths of lines are those of the page's style. */
#include <math.h>
#include <stdio.h>
#include "cli/html_report/html.h"
#include "maths/maths.h"

/* Edges of the axes within the picture, in its units, which are pixels on a phone. */
enum { WIDTH = 360, HEIGHT = 200, LEFT = 46, RIGHT = 344, TOP = 8, BOTTOM = 158, MOST_TICKS = 12 };

typedef struct axis {
  double lo, hi;
  double begin, end; /* where lo and hi are drawn */
} axis;

static double place(const axis *a, double value) {
  return a->begin + (value - a->lo) / (a->hi - a->lo) * (a->end - a->begin);
}

/* A step of 1, 2 or 5 times a power of ten that divides the axis into three to seven. */
static double tick_step(const axis *a) {
  const double rough = (a->hi - a->lo) / 5, power = pags_pow(10, floor(pags_log10(rough))), lead = rough / power;
  return power * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
}

static const char *tick_text(double value, bool logarithm, char text[32]) {
  const double v = logarithm ? pags_pow(10, value) : value, size = fabs(v);
  if (!logarithm && size >= 1e6)
    snprintf(text, 32, "%.4gM", v / 1e6);
  else if (!logarithm && size >= 1e4)
    snprintf(text, 32, "%.4gk", v / 1e3);
  else
    snprintf(text, 32, "%.4g", size < 1e-12 ? 0 : v);
  return text;
}

static void put_axes(pags_html *html, const pags_chart *chart, const axis *x, const axis *y) {
  char text[32];
  const double step_x = chart->log_x ? fmax(1, ceil((x->hi - x->lo) / 6)) : tick_step(x), step_y = tick_step(y);
  double at = ceil(y->lo / step_y - 1e-9) * step_y;
  for (int i = 0; i < MOST_TICKS && at <= y->hi + 1e-9 * step_y; i++, at += step_y)
    pags_html_put(html,
                  "<path class=\"grid\" d=\"M%d %.1fH%d\"/><text x=\"%d\" y=\"%.1f\" text-anchor=\"end\">%s</text>\n",
                  LEFT, place(y, at), RIGHT, LEFT - 4, place(y, at) + 4, tick_text(at, false, text));
  at = ceil(x->lo / step_x - 1e-9) * step_x;
  for (int i = 0; i < MOST_TICKS && at <= x->hi + 1e-9 * step_x; i++, at += step_x)
    pags_html_put(html, "<text x=\"%.1f\" y=\"%d\" text-anchor=\"middle\">%s</text>\n", place(x, at), BOTTOM + 15,
                  tick_text(at, chart->log_x, text));
  pags_html_put(html,
                "<path class=\"axis\" d=\"M%d %dV%dH%d\"/>\n<text x=\"%d\" y=\"%d\" text-anchor=\"middle\">%s</text>\n",
                LEFT, TOP, BOTTOM, RIGHT, (LEFT + RIGHT) / 2, HEIGHT - 8, chart->x_name);
}

static void put_curve(pags_html *html, const pags_chart *chart, const pags_curve *c, char name, const axis *x,
                      const axis *y) {
  if (chart->dots) {
    for (int64_t i = 0; i < c->count; i++)
      if (isfinite(c->points[i][1]))
        pags_html_put(html, "<circle class=\"dot %c\" cx=\"%.1f\" cy=\"%.1f\" r=\"3\"/>\n", name,
                      place(x, c->points[i][0]), place(y, c->points[i][1]));
    return;
  }
  pags_html_put(html, "<path class=\"%s %c\" d=\"", chart->bins && name == 'a' ? "bins" : "line", name);
  if (chart->bins) {
    pags_html_put(html, "M%.1f %.1f", place(x, c->points[0][0]), place(y, y->lo));
    for (int64_t i = 0; i + 1 < c->count; i++)
      pags_html_put(html, "V%.1fH%.1f", place(y, c->points[i][1]), place(x, c->points[i + 1][0]));
    pags_html_put(html, "V%.1f", place(y, y->lo));
  } else {
    double last = -HUGE_VAL; /* points less than half a pixel from the previous one are skipped */
    for (int64_t i = 0; i < c->count; i++) {
      const double px = place(x, c->points[i][0]);
      if (!isfinite(c->points[i][1]) || (px - last < 0.5 && i + 1 < c->count))
        continue;
      pags_html_put(html, "%s%.1f %.1f", isfinite(last) ? "L" : "M", px, place(y, c->points[i][1]));
      last = px;
    }
  }
  pags_html_put(html, "\"/>\n");
}

bool pags_chart_put(pags_html *html, const pags_chart *chart, const pags_curve *curves, int count) {
  axis x = {HUGE_VAL, -HUGE_VAL, LEFT, RIGHT}, y = {HUGE_VAL, -HUGE_VAL, BOTTOM, TOP};
  int drawn = 0;
  for (int k = 0; k < count; k++) {
    int64_t finite = 0;
    for (int64_t i = 0; i < curves[k].count; i++) {
      const double *const point = curves[k].points[i];
      if (!isfinite(point[1]))
        continue;
      finite++;
      x.lo = fmin(x.lo, point[0]);
      x.hi = fmax(x.hi, point[0]);
      y.lo = fmin(y.lo, point[1]);
      y.hi = fmax(y.hi, point[1]);
    }
    drawn += finite >= 2;
  }
  if (!drawn || !(x.hi > x.lo))
    return false;
  if (chart->dots) {
    x.lo -= 0.5;
    x.hi += 0.5;
  }
  y.lo = chart->from_zero ? fmin(y.lo, 0) : y.lo;
  const double room = y.hi > y.lo ? 0.05 * (y.hi - y.lo) : fmax(0.05 * fabs(y.hi), 1e-3);
  y.hi += room;
  y.lo -= chart->from_zero ? 0 : room;
  pags_html_put(html,
                "<figure class=\"chart\"><figcaption>%s</figcaption>\n<svg viewBox=\"0 0 %d %d\" role=\"img\" "
                "aria-label=\"%s\">\n<title>%s: %s over %s</title>\n",
                chart->title, WIDTH, HEIGHT, chart->title, chart->title, chart->y_name, chart->x_name);
  put_axes(html, chart, &x, &y);
  for (int k = 0; k < count; k++)
    if (curves[k].count >= 2)
      put_curve(html, chart, &curves[k], (char)('a' + k), &x, &y);
  pags_html_put(html, "</svg></figure>\n");
  return true;
}
