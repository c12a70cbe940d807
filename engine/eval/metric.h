/* SPDX-License-Identifier: Apache-2.0 */
/* What the metrics share: the check of a pair of pictures and the clamp to the displayable range. */
#ifndef PAGS_EVAL_METRIC_H
#define PAGS_EVAL_METRIC_H

#include <pags/eval.h>

/* Both F32 with three channels and of one size, else PAGS_ERROR_ARGUMENT. `metric` begins the message. */
pags_result pags_metric_check(const pags_image *a, const pags_image *b, const char *metric);

/* PSNR of each of at most 16 regions; the images have been checked. */
void pags_metric_psnr(const pags_image *a, const pags_image *b, const uint16_t *regions, int count, double *psnr);

/* NaN becomes 0: a broken pixel counts as black, not as equal to everything. */
static inline float pags_metric_clamp(float v) {
  return v > 0.0f ? (v < 1.0f ? v : 1.0f) : 0.0f;
}

#endif
