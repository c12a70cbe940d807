/* SPDX-License-Identifier: Apache-2.0 */
/* Draws what a page looks at into messages: a picture as JPEG with its statistics, or what was picked. Used by one
 * thread. */
#ifndef PAGS_CLI_VIEW_DRAWER_H
#define PAGS_CLI_VIEW_DRAWER_H

#include "cli/view/request.h"

#include <pags/compose.h>
#include <pags/dataset.h>
#include <pags/deadline.h>
#include <pags/tasks.h>
#include "base/json.h"

/* Bytes to send. A picture's are: 4 bytes, the length n of the text, little-endian; n bytes of JSON; the JPEG file. */
typedef struct pags_view_message {
  unsigned char *bytes; /* freed by the owner */
  size_t size;
  bool binary;
} pags_view_message;

typedef struct pags_drawer pags_drawer;

typedef struct pags_drawer_settings {
  pags_composition *composition; /* must outlive the drawer; NULL: pags_drawer_show says what is drawn */
  pags_dataset *photographs;     /* of a run, whose views are the scene's; NULL: found by `dataset` */
  pags_tasks *tasks;
  double budget_ms;    /* of a picture while the camera moves */
  const char *dataset; /* where the photographs are; NULL: as the scene says */
  pags_dataset_options dataset_options;
} pags_drawer_settings;

/* Draws another composition from now on, which must outlive this or the next call. PAGS_ERROR_MEMORY; then the drawer
 * has none. */
pags_result pags_drawer_show(pags_drawer *drawer, pags_composition *composition);

pags_result pags_drawer_create(const pags_drawer_settings *settings, pags_drawer **out);
void pags_drawer_destroy(pags_drawer *drawer); /* NULL is allowed */

/* A controller for the pictures of one page. */
pags_deadline_controller pags_drawer_controller(const pags_drawer *drawer);

/* How a picture is drawn. */
typedef struct pags_drawer_quality {
  int step;    /* of the deadline's ladder; 0: full quality, whatever time it takes */
  bool sharp;  /* the page is told so */
  int percent; /* JPEG quality, 1..100 */
} pags_drawer_quality;

/* What came of it. */
typedef struct pags_drawer_facts {
  double ms; /* drawing and encoding */
  int step;  /* that it was drawn at: 0 for a look that asks for full quality */
} pags_drawer_facts;

/* Draws a look. PAGS_CANCELLED if the tasks were cancelled; errors of photographs. */
pags_result pags_drawer_draw(pags_drawer *drawer, const pags_view_look *look, const pags_drawer_quality *quality,
                             pags_view_message *out, pags_drawer_facts *facts);

/* Picks what is at a pixel of a look. */
pags_result pags_drawer_pick(pags_drawer *drawer, const pags_view_look *look, double x, double y, int64_t serial,
                             pags_view_message *out);

/* A message of an error: what the last one said, for the page to show. */
pags_result pags_drawer_refuse(const char *text, int64_t serial, pags_view_message *out);

#endif
