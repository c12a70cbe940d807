/* Peak signal-to-noise ratio: 10 log10(1 / MSE) in dB, MSE over the channels of the counted pixels. */
#include "eval/metric.h"

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

pags_result pags_eval_psnr(const pags_image *a, const pags_image *b, const uint8_t *mask, double *psnr) {
  PAGS_TRY(pags_metric_check(a, b, "PSNR"));
  const float *pa = a->data, *pb = b->data;
  const int64_t pixels = (int64_t)a->width * a->height;
  int64_t counted = 0;
  double sum = 0.0;
  for (int64_t i = 0; i < pixels; i++) {
    if (mask && !mask[i])
      continue;
    counted++;
    for (int c = 0; c < 3; c++) {
      double d = (double)pags_metric_clamp(pa[3 * i + c]) - (double)pags_metric_clamp(pb[3 * i + c]);
      sum += d * d;
    }
  }
  if (counted == 0)
    *psnr = NAN;
  else
    *psnr = sum > 0.0 ? -10.0 * log10(sum / (3.0 * (double)counted)) : INFINITY;
  return PAGS_OK;
}
