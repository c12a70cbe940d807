/* SPDX-License-Identifier: Apache-2.0 */
/* Fits the sky's cube map as in Street Gaussians (Yan et al. 2024): Adam, learning rate 0.01 falling log-linearly to
 * 1e-4. Texels that no pixel sees keep their moments. */
#include "train/sky_fit.h"

#include <math.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "maths/maths.h"
#include "simd/kernels.h"

enum { LOOK_SHRINK = 8, LEAST_SIZE = 64, MOST_SIZE = 1024 };
static const double least_share = 1e-3;
static const double first_rate = 0.01;  /* learning rate of texels at the first step */
static const double final_share = 0.01; /* the learning rate's final share */

int pags_sky_fit_size(const pags_dataset *dataset) {
  double focal = 0.0;
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++)
    focal = fmax(focal, pags_dataset_view(dataset, i)->camera.fx);
  int size = LEAST_SIZE; /* a cube face spans 2 focal lengths; at its middle a texel is 2 focal / N pixels */
  while (size < MOST_SIZE && size <= focal)
    size *= 2;
  return size;
}

uint64_t pags_sky_fit_bytes(int size) {
  const uint64_t texels = 6 * (uint64_t)size * (uint64_t)size;
  return texels * (3 * 3 * sizeof(float) + sizeof(uint16_t));
}

uint64_t pags_sky_fit_most_bytes(const pags_dataset *dataset) {
  return pags_sky_fit_bytes(pags_sky_fit_size(dataset));
}

pags_result pags_sky_fit_create(pags_sky_fit *fit, const pags_dataset *dataset, pags_photo_cache *photos,
                                double *share) {
  double colour[3] = {0.0, 0.0, 0.0};
  int64_t sky = 0, all = 0;
  *fit = (pags_sky_fit){0};
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    pags_photo photo;
    if (pags_dataset_view(dataset, i)->test)
      continue;
    PAGS_TRY(pags_photo_cache_get(photos, i, LOOK_SHRINK, &photo));
    const int64_t plane = (int64_t)photo.height * photo.stride;
    all += (int64_t)photo.width * photo.height;
    for (int y = 0; photo.labels && y < photo.height; y++)
      for (int x = 0; x < photo.width; x++) {
        const int64_t at = (int64_t)y * photo.stride + x;
        if (!(photo.labels[at] & PAGS_LABEL_SKY) || (photo.mask && !photo.mask[at]))
          continue;
        for (int c = 0; c < 3; c++)
          colour[c] += photo.rgb[c * plane + at] / 255.0;
        sky++;
      }
  }
  *share = all > 0 ? (double)sky / (double)all : 0.0;
  if (*share < least_share)
    return PAGS_OK;
  PAGS_TRY(pags_sky_fit_prepare(fit, pags_sky_fit_size(dataset)));
  const int64_t floats = 18 * (int64_t)fit->sky.size * fit->sky.size;
  for (int64_t i = 0; i < floats; i++)
    fit->sky.texels[i] = (float)(colour[i % 3] / (double)sky);
  return PAGS_OK;
}

pags_result pags_sky_fit_prepare(pags_sky_fit *fit, int size) {
  const char *why;
  *fit = (pags_sky_fit){.kernels = pags_kernels_get(&why), .ranks = 1};
  if (!fit->kernels)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s", why);
  PAGS_TRY(pags_sky_create(&fit->sky, size));
  size_t floats = (size_t)18 * (size_t)size * (size_t)size;
  fit->first = calloc(floats, sizeof(float));
  fit->second = calloc(floats, sizeof(float));
  fit->visits = calloc(floats / 3, sizeof *fit->visits);
  PAGS_CHECK_MEMORY(fit->first && fit->second && fit->visits, "a sky of %d texels a side", size);
  return PAGS_OK;
}

/* ---- Shares of ranks ---- */

int64_t pags_sky_fit_blocks(const pags_sky_fit *fit) {
  const int64_t texels = 6 * (int64_t)fit->sky.size * fit->sky.size;
  return (texels + PAGS_SKY_BLOCK - 1) / PAGS_SKY_BLOCK;
}

int64_t pags_sky_fit_own_blocks(const pags_sky_fit *fit, int rank) {
  return fit->ranks > 0 ? (pags_sky_fit_blocks(fit) - rank + fit->ranks - 1) / fit->ranks : 0;
}

/* Moves every ranks-th block of `bytes` each to a smaller array; *all is of `size` bytes. Blocks of zeros, which most
 * of a sky stays, aren't written, so that they take no memory. */
static bool keep_blocks(void **all, int64_t size, int rank, int ranks, int64_t own, int64_t bytes) {
  static const char zeros[3 * PAGS_SKY_BLOCK * sizeof(float)] = {0};
  char *const kept = calloc((size_t)(own + 1), (size_t)bytes);
  for (int64_t i = 0; kept && i < own; i++) {
    const char *const from = (char *)*all + (i * ranks + rank) * bytes;
    const int64_t left = (char *)*all + size - from, length = left < bytes ? left : bytes;
    if (memcmp(from, zeros, (size_t)length) != 0)
      memcpy(kept + i * bytes, from, (size_t)length);
  }
  if (!kept)
    return false;
  free(*all);
  *all = kept;
  return true;
}

pags_result pags_sky_fit_share(pags_sky_fit *fit, int rank, int ranks) {
  const int64_t texels = 6 * (int64_t)fit->sky.size * fit->sky.size;
  const int64_t colours = 3 * PAGS_SKY_BLOCK * (int64_t)sizeof(float), whole = 3 * texels * (int64_t)sizeof(float);
  if (texels == 0)
    return PAGS_OK;
  fit->rank = rank;
  fit->ranks = ranks;
  const int64_t own = pags_sky_fit_own_blocks(fit, rank), visits = (int64_t)sizeof *fit->visits;
  void *first = fit->first, *second = fit->second, *visited = fit->visits;
  const bool kept = keep_blocks(&first, whole, rank, ranks, own, colours) &&
                    keep_blocks(&second, whole, rank, ranks, own, colours) &&
                    keep_blocks(&visited, visits * texels, rank, ranks, own, visits * PAGS_SKY_BLOCK);
  fit->first = first;
  fit->second = second;
  fit->visits = visited;
  return kept ? PAGS_OK : pags_out_of_memory("a sky of %d texels a side", fit->sky.size);
}

void pags_sky_fit_destroy(pags_sky_fit *fit) {
  pags_sky_destroy(&fit->sky);
  free(fit->first);
  free(fit->second);
  free(fit->visits);
  free(fit->correction);
  pags_gradient_store_destroy(&fit->sum);
  *fit = (pags_sky_fit){0};
}

/* Size of the table of bias corrections 1 / (1 - beta1^k), 1 / (1 - beta2^k) by number of visits k; the last entry
 * serves for all larger k. */
enum { CORRECTIONS = 8192 };
enum { BLOCK_FLOATS = 3 * PAGS_SKY_BLOCK, FINISH_GRAIN = 64 };

static const float epsilon = 1e-15f;

/* Does one Adam step for a block of texels of this rank. A texel that no pixel saw stays as it is; a gradient that
 * isn't finite counts as none. */
static void update_block(pags_sky_fit *f, int64_t block, const float *gradient) {
  const int64_t first_texel = block * PAGS_SKY_BLOCK, own_texel = block / f->ranks * PAGS_SKY_BLOCK;
  const int64_t left = 6 * (int64_t)f->sky.size * f->sky.size - first_texel;
  const int64_t texels = left < PAGS_SKY_BLOCK ? left : PAGS_SKY_BLOCK;
  float rate[BLOCK_FLOATS] = {0.0f}, correction[BLOCK_FLOATS] = {0.0f};
  uint16_t *visits = f->visits + own_texel;
  for (int64_t i = 0; i < texels; i++) {
    const float *g = gradient + 3 * i;
    const int finite = isfinite(g[0]) && isfinite(g[1]) && isfinite(g[2]);
    if (!finite || (g[0] == 0.0f && g[1] == 0.0f && g[2] == 0.0f))
      continue;
    visits[i] = (uint16_t)(visits[i] + (visits[i] < UINT16_MAX));
    const float *c = f->correction[visits[i] < CORRECTIONS ? visits[i] : CORRECTIONS - 1];
    for (int64_t k = 3 * i; k < 3 * i + 3; k++) {
      rate[k] = f->rate * c[0];
      correction[k] = c[1];
    }
  }

  const pags_sky_step step = {f->beta1, f->beta2, epsilon, gradient, rate, correction};
  float *const parts[3] = {f->sky.texels + 3 * first_texel, f->first + 3 * own_texel, f->second + 3 * own_texel};
  if (texels == PAGS_SKY_BLOCK) {
    f->kernels->sky_adam(&step, BLOCK_FLOATS, parts[0], parts[1], parts[2]);
    return;
  }
  /* The last block of a map whose texels don't fill it. */
  float whole[3][BLOCK_FLOATS] = {{0.0f}};
  for (int k = 0; k < 3; k++)
    memcpy(whole[k], parts[k], 3 * (size_t)texels * sizeof(float));
  f->kernels->sky_adam(&step, BLOCK_FLOATS, whole[0], whole[1], whole[2]);
  for (int k = 0; k < 3; k++)
    memcpy(parts[k], whole[k], 3 * (size_t)texels * sizeof(float));
}

static int64_t next_seen(const pags_sky_gradient *g, int64_t block) {
  while (block < g->blocks && !g->seen[block])
    block++;
  return block;
}

static void update(void *user, const pags_sky_gradient *g, PAGS_UNUSED int worker) {
  pags_sky_fit *f = user;
  for (int64_t block = next_seen(g, 0); block < g->blocks; block = next_seen(g, block + 1))
    update_block(f, g->first / PAGS_SKY_BLOCK + block, g->data + block * BLOCK_FLOATS);
}

/* Adds a photograph's gradients to the step's sum. One that isn't finite counts as none. */
static void add(void *user, const pags_sky_gradient *g, PAGS_UNUSED int worker) {
  pags_sky_fit *f = user;
  for (int64_t block = next_seen(g, 0); block < g->blocks; block = next_seen(g, block + 1)) {
    const float *const from = g->data + block * BLOCK_FLOATS;
    float sound[BLOCK_FLOATS];
    for (int i = 0; i < BLOCK_FLOATS; i++)
      sound[i] = isfinite(from[i]) ? from[i] : 0.0f;
    pags_gradient_store_add(&f->sum, (g->first / PAGS_SKY_BLOCK + block) / f->ranks, f->step, sound, BLOCK_FLOATS);
  }
}

typedef struct finish_job {
  pags_sky_fit *fit;
  float share; /* of a photograph in the step */
} finish_job;

static void finish_blocks(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const finish_job *const job = context;
  pags_sky_fit *const f = job->fit;
  for (int64_t own = begin; own < end; own++) {
    const float *const sum = pags_gradient_store_find(&f->sum, own, f->step);
    float mean[BLOCK_FLOATS];
    if (!sum)
      continue;
    for (int i = 0; i < BLOCK_FLOATS; i++)
      mean[i] = job->share * sum[i];
    update_block(f, own * f->ranks + f->rank, mean);
  }
}

pags_result pags_sky_fit_finish(pags_sky_fit *fit, const pags_schedule *schedule, int64_t step, pags_tasks *tasks) {
  finish_job job = {fit, 1.0f / (float)schedule->batch};
  if (fit->step != step)
    return PAGS_OK; /* none of the step's photographs shows the sky */
  return pags_parallel_run(tasks, fit->sum.clusters, FINISH_GRAIN, finish_blocks, &job);
}

pags_result pags_sky_fit_receive(pags_sky_fit *fit, const pags_schedule *schedule, int64_t step,
                                 pags_picture_gradient *gradient) {
  const double t = fmin((double)step / (double)schedule->length, 1.0);
  if (!fit->correction) {
    /* Compute the bias corrections once. */
    double power1 = 1.0, power2 = 1.0;
    fit->correction = malloc(CORRECTIONS * sizeof *fit->correction);
    PAGS_CHECK_MEMORY(fit->correction, "the sky's optimiser");
    fit->correction[0][0] = fit->correction[0][1] = 1.0f;
    for (int k = 1; k < CORRECTIONS; k++) {
      power1 *= schedule->beta1;
      power2 *= schedule->beta2;
      fit->correction[k][0] = (float)(1.0 / (1.0 - power1));
      fit->correction[k][1] = (float)(1.0 / (1.0 - power2));
    }
  }
  fit->beta1 = (float)schedule->beta1;
  fit->beta2 = (float)schedule->beta2;
  fit->rate = (float)(schedule->rate_factor * first_rate * pags_pow(final_share, t));
  fit->step = step;
  if (schedule->batch > 1)
    PAGS_TRY(pags_gradient_store_reserve(&fit->sum, pags_sky_fit_own_blocks(fit, fit->rank), BLOCK_FLOATS));
  gradient->sky = schedule->batch > 1 ? add : update;
  gradient->sky_user = fit;
  gradient->sky_cut = 1.0f / 255.0f;
  return PAGS_OK;
}
