/* SPDX-License-Identifier: Apache-2.0 */
/* Pages that watch a run of the training (pags train --view): a server on a thread of its own, and pictures that the
 * trainer's thread draws between two steps, so that nobody looks at Gaussians while they change. Pictures are drawn by
 * a pool of threads and a frame of their own, made before the first step. */
#ifndef PAGS_CLI_VIEW_WATCH_H
#define PAGS_CLI_VIEW_WATCH_H

#include <pags/dataset.h>
#include <pags/train.h>
#include <stdbool.h>

typedef struct pags_watch pags_watch;

typedef struct pags_watch_settings {
  pags_dataset *dataset; /* must outlive the watch */
  const char *name;      /* what the scene is called */
  const char *log;       /* log.jsonl of the run that is gone on from; NULL: none */
  int threads, port;
  double share; /* 0..1: of the time that the run takes, pictures take at most this */
} pags_watch_settings;

/* Opens the port and begins to serve. PAGS_ERROR_IO if the port can't be had. */
pags_result pags_watch_create(const pags_watch_settings *settings, pags_watch **out);

/* The address to open in a browser; owned by the watch. */
const char *pags_watch_url(const pags_watch *watch);

/* Between two steps, on the trainer's thread: draws at most one picture for the pages, and does what they ask for.
 * Returns false if one asked to stop. */
bool pags_watch_step(pags_watch *watch, const pags_train_progress *progress);

/* Tells the pages how the run has ended, for three seconds at most, and frees everything. NULL is allowed. */
void pags_watch_end(pags_watch *watch, pags_result result, bool finished);

#endif
