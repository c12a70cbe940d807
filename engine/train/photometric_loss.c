/* SPDX-License-Identifier: Apache-2.0 */
/* Evaluates the photometric loss in parallel: splits the picture into bands of rows, one block per band and channel,
 * and adds the bands' sums in order. The arithmetic is in simd/ssim.c. */
#include "train/photometric_loss.h"

#include <assert.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "simd/kernels.h"

/* Rows of a band: few enough for all threads to get work, enough that the 20 extra rows around a band (for SSIM's
 * window and its gradient) cost little. MOST_ROWS unless there are more workers than such bands; never below
 * LEAST_ROWS. Sums are those of each row, added up over SUMMED rows of a channel, then over the channels of these rows,
 * whatever the bands are. */
enum { MOST_ROWS = 96, LEAST_ROWS = 16, SUMMED = 96 };

typedef struct loss_job {
  const pags_kernels *kernels;
  pags_tasks *tasks;
  const pags_picture *picture;
  const pags_photo *photo;
  const pags_comparison *how;
  float *const *gradient;
  float l1_scale, ssim_scale;
  int band;                       /* rows of a band */
  double (*sums)[PAGS_LOSS_SUMS]; /* per channel and row */
  bool *done;                     /* per band and channel */
} loss_job;

pags_result pags_photo_check_size(const pags_picture *picture, const pags_photo *photo) {
  if (picture->width == photo->width && picture->height == photo->height && picture->stride == photo->stride)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT, "expected a photograph of the picture's %dx%d pixels, got %dx%d",
                   picture->width, picture->height, photo->width, photo->height);
}

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
  const int channel = (int)(block % 3), begin = (int)(block / 3) * job->band;
  pags_arena *arena = pags_tasks_arena(job->tasks, worker);
  const pags_arena_mark mark = pags_arena_save(arena);
  pags_loss_rows rows = {
      .width = photo->width,
      .height = photo->height,
      .begin = begin,
      .end = begin + job->band < photo->height ? begin + job->band : photo->height,
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
      .sums = job->sums + (int64_t)channel * photo->height + begin,
  };
  if (rows.scratch)
    job->kernels->loss_rows(&rows);
  job->done[block] = rows.scratch != NULL;
  pags_arena_release(arena, mark);
}

static void run_blocks(void *context, int64_t begin, int64_t end, int worker) {
  for (int64_t block = begin; block < end; block++)
    run_block(context, block, worker);
}

/* Adds up the rows' sums in the order that the comment of SUMMED tells. */
static void add_up(const loss_job *job, int64_t counted, pags_photometric_loss *out) {
  const double ssim_weight = job->how->ssim_weight;
  const int height = job->photo->height;
  double total[PAGS_LOSS_SUMS] = {0.0};
  *out = (pags_photometric_loss){.counted = counted};
  for (int begin = 0; begin < height; begin += SUMMED)
    for (int c = 0; c < 3; c++) {
      double some[PAGS_LOSS_SUMS] = {0.0};
      for (int y = begin; y < begin + SUMMED && y < height; y++)
        for (int k = 0; k < PAGS_LOSS_SUMS; k++)
          some[k] += job->sums[(int64_t)c * height + y][k];
      for (int k = 0; k < PAGS_LOSS_SUMS; k++)
        total[k] += some[k];
      out->by_exposure[c] += some[PAGS_LOSS_BY_GAIN];
      out->by_exposure[3 + c] += some[PAGS_LOSS_BY_OFFSET];
    }
  if (counted) {
    const double values = 3.0 * (double)counted;
    out->l1 = total[PAGS_LOSS_L1] / values;
    out->mse = total[PAGS_LOSS_SQUARED] / values;
    out->ssim = total[PAGS_LOSS_SSIM] / values;
    out->loss = (1.0 - ssim_weight) * (out->l1 + total[PAGS_LOSS_MORE_L1] / values) +
                ssim_weight * (1.0 - out->ssim + total[PAGS_LOSS_MORE_DSSIM] / values);
  }
}

static pags_result evaluate(loss_job *job, pags_photometric_loss *out) {
  const double ssim_weight = job->how->ssim_weight;
  const int height = job->photo->height, workers = pags_tasks_workers(job->tasks);
  /* Each worker gets a band of one channel, within the limits. */
  const int bands = workers / 3 > 1 ? workers / 3 : 1, rows = (height + bands - 1) / bands;
  job->band = rows < LEAST_ROWS ? LEAST_ROWS : rows > MOST_ROWS ? MOST_ROWS : rows;
  const int64_t blocks = 3 * (((int64_t)height + job->band - 1) / job->band), counted = pags_photo_counted(job->photo);
  if (counted) {
    job->l1_scale = (float)((1.0 - ssim_weight) / (3.0 * (double)counted));
    job->ssim_scale = (float)(-ssim_weight / (3.0 * (double)counted));
  }
  pags_arena *const arena = pags_tasks_arena(job->tasks, 0);
  job->sums = pags_arena_alloc(arena, 3 * (size_t)height, sizeof *job->sums);
  job->done = pags_arena_alloc(arena, (size_t)blocks, sizeof *job->done);
  PAGS_CHECK_MEMORY(job->sums && job->done, "the loss of a picture %d pixels high", height);
  PAGS_TRY(pags_parallel_run(job->tasks, blocks, 1, run_blocks, job));
  for (int64_t b = 0; b < blocks; b++)
    PAGS_CHECK_MEMORY(job->done[b], "the loss of a picture %d pixels wide", job->photo->width);
  add_up(job, counted, out);
  return PAGS_OK;
}

pags_result pags_photometric_loss_evaluate(pags_tasks *tasks, const pags_picture *picture, const pags_photo *photo,
                                           const pags_comparison *how, float *const gradient[3],
                                           pags_photometric_loss *out) {
  assert(how->times >= 1.0 && how->ssim_weight >= 0.0 && how->ssim_weight <= 1.0);
  PAGS_TRY(pags_photo_check_size(picture, photo));
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
