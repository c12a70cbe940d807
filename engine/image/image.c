/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures in memory: creation, and conversion of sample types and channels. */
#include <pags/image.h>

#include "base/memory.h"
#include "image/convert.h"
#include "image/encoded.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

/* ---- Creation ---- */

static size_t sample_bytes(pags_sample sample) {
  return sample == PAGS_U8 ? 1 : sample == PAGS_U16 ? 2 : 4;
}

pags_result pags_image_create(pags_image *image, int width, int height, int channels, pags_sample sample) {
  assert(image);
  memset(image, 0, sizeof *image);
  if (width < 1 || width > PAGS_IMAGE_MAX_SIDE || height < 1 || height > PAGS_IMAGE_MAX_SIDE || channels < 1 ||
      channels > 4)
    return pags_fail(PAGS_ERROR_ARGUMENT, "a picture of %d x %d pixels with %d channels: expected 1..%d and 1..4",
                     width, height, channels, PAGS_IMAGE_MAX_SIDE);
  /* At most 65535 * 65535 * 4 * 4 < 2^37, which overflows only a 32-bit size_t. */
  uint64_t bytes = (uint64_t)width * (uint64_t)height * (uint64_t)channels * sample_bytes(sample);
  image->data = bytes <= SIZE_MAX ? malloc((size_t)bytes) : NULL;
  if (!image->data)
    return pags_out_of_memory("a picture of %llu bytes", (unsigned long long)bytes);
  memset(image->data, 0, (size_t)bytes);
  image->width = width;
  image->height = height;
  image->channels = channels;
  image->sample = sample;
  return PAGS_OK;
}

void pags_image_destroy(pags_image *image) {
  if (!image)
    return;
  free(image->data);
  memset(image, 0, sizeof *image);
}

/* ---- Conversion ---- */

/* Returns sample `index` as a double; U8 and U16 are mapped to [0, 1]. All conversions go through such doubles, which
 * are exact enough that u8 -> u16 -> u8 gives the same bytes. */
static double sample_get(const void *data, pags_sample sample, size_t index) {
  if (sample == PAGS_U8)
    return ((const uint8_t *)data)[index] / 255.0;
  if (sample == PAGS_U16)
    return ((const uint16_t *)data)[index] / 65535.0;
  return (double)((const float *)data)[index];
}

/* Clamps to [0, 1]; NaN becomes 0. */
static double clamp01(double value) {
  return value > 0 ? (value < 1 ? value : 1) : 0;
}

/* Returns which channel of an image with `from` channels fills channel `c` of one with `to` channels: -1 for opaque
 * alpha, -2 for the luma of RGB. */
static int source_channel(int from, int to, int c) {
  int from_alpha = from == 2 || from == 4;
  int is_alpha = (to == 2 && c == 1) || (to == 4 && c == 3);
  if (is_alpha)
    return from_alpha ? from - 1 : -1;
  if (from <= 2)
    return 0;
  return to <= 2 ? -2 : c;
}

/* Luma by the Rec. 709 weights, applied to display-referred values: a grey version to look at or to threshold, not a
 * photometric luminance. */
static double luma(const void *data, pags_sample sample, size_t index) {
  return 0.2126 * sample_get(data, sample, index) + 0.7152 * sample_get(data, sample, index + 1) +
         0.0722 * sample_get(data, sample, index + 2);
}

static void convert(const pags_image *from, pags_image *to) {
  int n = from->channels, m = to->channels;
  size_t pixels = (size_t)from->width * (size_t)from->height;
  for (int c = 0; c < m; c++) {
    int source = source_channel(n, m, c);
    for (size_t i = 0; i < pixels; i++) {
      size_t at = i * (size_t)n;
      double value = source == -1   ? 1.0
                     : source == -2 ? luma(from->data, from->sample, at)
                                    : sample_get(from->data, from->sample, at + (size_t)source);

      /* Store the value in the sample type of `to`. */
      size_t index = i * (size_t)m + (size_t)c;
      if (to->sample == PAGS_U8)
        ((uint8_t *)to->data)[index] = (uint8_t)(clamp01(value) * 255 + 0.5);
      else if (to->sample == PAGS_U16)
        ((uint16_t *)to->data)[index] = (uint16_t)(clamp01(value) * 65535 + 0.5);
      else
        ((float *)to->data)[index] = (float)value;
    }
  }
}

pags_result pags_image_converted(const pags_image *from, pags_sample sample, int channels, pags_image *to) {
  PAGS_TRY(pags_image_create(to, from->width, from->height, channels, sample));
  convert(from, to);
  return PAGS_OK;
}

pags_result pags_image_convert(pags_image *image, pags_sample sample, int channels) {
  if (image->sample == sample && image->channels == channels)
    return PAGS_OK;
  pags_image out;
  PAGS_TRY(pags_image_converted(image, sample, channels, &out));
  pags_image_destroy(image);
  *image = out;
  return PAGS_OK;
}
