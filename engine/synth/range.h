/* SPDX-License-Identifier: Apache-2.0 */
/* Checks that an option of the synthetic scenes lies within its range; the error message names the option. */
#ifndef PAGS_SYNTH_RANGE_H
#define PAGS_SYNTH_RANGE_H

#include <pags/base.h>

static inline pags_result pags_synth_in_range(const char *name, double value, double lo, double hi) {
  if (value >= lo && value <= hi)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT, "%s is %.12g, expected %.12g..%.12g", name, value, lo, hi);
}

#endif
