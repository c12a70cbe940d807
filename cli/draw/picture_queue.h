/* SPDX-License-Identifier: Apache-2.0 */
/* Queue of rendered pictures to be written: gathers one picture per worker thread, then encodes and writes all in
 * parallel. Writing doesn't overlap rendering, since it would distort the measured render times. */
#ifndef PAGS_CLI_PICTURE_QUEUE_H
#define PAGS_CLI_PICTURE_QUEUE_H

#include "cli/draw/picture.h"

#include <pags/tasks.h>

typedef struct pags_picture_slot pags_picture_slot;

typedef struct pags_picture_queue {
  const pags_picture_writer *writer;
  pags_tasks *tasks;
  const char *folder;
  int count, used; /* number of slots; slots that hold a picture */
  pags_picture_slot *slots;
} pags_picture_queue;

/* `writer`, `tasks` and `folder` must outlive the queue. */
pags_result pags_picture_queue_create(const pags_picture_writer *writer, pags_tasks *tasks, const char *folder,
                                      pags_picture_queue *out);
/* Frees the queue and drops pictures that aren't written yet. A zeroed struct is allowed. */
void pags_picture_queue_destroy(pags_picture_queue *queue);

/* Adds a copy of the picture and its passes. If the queue is full then, writes all its pictures and returns the first
 * error. */
pags_result pags_picture_queue_put(pags_picture_queue *queue, const pags_picture *picture, const pags_passes *passes,
                                   const pags_camera *camera, const char *name);

/* Writes the pictures in the queue, even if the tasks were cancelled. */
pags_result pags_picture_queue_finish(pags_picture_queue *queue);

#endif
