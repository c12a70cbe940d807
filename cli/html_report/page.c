/* SPDX-License-Identifier: Apache-2.0 */
/* The first half of a report's page: its head, figures, curves and views. */
#include "cli/html_report/page.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

/* A is blue, B is orange and dashed, for colour-blind readers and prints. The policy refuses anything that isn't in the
 * page, in case a name is not escaped. */
static const char head[] =
    "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
    "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src "
    "'unsafe-inline'\">\n";

static const char style[] =
    "<style>\n"
    ":root{color-scheme:light dark;--ink:#1b1f24;--soft:#5a636e;--paper:#fff;--card:#f3f5f7;--line:#cfd6dd;"
    "--a:#1f6fb4;--b:#c05a00;--fill:#1f6fb44d}\n"
    "@media(prefers-color-scheme:dark){:root{--ink:#e4e7eb;--soft:#a3acb6;--paper:#15181c;--card:#20252b;"
    "--line:#3b434c;--a:#6cb4f0;--b:#f2a154;--fill:#6cb4f04d}}\n"
    "*{box-sizing:border-box}\n"
    "body{margin:0 auto;padding:16px;max-width:1120px;background:var(--paper);color:var(--ink);"
    "font:16px/1.45 system-ui,sans-serif}\n"
    "h1{font-size:1.6em;margin:.2em 0;overflow-wrap:anywhere}\n"
    "h2{font-size:1.2em;margin:1.8em 0 .5em;padding-top:.5em;border-top:1px solid var(--line)}\n"
    "h3{font-size:1em;margin:1em 0 .3em;overflow-wrap:anywhere}\n"
    "p{margin:.4em 0;max-width:75ch;overflow-wrap:anywhere}\n"
    ".soft,figcaption,summary{color:var(--soft)}\n"
    ".warn{border-left:4px solid var(--b);padding-left:10px}\n"
    ".cards{display:grid;grid-template-columns:repeat(auto-fill,minmax(150px,1fr));gap:10px;margin:0;padding:0}\n"
    ".cards div{background:var(--card);border-radius:6px;padding:8px 12px}\n"
    ".cards dt{font-size:.85em;color:var(--soft)}\n"
    ".cards dd{margin:0;font-size:1.3em;font-variant-numeric:tabular-nums}\n"
    ".row,.charts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,300px),1fr));gap:12px}\n"
    ".charts{grid-template-columns:repeat(auto-fill,minmax(min(100%,340px),1fr))}\n"
    ".chart{background:var(--card);border-radius:6px;padding:8px}\n"
    "figure{margin:0;break-inside:avoid}\n"
    "figcaption{font-size:.85em}\n"
    "img,svg{display:block;width:100%;height:auto}\n"
    "img{image-rendering:auto;background:var(--card)}\n"
    ".view{margin:0 0 1.4em;break-inside:avoid}\n"
    "svg text{font:11px system-ui,sans-serif;fill:var(--soft)}\n"
    ".grid{stroke:var(--line);stroke-width:.6}\n"
    ".axis{fill:none;stroke:var(--soft)}\n"
    ".line{fill:none;stroke-width:1.8;stroke-linejoin:round}\n"
    ".bins{stroke-width:1}\n"
    ".a{stroke:var(--a)}.b{stroke:var(--b)}\n"
    ".bins.a{fill:var(--fill)}.line.b{stroke-dasharray:5 3}\n"
    ".dot{fill:none;stroke-width:1.8}.dot.a{fill:var(--a)}\n"
    ".key{display:inline-block;width:28px;height:.8em;vertical-align:middle}\n"
    ".wide{overflow-x:auto}.wide,.charts{margin:.7em 0}\n"
    ".gap{display:none}@media(min-width:980px){.gap{display:block}}\n"
    "table{border-collapse:collapse;font-size:.92em}\n"
    "th,td{padding:3px 12px 3px 0;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}\n"
    "th{color:var(--soft);font-weight:600}\n"
    ".n{text-align:right;font-variant-numeric:tabular-nums}td.n{white-space:nowrap}\n"
    ".bar{display:inline-block;height:.7em;background:var(--a);print-color-adjust:exact;"
    "-webkit-print-color-adjust:exact}\n"
    "pre{white-space:pre-wrap;overflow-wrap:anywhere;background:var(--card);border-radius:6px;padding:8px 12px;"
    "font-size:.85em}\n"
    "@media print{:root{color-scheme:light;--ink:#000;--soft:#333;--paper:#fff;--card:#fff;--line:#999;--a:#1f6fb4;"
    "--b:#c05a00;--fill:#1f6fb44d}body{max-width:none;padding:0;font-size:11pt}"
    ".row{grid-template-columns:repeat(3,1fr)}.charts{grid-template-columns:repeat(2,1fr)}}\n"
    "</style>\n";

/* ---- Begin and end ---- */

void pags_page_scene_heading(pags_html *html, const pags_report_run *runs, int count, int number) {
  if (count < 2)
    return;
  pags_html_put(html, "<h3>%c: <bdi>", 'A' + number);
  pags_html_text(html, runs[number].name);
  pags_html_put(html, "</bdi></h3>\n");
}

/* Writes "YYYY-MM-DD hh:mm UTC". */
static void put_date(pags_html *html) {
  char text[32] = "";
  const time_t now = time(NULL);
  const struct tm *utc = gmtime(&now);
  if (utc)
    strftime(text, sizeof text, "%Y-%m-%d %H:%M UTC", utc);
  pags_html_put(html, "%s", text);
}

static void put_names(pags_html *html, const pags_report_run *runs, int count) {
  for (int k = 0; k < count; k++) {
    pags_html_put(html, "%s", k ? " beside " : "");
    pags_html_text(html, runs[k].name);
  }
}

void pags_page_begin(pags_html *html, const pags_report_run *runs, int count) {
  pags_html_put(html, "%s<title>", head);
  put_names(html, runs, count);
  pags_html_put(html, " &ndash; PAGS report</title>\n");
  for (const char *rest = style; *rest; rest += strcspn(rest, "\n") + 1)
    pags_html_put(html, "%.*s", (int)strcspn(rest, "\n") + 1, rest);
  pags_html_put(html, "</head>\n<body>\n<h1><bdi>");
  put_names(html, runs, count);
  pags_html_put(html, "</bdi></h1>\n<p class=\"soft\">PAGS report, written ");
  put_date(html);
  pags_html_put(html, " by version %s.</p>\n", PAGS_VERSION_STRING);
  if (count > 1)
    for (int k = 0; k < count; k++) {
      pags_html_put(html,
                    "<p><svg class=\"key\" viewBox=\"0 0 28 10\" aria-hidden=\"true\"><path class=\"line %c\" d=\"M0 "
                    "5H28\"/></svg> <b>%c</b>: ",
                    'a' + k, 'A' + k);
      pags_html_element(html, "span", runs[k].path);
      pags_html_put(html, "</p>\n");
    }
}

void pags_page_end(pags_html *html) {
  pags_html_put(html, "</body>\n</html>\n");
}

/* ---- Figures ---- */

typedef enum figure_kind { DECIBELS, RATIO, COUNT, RATE, BYTES, DURATION } figure_kind;

static const char *figure_text(figure_kind kind, double value, char text[40]) {
  if (!isfinite(value))
    return "\xE2\x80\x93"; /* a dash */
  switch (kind) {
    case DECIBELS: snprintf(text, 40, "%.2f dB", value); break;
    case RATIO: snprintf(text, 40, "%.4f", value); break;
    case COUNT: pags_html_thousands((int64_t)value, text); break;
    case RATE: snprintf(text, 40, "%.1f", value); break;
    case BYTES: pags_format_bytes(value, text, 40); break;
    case DURATION: pags_format_duration(value, text, 40); break;
  }
  return text;
}

static void put_figure(pags_html *html, int count, const char *label, figure_kind kind, const double *values) {
  char text[40];
  bool known = false;
  for (int k = 0; k < count; k++)
    known = known || isfinite(values[k]);
  if (!known)
    return;
  if (count == 1) {
    pags_html_put(html, "<div><dt>%s</dt><dd>%s</dd></div>\n", label, figure_text(kind, values[0], text));
    return;
  }
  pags_html_put(html, "<tr><th scope=\"row\">%s</th>", label);
  for (int k = 0; k < count; k++)
    pags_html_put(html, "<td class=\"n\">%s</td>", figure_text(kind, values[k], text));
  const double more = values[1] - values[0];
  if (kind == DECIBELS || kind == RATIO)
    pags_html_put(html, "<td class=\"n\">%s%s</td></tr>\n", more > 0 ? "+" : "", figure_text(kind, more, text));
  else if (values[0] > 0 && isfinite(more))
    pags_html_put(html, "<td class=\"n\">%+.1f %%</td></tr>\n", 100 * more / values[0]);
  else
    pags_html_put(html, "<td class=\"n\">&ndash;</td></tr>\n");
}

/* Begins a sentence on the scene `number`; on a page on two it names which. */
static void begin_sentence(pags_html *html, const char *kind, int count, int number) {
  pags_html_put(html, "<p class=\"%s\">", kind);
  if (count == 2)
    pags_html_put(html, "<b>%c</b>: ", 'A' + number);
}

static bool is_flag(const pags_report_run *run, const char *key, bool wanted) {
  const pags_json_value *flag = run->log.report ? pags_json_member(pags_json_root(run->log.report), key) : NULL;
  return flag && flag->type == PAGS_JSON_BOOL && flag->boolean == wanted;
}

/* States how the training ended, and what is unknown. */
static void put_state(pags_html *html, const pags_report_run *run, int count, int number) {
  const double bad = pags_run_log_number(&run->log, NULL, "bad_rows");
  const char *first = pags_run_log_text(&run->log, "first_bad_row");
  if (is_flag(run, "finished", false)) {
    begin_sentence(html, "warn", count, number);
    pags_html_put(
        html, "The training was stopped before its last step; <code>pags train --resume</code> continues it.</p>\n");
  }
  if (is_flag(run, "resumed", true)) {
    begin_sentence(html, "soft", count, number);
    pags_html_put(html, "The training was resumed: time, memory and command line are those of its last process.</p>\n");
  }
  if (run->log.fault) {
    begin_sentence(html, "warn", count, number);
    pags_html_put(html, "A file of the training can't be read: ");
    pags_html_text(html, run->log.fault);
    pags_html_put(html, "</p>\n");
  } else if (!run->log.report) {
    begin_sentence(html, "soft", count, number);
    pags_html_put(html, "There is no report.json of a training: its time, memory and command line are unknown.</p>\n");
  }
  if (bad > 0) {
    begin_sentence(html, "warn", count, number);
    pags_html_put(html, "%.0f updates were skipped because a value wasn't finite; the first was ", bad);
    pags_html_text(html, first ? first : "not noted");
    pags_html_put(html, "</p>\n");
  }
}

void pags_page_figures(pags_html *html, const pags_report_run *runs, int count) {
  static const struct {
    const char *key, *label;
    figure_kind kind;
  } of_report[] = {{"psnr", "PSNR, training views", DECIBELS},
                   {"seconds", "training time", DURATION},
                   {"iterations_per_second", "iterations/s, at the end", RATE},
                   {"peak_rss_bytes", "peak memory", BYTES}};
  const char *kind = runs[0].views.held_out ? "held-out views" : "views";
  double values[4][2], regions[2][2], rest[3][2];
  char label[64];
  pags_html_put(html, "<h2>Figures</h2>\n");
  for (int k = 0; k < count; k++) {
    put_state(html, &runs[k], count, k);
    const pags_view_score *mean = &runs[k].views.mean.mean;
    const bool measured = runs[k].views.mean.views > 0;
    regions[0][k] = measured ? mean->psnr[PAGS_REGION_WHOLE] : (double)NAN;
    regions[1][k] = measured ? mean->ssim[PAGS_REGION_WHOLE] : (double)NAN;
    rest[0][k] = (double)runs[k].contents.gaussians;
    rest[1][k] = runs[k].contents.bytes;
    rest[2][k] = runs[k].scene->iterations > 0 ? (double)runs[k].scene->iterations : (double)NAN;
    for (int i = 0; i < 4; i++)
      values[i][k] = pags_run_log_number(&runs[k].log, NULL, of_report[i].key);
  }
  if (count == 1)
    pags_html_put(html, "<dl class=\"cards\">\n");
  else
    pags_html_begin_table(html, "|#A|#B|#B relative to A");
  snprintf(label, sizeof label, "PSNR, %s", kind);
  put_figure(html, count, label, DECIBELS, regions[0]);
  snprintf(label, sizeof label, "SSIM, %s", kind);
  put_figure(html, count, label, RATIO, regions[1]);
  put_figure(html, count, of_report[0].label, of_report[0].kind, values[0]);
  put_figure(html, count, "Gaussians", COUNT, rest[0]);
  put_figure(html, count, "files", BYTES, rest[1]);
  put_figure(html, count, "iterations", COUNT, rest[2]);
  for (int i = 1; i < 4; i++)
    put_figure(html, count, of_report[i].label, of_report[i].kind, values[i]);
  if (count == 1)
    pags_html_put(html, "</dl>\n");
  else
    pags_html_end_table(html);
}

/* ---- Curves ---- */

void pags_page_curves(pags_html *html, const pags_report_run *runs, int count) {
  bool any = false;
  pags_html_put(html, "<h2>Over the training</h2>\n<div class=\"charts\">\n");
  for (int c = 0; c < PAGS_LOG_CURVES; c++) {
    pags_curve curves[2];
    for (int k = 0; k < count; k++)
      curves[k] = (pags_curve){runs[k].log.curves[c].step, runs[k].log.curves[c].value, runs[k].log.curves[c].count};
    const pags_chart chart = {.title = pags_log_curves[c].title,
                              .x_name = "step",
                              .y_name = pags_log_curves[c].y_name,
                              .from_zero = pags_log_curves[c].from_zero};
    any = pags_chart_put(html, &chart, curves, count) || any;
  }
  pags_html_put(html, "</div>\n");
  if (!any)
    pags_html_put(html, "<p class=\"soft\">There is no log.jsonl, so there are no curves.</p>\n");
  for (int k = 0; k < count; k++)
    if (runs[k].log.unread) {
      begin_sentence(html, "warn", count, k);
      pags_html_put(html, "%lld of %lld lines of log.jsonl can't be read.</p>\n", (long long)runs[k].log.unread,
                    (long long)runs[k].log.lines);
    }
}

/* ---- Quality ---- */

static void put_region(pags_html *html, const pags_report_run *runs, int count, int region, const char *name) {
  bool known = false;
  for (int k = 0; k < count; k++)
    known = known || !isnan(runs[k].views.mean.mean.psnr[region]);
  if (!known)
    return;
  pags_html_put(html, "<tr><th scope=\"row\">%s</th>", name);
  for (int k = 0; k < count; k++) {
    pags_html_number(html, 2, runs[k].views.mean.mean.psnr[region]);
    pags_html_number(html, 4, runs[k].views.mean.mean.ssim[region]);
  }
  if (count == 2)
    pags_html_number(html, 2, runs[1].views.mean.mean.psnr[region] - runs[0].views.mean.mean.psnr[region]);
  pags_html_put(html, "</tr>\n");
}

/* Names the views that the figures are measured on. */
static void put_extent(pags_html *html, const pags_report_views *views, int count, int number) {
  const char *kind = views->held_out ? "held-out views" : "views, none of them held out";
  if (views->absent) {
    begin_sentence(html, "warn", count, number);
    pags_html_put(html, "Photographs are missing, and so are the figures that need them: ");
    pags_html_text(html, views->absent);
    pags_html_put(html, "</p>\n");
  }
  if (views->mean.views) {
    begin_sentence(html, "soft", count, number);
    pags_html_put(html, "Means over %lld of %lld %s, as <code>pags eval</code> measures them.%s</p>\n",
                  (long long)views->mean.views, (long long)views->count, kind,
                  views->drawn < views->count
                      ? " Only evenly spaced views that fit into the time limit of a "
                        "report after training were measured; <code>pags report</code> measures all."
                      : "");
  }
}

static void put_view_chart(pags_html *html, const pags_report_run *runs, int count) {
  enum { MOST = 2000 };
  double x[2][MOST], y[2][MOST];
  pags_curve curves[2];
  for (int k = 0; k < count; k++) {
    const pags_report_views *views = &runs[k].views;
    const int64_t most = views->count < MOST ? views->count : MOST;
    for (int64_t i = 0; i < most; i++) {
      const int64_t at = i * views->count / most;
      x[k][i] = (double)at + 1;
      y[k][i] = views->items[at].score.psnr[PAGS_REGION_WHOLE];
    }
    curves[k] = (pags_curve){x[k], y[k], most};
  }
  const pags_chart chart = {
      .title = "PSNR of each view, dB", .x_name = "view, in the order of the data set", .y_name = "dB", .dots = true};
  pags_chart_put(html, &chart, curves, count);
}

void pags_page_quality(pags_html *html, const pags_report_run *runs, int count) {
  static const char *const names[PAGS_REGION_COUNT] = {"whole picture",   "critical: vehicles, pedestrians, cyclists",
                                                       "all else",        "moving",
                                                       "moving vehicles", "moving pedestrians",
                                                       "moving cyclists"};
  bool measured = false;
  pags_html_put(html, "<h2>Comparison with the photographs</h2>\n");
  for (int k = 0; k < count; k++) {
    put_extent(html, &runs[k].views, count, k);
    measured = measured || runs[k].views.mean.views;
  }
  if (!measured)
    return;
  pags_html_begin_table(
      html, count == 2 ? "region|#A: PSNR, dB|#SSIM|#B: PSNR, dB|#SSIM|#B &minus; A, dB" : "region|#PSNR, dB|#SSIM");
  for (int r = 0; r < PAGS_REGION_COUNT; r++)
    put_region(html, runs, count, r, names[r]);
  pags_html_end_table(html);
  pags_html_put(html, "<div class=\"charts\">\n");
  put_view_chart(html, runs, count);
  pags_html_put(html, "</div>\n");
}

/* ---- Views ---- */

static void put_picture(pags_html *html, const pags_report_view *view, pags_view_picture which, const char *caption) {
  if (view && view->jpeg[which].size)
    pags_html_picture(html, &view->jpeg[which], view->width, view->height, caption);
}

static void put_view(pags_html *html, const pags_report_view *const *views, int count) {
  static const char *const renders[] = {"rendered, A", "rendered, B"}, *const errors[] = {"error, A", "error, B"};
  pags_html_put(html, "<section class=\"view\"><h3><bdi>");
  pags_html_text(html, views[0]->name);
  pags_html_put(html, "</bdi>");
  for (int k = 0; k < count; k++) {
    const pags_view_score *score = &views[k]->score;
    if (count == 2)
      pags_html_put(html, " &middot; %c", 'A' + k);
    if (!isnan(score->psnr[PAGS_REGION_WHOLE]))
      pags_html_put(html, " &middot; %.2f dB, SSIM %.4f", score->psnr[PAGS_REGION_WHOLE],
                    score->ssim[PAGS_REGION_WHOLE]);
  }
  pags_html_put(html, "</h3>\n<div class=\"row\">\n");
  const bool first = views[0]->jpeg[PAGS_VIEW_PICTURE_PHOTOGRAPH].size || count == 1;
  put_picture(html, views[first ? 0 : 1], PAGS_VIEW_PICTURE_PHOTOGRAPH, "photograph");
  for (int k = 0; k < count; k++)
    put_picture(html, views[k], PAGS_VIEW_PICTURE_RENDER, count == 2 ? renders[k] : "rendered");
  if (count == 2)
    pags_html_put(html, "<div class=\"gap\"></div>"); /* puts each error below its rendering */
  for (int k = 0; k < count; k++)
    put_picture(html, views[k], PAGS_VIEW_PICTURE_ERROR, count == 2 ? errors[k] : "error");
  pags_html_put(html, "</div></section>\n");
}

/* Names the views that have no picture. */
static void put_left_out(pags_html *html, const pags_report_views *views) {
  enum { MOST = 2000 };
  int64_t left = 0, named = 0;
  for (int64_t i = 0; i < views->count; i++)
    left += !views->items[i].jpeg[PAGS_VIEW_PICTURE_RENDER].size;
  if (!left)
    return;
  pags_html_put(html, "<details><summary>%lld of %lld views have no picture, to keep the page small</summary>\n<p>",
                (long long)left, (long long)views->count);
  for (int64_t i = 0; i < views->count && named < MOST; i++)
    if (!views->items[i].jpeg[PAGS_VIEW_PICTURE_RENDER].size) {
      pags_html_put(html, "%s<bdi>", named++ ? ", " : "");
      pags_html_text(html, views->items[i].name);
      pags_html_put(html, "</bdi>");
    }
  pags_html_put(html, "%s</p></details>\n", named < left ? ", and more" : "");
}

void pags_page_views(pags_html *html, const pags_report_run *runs, int count) {
  int64_t shown = 0;
  pags_html_put(html, "<h2>Views</h2>\n");
  for (int64_t i = 0; i < runs[0].views.count; i++)
    shown += runs[0].views.items[i].jpeg[PAGS_VIEW_PICTURE_RENDER].size > 0;
  if (!shown)
    pags_html_put(html, "<p class=\"soft\">%s</p>\n",
                  count == 2 ? "No view is in both." : "There is no recorded view to show.");
  else if (runs[0].views.opened || runs[count - 1].views.opened)
    pags_html_put(html,
                  "<p class=\"soft\">Error: mean difference of the channels, from none (dark) to a quarter of the "
                  "range or more (pale yellow); masked pixels are dark.</p>\n");
  for (int64_t i = 0; i < runs[0].views.count; i++) {
    const pags_report_view *view = &runs[0].views.items[i];
    const pags_report_view *pair[2] = {view, count == 2 ? pags_report_views_find(&runs[1].views, view->name) : NULL};
    if (view->jpeg[PAGS_VIEW_PICTURE_RENDER].size)
      put_view(html, pair, pair[1] ? 2 : 1);
  }
  for (int k = 0; k < count; k++)
    put_left_out(html, &runs[k].views);
}
