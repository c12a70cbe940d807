/* SPDX-License-Identifier: Apache-2.0 */
/* Time in milliseconds by a monotonic clock with an arbitrary zero: only differences have a meaning. */
#ifndef PAGS_BASE_CLOCK_H
#define PAGS_BASE_CLOCK_H

#include "port/port.h"

static inline double pags_clock_ms(void) {
  return (double)pags_port_clock_ns() * 1e-6;
}

/* Returns the milliseconds since *since and sets *since to the present time. */
static inline double pags_clock_lap_ms(double *since) {
  double now = pags_clock_ms(), passed = now - *since;
  *since = now;
  return passed;
}

#endif
