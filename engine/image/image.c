/* SPDX-License-Identifier: Apache-2.0 */
/* Images in memory: creation, conversion of sample types and channels, and reading and writing files through the
 * OpenImageIO module (module.h). */
#include <pags/image.h>

#include "base/file.h"
#include "base/memory.h"
#include "image/jpeg.h"
#include "image/module.h"
#include "image/oiio.h"
#include "image/png.h"

#include <assert.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#define MAX_SIDE 65535

/* ---- Creation ---- */

static size_t sample_bytes(pags_sample sample) {
  return sample == PAGS_U8 ? 1 : sample == PAGS_U16 ? 2 : 4;
}

/* Allocates memory for an image. The largest has 65535 * 65535 * 4 * 4 < 2^37 bytes, which overflows only a 32-bit
 * size_t. */
static pags_result allocate(uint64_t bytes, void **out) {
  *out = bytes <= SIZE_MAX ? malloc((size_t)bytes) : NULL;
  if (!*out)
    return pags_out_of_memory("a picture of %llu bytes", (unsigned long long)bytes);
  return PAGS_OK;
}

static uint64_t picture_bytes(int width, int height, int channels, pags_sample sample) {
  return (uint64_t)width * (uint64_t)height * (uint64_t)channels * sample_bytes(sample);
}

pags_result pags_image_create(pags_image *image, int width, int height, int channels, pags_sample sample) {
  assert(image);
  memset(image, 0, sizeof *image);
  if (width < 1 || width > MAX_SIDE || height < 1 || height > MAX_SIDE || channels < 1 || channels > 4)
    return pags_fail(PAGS_ERROR_ARGUMENT, "a picture of %d x %d pixels with %d channels: expected 1..%d and 1..4",
                     width, height, channels, MAX_SIDE);
  uint64_t bytes = picture_bytes(width, height, channels, sample);
  PAGS_TRY(allocate(bytes, &image->data));
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

/* Converts `image` to the given sample type and number of channels, unless it has them already. */
static pags_result convert_in_place(pags_image *image, pags_sample sample, int channels) {
  if (image->sample == sample && image->channels == channels)
    return PAGS_OK;
  pags_image out;
  PAGS_TRY(pags_image_create(&out, image->width, image->height, channels, sample));
  convert(image, &out);
  pags_image_destroy(image);
  *image = out;
  return PAGS_OK;
}

/* ---- Reading files ---- */

static pags_result open_picture(const char *path, const pags_oiio **oiio, void **reader, pags_oiio_info *info) {
  /* A missing, unreadable or wrong kind of path is reported here, before a decoder reports it as a broken picture. */
  struct stat status;
  if (stat(path, &status) != 0)
    return pags_fail(PAGS_ERROR_IO, "%s: %s", path, strerror(errno));
  if (S_ISDIR(status.st_mode))
    return pags_fail(PAGS_ERROR_IO, "%s: is a folder, expected a picture", path);
  if (access(path, R_OK) != 0)
    return pags_fail(PAGS_ERROR_IO, "%s: %s", path, strerror(errno));

  PAGS_TRY(pags_png_check_chunks(path));
  PAGS_TRY(pags_oiio_module(oiio));
  pags_oiio_message message;
  pags_result result = (*oiio)->open(path, reader, info, &message);
  if (result != PAGS_OK)
    return pags_fail(result, "%s: not a readable picture: %s", path, message.text);
  if (info->width >= 1 && info->width <= MAX_SIDE && info->height >= 1 && info->height <= MAX_SIDE &&
      info->depth <= 1 && info->channels >= 1)
    return PAGS_OK;
  (*oiio)->close(*reader);
  return pags_fail(PAGS_ERROR_FORMAT, "%s: %lld x %lld x %lld pixels with %d channels, expected sides of 1..%d", path,
                   (long long)info->width, (long long)info->height, (long long)info->depth, info->channels, MAX_SIDE);
}

pags_result pags_image_size(const char *path, int *width, int *height) {
  assert(path && width && height);
  const pags_oiio *oiio;
  void *reader;
  pags_oiio_info info;
  PAGS_TRY(open_picture(path, &oiio, &reader, &info));
  oiio->close(reader);
  *width = (int)info.width;
  *height = (int)info.height;
  return PAGS_OK;
}

pags_result pags_image_load(const char *path, pags_sample sample, int channels, pags_image *out) {
  assert(path && out && channels >= 0 && channels <= 4);
  memset(out, 0, sizeof *out);
  const pags_oiio *oiio;
  void *reader;
  pags_oiio_info info;
  PAGS_TRY(open_picture(path, &oiio, &reader, &info));
  /* Channels that are not needed are not read. For one or two wanted channels up to four are: the luma of a colour
   * picture takes three, its alpha is the fourth. */
  int most = channels == 3 ? 3 : 4;
  int stored = info.channels < most ? info.channels : most;
  pags_result result = pags_image_create(out, (int)info.width, (int)info.height, stored, info.sample);
  if (result == PAGS_OK) {
    pags_oiio_message message;
    result = oiio->read(reader, stored, info.sample, out->data, &message);
    if (result != PAGS_OK)
      pags_fail(result, "%s: can't be decoded: %s", path, message.text);
  }
  oiio->close(reader);
  if (result == PAGS_OK && strcmp(info.format, "jpeg") == 0)
    result = pags_jpeg_check_end(path);
  if (result == PAGS_OK)
    result = convert_in_place(out, sample, channels ? channels : stored);
  if (result != PAGS_OK)
    pags_image_destroy(out);
  return result;
}

/* ---- Writing files ---- */

static pags_result write_file(const char *path, const char *format, const pags_oiio_picture *picture) {
  const pags_oiio *oiio;
  PAGS_TRY(pags_oiio_module(&oiio));
  pags_oiio_message message = {""};
  pags_result result = oiio->write(path, format, picture, pags_file_write_unsynced, &message);
  if (result != PAGS_OK && message.text[0])
    pags_fail(result, "%s: can't be written: %s", path, message.text);
  return result;
}

static const char *format_of(const char *path) {
  const char *dot = strrchr(path, '.');
  if (dot && strcasecmp(dot, ".png") == 0)
    return "png";
  if (dot && (strcasecmp(dot, ".jpg") == 0 || strcasecmp(dot, ".jpeg") == 0))
    return "jpg";
  return dot && strcasecmp(dot, ".exr") == 0 ? "exr" : NULL;
}

pags_result pags_image_save(const char *path, const pags_image *image) {
  assert(path && image && image->data);
  const char *format = format_of(path);
  if (!format)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected a name ending in .png, .jpg or .exr", path);
  int jpeg = strcmp(format, "jpg") == 0, exr = strcmp(format, "exr") == 0;
  int alpha = image->channels == 2 || image->channels == 4;
  int channels = jpeg && alpha ? image->channels - 1 : image->channels;
  pags_sample sample = exr ? PAGS_F32 : image->sample == PAGS_F32 || jpeg ? PAGS_U8 : image->sample;
  pags_image copy = {0};
  const pags_image *written = image;
  if (sample != image->sample || channels != image->channels) {
    PAGS_TRY(pags_image_create(&copy, image->width, image->height, channels, sample));
    convert(image, &copy);
    written = &copy;
  }
  static const char *const grey[] = {"Y", "A"}, *const colour[] = {"R", "G", "B", "A"};
  pags_oiio_picture picture = {.width = image->width,
                               .height = image->height,
                               .channels = channels,
                               .sample = sample,
                               .data = written->data,
                               .names = channels <= 2 ? grey : colour};
  pags_result result = write_file(path, format, &picture);
  pags_image_destroy(&copy);
  return result;
}

pags_result pags_image_save_exr(const char *path, int width, int height, int channels, const char *const *names,
                                const float *const *planes, int stride) {
  assert(path && names && planes && width >= 1 && width <= MAX_SIDE && height >= 1 && height <= MAX_SIDE);
  assert(channels >= 1 && channels <= 64 && stride >= width);
  void *memory;
  PAGS_TRY(allocate(picture_bytes(width, height, channels, PAGS_F32), &memory));
  float *data = memory;
  for (int c = 0; c < channels; c++)
    for (size_t y = 0; y < (size_t)height; y++)
      for (size_t x = 0; x < (size_t)width; x++)
        data[(y * (size_t)width + x) * (size_t)channels + (size_t)c] = planes[c][y * (size_t)stride + x];
  pags_oiio_picture picture = {
      .width = width, .height = height, .channels = channels, .sample = PAGS_F32, .data = data, .names = names};
  pags_result result = write_file(path, "exr", &picture);
  free(data);
  return result;
}
