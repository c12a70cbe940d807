/* SPDX-License-Identifier: Apache-2.0 */
/* The layers of SqueezeNet 1.1 and AlexNet, see layers.h. The parallel loops run over rows of the output: one row of
 * all output channels needs only the few rows of the input below its windows, which stay in the cache while the
 * channels are computed. */
#include "eval/layers.h"

#include <stdlib.h>

#include "base/memory.h"

pags_result pags_map_create(pags_map *map, int channels, int width, int height, int phases) {
  const int64_t across = ((int64_t)width + phases - 1) / phases + 2 * PAGS_MAP_BORDER;
  const int64_t stride = (across + 15) / 16 * 16;
  *map = (pags_map){.channels = channels, .width = width, .height = height, .phases = phases, .stride = stride};
  map->plane = stride * ((int64_t)height + 2 * PAGS_MAP_BORDER);
  map->base = calloc((size_t)(map->plane * channels * phases), sizeof(float));
  PAGS_CHECK_MEMORY(map->base, "LPIPS: %d planes of %dx%d", channels, width, height);
  return PAGS_OK;
}

void pags_map_destroy(pags_map *map) {
  free(map->base);
  *map = (pags_map){0};
}

/* ---- Convolution ---- */

enum { TAPS = 8 }; /* taps whose weights and addresses fit into registers */

/* out[x] += sum over k of w[k] * in[offset[k] + x], k = 0..7. */
static void add_taps(float *restrict out, int width, const float *in, const int64_t offset[TAPS], const float w[TAPS]) {
  const float *t0 = in + offset[0], *t1 = in + offset[1], *t2 = in + offset[2], *t3 = in + offset[3],
              *t4 = in + offset[4], *t5 = in + offset[5], *t6 = in + offset[6], *t7 = in + offset[7];
  const float w0 = w[0], w1 = w[1], w2 = w[2], w3 = w[3], w4 = w[4], w5 = w[5], w6 = w[6], w7 = w[7];
  for (int x = 0; x < width; x++) {
    float s = out[x];
    s += w0 * t0[x];
    s += w1 * t1[x];
    s += w2 * t2[x];
    s += w3 * t3[x];
    s += w4 * t4[x];
    s += w5 * t5[x];
    s += w6 * t6[x];
    s += w7 * t7[x];
    out[x] = s;
  }
}

static void add_tap(float *restrict out, int width, const float *in, float w) {
  for (int x = 0; x < width; x++)
    out[x] += w * in[x];
}

static void fill(float *row, int width, float value) {
  for (int x = 0; x < width; x++)
    row[x] = value;
}

typedef struct conv_job {
  const pags_map *in, *out;
  const pags_conv *conv;
  int first;             /* channel of `out` that the convolution's first output goes to */
  int taps;              /* of a window, all input channels together */
  const int64_t *offset; /* of each tap, in the order of the weights, from the first column of the window's first row */
} conv_job;

static void conv_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const conv_job *job = context;
  const int width = job->out->width, taps = job->taps;
  for (int y = (int)begin; y < (int)end; y++)
    for (int o = 0; o < job->conv->outputs; o++) {
      const float *in = pags_map_row(job->in, 0, job->conv->step * y);
      const float *weight = job->conv->weight + (int64_t)o * taps;
      float *row = pags_map_row(job->out, job->first + o, y);
      fill(row, width, job->conv->bias[o]);
      int t = 0;
      for (; t + TAPS <= taps; t += TAPS)
        add_taps(row, width, in, job->offset + t, weight + t);
      for (; t < taps; t++)
        add_tap(row, width, in + job->offset[t], weight[t]);
      for (int x = 0; x < width; x++) /* ReLU */
        row[x] = row[x] > 0.0f ? row[x] : 0.0f;
    }
}

/* Convolves into the channels of `out` from `first` on. */
static pags_result convolve(const pags_map *in, const pags_conv *conv, int first, pags_tasks *tasks,
                            const pags_map *out) {
  const int step = conv->step, taps = conv->inputs * conv->size * conv->size;
  PAGS_AUTOFREE int64_t *offset = malloc((size_t)taps * sizeof *offset);
  int64_t *at = offset;
  PAGS_CHECK_MEMORY(offset, "LPIPS: a convolution of %d channels", conv->inputs);
  for (int c = 0; c < conv->inputs; c++)
    for (int y = -conv->padding; y < conv->size - conv->padding; y++)
      for (int x = -conv->padding; x < conv->size - conv->padding; x++) {
        const int phase = (x % step + step) % step;
        *at++ = (c + in->channels * phase) * in->plane + y * in->stride + (x - phase) / step;
      }
  conv_job job = {.in = in, .out = out, .conv = conv, .first = first, .taps = taps, .offset = offset};
  return pags_parallel_for(tasks, out->height, 1, conv_rows, &job) ? PAGS_OK
                                                                   : pags_fail(PAGS_CANCELLED, "LPIPS: cancelled");
}

pags_result pags_layer_conv(const pags_map *in, const pags_conv *conv, pags_tasks *tasks, pags_map *out) {
  const int more = 2 * conv->padding - conv->size;
  PAGS_TRY(pags_map_create(out, conv->outputs, (in->width + more) / conv->step + 1,
                           (in->height + more) / conv->step + 1, 1));
  return convolve(in, conv, 0, tasks, out);
}

pags_result pags_layer_fire(const pags_map *in, const pags_fire *fire, pags_tasks *tasks, pags_map *out) {
  PAGS_AUTO(pags_map_destroy) pags_map squeezed = {0};
  PAGS_TRY(pags_layer_conv(in, &fire->squeeze, tasks, &squeezed));
  PAGS_TRY(pags_map_create(out, fire->expand1.outputs + fire->expand3.outputs, in->width, in->height, 1));
  PAGS_TRY(convolve(&squeezed, &fire->expand1, 0, tasks, out));
  return convolve(&squeezed, &fire->expand3, fire->expand1.outputs, tasks, out);
}

/* ---- Max pooling ---- */

typedef struct pool_job {
  const pags_map *in, *out;
} pool_job;

static void pool_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const pool_job *job = context;
  const pags_map *in = job->in, *out = job->out;
  for (int y = (int)begin; y < (int)end; y++)
    for (int c = 0; c < out->channels; c++) {
      float *row = pags_map_row(out, c, y);
      /* After ReLU no value is negative, so that a maximum over part of a window may start from 0. */
      fill(row, out->width, 0.0f);
      for (int k = 0; k < 3 && 2 * y + k < in->height; k++) {
        const float *from = pags_map_row(in, c, 2 * y + k);
        for (int x = 0; x < out->width; x++)
          for (int j = 0; j < 3 && 2 * x + j < in->width; j++)
            row[x] = row[x] > from[2 * x + j] ? row[x] : from[2 * x + j];
      }
    }
}

static int pooled(int extent, bool partial) {
  return (extent - 3 + partial) / 2 + 1;
}

pags_result pags_layer_pool(const pags_map *in, bool partial, pags_tasks *tasks, pags_map *out) {
  PAGS_TRY(pags_map_create(out, in->channels, pooled(in->width, partial), pooled(in->height, partial), 1));
  pool_job job = {.in = in, .out = out};
  return pags_parallel_for(tasks, out->height, 1, pool_rows, &job) ? PAGS_OK
                                                                   : pags_fail(PAGS_CANCELLED, "LPIPS: cancelled");
}
