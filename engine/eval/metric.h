/* SPDX-License-Identifier: Apache-2.0 */
/* Shared by the image metrics: the check of a pair of images, PSNR by regions, clamping to the displayable range, and
 * the owner of LPIPS weights. */
#ifndef PAGS_EVAL_METRIC_H
#define PAGS_EVAL_METRIC_H

#include <pags/eval.h>

#include "base/memory.h"

PAGS_DEFINE_AUTO(pags_lpips, pags_lpips_destroy)

/* Checks that both images are F32 with three channels and of the same size, else PAGS_ERROR_ARGUMENT. The error
 * message begins with `metric`. */
pags_result pags_metric_check(const pags_image *a, const pags_image *b, const char *metric);

/* The pixels that count: those of up to 16 regions, by the bits of each pixel, or, without regions, of a mask; without
 * both, all. */
typedef struct pags_metric_pixels {
  const uint16_t *regions;
  const uint8_t *mask;
  int count; /* of the regions; 1 without regions */
} pags_metric_pixels;

/* Returns a bit for each region that contains pixel `at`; with a mask or neither, bit 0 is the only region. */
static inline unsigned pags_metric_regions(const pags_metric_pixels *pixels, int64_t at) {
  return pixels->regions ? pixels->regions[at] : !pixels->mask || pixels->mask[at];
}

/* psnr[r] = PSNR, dB, over region r. The images must have passed pags_metric_check. */
void pags_metric_psnr(const pags_image *a, const pags_image *b, const pags_metric_pixels *pixels, double *psnr);

/* Clamps to [0, 1]. NaN becomes 0, so that a broken pixel counts as black instead of making the metric NaN. */
static inline float pags_metric_clamp(float v) {
  return v > 0.0f ? (v < 1.0f ? v : 1.0f) : 0.0f;
}

#endif
