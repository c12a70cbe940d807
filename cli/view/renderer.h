/* SPDX-License-Identifier: Apache-2.0 */
/* Renders looks of pages into messages: a picture as JPEG with its statistics, or the result of a pick. For one thread
 * at a time. */
#ifndef PAGS_CLI_VIEW_RENDERER_H
#define PAGS_CLI_VIEW_RENDERER_H

#include "cli/view/request.h"

#include <pags/compose.h>
#include <pags/dataset.h>
#include <pags/deadline.h>
#include <pags/tasks.h>
#include "base/json.h"

/* A message to a page. Picture: 4 bytes, the length n of the text, little-endian; n bytes of JSON; the JPEG file. */
typedef struct pags_view_message {
  unsigned char *bytes; /* freed by the owner */
  size_t size;
  bool binary;
} pags_view_message;

/* Makes a message from a JSON document, whose object is still open. Destroys the writer. PAGS_ERROR_MEMORY. */
pags_result pags_view_message_of(pags_json_writer *json, pags_view_message *out);

typedef struct pags_renderer pags_renderer;

typedef struct pags_renderer_settings {
  pags_composition *composition; /* must outlive the renderer; NULL: set later by pags_renderer_set_scene */
  pags_dataset *photographs;     /* training data set, whose views are the scene's; NULL: opened from `dataset` */
  pags_tasks *tasks;
  double budget_ms;    /* per picture while the camera moves */
  const char *dataset; /* data set of the photographs; NULL: the one named in the scene */
  pags_dataset_options dataset_options;
} pags_renderer_settings;

/* Renders another composition from now on, which must live until the next call or the end. PAGS_ERROR_MEMORY leaves the
 * renderer without one. */
pags_result pags_renderer_set_scene(pags_renderer *renderer, pags_composition *composition);

/* After a failure, *out must be destroyed, too. */
pags_result pags_renderer_create(const pags_renderer_settings *settings, pags_renderer **out);
void pags_renderer_destroy(pags_renderer *renderer); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_renderer, pags_renderer_destroy)

/* A deadline controller for the pictures of one page. */
pags_deadline_controller pags_renderer_controller(const pags_renderer *renderer);

typedef struct pags_renderer_quality {
  int step;    /* step of the deadline controller; 0: full quality without a time limit */
  bool sharp;  /* reported to the page */
  int percent; /* JPEG quality, 1..100 */
} pags_renderer_quality;

/* Renders a look; photographs always in full quality. PAGS_CANCELLED if the tasks were cancelled; errors of reading
 * photographs. */
pags_result pags_renderer_draw(pags_renderer *renderer, const pags_view_look *look,
                               const pags_renderer_quality *quality, pags_view_message *out);

/* Finds the Gaussian and object at a pixel of a look. */
pags_result pags_renderer_pick(pags_renderer *renderer, const pags_view_look *look, double x, double y, int64_t serial,
                               pags_view_message *out);

/* Makes an error message that the page shows. */
pags_result pags_renderer_error_message(const char *text, int64_t serial, pags_view_message *out);

#endif
