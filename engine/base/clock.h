/* SPDX-License-Identifier: Apache-2.0 */
/* Milliseconds of a clock that only goes forward, from wherever it began. */
#ifndef PAGS_BASE_CLOCK_H
#define PAGS_BASE_CLOCK_H

#include <time.h>

static inline double pags_clock_ms(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

/* What has passed since `*since`, which becomes now. */
static inline double pags_clock_lap_ms(double *since) {
  double now = pags_clock_ms(), passed = now - *since;
  *since = now;
  return passed;
}

#endif
