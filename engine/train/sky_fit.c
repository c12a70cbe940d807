/* Fitting the sky's cube map (Street Gaussians: Adam, rate 0.01 to 1e-4 log-linear). */
#include "train/sky_fit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LOOK_SHRINK = 8, LEAST_SIZE = 64, MOST_SIZE = 1024, BLOCK_GRAIN = 256 };
static const double least_share = 1e-3;
static const double final_share = 0.01; /* of the rate, at the schedule's end */

/* Sums over the sky pixels of one photograph. */
static void add_photo(const pags_photo *photo, double colour[3], int64_t *sky, int64_t *all) {
  *all += (int64_t)photo->width * photo->height;
  for (int y = 0; photo->labels && y < photo->height; y++)
    for (int x = 0; x < photo->width; x++) {
      int64_t at = (int64_t)y * photo->stride + x;
      if (!(photo->labels[at] & PAGS_LABEL_SKY) || (photo->mask && !photo->mask[at]))
        continue;
      for (int c = 0; c < 3; c++)
        colour[c] += photo->rgb[(int64_t)c * photo->height * photo->stride + at] / 255.0;
      ++*sky;
    }
}

static int choose_size(const pags_dataset *dataset) {
  double focal = 0.0;
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++)
    focal = fmax(focal, pags_dataset_view(dataset, i)->camera.fx);
  int size = LEAST_SIZE; /* a face of N texels spans 2 focal lengths of pixels at its middle */
  while (size < MOST_SIZE && size <= focal)
    size *= 2;
  return size;
}

pags_result pags_sky_fit_create(pags_sky_fit *fit, const pags_dataset *dataset, pags_photo_cache *photos, double *share) {
  double colour[3] = {0.0, 0.0, 0.0};
  int64_t sky = 0, all = 0;
  *fit = (pags_sky_fit){0};
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    pags_photo photo;
    if (pags_dataset_view(dataset, i)->test)
      continue;
    PAGS_TRY(pags_photo_cache_get(photos, i, LOOK_SHRINK, &photo));
    add_photo(&photo, colour, &sky, &all);
  }
  *share = all > 0 ? (double)sky / (double)all : 0.0;
  if (*share < least_share)
    return PAGS_OK;
  PAGS_TRY(pags_sky_fit_prepare(fit, choose_size(dataset)));
  int64_t texels = 6 * (int64_t)fit->sky.size * fit->sky.size;
  for (int64_t i = 0; i < texels; i++)
    for (int c = 0; c < 3; c++)
      fit->sky.texels[3 * i + c] = (float)(colour[c] / (double)sky);
  return PAGS_OK;
}

static int64_t block_count(int size) { return (6 * (int64_t)size * size + PAGS_SKY_BLOCK - 1) / PAGS_SKY_BLOCK; }

pags_result pags_sky_fit_prepare(pags_sky_fit *fit, int size) {
  *fit = (pags_sky_fit){0};
  PAGS_TRY(pags_sky_create(&fit->sky, size));
  size_t floats = (size_t)18 * (size_t)size * (size_t)size;
  fit->first = calloc(floats, sizeof(float));
  fit->second = calloc(floats, sizeof(float));
  fit->gradient = calloc(floats, sizeof(float));
  fit->visits = calloc(floats / 3, sizeof *fit->visits);
  fit->blocks = calloc((size_t)block_count(size), 1);
  if (!fit->first || !fit->second || !fit->gradient || !fit->visits || !fit->blocks) {
    pags_sky_fit_destroy(fit);
    return pags_fail(PAGS_ERROR_MEMORY, "no memory for a sky of %d texels a side", size);
  }
  return PAGS_OK;
}

void pags_sky_fit_destroy(pags_sky_fit *fit) {
  pags_sky_destroy(&fit->sky);
  free(fit->first);
  free(fit->second);
  free(fit->gradient);
  free(fit->visits);
  free(fit->correction);
  free(fit->blocks);
  *fit = (pags_sky_fit){0};
}

void pags_sky_fit_receive(pags_sky_fit *fit, pags_picture_gradient *gradient) {
  gradient->sky = fit->gradient;
  gradient->sky_blocks = fit->blocks;
  gradient->sky_cut = 1.0f / 255.0f;
}

enum { CORRECTIONS = 8192 }; /* by visits, the last for all beyond: 1 / (1 - beta1^k), 1 / (1 - beta2^k) */

typedef struct update_job {
  pags_sky_fit *fit;
  float beta1, beta2, rate, epsilon;
} update_job;

enum { BLOCK_FLOATS = 3 * PAGS_SKY_BLOCK };

typedef struct block_factors { /* per float; what leaves it as it is where no pixel saw the texel */
  float keep1[BLOCK_FLOATS], keep2[BLOCK_FLOATS], rate[BLOCK_FLOATS], correction[BLOCK_FLOATS];
} block_factors;

static int is_seen(float *g) {
  int finite = isfinite(g[0]) && isfinite(g[1]) && isfinite(g[2]);
  for (int k = 0; k < 3 && !finite; k++)
    g[k] = 0.0f;
  return g[0] != 0.0f || g[1] != 0.0f || g[2] != 0.0f;
}

static void find_factors(const update_job *job, int64_t first, int64_t count, block_factors *out) {
  pags_sky_fit *f = job->fit;
  for (int64_t i = 0; i < count; i++) {
    uint16_t *visits = f->visits + first + i;
    int seen = is_seen(f->gradient + 3 * (first + i));
    if (seen && *visits < UINT16_MAX)
      ++*visits;
    const float *c = f->correction[*visits < CORRECTIONS ? *visits : CORRECTIONS - 1];
    for (int64_t k = 3 * i; k < 3 * i + 3; k++) {
      out->keep1[k] = seen ? job->beta1 : 1.0f;
      out->keep2[k] = seen ? job->beta2 : 1.0f;
      out->rate[k] = seen ? job->rate * c[0] : 0.0f;
      out->correction[k] = c[1];
    }
  }
}

/* Without a branch, for compilers to make vectors of. */
static void update_block(const update_job *job, int64_t first_texel, int64_t texels) {
  pags_sky_fit *f = job->fit;
  const int64_t at = 3 * first_texel, count = 3 * texels;
  const float epsilon = job->epsilon;
  block_factors by;
  float *restrict first = f->first + at, *restrict second = f->second + at, *restrict colour = f->sky.texels + at;
  float *restrict gradient = f->gradient + at;
  find_factors(job, first_texel, texels, &by);
  for (int64_t i = 0; i < count; i++) {
    const float g = gradient[i];
    first[i] = by.keep1[i] * first[i] + (1.0f - by.keep1[i]) * g;
    second[i] = by.keep2[i] * second[i] + (1.0f - by.keep2[i]) * g * g;
    colour[i] -= by.rate[i] * first[i] / (sqrtf(second[i] * by.correction[i]) + epsilon);
    gradient[i] = 0.0f;
  }
}

static void update_blocks(void *context, int64_t begin, int64_t end, int worker) {
  const update_job *job = context;
  pags_sky_fit *f = job->fit;
  int64_t texels = 6 * (int64_t)f->sky.size * f->sky.size;
  (void)worker;
  for (int64_t block = begin; block < end; block++) {
    int64_t first = block * PAGS_SKY_BLOCK, last = first + PAGS_SKY_BLOCK < texels ? first + PAGS_SKY_BLOCK : texels;
    if (!f->blocks[block])
      continue;
    update_block(job, first, last - first);
    f->blocks[block] = 0;
  }
}

static pags_result make_corrections(pags_sky_fit *fit, const pags_train_config *c) {
  double power1 = 1.0, power2 = 1.0;
  fit->correction = malloc(CORRECTIONS * sizeof *fit->correction);
  if (!fit->correction)
    return pags_fail(PAGS_ERROR_MEMORY, "no memory for the sky's optimiser");
  fit->correction[0][0] = fit->correction[0][1] = 1.0f;
  for (int k = 1; k < CORRECTIONS; k++) {
    power1 *= c->beta1;
    power2 *= c->beta2;
    fit->correction[k][0] = (float)(1.0 / (1.0 - power1));
    fit->correction[k][1] = (float)(1.0 / (1.0 - power2));
  }
  return PAGS_OK;
}

pags_result pags_sky_fit_update(pags_sky_fit *fit, const pags_schedule *schedule, int64_t step, pags_tasks *tasks) {
  const pags_train_config *c = &schedule->config;
  double t = fmin((double)step / (double)schedule->length, 1.0);
  if (!fit->correction)
    PAGS_TRY(make_corrections(fit, c));
  update_job job = {.fit = fit,
                    .beta1 = (float)c->beta1,
                    .beta2 = (float)c->beta2,
                    .rate = (float)(c->sky_rate * pow(final_share, t)),
                    .epsilon = 1e-15f};
  return pags_parallel_for(tasks, block_count(fit->sky.size), BLOCK_GRAIN, update_blocks, &job)
             ? PAGS_OK
             : pags_fail(PAGS_CANCELLED, "cancelled");
}
