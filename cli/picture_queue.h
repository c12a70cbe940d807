/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures on their way into files: gathered until there is one for each worker, then written side by side. Not while
 * the next one is rendered: its times would then tell of the writing, too. */
#ifndef PAGS_CLI_PICTURE_QUEUE_H
#define PAGS_CLI_PICTURE_QUEUE_H

#include "cli/picture.h"

#include <pags/tasks.h>

typedef struct pags_picture_slot pags_picture_slot;

typedef struct pags_picture_queue {
  const pags_picture_writer *writer;
  pags_tasks *tasks;
  const char *folder;
  int count, used; /* slots */
  pags_picture_slot *slots;
} pags_picture_queue;

/* `writer`, `tasks` and `folder` must outlive it. */
pags_result pags_picture_queue_create(const pags_picture_writer *writer, pags_tasks *tasks, const char *folder,
                                      pags_picture_queue *out);
/* Forgets what is not yet written. A zeroed struct is allowed. */
void pags_picture_queue_destroy(pags_picture_queue *queue);

/* Takes a copy of the picture; may write all that are gathered and fail with the first one's error. */
pags_result pags_picture_queue_put(pags_picture_queue *queue, const pags_picture *picture, const pags_camera *camera,
                                   const char *name);

/* Writes what is gathered, even where the tasks were cancelled. */
pags_result pags_picture_queue_finish(pags_picture_queue *queue);

#endif
