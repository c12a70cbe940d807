/* SPDX-License-Identifier: Apache-2.0 */
/* The first half of a report's page: its head, figures, curves and views. */
#include "cli/html_report/page.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "cli/measure/decisions.h"

#include <report_style.h> /* made of page.css */

/* A is blue, B is orange and dashed, for colour-blind readers and prints. The policy refuses anything that isn't in the
 * page, in case a name is not escaped. */
static const char head[] =
    "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
    "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src "
    "'unsafe-inline'\">\n";

/* ---- Begin ---- */

void pags_page_scene_heading(pags_html *html, const pags_report_run *runs, int count, int number) {
  if (count > 1)
    pags_html_put(html, "<h3>%c: <bdi>%s</bdi></h3>\n", 'A' + number, pags_html_text(html, runs[number].name));
}

void pags_page_begin(pags_html *html, const pags_report_run *runs, int count) {
  char date[32] = "";
  const time_t now = time(NULL);
  const struct tm *utc = gmtime(&now);
  if (utc)
    strftime(date, sizeof date, "%Y-%m-%d %H:%M UTC", utc);
  const char *const a = pags_html_text(html, runs[0].name), *const compared = count > 1 ? " compared with " : "";
  const char *const b = count > 1 ? pags_html_text(html, runs[1].name) : "";
  pags_html_put(
      html,
      "%s<title>%s%s%s &ndash; PAGS report</title>\n<style>\n%s</style>\n</head>\n<body>\n<h1><bdi>%s%s%s</bdi></h1>\n"
      "<p class=\"soft\">PAGS report, written %s by version %s.</p>\n",
      head, a, compared, b, report_style, a, compared, b, date, PAGS_VERSION_STRING);
  if (count == 1)
    return;
  for (int k = 0; k < count; k++)
    pags_html_put(html,
                  "<p><svg class=\"key\" viewBox=\"0 0 28 10\" aria-hidden=\"true\"><path class=\"line %c\" d=\"M0 "
                  "5H28\"/></svg> <b>%c</b>: <span><bdi>%s</bdi></span></p>\n",
                  'a' + k, 'A' + k, pags_html_text(html, runs[k].path));
}

/* ---- Figures ---- */

typedef enum figure_kind { DECIBELS, RATIO, COUNT, RATE, BYTES, DURATION } figure_kind;

static const char *figure_text(pags_html *html, figure_kind kind, double value, char text[40]) {
  if (!isfinite(value))
    return "\xE2\x80\x93"; /* a dash */
  switch (kind) {
    case DECIBELS: snprintf(text, 40, "%.2f dB", value); break;
    case RATIO: snprintf(text, 40, "%.4f", value); break;
    case COUNT: return pags_html_count(html, (int64_t)value);
    case RATE: snprintf(text, 40, "%.1f", value); break;
    case BYTES: return pags_format_bytes(value, text, 40);
    case DURATION: return pags_format_duration(value, text, 40);
  }
  return text;
}

/* Puts the figure of one scene or, with its change, of two; nothing if it is unknown. */
static void put_figure(pags_html *html, int count, const char *label, figure_kind kind, double a, double b) {
  char text_a[40], text_b[40], change[40] = "&ndash;";
  const char *const of_a = figure_text(html, kind, a, text_a), *const of_b = figure_text(html, kind, b, text_b);
  if (!isfinite(a) && !isfinite(b))
    return;
  if (count == 1) {
    pags_html_put(html, "<div><dt>%s</dt><dd>%s</dd></div>\n", label, of_a);
    return;
  }
  if (kind == DECIBELS || kind == RATIO) {
    char text[40];
    snprintf(change, sizeof change, "%s%s", b - a > 0 ? "+" : "", figure_text(html, kind, b - a, text));
  } else if (a > 0 && isfinite(b)) {
    snprintf(change, sizeof change, "%+.1f %%", 100 * (b - a) / a);
  }
  pags_html_put(
      html, "<tr><th scope=\"row\">%s</th><td class=\"n\">%s</td><td class=\"n\">%s</td><td class=\"n\">%s</td></tr>\n",
      label, of_a, of_b, change);
}

/* Begins a sentence on the scene `number`; on a page on two it names which. */
static const char *letter_of(int count, int number) {
  return count < 2 ? "" : number ? "<b>B</b>: " : "<b>A</b>: ";
}

/* States how the training ended, and what is unknown. */
static void put_state(pags_html *html, const pags_run_log *log, const char *letter) {
  const double bad = pags_spoken_number(log->facts, "bad_rows");
  const char *first = pags_page_string(log->facts, "first_bad_row");
  if (pags_page_flag(log->facts, "finished", false))
    pags_html_put(html,
                  "<p class=\"warn\">%sThe training was stopped before its last step; <code>pags train --resume</code> "
                  "continues it.</p>\n",
                  letter);
  if (pags_page_flag(log->facts, "resumed", true))
    pags_html_put(html,
                  "<p class=\"soft\">%sThe training was resumed: time, memory and command line are those of its last "
                  "process.</p>\n",
                  letter);
  if (log->fault)
    pags_html_put(html, "<p class=\"warn\">%sA file of the training can't be read: %s</p>\n", letter,
                  pags_html_text(html, log->fault));
  else if (!log->report)
    pags_html_put(html,
                  "<p class=\"soft\">%sThere is no report.json of a training: its time, memory and command line are "
                  "unknown.</p>\n",
                  letter);
  if (bad > 0)
    pags_html_put(html,
                  "<p class=\"warn\">%s%.0f updates were skipped because a value wasn't finite; the first was %s</p>\n",
                  letter, bad, pags_html_text(html, first ? first : "not noted"));
}

void pags_page_figures(pags_html *html, const pags_report_run *runs, int count, const char *network) {
  enum { FIGURES = 10 };
  char labels[2][64], lpips[64];
  double values[2][FIGURES];
  pags_html_put(html, "<h2>Figures</h2>\n");
  snprintf(lpips, sizeof lpips, "LPIPS (%s), %lld view%s", network, (long long)runs[0].views.with_lpips,
           runs[0].views.with_lpips == 1 ? "" : "s");
  for (int k = 0; k < 2; k++) {
    const pags_report_run *const run = &runs[k];
    const bool measured = k < count && run->views.mean.views > 0;
    snprintf(labels[k], sizeof labels[k], "%s, %s", k ? "SSIM" : "PSNR",
             runs[0].views.held_out ? "held-out views" : "views");
    const double nothing = (double)NAN;
    const double known[FIGURES] = {measured ? run->views.mean.mean.psnr[PAGS_REGION_WHOLE] : nothing,
                                   measured ? run->views.mean.mean.ssim[PAGS_REGION_WHOLE] : nothing,
                                   measured ? run->views.mean.mean.lpips : nothing,
                                   pags_spoken_number(run->log.facts, "psnr"),
                                   k < count ? (double)run->contents.gaussians : nothing,
                                   k < count ? run->contents.bytes : nothing,
                                   k < count && run->scene->iterations > 0 ? (double)run->scene->iterations : nothing,
                                   pags_spoken_number(run->log.facts, "seconds"),
                                   pags_spoken_number(run->log.facts, "iterations_per_second"),
                                   pags_spoken_number(run->log.facts, "peak_rss_bytes")};
    memcpy(values[k], known, sizeof known);
    if (k < count)
      put_state(html, &run->log, letter_of(count, k));
  }
  const struct {
    const char *label;
    figure_kind kind;
  } figures[FIGURES] = {{labels[0], DECIBELS},
                        {labels[1], RATIO},
                        {lpips, RATIO},
                        {"PSNR, training views", DECIBELS},
                        {"Gaussians", COUNT},
                        {"files", BYTES},
                        {"iterations", COUNT},
                        {"training time", DURATION},
                        {"iterations/s, at the end", RATE},
                        {"peak memory", BYTES}};
  if (count == 1)
    pags_html_put(html, "<dl class=\"cards\">\n");
  else
    pags_html_begin_table(html, "|#A|#B|#B relative to A");
  for (int i = 0; i < FIGURES; i++)
    put_figure(html, count, figures[i].label, figures[i].kind, values[0][i], values[1][i]);
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
    const pags_log_curve *const of = &pags_log_curves[c];
    const pags_chart chart = {.title = of->title, .x_name = "step", .y_name = of->y_name, .from_zero = of->from_zero};
    any = pags_chart_put(html, &chart, (pags_curve[]){runs[0].log.curves[c], runs[1].log.curves[c]}, count) || any;
  }
  pags_html_put(html, "</div>\n%s",
                any ? "" : "<p class=\"soft\">There is no log.jsonl, so there are no curves.</p>\n");
  for (int k = 0; k < count; k++)
    if (runs[k].log.unread)
      pags_html_put(html, "<p class=\"warn\">%s%lld of %lld lines of log.jsonl can't be read.</p>\n",
                    letter_of(count, k), (long long)runs[k].log.unread, (long long)runs[k].log.lines);
}

/* ---- Quality ---- */

/* Names the views that the figures are measured on. */
static void put_extent(pags_html *html, const pags_report_views *views, const char *letter) {
  if (views->absent)
    pags_html_put(html, "<p class=\"warn\">%sPhotographs are missing, and so are the figures that need them: %s</p>\n",
                  letter, pags_html_text(html, views->absent));
  if (views->mean.views)
    pags_html_put(html,
                  "<p class=\"soft\">%sMeans over %lld of %lld %s, as <code>pags eval</code> measures them.%s</p>\n",
                  letter, (long long)views->mean.views, (long long)views->count,
                  views->held_out ? "held-out views" : "views, none of them held out",
                  views->drawn < views->count ? " Only evenly spaced views that fit into the time limit of a report "
                                                "after training were measured; <code>pags report</code> measures all."
                                              : "");
}

static void put_view_chart(pags_html *html, const pags_report_run *runs, int count) {
  enum { MOST = 2000 };
  double points[2][MOST][2];
  pags_curve curves[2];
  for (int k = 0; k < count; k++) {
    const pags_report_views *views = &runs[k].views;
    const int64_t most = views->count < MOST ? views->count : MOST;
    for (int64_t i = 0; i < most; i++) {
      const int64_t at = i * views->count / most;
      points[k][i][0] = (double)at + 1;
      points[k][i][1] = views->items[at].score.psnr[PAGS_REGION_WHOLE];
    }
    curves[k] = (pags_curve){.points = points[k], .count = most};
  }
  const pags_chart chart = {
      .title = "PSNR of each view, dB", .x_name = "view, in the order of the data set", .y_name = "dB", .dots = true};
  pags_html_put(html, "<div class=\"charts\">\n");
  pags_chart_put(html, &chart, curves, count);
  pags_html_put(html, "</div>\n");
}

void pags_page_quality(pags_html *html, const pags_report_run *runs, int count) {
  static const char *const names[PAGS_REGION_COUNT] = {"whole picture",   "critical: vehicles, pedestrians, cyclists",
                                                       "all else",        "moving",
                                                       "moving vehicles", "moving pedestrians",
                                                       "moving cyclists"};
  pags_html_put(html, "<h2>Comparison with the photographs</h2>\n");
  for (int k = 0; k < count; k++)
    put_extent(html, &runs[k].views, letter_of(count, k));
  if (!runs[0].views.mean.views && !runs[1].views.mean.views)
    return;
  pags_html_begin_table(
      html, count == 2 ? "region|#A: PSNR, dB|#SSIM|#B: PSNR, dB|#SSIM|#B &minus; A, dB" : "region|#PSNR, dB|#SSIM");
  for (int r = 0; r < PAGS_REGION_COUNT; r++) {
    const pags_view_score *const a = &runs[0].views.mean.mean, *const b = &runs[count - 1].views.mean.mean;
    if (isnan(a->psnr[r]) && isnan(b->psnr[r]))
      continue;
    pags_html_put(html, "<tr><th scope=\"row\">%s</th><td class=\"n\">%s</td><td class=\"n\">%s</td>", names[r],
                  pags_html_number(html, 2, a->psnr[r]), pags_html_number(html, 4, a->ssim[r]));
    if (count == 2)
      pags_html_put(html, "<td class=\"n\">%s</td><td class=\"n\">%s</td><td class=\"n\">%s</td>",
                    pags_html_number(html, 2, b->psnr[r]), pags_html_number(html, 4, b->ssim[r]),
                    pags_html_number(html, 2, b->psnr[r] - a->psnr[r]));
    pags_html_put(html, "</tr>\n");
  }
  pags_html_end_table(html);
  put_view_chart(html, runs, count);
}

/* ---- Views ---- */

static void put_picture(pags_html *html, const pags_report_view *view, pags_view_picture which, const char *caption) {
  if (view->jpeg[which].size)
    pags_html_picture(html, &view->jpeg[which], view->width, view->height, caption);
}

static void put_view(pags_html *html, const pags_report_view *const *views, int count) {
  static const char *const renders[] = {"rendered, A", "rendered, B"}, *const errors[] = {"error, A", "error, B"};
  pags_html_put(html, "<section class=\"view\"><h3><bdi>%s</bdi>", pags_html_text(html, views[0]->name));
  for (int k = 0; k < count; k++) {
    const pags_view_score *score = &views[k]->score;
    if (count == 2)
      pags_html_put(html, " &middot; %c", 'A' + k);
    if (!isnan(score->psnr[PAGS_REGION_WHOLE]))
      pags_html_put(html, " &middot; %.2f dB, SSIM %.4f", score->psnr[PAGS_REGION_WHOLE],
                    score->ssim[PAGS_REGION_WHOLE]);
    if (!isnan(score->lpips))
      pags_html_put(html, ", LPIPS %.4f", score->lpips);
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

static bool has_picture(const pags_report_view *view) {
  return view->jpeg[PAGS_VIEW_PICTURE_RENDER].size > 0;
}

/* Names the views that have no picture. */
static void put_left_out(pags_html *html, const pags_report_views *views) {
  enum { MOST = 2000 };
  const int64_t left = views->count - pags_report_views_pictures(views);
  int64_t named = 0;
  if (!left)
    return;
  pags_html_put(html, "<details><summary>%lld of %lld views have no picture, to keep the page small</summary>\n<p>",
                (long long)left, (long long)views->count);
  for (int64_t i = 0; i < views->count && named < MOST; i++)
    if (!has_picture(&views->items[i]))
      pags_html_put(html, "%s<bdi>%s</bdi>", named++ ? ", " : "", pags_html_text(html, views->items[i].name));
  pags_html_put(html, "%s</p></details>\n", named < left ? ", and more" : "");
}

void pags_page_views(pags_html *html, const pags_report_run *runs, int count) {
  pags_html_put(html, "<h2>Views</h2>\n");
  if (!pags_report_views_pictures(&runs[0].views))
    pags_html_put(html, "<p class=\"soft\">%s</p>\n",
                  count == 2 ? "No view is in both." : "There is no recorded view to show.");
  else if (runs[0].views.opened || runs[count - 1].views.opened)
    pags_html_put(html,
                  "<p class=\"soft\">Error: mean difference of the channels, from none (dark) to a quarter of the "
                  "range or more (pale yellow); masked pixels are dark.</p>\n");
  for (int64_t i = 0; i < runs[0].views.count; i++) {
    const pags_report_view *view = &runs[0].views.items[i];
    const pags_report_view *pair[2] = {view, count == 2 ? pags_report_views_find(&runs[1].views, view->name) : NULL};
    if (has_picture(view))
      put_view(html, pair, pair[1] ? 2 : 1);
  }
  for (int k = 0; k < count; k++)
    put_left_out(html, &runs[k].views);
}
