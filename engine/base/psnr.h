/* SPDX-License-Identifier: Apache-2.0 */
/* The peak signal-to-noise ratio for reports: at most 100 dB, the error of a 400th of an 8-bit step. Equal pictures
 * have an infinite one, which JSON can't hold and which would dominate any mean. */
#ifndef PAGS_BASE_PSNR_H
#define PAGS_BASE_PSNR_H

#include "maths/maths.h"

/* NaN (no pixels) stays NaN. */
static inline double pags_psnr_capped(double decibels) {
  return decibels > 100 ? 100 : decibels;
}

/* Of the mean squared error of values in [0, 1]. */
static inline double pags_psnr(double mean_square) {
  return mean_square == 0 ? 100 : pags_psnr_capped(-10 * pags_log10(mean_square));
}

#endif
