/* SPDX-License-Identifier: Apache-2.0 */
/* The sections of a report's page, on one scene or two. Each appends itself with its heading, or nothing where it has
 * nothing to say. */
#ifndef PAGS_CLI_HTML_REPORT_PAGE_H
#define PAGS_CLI_HTML_REPORT_PAGE_H

#include "cli/html_report/contents.h"
#include "cli/html_report/html.h"
#include "cli/html_report/run_log.h"
#include "cli/html_report/views.h"

/* Contents of the page about one scene. */
typedef struct pags_report_run {
  const char *path; /* as it was given */
  const char *name; /* the end of the path, or all of it where that tells nothing */
  pags_composition *composition;
  const pags_scene *scene; /* its models are empty */
  pags_scene_contents contents;
  pags_run_log log;
  pags_report_views views;
  pags_json *notes, *config; /* how each object was modelled, and the training configuration; NULL: unknown */
} pags_report_run;

void pags_page_begin(pags_html *html, const pags_report_run *runs, int count);
void pags_page_figures(pags_html *html, const pags_report_run *runs, int count);
void pags_page_curves(pags_html *html, const pags_report_run *runs, int count);
void pags_page_quality(pags_html *html, const pags_report_run *runs, int count);
void pags_page_views(pags_html *html, const pags_report_run *runs, int count);
void pags_page_modelled(pags_html *html, const pags_report_run *runs, int count);
void pags_page_objects(pags_html *html, const pags_report_run *runs, int count);
void pags_page_histograms(pags_html *html, const pags_report_run *runs, int count);
void pags_page_making(pags_html *html, const pags_report_run *runs, int count);
void pags_page_end(pags_html *html);

/* The heading of a scene's part of a page on two: "A: name"; nothing on a page on one. */
void pags_page_scene_heading(pags_html *html, const pags_report_run *runs, int count, int number);

#endif
