/* SPDX-License-Identifier: Apache-2.0 */
/* Peak signal-to-noise ratio, 10 log10(1 / MSE) in dB, with the mean squared error over the three channels of the
 * counted pixels: all, those of a mask, or those of each of several regions. */
#include "eval/metric.h"
#include "maths/maths.h"

#include <math.h>

pags_result pags_metric_check(const pags_image *a, const pags_image *b, const char *metric) {
  if (a->sample != PAGS_F32 || b->sample != PAGS_F32 || a->channels != 3 || b->channels != 3)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected two float images of 3 channels, got %d and %d channels", metric,
                     a->channels, b->channels);
  if (a->width != b->width || a->height != b->height)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected two images of one size, got %dx%d and %dx%d", metric, a->width,
                     a->height, b->width, b->height);
  if (a->width < 1 || a->height < 1)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected images of at least one pixel", metric);
  return PAGS_OK;
}

void pags_metric_psnr(const pags_image *a, const pags_image *b, const pags_metric_pixels *pixels, double *psnr) {
  const float *pa = a->data, *pb = b->data;
  int64_t counted[16] = {0};
  double sums[16] = {0};
  for (int64_t i = 0; i < (int64_t)a->width * a->height; i++) {
    unsigned bits = pags_metric_regions(pixels, i);
    double error = 0.0;
    for (int c = 0; c < 3 && bits; c++) {
      const double d = (double)pags_metric_clamp(pa[3 * i + c]) - (double)pags_metric_clamp(pb[3 * i + c]);
      error += d * d;
    }
    for (int r = 0; bits; r++, bits >>= 1)
      if (bits & 1) {
        counted[r]++;
        sums[r] += error;
      }
  }
  for (int r = 0; r < pixels->count; r++)
    psnr[r] = !counted[r] ? NAN : sums[r] > 0.0 ? -10.0 * pags_log10(sums[r] / (3.0 * (double)counted[r])) : INFINITY;
}

pags_result pags_eval_psnr(const pags_image *a, const pags_image *b, const uint8_t *mask, double *psnr) {
  PAGS_TRY(pags_metric_check(a, b, "PSNR"));
  pags_metric_psnr(a, b, &(pags_metric_pixels){.mask = mask, .count = 1}, psnr);
  return PAGS_OK;
}
