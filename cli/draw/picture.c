/* SPDX-License-Identifier: Apache-2.0 */
/* Converts the planes of a rendered picture to images and writes PNG and EXR files, one per channel. */
#include "cli/draw/picture.h"

#include <stdlib.h>
#include <string.h>
#include "base/file.h"
#include "base/memory.h"

/* float32 can't represent every integer above 2^24. */
static const int64_t largest_float_id = 16777216;

static const char *const channel_names[PAGS_CHANNEL_COUNT] = {
    "color",         "alpha",        "depth",           "id",     "object", "priority", "normal", "heat",
    "crypto-object", "crypto-class", "expected-normal", "motion", "count",  "overdraw"};

/* ---- Channels ---- */

static bool has(const pags_picture_writer *writer, pags_channel channel) {
  return writer->channels >> channel & 1;
}

static int find_channel(const char *name, size_t length) {
  for (int c = 0; c < PAGS_CHANNEL_COUNT; c++)
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

pags_result pags_picture_writer_create(const pags_composition *composition, unsigned channels,
                                       pags_picture_format format, int bits, pags_picture_writer *out) {
  int64_t gaussians = pags_composition_gaussian_count(composition);
  size_t count = (size_t)gaussians + 1;
  *out = (pags_picture_writer){.channels = channels, .format = format, .bits = bits};
  bool objects = has(out, PAGS_CHANNEL_OBJECT),
       priorities = has(out, PAGS_CHANNEL_PRIORITY) || has(out, PAGS_CHANNEL_HEAT);
  if (has(out, PAGS_CHANNEL_ID) && gaussians > largest_float_id)
    return pags_fail(PAGS_ERROR_LIMIT,
                     "--channel id: %lld Gaussians are more than the 2^24 ids that a float EXR can represent",
                     (long long)gaussians);
  if (objects)
    out->object_of = malloc(count * sizeof *out->object_of);
  if (priorities)
    out->priority_of = malloc(count * sizeof *out->priority_of);
  pags_result result = PAGS_OK;
  if ((objects && !out->object_of) || (priorities && !out->priority_of))
    result = pags_out_of_memory("the channels of %lld Gaussians", (long long)gaussians);
  if (result == PAGS_OK && objects)
    pags_composition_objects(composition, out->object_of);
  if (result == PAGS_OK && priorities && !pags_composition_priorities(composition, out->priority_of))
    result = pags_fail(PAGS_ERROR_ARGUMENT,
                       "--channel priority: the scene holds neither priorities (property s_sem) nor objects");
  for (int m = 0; m < 2 && result == PAGS_OK; m++)
    if (has(out, m ? PAGS_CHANNEL_CRYPTO_CLASS : PAGS_CHANNEL_CRYPTO_OBJECT))
      result = pags_matte_names_of_scene(pags_composition_scene(composition), m, &out->mattes[m]);
  if (result != PAGS_OK)
    pags_picture_writer_destroy(out);
  return result;
}

void pags_picture_writer_destroy(pags_picture_writer *writer) {
  free(writer->object_of);
  free(writer->priority_of);
  for (int m = 0; m < 2; m++)
    pags_matte_names_destroy(&writer->mattes[m]);
  memset(writer, 0, sizeof *writer);
}

/* ---- Conversion to images ---- */

/* Interleaves planes into an image, clamping to 0..1 and rounding to nearest; NaN becomes 0. */
static void fill(const float *const *planes, int stride, pags_image *image) {
  int channels = image->channels;
  for (int y = 0; y < image->height; y++)
    for (int c = 0; c < channels; c++) {
      const float *row = planes[c] + (size_t)y * (size_t)stride;
      size_t at = (size_t)y * (size_t)image->width * (size_t)channels + (size_t)c;
      for (int x = 0; x < image->width; ++x, at += (size_t)channels) {
        float v = row[x] > 0 ? (row[x] < 1 ? row[x] : 1) : 0;
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

/* Joins folder and file; where the file's name has folders, makes them. */
static pags_result join(const char *folder, const char *file, char **path) {
  *path = pags_path_join(folder, file);
  char *within = *path && strchr(file, '/') ? pags_path_folder(*path) : NULL;
  const pags_result result = !*path || (strchr(file, '/') && !within) ? pags_out_of_memory(NULL)
                             : within                                 ? pags_make_dirs(within)
                                                                      : PAGS_OK;
  free(within);
  if (result != PAGS_OK) {
    free(*path);
    *path = NULL;
  }
  return result;
}

pags_result pags_image_save_in(const char *folder, const char *file, const pags_image *image) {
  char *path;
  PAGS_TRY(join(folder, file, &path));
  const pags_result result = pags_image_save(path, image);
  free(path);
  return result;
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

/* ---- Planes of a channel ---- */

static void fill_values(const pags_picture_writer *writer, const pags_picture *picture, pags_channel channel,
                        float *out) {
  size_t count = (size_t)picture->stride * (size_t)picture->height;
  for (size_t i = 0; i < count; i++) {
    int32_t id = channel == PAGS_CHANNEL_ALPHA ? 0 : picture->id[i];
    out[i] = channel == PAGS_CHANNEL_ALPHA    ? 1 - picture->transmittance[i]
             : channel == PAGS_CHANNEL_ID     ? (float)id
             : channel == PAGS_CHANNEL_OBJECT ? (id < 0 ? -1.0f : (float)writer->object_of[id])
                                              : (id < 0 ? 0.0f : writer->priority_of[id]);
  }
}

static void fill_heat(const pags_picture_writer *writer, const pags_picture *picture, float *const out[3]) {
  size_t count = (size_t)picture->stride * (size_t)picture->height;
  for (size_t i = 0; i < count; i++) {
    float rgb[3] = {0, 0, 0}, shown = 1 - picture->transmittance[i];
    if (picture->id[i] >= 0)
      pags_colormap_heat(writer->priority_of[picture->id[i]], rgb);
    for (int c = 0; c < 3; c++)
      out[c][i] = shown * rgb[c];
  }
}

/* Finds the planes of a pass. Returns how many. */
static int pass_planes(const pags_passes *passes, pags_channel channel, const float *planes[PAGS_MATTE_PLANES]) {
  const bool normal = channel == PAGS_CHANNEL_EXPECTED_NORMAL, motion = channel == PAGS_CHANNEL_MOTION;
  if (channel == PAGS_CHANNEL_BLENDED || channel == PAGS_CHANNEL_OVERDRAW) {
    planes[0] = passes->pairs[channel - PAGS_CHANNEL_BLENDED];
    return 1;
  }
  const float *const *const from = normal   ? passes->normal
                                   : motion ? passes->motion
                                            : passes->matte[channel - PAGS_CHANNEL_CRYPTO_OBJECT];
  const int count = normal ? 3 : motion ? 4 : PAGS_MATTE_PLANES;
  for (int c = 0; c < count; c++)
    planes[c] = from[c];
  return count;
}

/* Finds the planes of a channel, computing them into `scratch` if the picture doesn't have them. Returns how many
 * planes. */
static int channel_planes(const pags_picture_writer *writer, const pags_picture *picture, const pags_passes *passes,
                          const pags_camera *camera, pags_channel channel, float *scratch,
                          const float *planes[PAGS_MATTE_PLANES]) {
  if (PAGS_CHANNELS_PASSES >> channel & 1)
    return pass_planes(passes, channel, planes);
  size_t count = (size_t)picture->stride * (size_t)picture->height;
  float *own[3] = {scratch, scratch + count, scratch + 2 * count};
  for (int c = 0; c < 3; c++)
    planes[c] = channel == PAGS_CHANNEL_COLOR ? picture->rgb[c] : own[c];
  if (channel == PAGS_CHANNEL_NORMAL)
    pags_normals_from_depth(picture, camera, own);
  else if (channel == PAGS_CHANNEL_HEAT)
    fill_heat(writer, picture, own);
  else if (channel == PAGS_CHANNEL_DEPTH)
    planes[0] = picture->depth;
  else if (channel != PAGS_CHANNEL_COLOR)
    fill_values(writer, picture, channel, scratch);
  return channel == PAGS_CHANNEL_COLOR || channel == PAGS_CHANNEL_NORMAL || channel == PAGS_CHANNEL_HEAT ? 3 : 1;
}

/* ---- Writing ---- */

static pags_result reserve(pags_plane_scratch *scratch, const pags_picture *picture) {
  size_t count = 3 * (size_t)picture->stride * (size_t)picture->height;
  if (count <= scratch->capacity)
    return PAGS_OK;
  free(scratch->data);
  scratch->data = malloc(count * sizeof *scratch->data);
  scratch->capacity = scratch->data ? count : 0;
  if (!scratch->data)
    return pags_out_of_memory("a picture of %dx%d", picture->width, picture->height);
  return PAGS_OK;
}

/* The attributes by which other programs know a Cryptomatte (specification 1.2.0): name and value by turns. The key is
 * made of the first seven digits of the hash of the layer's name. */
typedef struct matte_texts {
  char keys[4][40];
  const char *list[9];
} matte_texts;

static void describe_matte(const char *layer, const char *manifest, matte_texts *out) {
  const char *const what[4] = {"name", "hash", "conversion", "manifest"};
  const char *const values[4] = {layer, "MurmurHash3_32", "uint32_to_float32", manifest};
  char hash[9];
  snprintf(hash, sizeof hash, "%08x", pags_cryptomatte_hash(layer, strlen(layer)));
  for (int k = 0; k < 4; k++) {
    snprintf(out->keys[k], sizeof out->keys[k], "cryptomatte/%.7s/%s", hash, what[k]);
    out->list[2 * k] = out->keys[k];
    out->list[2 * k + 1] = values[k];
  }
  out->list[8] = NULL;
}

#define MATTE(layer)                                                                   \
  {layer "00.R", layer "00.G", layer "00.B", layer "00.A", layer "01.R", layer "01.G", \
   layer "01.B", layer "01.A", layer "02.R", layer "02.G", layer "02.B", layer "02.A"}

static pags_result write_exr(const pags_picture_writer *writer, const pags_picture *picture, const float *const *planes,
                             int count, pags_channel channel, const char *path) {
  static const char *const names[PAGS_CHANNEL_COUNT][PAGS_MATTE_PLANES] = {{"R", "G", "B"},
                                                                           {"A"},
                                                                           {"Z"},
                                                                           {"id"},
                                                                           {"object"},
                                                                           {"priority"},
                                                                           {"X", "Y", "Z"},
                                                                           {"R", "G", "B"},
                                                                           MATTE("CryptoObject"),
                                                                           MATTE("CryptoClass"),
                                                                           {"X", "Y", "Z"},
                                                                           {"X", "Y", "Z", "W"},
                                                                           {"count"},
                                                                           {"overdraw"}};
  const int m = channel == PAGS_CHANNEL_CRYPTO_CLASS;
  matte_texts texts = {.list = {NULL}};
  if (channel == PAGS_CHANNEL_CRYPTO_OBJECT || m)
    describe_matte(m ? "CryptoClass" : "CryptoObject", writer->mattes[m].manifest, &texts);
  return pags_image_save_exr(path, picture->width, picture->height, count, names[channel], planes, picture->stride,
                             texts.list);
}

pags_result pags_picture_write(const pags_picture_writer *writer, const pags_picture *picture,
                               const pags_passes *passes, const pags_camera *camera, pags_plane_scratch *scratch,
                               const char *folder, const char *name) {
  PAGS_TRY(reserve(scratch, picture));
  for (int c = 0; c < PAGS_CHANNEL_COUNT; c++) {
    pags_channel channel = (pags_channel)c;
    const float *planes[PAGS_MATTE_PLANES];
    char file[PAGS_STEM + 24], *path;
    if (!has(writer, channel))
      continue;
    bool png = channel == PAGS_CHANNEL_HEAT || (writer->format == PAGS_PICTURE_PNG && channel <= PAGS_CHANNEL_ALPHA),
         color = channel == PAGS_CHANNEL_COLOR;
    snprintf(file, sizeof file, "%s%s%s%s", name, color ? "" : "_", color ? "" : channel_names[c],
             png ? ".png" : ".exr");
    PAGS_TRY(join(folder, file, &path));
    int count = channel_planes(writer, picture, passes, camera, channel, scratch->data, planes);
    pags_result result = png ? save_png(picture, planes, count, writer->bits, path)
                             : write_exr(writer, picture, planes, count, channel, path);
    free(path);
    PAGS_TRY(result);
  }
  return PAGS_OK;
}

bool pags_picture_writer_needs_extras(const pags_picture_writer *writer) {
  return (writer->channels & ~(1u << PAGS_CHANNEL_COLOR | 1u << PAGS_CHANNEL_ALPHA | PAGS_CHANNELS_PASSES)) != 0;
}
