/* SPDX-License-Identifier: Apache-2.0 */
/* How a run of the training stands, for the pages that watch it: its figures, curves and worst views, and what pages
 * ask of it. The trainer's thread writes, the server's thread reads; all functions may be called from any thread. */
#ifndef PAGS_CLI_VIEW_BOARD_H
#define PAGS_CLI_VIEW_BOARD_H

#include "cli/view/drawer.h"

#include <pags/train.h>

typedef struct pags_board pags_board;

/* `views` of the data set; `log` is the log.jsonl of the run that is gone on from, whose curves come first; NULL: none.
 * A log that can't be read has no curves. */
pags_result pags_board_create(int64_t views, const char *log, pags_board **out);
void pags_board_destroy(pags_board *board); /* NULL is allowed */

/* What the board is told after a step besides its progress. */
typedef struct pags_board_share {
  double most;  /* share of the time that pages may take */
  double taken; /* that they took so far */
  int64_t pictures;
} pags_board_share;
void pags_board_tell(pags_board *board, const pags_train_progress *progress, pags_board_share share);

/* Says what was done of what a page asked for; `text` is copied. */
void pags_board_say(pags_board *board, const char *text);

/* Whether a page has asked for a checkpoint since the last call, and whether one has asked to stop. */
bool pags_board_wants_checkpoint(pags_board *board);
bool pags_board_wants_stop(pags_board *board);

/* Answers RUN, CHECKPOINT or STOP. PAGS_ERROR_MEMORY. */
pags_result pags_board_answer(pags_board *board, const pags_view_request *request, pags_view_message *out);

#endif
