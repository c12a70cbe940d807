/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures in memory: creation, conversion of sample types and channels, and turning. */
#include <assert.h>

#include "base/memory.h"
#include "image/formats.h"
#include "image/pixels.h"

/* ---- Creation ---- */

pags_result pags_image_create(pags_image *image, int width, int height, int channels, pags_sample sample) {
  assert(image);
  memset(image, 0, sizeof *image);
  if (width < 1 || width > PAGS_IMAGE_MAX_SIDE || height < 1 || height > PAGS_IMAGE_MAX_SIDE || channels < 1 ||
      channels > 4)
    return pags_fail(PAGS_ERROR_ARGUMENT, "a picture of %d x %d pixels with %d channels: expected 1..%d and 1..4",
                     width, height, channels, PAGS_IMAGE_MAX_SIDE);
  *image = (pags_image){.width = width, .height = height, .channels = channels, .sample = sample};
  /* At most 65535 * 65535 * 4 * 4 < 2^37, which overflows only a 32-bit size_t. */
  const uint64_t bytes = (uint64_t)width * (uint64_t)height * pags_pixel_bytes(image);
  void *const data = bytes <= SIZE_MAX ? malloc((size_t)bytes) : NULL;
  if (!data) {
    memset(image, 0, sizeof *image);
    return pags_out_of_memory("a picture of %llu bytes", (unsigned long long)bytes);
  }
  image->data = memset(data, 0, (size_t)bytes);
  return PAGS_OK;
}

void pags_image_destroy(pags_image *image) {
  if (!image)
    return;
  free(image->data);
  memset(image, 0, sizeof *image);
}

void pags_image_move(pags_image *from, pags_image *to) {
  free(to->data);
  *to = *from;
  memset(from, 0, sizeof *from);
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
  if ((to == 2 && c == 1) || (to == 4 && c == 3))
    return from == 2 || from == 4 ? from - 1 : -1;
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

pags_result pags_image_converted(const pags_image *from, pags_sample sample, int channels, pags_image *to) {
  PAGS_TRY(pags_image_create(to, from->width, from->height, channels, sample));
  const int n = from->channels, m = to->channels;
  const size_t pixels = (size_t)from->width * (size_t)from->height;
  for (int c = 0; c < m; c++) {
    const int source = source_channel(n, m, c);
    for (size_t i = 0; i < pixels; i++) {
      const size_t at = i * (size_t)n, index = i * (size_t)m + (size_t)c;
      const double value = source == -1   ? 1.0
                           : source == -2 ? luma(from->data, from->sample, at)
                                          : sample_get(from->data, from->sample, at + (size_t)source);
      if (to->sample == PAGS_U8)
        ((uint8_t *)to->data)[index] = (uint8_t)(clamp01(value) * 255 + 0.5);
      else if (to->sample == PAGS_U16)
        ((uint16_t *)to->data)[index] = (uint16_t)(clamp01(value) * 65535 + 0.5);
      else
        ((float *)to->data)[index] = (float)value;
    }
  }
  return PAGS_OK;
}

pags_result pags_image_convert(pags_image *image, pags_sample sample, int channels) {
  if (image->sample == sample && image->channels == channels)
    return PAGS_OK;
  pags_image out;
  PAGS_TRY(pags_image_converted(image, sample, channels, &out));
  pags_image_move(&out, image);
  return PAGS_OK;
}

/* ---- Turning ---- */

pags_result pags_image_turn(pags_image *image, int orientation) {
  assert(image->data && orientation >= 1 && orientation <= 8);
  if (orientation == 1)
    return PAGS_OK;
  const bool exchanged = orientation >= 5;
  const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  const bool from_below = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  pags_image out;
  PAGS_TRY(pags_image_create(&out, exchanged ? image->height : image->width, exchanged ? image->width : image->height,
                             image->channels, image->sample));
  const size_t bytes = pags_pixel_bytes(image);
  uint8_t *to = out.data;
  for (int y = 0; y < out.height; y++)
    for (int x = 0; x < out.width; x++, to += bytes) {
      const int u = exchanged ? y : x, v = exchanged ? x : y; /* column and row in the file, before mirroring */
      const size_t column = (size_t)(from_right ? image->width - 1 - u : u);
      const size_t row = (size_t)(from_below ? image->height - 1 - v : v);
      memcpy(to, (const uint8_t *)image->data + (row * (size_t)image->width + column) * bytes, bytes);
    }
  pags_image_move(&out, image);
  return PAGS_OK;
}
