/* SPDX-License-Identifier: Apache-2.0 */
/* A frame and its thread pool, set up once for a group of cmocka tests. */
#ifndef PAGS_TESTS_FRAME_FIXTURE_H
#define PAGS_TESTS_FRAME_FIXTURE_H

#include <pags/frame.h>

static pags_tasks *tasks;
static pags_frame *frame;

static inline int frame_set_up(void **state) {
  (void)state;
  tasks = pags_tasks_create(2);
  return tasks && pags_frame_create(tasks, &frame) == PAGS_OK ? 0 : -1;
}

static inline int frame_tear_down(void **state) {
  (void)state;
  pags_frame_destroy(frame);
  pags_tasks_destroy(tasks);
  return 0;
}

#endif
