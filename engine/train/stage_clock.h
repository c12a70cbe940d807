/* SPDX-License-Identifier: Apache-2.0 */
/* The time that a stage of training takes, in ms: by the wall's clock, and of the processor on the thread that trains,
 * which doesn't count while it waits for other ranks. */
#ifndef PAGS_TRAIN_STAGE_CLOCK_H
#define PAGS_TRAIN_STAGE_CLOCK_H

#include "base/clock.h"

typedef struct pags_stage_time {
  double wall, processor;
} pags_stage_time;

static inline pags_stage_time pags_stage_now(void) {
  return (pags_stage_time){pags_clock_ms(), (double)pags_port_thread_clock_ns() * 1e-6};
}

/* Adds the time since *since to *sum, and sets *since to the present. */
static inline void pags_stage_lap(pags_stage_time *since, pags_stage_time *sum) {
  const pags_stage_time now = pags_stage_now();
  sum->wall += now.wall - since->wall;
  sum->processor += now.processor - since->processor;
  *since = now;
}

#endif
