/* SPDX-License-Identifier: Apache-2.0 */
/* Status of a training run for the pages that watch it: figures, curves, worst views, and the requests of pages. The
 * training thread writes, the server's thread reads; all functions may be called from any thread. */
#ifndef PAGS_CLI_VIEW_RUN_STATUS_H
#define PAGS_CLI_VIEW_RUN_STATUS_H

#include "cli/view/renderer.h"

#include <pags/train.h>

typedef struct pags_run_status pags_run_status;

/* `views`: number of views of the data set; `log`: log.jsonl of the resumed run, whose curves come first; NULL: none.
 * An unreadable log is ignored. */
pags_result pags_run_status_create(int64_t views, const char *log, pags_run_status **out);
void pags_run_status_destroy(pags_run_status *run_status); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_run_status, pags_run_status_destroy)

/* Share of the run time that pages take. */
typedef struct pags_run_status_share {
  double most;  /* maximum, 0..1 */
  double taken; /* measured, 0..1 */
  int64_t pictures;
} pags_run_status_share;
void pags_run_status_update(pags_run_status *run_status, const pags_train_progress *progress,
                            pags_run_status_share share);

/* Sets the line that reports the result of a request, such as a checkpoint; `text` is copied. */
void pags_run_status_notify(pags_run_status *run_status, const char *text);

/* Whether a page has requested a checkpoint since the last call; whether one has requested to stop. */
bool pags_run_status_wants_checkpoint(pags_run_status *run_status);
bool pags_run_status_wants_stop(pags_run_status *run_status);

/* Answers RUN, CHECKPOINT or STOP. PAGS_ERROR_MEMORY. */
pags_result pags_run_status_answer(pags_run_status *run_status, const pags_view_request *request,
                                   pags_view_message *out);

#endif
