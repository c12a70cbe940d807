/* SPDX-License-Identifier: Apache-2.0 */
/* Shrinks images by area averaging. For each output row, the source rows are first summed into a row of floats, then
 * that row's columns. The sums are taken in a fixed order. */
#include "image/resample.h"

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "base/memory.h"
#include "maths/maths.h"

/* The source pixels [first, last) that the interval [begin, end) = [index * step, (index + 1) * step) of an output
 * pixel touches. Ends that miss an integer only by rounding are set to that integer, so that shrinking 540 to 270
 * never reads a third pixel of weight 1e-13. */
typedef struct span {
  int first, last;
  double begin, end;
} span;

static double snap(double value) {
  double whole = pags_round(value);
  return fabs(value - whole) < 1e-6 ? whole : value;
}

static span span_of(int index, double step, int size) {
  span s = {.begin = snap(index * step), .end = snap((index + 1) * step)};
  if (s.end > size)
    s.end = size;
  s.first = (int)floor(s.begin);
  s.last = (int)ceil(s.end);
  if (s.first > size - 1)
    s.first = size - 1;
  if (s.last <= s.first)
    s.last = s.first + 1;
  return s;
}

/* Length of the part of source pixel i, [i, i + 1), that lies in the span. */
static float weight_of(const span *s, int i) {
  double begin = s->begin > i ? s->begin : i, end = s->end < i + 1 ? s->end : i + 1;
  return end > begin ? (float)(end - begin) : 0;
}

/* Sets `row` to the weighted sum of the span's source rows; returns the sum of the weights. */
static float sum_rows(const pags_image *from, const span *s, float *row) {
  size_t count = (size_t)from->width * (size_t)from->channels;
  float total = 0;
  for (size_t i = 0; i < count; i++)
    row[i] = 0;
  for (int y = s->first; y < s->last; y++) {
    const uint8_t *source = (const uint8_t *)from->data + (size_t)y * count;
    float weight = weight_of(s, y);
    total += weight;
    for (size_t i = 0; i < count; i++)
      row[i] += weight * (float)source[i];
  }
  return total;
}

/* The spans of a row's output pixels, which are the same in every row, and the weights of their source pixels. */
typedef struct columns {
  int *first, *last;
  float *weights; /* of all source pixels of the first span, then of the second, ... */
} columns;

/* Returns false if there is no memory. */
static bool find_columns(int width, double step, int count, columns *out) {
  out->first = malloc((size_t)count * sizeof *out->first);
  out->last = malloc((size_t)count * sizeof *out->last);
  out->weights = malloc(((size_t)width + 2 * (size_t)count) * sizeof *out->weights);
  if (!out->first || !out->last || !out->weights)
    return false;
  float *weight = out->weights;
  for (int x = 0; x < count; x++) {
    const span s = span_of(x, step, width);
    out->first[x] = s.first;
    out->last[x] = s.last;
    for (int i = s.first; i < s.last; i++)
      *weight++ = weight_of(&s, i);
  }
  return true;
}

static void destroy_columns(columns *c) {
  free(c->first);
  free(c->last);
  free(c->weights);
}

static uint8_t to_byte(float value) {
  return (uint8_t)(value > 254.5f ? 255 : value + 0.5f);
}

pags_result pags_shrink_mean(const pags_image *from, double step_x, double step_y, pags_image *to) {
  assert(from->sample == PAGS_U8 && to->sample == PAGS_U8 && from->channels == to->channels);
  assert(step_x >= 1 && step_y >= 1);
  int channels = from->channels;
  float *row = malloc((size_t)from->width * (size_t)channels * sizeof *row);
  columns spans = {0};
  if (!row || !find_columns(from->width, step_x, to->width, &spans)) {
    free(row);
    destroy_columns(&spans);
    return pags_out_of_memory("a row of %d pixels", from->width);
  }
  uint8_t *out = to->data;
  for (int y = 0; y < to->height; y++) {
    span sy = span_of(y, step_y, from->height);
    float row_weight = sum_rows(from, &sy, row);
    const float *weight = spans.weights;
    for (int x = 0; x < to->width; x++) {
      const int first = spans.first[x], last = spans.last[x];
      float sum[4] = {0}, total = 0;
      for (int i = first; i < last; i++, weight++) {
        total += *weight;
        for (int c = 0; c < channels; c++)
          sum[c] += *weight * row[i * channels + c];
      }
      float scale = 1 / (total * row_weight);
      for (int c = 0; c < channels; c++)
        *out++ = to_byte(sum[c] * scale);
    }
  }
  free(row);
  destroy_columns(&spans);
  return PAGS_OK;
}

static uint8_t all_used(const pags_image *from, const span *sx, const span *sy) {
  for (int y = sy->first; y < sy->last; y++)
    for (int x = sx->first; x < sx->last; x++)
      if (((const uint8_t *)from->data)[(size_t)y * (size_t)from->width + (size_t)x] < 128)
        return 0;
  return 255;
}

void pags_shrink_mask(const pags_image *from, double step_x, double step_y, pags_image *to) {
  assert(from->sample == PAGS_U8 && to->sample == PAGS_U8 && from->channels == 1 && to->channels == 1);
  assert(step_x >= 1 && step_y >= 1);
  uint8_t *out = to->data;
  for (int y = 0; y < to->height; y++) {
    span sy = span_of(y, step_y, from->height);
    for (int x = 0; x < to->width; x++) {
      span sx = span_of(x, step_x, from->width);
      *out++ = all_used(from, &sx, &sy);
    }
  }
}
