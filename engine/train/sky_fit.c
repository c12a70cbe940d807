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

static void update_texel(const update_job *job, int64_t texel) {
  pags_sky_fit *f = job->fit;
  const float *g = f->gradient + 3 * texel;
  if ((g[0] == 0.0f && g[1] == 0.0f && g[2] == 0.0f) || !isfinite(g[0]) || !isfinite(g[1]) || !isfinite(g[2]))
    return; /* out of view: left alone, moments too */
  if (f->visits[texel] < UINT16_MAX)
    f->visits[texel]++;
  const float *c = f->correction[f->visits[texel] < CORRECTIONS ? f->visits[texel] : CORRECTIONS - 1];
  for (int64_t i = 3 * texel; i < 3 * texel + 3; i++) {
    f->first[i] = job->beta1 * f->first[i] + (1.0f - job->beta1) * f->gradient[i];
    f->second[i] = job->beta2 * f->second[i] + (1.0f - job->beta2) * f->gradient[i] * f->gradient[i];
    f->sky.texels[i] -= job->rate * f->first[i] * c[0] / (sqrtf(f->second[i] * c[1]) + job->epsilon);
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
    for (int64_t texel = first; texel < last; texel++)
      update_texel(job, texel);
    memset(f->gradient + 3 * first, 0, 3 * (size_t)(last - first) * sizeof(float));
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
