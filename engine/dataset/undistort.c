/* SPDX-License-Identifier: Apache-2.0 */
/* Undistorts a photograph and its mask row by row by bilinear resampling through the distortion model. The stored
 * (display-referred) values are interpolated without conversion to linear light.
 *
 * The centre of output pixel (x, y) lies at (x + 0.5, y + 0.5). The distortion model maps its ray to a source
 * position (u, v), which lies between the four source pixels whose centres surround it. Within half a pixel of the
 * border, the outermost source pixels are repeated. */
#include "dataset/internal.h"

#include <assert.h>
#include <stdlib.h>

#include "base/memory.h"

/* Bilinear weights are fixed-point numbers with FRACTION bits per direction, far finer than a step of a byte. The
 * four weights of a pixel add up to exactly `unit`. */
enum { FRACTION = 10 };
static const uint32_t unit = UINT32_C(1) << 2 * FRACTION;

typedef struct taps {
  size_t at[4]; /* indices of the four source pixels */
  uint32_t weight[4];
} taps;

static int clamp(int value, int size) {
  return value < 0 ? 0 : value >= size ? size - 1 : value;
}

/* Computes the four source pixels and their weights at position (u, v); returns false if (u, v) lies outside of the
 * picture. */
static bool find_taps(const pags_lens *lens, double u, double v, taps *out) {
  if (!(u >= 0 && u <= lens->width && v >= 0 && v <= lens->height))
    return false;
  const int whole = 1 << FRACTION;
  int fixed_u = (int)((u + 0.5) * whole), fixed_v = (int)((v + 0.5) * whole); /* at most 2^26 */
  int x = (fixed_u >> FRACTION) - 1, y = (fixed_v >> FRACTION) - 1;
  uint32_t right_share = (uint32_t)(fixed_u & (whole - 1)), low_share = (uint32_t)(fixed_v & (whole - 1));
  uint32_t left_share = (uint32_t)whole - right_share, high_share = (uint32_t)whole - low_share;
  size_t left = (size_t)clamp(x, lens->width), right = (size_t)clamp(x + 1, lens->width);
  size_t top = (size_t)clamp(y, lens->height) * (size_t)lens->width;
  size_t bottom = (size_t)clamp(y + 1, lens->height) * (size_t)lens->width;
  *out = (taps){
      .at = {top + left, top + right, bottom + left, bottom + right},
      .weight = {left_share * high_share, right_share * high_share, left_share * low_share, right_share * low_share}};
  return true;
}

static void mix(const uint8_t *from, const taps *t, uint8_t to[3]) {
  const uint8_t *a = from + 3 * t->at[0], *b = from + 3 * t->at[1], *c = from + 3 * t->at[2], *d = from + 3 * t->at[3];
  for (int i = 0; i < 3; i++) {
    uint32_t sum = t->weight[0] * a[i] + t->weight[1] * b[i] + t->weight[2] * c[i] + t->weight[3] * d[i];
    to[i] = (uint8_t)((sum + unit / 2) / unit);
  }
}

static bool mask_uses(const uint8_t *mask, const taps *t) {
  for (int i = 0; i < 4; i++)
    if (mask[t->at[i]] < 128 && t->weight[i] > 0)
      return false;
  return true;
}

pags_result pags_undistort(const pags_lens *lens, const pags_camera *pinhole, const pags_image *from,
                           const pags_image *from_mask, pags_image *to, pags_image *to_mask) {
  assert(from->sample == PAGS_U8 && from->channels == 3 && from->width == lens->width && from->height == lens->height);
  assert(!from_mask || (from_mask->sample == PAGS_U8 && from_mask->channels == 1));
  assert(!from_mask || (from_mask->width == lens->width && from_mask->height == lens->height));
  *to = *to_mask = (pags_image){0};
  PAGS_AUTOFREE double *source = malloc((size_t)pinhole->width * 2 * sizeof *source); /* two numbers per pixel */
  PAGS_CHECK_MEMORY(source, "a row of %d pixels", pinhole->width);
  PAGS_TRY(pags_image_create(to, pinhole->width, pinhole->height, 3, PAGS_U8));
  PAGS_TRY(pags_image_create(to_mask, pinhole->width, pinhole->height, 1, PAGS_U8));
  const double step = 1 / pinhole->fx, first = (0.5 - pinhole->cx) * step;
  uint8_t *out = to->data, *mask = to_mask->data;
  bool complete = true; /* every pixel has a source */
  for (int y = 0; y < pinhole->height; y++) {
    pags_lens_project_row(lens, pinhole->width, first, step, (y + 0.5 - pinhole->cy) / pinhole->fy, source);
    for (int x = 0; x < pinhole->width; x++, out += 3) {
      taps t;
      const bool has_source = find_taps(lens, source[2 * x], source[2 * x + 1], &t);
      if (has_source)
        mix(from->data, &t, out);
      complete = complete && has_source;
      *mask++ = has_source && (!from_mask || mask_uses(from_mask->data, &t)) ? 255 : 0;
    }
  }
  if (complete && !from_mask)
    pags_image_destroy(to_mask);
  return PAGS_OK;
}

pags_result pags_undistort_labels(const pags_lens *lens, const pags_camera *pinhole, const pags_image *from,
                                  pags_image *to) {
  assert(from->sample == PAGS_U8 && from->channels == 1 && from->width == lens->width && from->height == lens->height);
  PAGS_AUTOFREE double *source = malloc((size_t)pinhole->width * 2 * sizeof *source);
  PAGS_CHECK_MEMORY(source, "a row of %d pixels", pinhole->width);
  PAGS_TRY(pags_image_create(to, pinhole->width, pinhole->height, 1, PAGS_U8));
  const double step = 1 / pinhole->fx;
  const uint8_t *labels = from->data;
  uint8_t *out = to->data;
  for (int y = 0; y < pinhole->height; y++) {
    pags_lens_project_row(lens, pinhole->width, (0.5 - pinhole->cx) * step, step, (y + 0.5 - pinhole->cy) / pinhole->fy,
                          source);
    for (int x = 0; x < pinhole->width; x++, out++) {
      double u = source[2 * x], v = source[2 * x + 1];
      if (u >= 0 && u <= lens->width && v >= 0 && v <= lens->height)
        *out = labels[(size_t)clamp((int)v, lens->height) * (size_t)lens->width + (size_t)clamp((int)u, lens->width)];
    }
  }
  return PAGS_OK;
}
