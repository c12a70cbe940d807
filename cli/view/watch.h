/* SPDX-License-Identifier: Apache-2.0 */
/* Pages that watch a training run (pags train --view). A thread serves them; the training thread renders pictures
 * between two steps, so that no picture shows half-updated Gaussians. Pictures have their own thread pool and frame,
 * created before the first step. */
#ifndef PAGS_CLI_VIEW_WATCH_H
#define PAGS_CLI_VIEW_WATCH_H

#include <pags/dataset.h>
#include <pags/train.h>
#include <stdbool.h>

typedef struct pags_watch pags_watch;

typedef struct pags_watch_settings {
  pags_dataset *dataset; /* must outlive the watch */
  const char *name;      /* name of the scene */
  const char *log;       /* log.jsonl of the resumed run; NULL: none */
  int threads, port;
  double share; /* maximum share of the run time for pictures, 0..1 */
} pags_watch_settings;

#ifdef PAGS_WITH_VIEW

/* Opens the port and starts to serve. PAGS_ERROR_IO if the port isn't available. */
pags_result pags_watch_create(const pags_watch_settings *settings, pags_watch **out);

/* The address to open in a browser; owned by the watch. */
const char *pags_watch_url(const pags_watch *watch);

/* Call on the training thread between two steps: renders at most one picture and handles requests for checkpoints.
 * Returns false if a page has asked the run to stop. */
bool pags_watch_step(pags_watch *watch, const pags_train_progress *progress);

/* Tells the pages how the run ended, waits at most three seconds for them, and frees everything. NULL is allowed. */
void pags_watch_end(pags_watch *watch, pags_result result, bool finished);

#else

static inline pags_result pags_watch_create(const pags_watch_settings *settings, pags_watch **out) {
  (void)settings, (void)out;
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "--view is not in this build, which lacks libwebsockets (Debian: "
                   "libwebsockets-dev; CMake option PAGS_VIEW)");
}
static inline const char *pags_watch_url(PAGS_UNUSED const pags_watch *watch) {
  return "";
}
static inline bool pags_watch_step(pags_watch *watch, const pags_train_progress *progress) {
  (void)watch, (void)progress;
  return true;
}
static inline void pags_watch_end(pags_watch *watch, pags_result result, bool finished) {
  (void)watch, (void)result, (void)finished;
}

#endif
#endif
