/* SPDX-License-Identifier: Apache-2.0 */
/* What a report's page shows of one scene or two: contents, logs of the training, views; and the sections of the page.
 */
#ifndef PAGS_CLI_HTML_REPORT_PAGE_H
#define PAGS_CLI_HTML_REPORT_PAGE_H

#include "base/json.h"
#include "cli/common/photographs.h"
#include "cli/html_report/html.h"
#include "cli/html_report/html_report.h"
#include "cli/measure/view_scores.h"

#include <pags/compose.h>

/* ---- Contents: Gaussians per object, histograms of priorities and sizes, bytes of the files ---- */

enum { PAGS_PRIORITY_BINS = 20, PAGS_SIZE_BINS = 28 };

/* Points of histograms: edges, and heights in per cent of the Gaussians; the last height is no bin's. */
typedef struct pags_scene_contents {
  int64_t gaussians;
  double bytes;       /* of scene.json, models and sky, or of the splat file */
  int64_t *of_object; /* Gaussians of each of the scene's objects: of its own model, or its share of the background */
  bool has_priorities;
  double priorities[PAGS_PRIORITY_BINS + 1][2];
  /* Decimal logarithms of the largest standard deviation, metres, of each Gaussian; what is beyond either end is in the
   * bin at that end. */
  double sizes[PAGS_SIZE_BINS + 1][2];
} pags_scene_contents;

/* `path` is the scene's folder or file, `scene` as it was loaded. PAGS_ERROR_MEMORY; the caller frees out->of_object
 * then, too. */
pags_result pags_scene_contents_find(const char *path, const pags_scene *scene, pags_scene_contents *out);

/* ---- Logs of a training in the scene's folder: log.jsonl as curves, and report.json ---- */

/* A member of the log's lines that is drawn over the steps where lines have it. */
typedef struct pags_log_curve {
  const char *key, *title, *y_name;
  bool from_zero;
} pags_log_curve;

enum { PAGS_LOG_CURVES = 4 };
extern const pags_log_curve pags_log_curves[PAGS_LOG_CURVES];

typedef struct pags_run_log {
  pags_curve curves[PAGS_LOG_CURVES];
  int64_t lines, unread;        /* lines of the log; of these not readable, as the last one of a run that was killed */
  pags_json *report;            /* report.json; NULL: missing */
  const pags_json_value *facts; /* its root */
  char *fault;                  /* why a file that is there couldn't be read; NULL: all that are there were */
} pags_run_log;

/* Reads what `folder` has; none of it is needed. PAGS_ERROR_MEMORY; `out` must be destroyed then, too. */
pags_result pags_run_log_read(const char *folder, pags_run_log *out);
void pags_run_log_destroy(pags_run_log *log); /* a zeroed struct is allowed */

/* Members of a JSON object that may be NULL: NULL or false without one of that type. Numbers: pags_spoken_number. */
const char *pags_page_string(const pags_json_value *object, const char *key);
bool pags_page_flag(const pags_json_value *object, const char *key, bool wanted);

/* ---- Recorded views: their scores against the photographs, and small pictures of some of them ---- */

typedef enum pags_view_picture {
  PAGS_VIEW_PICTURE_PHOTOGRAPH,
  PAGS_VIEW_PICTURE_RENDER,
  PAGS_VIEW_PICTURE_ERROR,
  PAGS_VIEW_PICTURES
} pags_view_picture;

typedef struct pags_report_view {
  const char *name;                  /* the scene's or the data set's */
  const pags_scene_view *scene_view; /* NULL: the scene records no views */
  int64_t photograph;                /* index in the photographs; -1: it has none */
  bool shown;                        /* chosen for pictures */
  bool drawn;                        /* measured, if it has a photograph and time was left */
  pags_view_score score;
  int width, height;                  /* of its pictures */
  pags_sink jpeg[PAGS_VIEW_PICTURES]; /* empty: none */
} pags_report_view;

typedef struct pags_report_views {
  pags_photographs photographs;
  bool opened;   /* whether there are photographs */
  char *absent;  /* why photographs are missing or unreadable; NULL: all were read */
  bool held_out; /* the views are the held-out ones; false: all views, since none is held out */
  int64_t count;
  pags_report_view *items;
  pags_mean_score mean; /* over the views that were measured */
  int64_t drawn;        /* how many were */
  int64_t with_lpips;   /* measured views with LPIPS */
} pags_report_views;

/* Opens the photographs, if they are there, and lists the held-out views. Where the settings name a data set, it must
 * be there. `scene` must outlive `out`, which must be destroyed on failure, too. */
pags_result pags_report_views_open(const pags_scene *scene, const char *path, const pags_html_report_settings *settings,
                                   pags_report_views *out);

/* Chooses at most `most` evenly spread views for pictures; with `other` (may be NULL) only views whose names occur in
 * both, for both. */
void pags_report_views_choose(pags_report_views *views, pags_report_views *other, int64_t most);

/* Renders the views, measures them against their photographs and makes the pictures, until the settings' seconds have
 * passed. At any time the finished views are evenly spread. */
pags_result pags_report_views_draw(pags_report_views *views, pags_composition *composition,
                                   const pags_html_report_settings *settings);

/* How many views have a picture. */
int64_t pags_report_views_pictures(const pags_report_views *views);
/* The view of that name, or NULL. */
pags_report_view *pags_report_views_find(const pags_report_views *views, const char *name);

void pags_report_views_destroy(pags_report_views *views); /* a zeroed struct is allowed */

/* ---- Sections, on one scene or two (of which a missing one is zeros): each appends itself with its heading, or
 * nothing where it has nothing to say ----
 */

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
/* `network`: of LPIPS. */
void pags_page_figures(pags_html *html, const pags_report_run *runs, int count, const char *network);
void pags_page_curves(pags_html *html, const pags_report_run *runs, int count);
void pags_page_quality(pags_html *html, const pags_report_run *runs, int count);
void pags_page_views(pags_html *html, const pags_report_run *runs, int count);
void pags_page_modelled(pags_html *html, const pags_report_run *runs, int count);
void pags_page_objects(pags_html *html, const pags_report_run *runs, int count);
void pags_page_histograms(pags_html *html, const pags_report_run *runs, int count);
void pags_page_making(pags_html *html, const pags_report_run *runs, int count);

/* The heading of a scene's part of a page on two: "A: name"; nothing on a page on one. */
void pags_page_scene_heading(pags_html *html, const pags_report_run *runs, int count, int number);

#endif
