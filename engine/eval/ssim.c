/* Structural similarity (Wang et al. 2004) as 3DGS computes it, in double.
 *
 *   SSIM = (2 mu_a mu_b + C1)(2 s_ab + C2) / ((mu_a^2 + mu_b^2 + C1)(s_aa + s_bb + C2))
 *
 * with means and (co)variances under an 11x11 Gaussian window of sigma 1.5 that sums to 1; pixels outside of the
 * picture are zeros. A mask selects which values of the map enter the mean; the windows see the unmasked pictures.
 *
 * The window is separable: for a row of the map, first the 11 source rows are summed down each column, then the sums
 * along the row. */
#include "eval/metric.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { RADIUS = 5, TAPS = 2 * RADIUS + 1, MOMENTS = 5 /* a, b, a^2, b^2, ab */ };

static const double C1 = 0.01 * 0.01, C2 = 0.03 * 0.03;

typedef struct ssim_job {
  const float *a, *b; /* interleaved */
  const uint8_t *mask;
  int width, height;
  double window[TAPS];
  double *scratch;        /* per worker */
  int64_t scratch_stride; /* doubles */
  double *row_sum;        /* per row, over channels and counted pixels */
} ssim_job;

static void make_window(double window[TAPS]) {
  double sum = 0.0;
  for (int i = 0; i < TAPS; i++) {
    double d = i - RADIUS;
    window[i] = exp(-d * d / (2.0 * 1.5 * 1.5));
    sum += window[i];
  }
  for (int i = 0; i < TAPS; i++)
    window[i] /= sum;
}

/* moments[m * stride + RADIUS + x] = sum over the window's rows; the margins stay zero. */
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

static void sum_along(const double window[TAPS], const double *restrict in, double *restrict out, int width) {
  for (int x = 0; x < width; x++) {
    double s = 0.0;
    for (int k = 0; k < TAPS; k++)
      s += window[k] * in[x + k];
    out[x] = s;
  }
}

static double map_value(double mu_a, double mu_b, double aa, double bb, double ab) {
  double s_aa = aa - mu_a * mu_a, s_bb = bb - mu_b * mu_b, s_ab = ab - mu_a * mu_b;
  return (2.0 * mu_a * mu_b + C1) * (2.0 * s_ab + C2) / ((mu_a * mu_a + mu_b * mu_b + C1) * (s_aa + s_bb + C2));
}

static double row_of_map(const ssim_job *job, int row, int channel, double *scratch, int64_t stride) {
  double *blurred = scratch + MOMENTS * stride;
  const uint8_t *mask = job->mask ? job->mask + (int64_t)row * job->width : NULL;
  sum_columns(job, row, channel, scratch, stride);
  for (int m = 0; m < MOMENTS; m++)
    sum_along(job->window, scratch + m * stride, blurred + m * stride, job->width);
  double sum = 0.0;
  for (int x = 0; x < job->width; x++) {
    if (mask && !mask[x])
      continue;
    const double *v = blurred + x;
    sum += map_value(v[0], v[stride], v[2 * stride], v[3 * stride], v[4 * stride]);
  }
  return sum;
}

static void ssim_rows(void *context, int64_t begin, int64_t end, int worker) {
  const ssim_job *job = context;
  double *scratch = job->scratch + worker * job->scratch_stride;
  for (int64_t y = begin; y < end; y++) {
    job->row_sum[y] = 0.0;
    for (int c = 0; c < 3; c++)
      job->row_sum[y] += row_of_map(job, (int)y, c, scratch, job->width + 2 * RADIUS);
  }
}

static int64_t count_mask(const uint8_t *mask, int64_t pixels) {
  if (!mask)
    return pixels;
  int64_t counted = 0;
  for (int64_t i = 0; i < pixels; i++)
    counted += mask[i] != 0;
  return counted;
}

pags_result pags_eval_ssim(const pags_image *a, const pags_image *b, const uint8_t *mask, pags_tasks *tasks,
                           double *ssim) {
  PAGS_TRY(pags_metric_check(a, b, "SSIM"));
  ssim_job job = {.a = a->data, .b = b->data, .mask = mask, .width = a->width, .height = a->height};
  make_window(job.window);
  job.scratch_stride = 2 * MOMENTS * ((int64_t)a->width + 2 * RADIUS);
  job.scratch = calloc((size_t)(job.scratch_stride * pags_tasks_workers(tasks)), sizeof *job.scratch);
  job.row_sum = calloc((size_t)a->height, sizeof *job.row_sum);
  pags_result result = PAGS_OK;
  if (!job.scratch || !job.row_sum)
    result = pags_fail(PAGS_ERROR_MEMORY, "SSIM: out of memory for a picture of %dx%d", a->width, a->height);
  else if (!pags_parallel_for(tasks, a->height, 8, ssim_rows, &job))
    result = pags_fail(PAGS_CANCELLED, "SSIM: cancelled");
  if (result == PAGS_OK) {
    int64_t counted = count_mask(mask, (int64_t)a->width * a->height);
    double sum = 0.0;
    for (int y = 0; y < a->height; y++)
      sum += job.row_sum[y];
    *ssim = counted ? sum / (3.0 * (double)counted) : NAN;
  }
  free(job.scratch);
  free(job.row_sum);
  return result;
}
