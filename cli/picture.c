/* Conversion of planes to pictures and their files. */
#include "picture.h"

#include <base/file.h>
#include <stdlib.h>
#include <string.h>

/* Whole numbers beyond 2^24 are not all floats. */
static const int64_t largest_float_id = 16777216;

static const char *const channel_names[PAGS_CHANNEL_COUNT] = {"color", "alpha", "depth", "id", "object", "priority"};

static bool has(const pags_picture_writer *writer, pags_channel channel) {
  return writer->channels >> channel & 1;
}

static int find_channel(const char *name, size_t length) {
  for (int c = 0; c < PAGS_CHANNEL_COUNT; ++c)
    if (strlen(channel_names[c]) == length && !strncmp(channel_names[c], name, length))
      return c;
  return -1;
}

bool pags_channels_parse(const char *list, unsigned *set, char *unknown, size_t unknown_size) {
  *set = 0;
  for (;;) {
    size_t length = strcspn(list, ",");
    int channel = find_channel(list, length);
    if (channel < 0) {
      snprintf(unknown, unknown_size, "%.*s", (int)(length < 64 ? length : 64), list);
      return false;
    }
    *set |= 1u << channel;
    if (!list[length])
      return true;
    list += length + 1;
  }
}

pags_result pags_picture_writer_create(const pags_model_view *view, unsigned channels, pags_picture_format format,
                                       int bits, pags_picture_writer *out) {
  size_t count = (size_t)view->gaussian_count + 1;
  *out = (pags_picture_writer){.channels = channels, .format = format, .bits = bits};
  if (has(out, PAGS_CHANNEL_ID) && view->gaussian_count > largest_float_id)
    return pags_fail(PAGS_ERROR_LIMIT,
                     "--channel id: %lld Gaussians are more than the 2^24 ids that a float EXR tells apart",
                     (long long)view->gaussian_count);
  if (has(out, PAGS_CHANNEL_OBJECT))
    out->object_of = malloc(count * sizeof *out->object_of);
  if (has(out, PAGS_CHANNEL_PRIORITY))
    out->priority_of = malloc(count * sizeof *out->priority_of);
  pags_result result = PAGS_OK;
  if ((has(out, PAGS_CHANNEL_OBJECT) && !out->object_of) || (has(out, PAGS_CHANNEL_PRIORITY) && !out->priority_of))
    result = pags_fail(PAGS_ERROR_MEMORY, "out of memory for the channels of %lld Gaussians",
                       (long long)view->gaussian_count);
  if (result == PAGS_OK && out->object_of)
    pags_model_view_objects(view, out->object_of);
  if (result == PAGS_OK && out->priority_of && !pags_model_view_priorities(view, out->priority_of))
    result = pags_fail(PAGS_ERROR_ARGUMENT, "--channel priority: the scene holds no priorities (property s_sem)");
  if (result != PAGS_OK)
    pags_picture_writer_destroy(out);
  return result;
}

void pags_picture_writer_destroy(pags_picture_writer *writer) {
  free(writer->object_of);
  free(writer->priority_of);
  memset(writer, 0, sizeof *writer);
}

static float clamp01(float v) {
  return v > 0 ? (v < 1 ? v : 1) : 0;
} /* NaN becomes 0 */

/* Interleaves planes into an image, rounding to nearest. */
static void fill(const float *const *planes, int stride, pags_image *image) {
  int channels = image->channels;
  for (int y = 0; y < image->height; ++y)
    for (int c = 0; c < channels; ++c) {
      const float *row = planes[c] + (size_t)y * (size_t)stride;
      size_t at = (size_t)y * (size_t)image->width * (size_t)channels + (size_t)c;
      for (int x = 0; x < image->width; ++x, at += (size_t)channels) {
        float v = clamp01(row[x]);
        if (image->sample == PAGS_U8)
          ((uint8_t *)image->data)[at] = (uint8_t)(v * 255.0f + 0.5f);
        else if (image->sample == PAGS_U16)
          ((uint16_t *)image->data)[at] = (uint16_t)(v * 65535.0f + 0.5f);
        else
          ((float *)image->data)[at] = v;
      }
    }
}

pags_result pags_picture_to_image(const pags_picture *picture, pags_sample sample, pags_image *out) {
  PAGS_TRY(pags_image_create(out, picture->width, picture->height, 3, sample));
  fill(picture->rgb, picture->stride, out);
  return PAGS_OK;
}

static pags_result save_png(const pags_picture *picture, const float *const *planes, int channels, int bits,
                            const char *path) {
  pags_image image;
  PAGS_TRY(pags_image_create(&image, picture->width, picture->height, channels, bits == 16 ? PAGS_U16 : PAGS_U8));
  fill(planes, picture->stride, &image);
  pags_result result = pags_image_save(path, &image);
  pags_image_destroy(&image);
  return result;
}

/* One value per pixel computed from transmittance or id; depth needs no copy. */
static const float *channel_plane(const pags_picture_writer *writer, const pags_picture *picture, pags_channel channel,
                                  float *plane) {
  size_t count = (size_t)picture->stride * (size_t)picture->height;
  switch (channel) {
    case PAGS_CHANNEL_ALPHA:
      for (size_t i = 0; i < count; ++i)
        plane[i] = 1 - picture->transmittance[i];
      return plane;
    case PAGS_CHANNEL_ID:
      for (size_t i = 0; i < count; ++i)
        plane[i] = (float)picture->id[i];
      return plane;
    case PAGS_CHANNEL_OBJECT:
      for (size_t i = 0; i < count; ++i)
        plane[i] = picture->id[i] < 0 ? -1.0f : (float)writer->object_of[picture->id[i]];
      return plane;
    case PAGS_CHANNEL_PRIORITY:
      for (size_t i = 0; i < count; ++i)
        plane[i] = picture->id[i] < 0 ? 0.0f : writer->priority_of[picture->id[i]];
      return plane;
    case PAGS_CHANNEL_DEPTH: return picture->depth;
    case PAGS_CHANNEL_COLOR:
    case PAGS_CHANNEL_COUNT: break;
  }
  return NULL;
}

static pags_result reserve(pags_plane_scratch *scratch, const pags_picture *picture) {
  size_t count = (size_t)picture->stride * (size_t)picture->height;
  if (count <= scratch->capacity)
    return PAGS_OK;
  free(scratch->data);
  scratch->data = malloc(count * sizeof *scratch->data);
  scratch->capacity = scratch->data ? count : 0;
  if (!scratch->data)
    return pags_fail(PAGS_ERROR_MEMORY, "out of memory for a picture of %dx%d", picture->width, picture->height);
  return PAGS_OK;
}

static pags_result write_channel(const pags_picture_writer *writer, const pags_picture *picture, pags_channel channel,
                                 float *scratch, const char *path, bool png) {
  static const char *const rgb_names[] = {"R", "G", "B"};
  static const char *const single_names[PAGS_CHANNEL_COUNT] = {NULL, "A", "Z", "id", "object", "priority"};
  if (channel == PAGS_CHANNEL_COLOR)
    return png ? save_png(picture, picture->rgb, 3, writer->bits, path)
               : pags_image_save_exr(path, picture->width, picture->height, 3, rgb_names, picture->rgb,
                                     picture->stride);
  const float *plane = channel_plane(writer, picture, channel, scratch);
  return png ? save_png(picture, &plane, 1, writer->bits, path)
             : pags_image_save_exr(path, picture->width, picture->height, 1, &single_names[channel], &plane,
                                   picture->stride);
}

pags_result pags_picture_write(const pags_picture_writer *writer, const pags_picture *picture,
                               pags_plane_scratch *scratch, const char *folder, const char *name) {
  PAGS_TRY(reserve(scratch, picture));
  for (int c = 0; c < PAGS_CHANNEL_COUNT; ++c) {
    pags_channel channel = (pags_channel)c;
    if (!has(writer, channel))
      continue;
    char file[320];
    bool png = writer->format == PAGS_PICTURE_PNG && channel <= PAGS_CHANNEL_ALPHA;
    snprintf(file, sizeof file, "%s%s%s%s", name, channel == PAGS_CHANNEL_COLOR ? "" : "_",
             channel == PAGS_CHANNEL_COLOR ? "" : channel_names[c], png ? ".png" : ".exr");
    char *path = pags_path_join(folder, file);
    if (!path)
      return pags_fail(PAGS_ERROR_MEMORY, "out of memory");
    pags_result result = write_channel(writer, picture, channel, scratch->data, path, png);
    free(path);
    PAGS_TRY(result);
  }
  return PAGS_OK;
}

bool pags_picture_writer_needs_extras(const pags_picture_writer *writer) {
  return (writer->channels & ~(1u << PAGS_CHANNEL_COLOR | 1u << PAGS_CHANNEL_ALPHA)) != 0;
}
