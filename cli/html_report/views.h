/* SPDX-License-Identifier: Apache-2.0 */
/* The recorded views of a report: their scores against the photographs, and small pictures of some of them. */
#ifndef PAGS_CLI_HTML_REPORT_VIEWS_H
#define PAGS_CLI_HTML_REPORT_VIEWS_H

#include "cli/common/photographs.h"
#include "cli/html_report/html_report.h"
#include "cli/measure/view_scores.h"
#include "image/encoded.h"

#include <pags/compose.h>

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

/* The view of that name, or NULL. */
pags_report_view *pags_report_views_find(const pags_report_views *views, const char *name);

void pags_report_views_destroy(pags_report_views *views); /* a zeroed struct is allowed */

#endif
