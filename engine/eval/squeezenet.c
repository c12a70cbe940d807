/* SPDX-License-Identifier: Apache-2.0 */
/* The layers of SqueezeNet 1.1, see squeezenet.h. The parallel loops run over rows of the output: one row of all
 * output channels needs only three rows of the input, which stay in the cache while the channels are computed. */
#include "eval/squeezenet.h"

#include <stdlib.h>

#include "base/memory.h"

pags_result pags_map_create(pags_map *map, int channels, int width, int height) {
  int64_t stride = ((int64_t)width + 2 + 15) / 16 * 16;
  *map = (pags_map){.channels = channels, .width = width, .height = height, .stride = stride};
  map->plane = stride * ((int64_t)height + 2);
  map->base = calloc((size_t)(map->plane * channels), sizeof(float));
  if (!map->base)
    return pags_out_of_memory("LPIPS: %d planes of %dx%d", channels, width, height);
  return PAGS_OK;
}

void pags_map_destroy(pags_map *map) {
  free(map->base);
  *map = (pags_map){0};
}

/* out[x] += sum over k of w[k] * tap[k][x], k = 0..8. */
static void add_nine(float *restrict out, int width, const float *const tap[9], const float w[9]) {
  const float *t0 = tap[0], *t1 = tap[1], *t2 = tap[2], *t3 = tap[3], *t4 = tap[4], *t5 = tap[5], *t6 = tap[6],
              *t7 = tap[7], *t8 = tap[8];
  const float w0 = w[0], w1 = w[1], w2 = w[2], w3 = w[3], w4 = w[4], w5 = w[5], w6 = w[6], w7 = w[7], w8 = w[8];
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
    s += w8 * t8[x];
    out[x] = s;
  }
}

/* out[x] += sum over k of w[k] * in[k * plane + x], k = 0..7: eight input channels of a 1x1 convolution. */
static void add_eight(float *restrict out, int width, const float *in, int64_t plane, const float w[8]) {
  const float *t0 = in, *t1 = in + plane, *t2 = in + 2 * plane, *t3 = in + 3 * plane, *t4 = in + 4 * plane,
              *t5 = in + 5 * plane, *t6 = in + 6 * plane, *t7 = in + 7 * plane;
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

static void fill(float *row, int width, float value) {
  for (int x = 0; x < width; x++)
    row[x] = value;
}

static void rectify(float *row, int width) {
  for (int x = 0; x < width; x++)
    row[x] = row[x] > 0.0f ? row[x] : 0.0f;
}

typedef struct layer_job {
  const pags_map *in, *out;
  const pags_conv *conv;
  int first_channel; /* channel of `out` that the convolution's first output goes to */
} layer_job;

static void first_rows(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const layer_job *job = context;
  const pags_conv *conv = job->conv;
  for (int y = (int)begin; y < (int)end; y++)
    for (int o = 0; o < conv->outputs; o++) {
      float *row = pags_map_row(job->out, o, y);
      fill(row, job->out->width, conv->bias[o]);
      for (int c = 0; c < 3; c++) {
        const float *tap[9];
        for (int k = 0; k < 3; k++) { /* input columns 2x, 2x + 1, 2x + 2 */
          tap[3 * k] = pags_map_row(job->in, c, 2 * y + k);
          tap[3 * k + 1] = pags_map_row(job->in, 3 + c, 2 * y + k);
          tap[3 * k + 2] = tap[3 * k] + 1;
        }
        add_nine(row, job->out->width, tap, conv->weight + (o * 3 + c) * 9);
      }
      rectify(row, job->out->width);
    }
}

/* A 1x1 convolution. In SqueezeNet its number of input channels is always a multiple of 8. */
static void conv1_rows(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const layer_job *job = context;
  const pags_conv *conv = job->conv;
  for (int y = (int)begin; y < (int)end; y++)
    for (int o = 0; o < conv->outputs; o++) {
      float *row = pags_map_row(job->out, job->first_channel + o, y);
      fill(row, job->out->width, conv->bias[o]);
      for (int i = 0; i < conv->inputs; i += 8)
        add_eight(row, job->out->width, pags_map_row(job->in, i, y), job->in->plane,
                  conv->weight + o * conv->inputs + i);
      rectify(row, job->out->width);
    }
}

static void conv3_rows(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const layer_job *job = context;
  const pags_conv *conv = job->conv;
  for (int y = (int)begin; y < (int)end; y++)
    for (int o = 0; o < conv->outputs; o++) {
      float *row = pags_map_row(job->out, job->first_channel + o, y);
      fill(row, job->out->width, conv->bias[o]);
      for (int i = 0; i < conv->inputs; i++) {
        const float *tap[9];
        for (int k = 0; k < 9; k++)
          tap[k] = pags_map_row(job->in, i, y + k / 3 - 1) + k % 3 - 1;
        add_nine(row, job->out->width, tap, conv->weight + (o * conv->inputs + i) * 9);
      }
      rectify(row, job->out->width);
    }
}

static void pool_rows(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const layer_job *job = context;
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

static pags_result run(pags_block_fn *rows, const layer_job *job, pags_tasks *tasks) {
  layer_job copy = *job;
  if (!pags_parallel_for(tasks, job->out->height, 1, rows, &copy))
    return pags_fail(PAGS_CANCELLED, "LPIPS: cancelled");
  return PAGS_OK;
}

pags_result pags_layer_first(const pags_map *in, int width, const pags_conv *conv, pags_tasks *tasks, pags_map *out) {
  PAGS_TRY(pags_map_create(out, conv->outputs, (width - 3) / 2 + 1, (in->height - 3) / 2 + 1));
  layer_job job = {.in = in, .out = out, .conv = conv};
  return run(first_rows, &job, tasks);
}

pags_result pags_layer_fire(const pags_map *in, const pags_fire *fire, pags_tasks *tasks, pags_map *out) {
  pags_map squeezed = {0};
  pags_result result = pags_map_create(&squeezed, fire->squeeze.outputs, in->width, in->height);
  if (result == PAGS_OK)
    result = pags_map_create(out, fire->expand1.outputs + fire->expand3.outputs, in->width, in->height);
  if (result == PAGS_OK) {
    layer_job job = {.in = in, .out = &squeezed, .conv = &fire->squeeze};
    result = run(conv1_rows, &job, tasks);
  }
  if (result == PAGS_OK) {
    layer_job job = {.in = &squeezed, .out = out, .conv = &fire->expand1};
    result = run(conv1_rows, &job, tasks);
  }
  if (result == PAGS_OK) {
    layer_job job = {.in = &squeezed, .out = out, .conv = &fire->expand3, .first_channel = fire->expand1.outputs};
    result = run(conv3_rows, &job, tasks);
  }
  pags_map_destroy(&squeezed);
  return result;
}

static int pooled(int extent) {
  return (extent - 3 + 1) / 2 + 1;
}

pags_result pags_layer_pool(const pags_map *in, pags_tasks *tasks, pags_map *out) {
  PAGS_TRY(pags_map_create(out, in->channels, pooled(in->width), pooled(in->height)));
  layer_job job = {.in = in, .out = out};
  return run(pool_rows, &job, tasks);
}
