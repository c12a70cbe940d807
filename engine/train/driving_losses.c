/* SPDX-License-Identifier: Apache-2.0 */
/* Loss terms of driving scenes: opacity where the sky is, depth where the LiDAR hit, opacity of moving objects inside
 * and outside of their boxes.
 *
 * With T the transmittance, alpha = 1 - T, n counted pixels, m samples kept, D the depth sum, s the sign of D / alpha
 * - sample:
 *
 *     sky      -(w/n) log T where the label says sky    d/dT = -(w/n) / T
 *              -(w/n) log(1 - T) elsewhere              d/dT = (w/n) / (1 - T); nothing where it is unknown
 *     objects  -(w/n) log T outside of the boxes        d/dT = -(w/n) / T
 *              (w/n) H(T) inside                        dH/dT = log((1 - T) / T)
 *     depth    (w/m) |D / alpha - sample|               d/dD = s (w/m) / alpha, d/dT = s (w/m) D / alpha^2
 *
 * Arguments of the logarithms are clamped to [1e-6, 1 - 1e-6], outside of which the gradient is zero:
 * simd/opacity.c. Every row has its own sum; the sums are added in order. */
#include "train/driving_losses.h"

#include <assert.h>
#include <math.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "simd/kernels.h"
#include "train/photometric_loss.h"

enum { IN_MOVING_BOX = PAGS_LABEL_VEHICLE | PAGS_LABEL_PEDESTRIAN | PAGS_LABEL_CYCLIST };

static const float least_alpha = 0.05f; /* the depth loss skips pixels whose alpha isn't larger */

typedef struct term {
  const pags_kernels *kernels;
  const pags_picture *picture;
  const pags_photo *photo;
  pags_opacity_row row; /* the members that are the same for all rows */
  double *sums;         /* one per row of pixels */
} term;

static void sum_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const term *const t = context;
  for (int64_t y = begin; y < end; y++) {
    const int64_t at = y * t->photo->stride;
    pags_opacity_row row = t->row;
    row.transmittance = t->picture->transmittance + at;
    row.labels = t->photo->labels + at;
    row.mask = t->photo->mask ? t->photo->mask + at : NULL;
    row.gradient += at;
    t->sums[y] = t->kernels->opacity_row(&row);
  }
}

static pags_result sum_term(pags_tasks *tasks, term *t, double weight, double *value) {
  const char *why = "no vector kernels";
  *value = 0.0;
  PAGS_TRY(pags_photo_check_size(t->picture, t->photo));
  const int64_t counted = t->photo->labels ? pags_photo_counted(t->photo) : 0;
  if (counted == 0 || weight == 0.0)
    return PAGS_OK;
  t->kernels = pags_kernels_get(&why);
  if (!t->kernels)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s", why);
  t->row.width = t->photo->width;
  t->row.scale = (float)(weight / (double)counted);
  pags_arena *const arena = pags_tasks_arena(tasks, 0);
  const pags_arena_mark mark = pags_arena_save(arena);
  t->sums = pags_arena_alloc(arena, (size_t)t->photo->height, sizeof *t->sums);
  PAGS_CHECK_MEMORY(t->sums, "the loss of a picture %d pixels high", t->photo->height);
  const pags_result result = pags_parallel_run(tasks, t->photo->height, 16, sum_rows, t);
  double sum = 0.0;
  for (int y = 0; result == PAGS_OK && y < t->photo->height; y++)
    sum += t->sums[y];
  pags_arena_release(arena, mark);
  *value = result == PAGS_OK ? weight * sum / (double)counted : 0.0;
  return result;
}

pags_result pags_driving_loss_sky(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                  double weight, float *transmittance_gradient, double *value) {
  term t = {.picture = picture,
            .photo = photo,
            .row = {.chosen = PAGS_LABEL_SKY, .unknown = PAGS_LABEL_SKY_UNKNOWN, .gradient = transmittance_gradient}};
  return sum_term(tasks, &t, weight, value);
}

pags_result pags_driving_loss_objects(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                      double weight, float *transmittance_gradient, double *value) {
  term t = {.picture = picture,
            .photo = photo,
            .row = {.chosen = IN_MOVING_BOX, .unsure = true, .gradient = transmittance_gradient}};
  return sum_term(tasks, &t, weight, value);
}

/* ---- Depth ---- */

/* A sample is a hit if its pixel lies in the picture, is counted and has enough alpha. Blocks of HIT samples find the
 * hits; bands of ROWS rows of pixels add to the gradients, so that what falls onto one pixel is added in the order of
 * the samples. */
enum { HIT = 1024, ROWS = 32 };
static const uint32_t no_hit = UINT32_MAX; /* larger than any key */

typedef struct depth_job {
  const pags_picture *picture;
  const pags_photo *photo;
  const pags_lidar_depth_sample *samples;
  int64_t count, kept;
  int shrink;
  double weight;
  float *depth_gradient, *transmittance_gradient;
  int64_t *at;    /* per sample: its pixel in the planes */
  float *error;   /* rendered minus measured, metres */
  uint32_t *key;  /* the bits of |error|: for floats >= 0, the order of the bits as integers is that of the values */
  int64_t *found; /* hits per block */
} depth_job;

static void find_hits(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  depth_job *const d = context;
  const pags_picture *const picture = d->picture;
  const float scale = 1.0f / (float)d->shrink; /* exact, since shrink is a power of two */
  int64_t found = 0;
  for (int64_t i = begin; i < end; i++) {
    const float x = d->samples[i].x * scale, y = d->samples[i].y * scale;
    d->key[i] = no_hit;
    if (!(x >= 0.0f && y >= 0.0f && x < (float)picture->width && y < (float)picture->height))
      continue;
    const int64_t at = (int64_t)y * picture->stride + (int64_t)x;
    const float alpha = 1.0f - picture->transmittance[at];
    if (!(alpha > least_alpha) || (d->photo->mask && !d->photo->mask[at]))
      continue;
    const float error = picture->depth_sum[at] / alpha - d->samples[i].depth, size = fabsf(error);
    if (!isfinite(error))
      continue;
    d->at[i] = at;
    d->error[i] = error;
    memcpy(&d->key[i], &size, sizeof size);
    found++;
  }
  d->found[begin / HIT] = found;
}

/* Returns the kept-th smallest key (counted from 1) by radix selection, 8 bits at a time from the top; `smaller`
 * receives the number of smaller keys. */
static uint32_t select_key(const uint32_t *keys, int64_t count, int64_t kept, int64_t *smaller) {
  uint32_t prefix = 0;
  *smaller = 0;
  for (int shift = 24; shift >= 0; shift -= 8) {
    int64_t bins[256] = {0};
    for (int64_t i = 0; i < count; i++)
      bins[keys[i] >> shift & 255] += (uint64_t)keys[i] >> (shift + 8) == (uint64_t)prefix >> (shift + 8);
    uint32_t bin = 0;
    while (*smaller + bins[bin] < kept)
      *smaller += bins[bin++];
    prefix |= bin << shift;
  }
  return prefix;
}

/* Keeps the hits with the smallest errors and makes the others none; returns the sum of the errors kept. */
static double keep_hits(depth_job *d) {
  int64_t smaller;
  const uint32_t largest = select_key(d->key, d->count, d->kept, &smaller);
  int64_t ties = d->kept - smaller; /* of the samples that equal the largest kept error, the first `ties` are kept */
  double sum = 0.0;
  for (int64_t i = 0; i < d->count; i++) {
    if (d->key[i] > largest || (d->key[i] == largest && ties-- <= 0))
      d->key[i] = no_hit;
    else
      sum += fabs((double)d->error[i]);
  }
  return sum;
}

/* Block function: adds to the gradients of the pixels in the rows [begin, end). */
static void add_hits(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const depth_job *const d = context;
  const int64_t first = begin * d->picture->stride, last = end * d->picture->stride;
  for (int64_t i = 0; i < d->count; i++) {
    if (d->key[i] == no_hit || d->at[i] < first || d->at[i] >= last)
      continue;
    const int64_t at = d->at[i];
    const float error = d->error[i];
    const double alpha = (double)(1.0f - d->picture->transmittance[at]);
    const double slope = error == 0.0f ? 0.0 : copysign(d->weight / (double)d->kept, (double)error) / alpha;
    d->depth_gradient[at] += (float)slope;
    d->transmittance_gradient[at] += (float)(slope * (double)d->picture->depth_sum[at] / alpha);
  }
}

static pags_result add_depth(pags_tasks *tasks, depth_job *d, double share, double *value) {
  pags_arena *const arena = pags_tasks_arena(tasks, 0);
  const int64_t blocks = (d->count + HIT - 1) / HIT;
  d->at = pags_arena_alloc(arena, (size_t)d->count, sizeof *d->at);
  d->error = pags_arena_alloc(arena, (size_t)d->count, sizeof *d->error);
  d->key = pags_arena_alloc(arena, (size_t)d->count, sizeof *d->key);
  d->found = pags_arena_alloc(arena, (size_t)blocks, sizeof *d->found);
  PAGS_CHECK_MEMORY(d->at && d->error && d->key && d->found, "%lld depth samples", (long long)d->count);
  PAGS_TRY(pags_parallel_run(tasks, d->count, HIT, find_hits, d));
  int64_t found = 0;
  for (int64_t b = 0; b < blocks; b++)
    found += d->found[b];
  d->kept = (int64_t)ceil(share * (double)found);
  if (d->kept == 0)
    return PAGS_OK;
  *value = d->weight * keep_hits(d) / (double)d->kept;
  return pags_parallel_run(tasks, d->picture->height, ROWS, add_hits, d);
}

pags_result pags_driving_loss_depth(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                    const pags_lidar_depth_sample *samples, int64_t count, int shrink, double weight,
                                    double share, float *depth_gradient, float *transmittance_gradient, double *value) {
  assert(picture->depth_sum && shrink >= 1 && share >= 0.0 && share <= 1.0);
  *value = 0.0;
  PAGS_TRY(pags_photo_check_size(picture, photo));
  if (count <= 0 || weight == 0.0)
    return PAGS_OK;
  depth_job d = {.picture = picture,
                 .photo = photo,
                 .samples = samples,
                 .count = count,
                 .shrink = shrink,
                 .weight = weight,
                 .depth_gradient = depth_gradient,
                 .transmittance_gradient = transmittance_gradient};
  pags_arena *const arena = pags_tasks_arena(tasks, 0);
  const pags_arena_mark mark = pags_arena_save(arena);
  const pags_result result = add_depth(tasks, &d, share, value);
  pags_arena_release(arena, mark);
  return result;
}
