/* SPDX-License-Identifier: Apache-2.0 */
/* Structural similarity (Wang et al. 2004) as 3DGS computes it, in double.
 *
 *   SSIM = (2 mu_a mu_b + C1)(2 s_ab + C2) / ((mu_a^2 + mu_b^2 + C1)(s_aa + s_bb + C2))
 *
 * with means mu and (co)variances s under an 11x11 Gaussian window of sigma 1.5 that sums to 1; pixels outside of the
 * picture count as zeros. The metric is the mean of the SSIM map. A mask selects which values of the map enter the
 * mean; the windows see the unmasked pictures.
 *
 * The window is separable: for a row of the map, first the 11 source rows are summed down each column, then these
 * sums along the row. */
#include "eval/metric.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "maths/maths.h"

enum { RADIUS = 5, TAPS = 2 * RADIUS + 1, MOMENTS = 5 /* a, b, a^2, b^2, ab */, MOST_REGIONS = 16 };

static const double C1 = 0.01 * 0.01, C2 = 0.03 * 0.03;

typedef struct ssim_job {
  const float *a, *b; /* pixels of the two pictures, channels interleaved */
  int width, height;
  pags_metric_pixels pixels;
  double window[TAPS];    /* the window in one dimension; sums to 1 */
  double *scratch;        /* a piece for each worker */
  int64_t scratch_stride; /* doubles in each piece */
  double *row_sum;        /* per row and region, over channels and counted pixels */
} ssim_job;

/* moments[m * stride + RADIUS + x] = moment m of column x, weighted and summed over the window's rows about `row`;
 * the RADIUS columns of margin at both sides stay zero. */
static void sum_columns(const ssim_job *job, int row, int channel, double *moments, int64_t stride) {
  memset(moments, 0, (size_t)(MOMENTS * stride) * sizeof *moments);
  double *m = moments + RADIUS;
  for (int k = 0; k < TAPS; k++) {
    int y = row + k - RADIUS;
    if (y < 0 || y >= job->height)
      continue;
    const float *pa = job->a + (int64_t)y * job->width * 3 + channel;
    const float *pb = job->b + (int64_t)y * job->width * 3 + channel;
    const double w = job->window[k];
    for (int x = 0; x < job->width; x++) {
      double a = (double)pags_metric_clamp(pa[3 * x]), b = (double)pags_metric_clamp(pb[3 * x]);
      m[x] += w * a;
      m[x + stride] += w * b;
      m[x + 2 * stride] += w * (a * a);
      m[x + 3 * stride] += w * (b * b);
      m[x + 4 * stride] += w * (a * b);
    }
  }
}

/* SSIM of one pixel from the window's means of a, b, a^2, b^2 and ab. */
static double map_value(double mu_a, double mu_b, double aa, double bb, double ab) {
  double s_aa = aa - mu_a * mu_a, s_bb = bb - mu_b * mu_b, s_ab = ab - mu_a * mu_b;
  return (2.0 * mu_a * mu_b + C1) * (2.0 * s_ab + C2) / ((mu_a * mu_a + mu_b * mu_b + C1) * (s_aa + s_bb + C2));
}

static void ssim_rows(void *context, int64_t begin, int64_t end, int worker) {
  const ssim_job *job = context;
  double *scratch = job->scratch + worker * job->scratch_stride;
  for (int64_t y = begin; y < end; y++)
    for (int c = 0; c < 3; c++) {
      /* Compute one channel of this row of the SSIM map and add it to the row's sums by region. */
      int row = (int)y;
      int64_t stride = job->width + 2 * RADIUS;
      double *sums = job->row_sum + y * job->pixels.count;
      double *blurred = scratch + MOMENTS * stride;
      double own[MOST_REGIONS] = {0};
      sum_columns(job, row, c, scratch, stride);
      for (int m = 0; m < MOMENTS; m++) {
        /* Sum moment m along the row, over the window's columns. */
        const double *restrict in = scratch + m * stride;
        double *restrict out = blurred + m * stride;
        for (int x = 0; x < job->width; x++) {
          double s = 0.0;
          for (int k = 0; k < TAPS; k++)
            s += job->window[k] * in[x + k];
          out[x] = s;
        }
      }
      for (int x = 0; x < job->width; x++) {
        const double *v = blurred + x;
        unsigned bits = pags_metric_regions(&job->pixels, (int64_t)row * job->width + x);
        double value = bits ? map_value(v[0], v[stride], v[2 * stride], v[3 * stride], v[4 * stride]) : 0.0;
        for (int r = 0; bits; r++, bits >>= 1)
          if (bits & 1)
            own[r] += value;
      }
      for (int r = 0; r < job->pixels.count; r++)
        sums[r] += own[r];
    }
}

static pags_result run(const pags_image *a, const pags_image *b, const pags_metric_pixels *pixels, pags_tasks *tasks,
                       double *ssim) {
  ssim_job job = {.a = a->data, .b = b->data, .width = a->width, .height = a->height, .pixels = *pixels};
  /* The Gaussian window of sigma 1.5 in one dimension, normalised. */
  double sum = 0.0;
  for (int i = 0; i < TAPS; i++) {
    double d = i - RADIUS;
    job.window[i] = pags_exp(-d * d / (2.0 * 1.5 * 1.5));
    sum += job.window[i];
  }
  for (int i = 0; i < TAPS; i++)
    job.window[i] /= sum;

  const int regions = job.pixels.count;
  job.scratch_stride = 2 * MOMENTS * ((int64_t)job.width + 2 * RADIUS);
  PAGS_AUTOFREE double *scratch = calloc((size_t)(job.scratch_stride * pags_tasks_workers(tasks)), sizeof *scratch);
  PAGS_AUTOFREE double *row_sum = calloc((size_t)job.height * (size_t)regions, sizeof *row_sum);
  PAGS_CHECK_MEMORY(scratch && row_sum, "SSIM: a picture of %dx%d", job.width, job.height);
  job.scratch = scratch;
  job.row_sum = row_sum;
  if (!pags_parallel_for(tasks, job.height, 8, ssim_rows, &job))
    return pags_fail(PAGS_CANCELLED, "SSIM: cancelled");

  /* ssim[r] = mean of the SSIM map over region r and the channels; NaN for an empty region. */
  int64_t counted[MOST_REGIONS] = {0};
  for (int64_t i = 0; i < (int64_t)job.width * job.height; i++) {
    unsigned bits = pags_metric_regions(&job.pixels, i);
    for (int r = 0; bits; r++, bits >>= 1)
      counted[r] += bits & 1;
  }
  for (int r = 0; r < regions; r++) {
    sum = 0.0;
    for (int y = 0; y < job.height; y++)
      sum += row_sum[(int64_t)y * regions + r];
    ssim[r] = counted[r] ? sum / (3.0 * (double)counted[r]) : NAN;
  }
  return PAGS_OK;
}

pags_result pags_eval_ssim(const pags_image *a, const pags_image *b, const uint8_t *mask, pags_tasks *tasks,
                           double *ssim) {
  PAGS_TRY(pags_metric_check(a, b, "SSIM"));
  return run(a, b, &(pags_metric_pixels){.mask = mask, .count = 1}, tasks, ssim);
}

pags_result pags_eval_regions(const pags_image *a, const pags_image *b, const uint16_t *regions, int count,
                              pags_tasks *tasks, double *psnr, double *ssim) {
  assert(count >= 1 && count <= MOST_REGIONS);
  PAGS_TRY(pags_metric_check(a, b, "PSNR and SSIM"));
  const pags_metric_pixels pixels = {.regions = regions, .count = count};
  pags_metric_psnr(a, b, &pixels, psnr);
  return run(a, b, &pixels, tasks, ssim);
}
