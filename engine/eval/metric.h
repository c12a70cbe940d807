/* SPDX-License-Identifier: Apache-2.0 */
/* Shared by the image metrics: the check of a pair of images, PSNR by regions, and clamping to the displayable
 * range. */
#ifndef PAGS_EVAL_METRIC_H
#define PAGS_EVAL_METRIC_H

#include <pags/eval.h>

/* Checks that both images are F32 with three channels and of the same size, else PAGS_ERROR_ARGUMENT. The error
 * message begins with `metric`. */
pags_result pags_metric_check(const pags_image *a, const pags_image *b, const char *metric);

/* psnr[r] = PSNR, dB, over the pixels whose `regions` value has bit r set, for r < count <= 16. The images must have
 * passed pags_metric_check. */
void pags_metric_psnr(const pags_image *a, const pags_image *b, const uint16_t *regions, int count, double *psnr);

/* Clamps to [0, 1]. NaN becomes 0, so that a broken pixel counts as black instead of making the metric NaN. */
static inline float pags_metric_clamp(float v) {
  return v > 0.0f ? (v < 1.0f ? v : 1.0f) : 0.0f;
}

#endif
