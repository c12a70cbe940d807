/* SPDX-License-Identifier: Apache-2.0 */
/* Shrinks images by area averaging. For each output row, the source rows are first summed into a row of floats, then
 * that row's columns. The sums are taken in a fixed order. */
#include <assert.h>
#include <math.h>

#include "base/memory.h"
#include "image/pixels.h"
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
  const size_t count = (size_t)from->width * (size_t)from->channels;
  float total = 0;
  memset(row, 0, count * sizeof *row);
  for (int y = s->first; y < s->last; y++) {
    const uint8_t *source = (const uint8_t *)from->data + (size_t)y * count;
    const float weight = weight_of(s, y);
    total += weight;
    for (size_t i = 0; i < count; i++)
      row[i] += weight * (float)source[i];
  }
  return total;
}

pags_result pags_shrink_mean(const pags_image *from, double step_x, double step_y, pags_image *to) {
  assert(from->sample == PAGS_U8 && to->sample == PAGS_U8 && from->channels == to->channels);
  assert(step_x >= 1 && step_y >= 1);
  const int channels = from->channels;
  /* The spans of a row's output pixels, which are the same in every row, and the weights of their source pixels: of all
   * of the first span, then of the second, ... */
  PAGS_AUTOFREE span *spans = malloc((size_t)to->width * sizeof *spans);
  PAGS_AUTOFREE float *weights = malloc(((size_t)from->width + 2 * (size_t)to->width) * sizeof *weights);
  PAGS_AUTOFREE float *row = malloc((size_t)from->width * (size_t)channels * sizeof *row);
  PAGS_CHECK_MEMORY(spans && weights && row, "a row of %d pixels", from->width);
  float *next = weights;
  for (int x = 0; x < to->width; x++) {
    spans[x] = span_of(x, step_x, from->width);
    for (int i = spans[x].first; i < spans[x].last; i++)
      *next++ = weight_of(&spans[x], i);
  }
  uint8_t *out = to->data;
  for (int y = 0; y < to->height; y++) {
    const span sy = span_of(y, step_y, from->height);
    const float row_weight = sum_rows(from, &sy, row), *weight = weights;
    for (int x = 0; x < to->width; x++) {
      const int last = spans[x].last;
      float sum[4] = {0}, total = 0;
      for (int i = spans[x].first; i < last; i++, weight++) {
        total += *weight;
        for (int c = 0; c < channels; c++)
          sum[c] += *weight * row[i * channels + c];
      }
      const float scale = 1 / (total * row_weight);
      for (int c = 0; c < channels; c++) {
        const float value = sum[c] * scale;
        *out++ = (uint8_t)(value > 254.5f ? 255 : value + 0.5f);
      }
    }
  }
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
