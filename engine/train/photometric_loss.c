/* SPDX-License-Identifier: Apache-2.0 */
/* Evaluates the photometric loss in parallel: splits the picture into bands of rows, one block per band and channel,
 * and adds the bands' sums in order. The arithmetic is in simd/ssim.inl. */
#include "train/photometric_loss.h"

#include <assert.h>
#include <string.h>

#include "base/memory.h"
#include "simd/kernels.h"

/* Rows of a band: few enough for all threads to get work, enough that the 20 extra rows around a band (for SSIM's
 * window and its gradient) cost little. */
enum { BAND = 96 };

typedef struct band_sums {
  double l1, squared, ssim, more_l1, more_dssim, by_exposure[2];
  int done;
} band_sums;

typedef struct loss_job {
  const pags_kernels *kernels;
  pags_tasks *tasks;
  const pags_picture *picture;
  const pags_photo *photo;
  const pags_comparison *how;
  float *const *gradient;
  float l1_scale, ssim_scale;
  band_sums *sums; /* one per block */
} loss_job;

int64_t pags_photo_counted(const pags_photo *photo) {
  if (!photo->mask)
    return (int64_t)photo->width * photo->height;
  int64_t counted = 0;
  for (int y = 0; y < photo->height; y++) {
    const uint8_t *row = photo->mask + (int64_t)y * photo->stride;
    for (int x = 0; x < photo->width; x++)
      counted += row[x] != 0;
  }
  return counted;
}

static void run_block(const loss_job *job, int64_t block, int worker) {
  const pags_photo *photo = job->photo;
  const int channel = (int)(block % 3), begin = (int)(block / 3) * BAND;
  pags_arena *arena = pags_tasks_arena(job->tasks, worker);
  const pags_arena_mark mark = pags_arena_save(arena);
  pags_loss_rows rows = {
      .width = photo->width,
      .height = photo->height,
      .begin = begin,
      .end = begin + BAND < photo->height ? begin + BAND : photo->height,
      .stride = photo->stride,
      .prediction = job->picture->rgb[channel],
      .exposure = {(float)job->how->exposure[channel], (float)job->how->exposure[3 + channel]},
      .target = photo->rgb + (int64_t)channel * photo->height * photo->stride,
      .mask = photo->mask,
      .emphasis = job->how->emphasis,
      .gain = (float)(job->how->times - 1.0),
      .gradient = job->gradient[channel],
      .l1_scale = job->l1_scale,
      .ssim_scale = job->ssim_scale,
      .scratch = pags_arena_alloc(arena, (size_t)pags_loss_scratch(photo->stride), sizeof(float)),
  };
  if (rows.scratch) {
    job->kernels->loss_rows(&rows);
    job->sums[block] = (band_sums){
        rows.l1, rows.squared, rows.ssim, rows.more_l1, rows.more_dssim, {rows.by_exposure[0], rows.by_exposure[1]}, 1};
  }
  pags_arena_release(arena, mark);
}

static void run_blocks(void *context, int64_t begin, int64_t end, int worker) {
  for (int64_t block = begin; block < end; block++)
    run_block(context, block, worker);
}

static pags_result add_up(const loss_job *job, int64_t blocks, int64_t counted, pags_photometric_loss *out) {
  const double ssim_weight = job->how->ssim_weight;
  double by_exposure[6] = {0.0}, l1 = 0.0, squared = 0.0, ssim = 0.0, more_l1 = 0.0, more_dssim = 0.0;
  for (int64_t b = 0; b < blocks; b++) {
    if (!job->sums[b].done)
      return pags_out_of_memory("the loss of a picture %d pixels wide", job->photo->width);
    l1 += job->sums[b].l1;
    squared += job->sums[b].squared;
    ssim += job->sums[b].ssim;
    more_l1 += job->sums[b].more_l1;
    more_dssim += job->sums[b].more_dssim;
    for (int k = 0; k < 2; k++)
      by_exposure[3 * k + b % 3] += job->sums[b].by_exposure[k];
  }
  *out = (pags_photometric_loss){.counted = counted};
  memcpy(out->by_exposure, by_exposure, sizeof by_exposure);
  if (counted) {
    const double values = 3.0 * (double)counted;
    out->l1 = l1 / values;
    out->mse = squared / values;
    out->ssim = ssim / values;
    out->loss =
        (1.0 - ssim_weight) * (out->l1 + more_l1 / values) + ssim_weight * (1.0 - out->ssim + more_dssim / values);
  }
  return PAGS_OK;
}

static pags_result evaluate(loss_job *job, pags_photometric_loss *out) {
  const double ssim_weight = job->how->ssim_weight;
  const int64_t blocks = 3 * (((int64_t)job->photo->height + BAND - 1) / BAND),
                counted = pags_photo_counted(job->photo);
  if (counted) {
    job->l1_scale = (float)((1.0 - ssim_weight) / (3.0 * (double)counted));
    job->ssim_scale = (float)(-ssim_weight / (3.0 * (double)counted));
  }
  job->sums = pags_arena_alloc(pags_tasks_arena(job->tasks, 0), (size_t)blocks, sizeof *job->sums);
  if (!job->sums)
    return pags_out_of_memory("the loss of a picture %d pixels high", job->photo->height);
  for (int64_t b = 0; b < blocks; b++)
    job->sums[b].done = 0;
  if (!pags_parallel_for(job->tasks, blocks, 1, run_blocks, job))
    return pags_fail(PAGS_CANCELLED, "cancelled");
  return add_up(job, blocks, counted, out);
}

pags_result pags_photometric_loss_evaluate(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                           const pags_comparison *how, float *const gradient[3],
                                           pags_photometric_loss *out) {
  assert(how->times >= 1.0 && how->ssim_weight >= 0.0 && how->ssim_weight <= 1.0);
  if (picture->width != photo->width || picture->height != photo->height || picture->stride != photo->stride)
    return pags_fail(PAGS_ERROR_ARGUMENT, "expected a photograph of the picture's %dx%d pixels, got %dx%d",
                     picture->width, picture->height, photo->width, photo->height);
  const char *why = "no vector kernels";
  loss_job job = {.kernels = pags_kernels_get(&why),
                  .tasks = tasks,
                  .picture = picture,
                  .photo = photo,
                  .how = how,
                  .gradient = gradient};
  if (!job.kernels)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s", why);
  /* The blocks that the calling thread (worker 0) computes allocate their scratch above what is allocated here, in
   * the same arena. */
  pags_arena *arena = pags_tasks_arena(tasks, 0);
  const pags_arena_mark mark = pags_arena_save(arena);
  pags_result result = evaluate(&job, out);
  pags_arena_release(arena, mark);
  return result;
}
