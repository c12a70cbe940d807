/* SPDX-License-Identifier: Apache-2.0 */
/* Converts the planes of a rendered picture to images and writes PNG and EXR files, one per channel. */
#include "cli/draw/picture.h"

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"

/* float32 can't represent every integer above 2^24. */
static const int64_t largest_float_id = 16777216;

#define MATTE(layer)                                                                   \
  {layer "00.R", layer "00.G", layer "00.B", layer "00.A", layer "01.R", layer "01.G", \
   layer "01.B", layer "01.A", layer "02.R", layer "02.G", layer "02.B", layer "02.A"}

/* Name of each channel, its planes, and their names in EXR files. */
static const struct {
  const char *name;
  int planes;
  const char *exr[PAGS_MATTE_PLANES];
} channels[PAGS_CHANNEL_COUNT] = {{"color", 3, {"R", "G", "B"}},
                                  {"alpha", 1, {"A"}},
                                  {"depth", 1, {"Z"}},
                                  {"id", 1, {"id"}},
                                  {"object", 1, {"object"}},
                                  {"priority", 1, {"priority"}},
                                  {"normal", 3, {"X", "Y", "Z"}},
                                  {"heat", 3, {"R", "G", "B"}},
                                  {"crypto-object", PAGS_MATTE_PLANES, MATTE("CryptoObject")},
                                  {"crypto-class", PAGS_MATTE_PLANES, MATTE("CryptoClass")},
                                  {"expected-normal", 3, {"X", "Y", "Z"}},
                                  {"motion", 4, {"X", "Y", "Z", "W"}},
                                  {"count", 1, {"count"}},
                                  {"overdraw", 1, {"overdraw"}}};

/* ---- Channels ---- */

static bool has(const pags_picture_writer *writer, pags_channel channel) {
  return writer->channels >> channel & 1;
}

bool pags_channels_parse(const char *list, unsigned *set, char *unknown, size_t unknown_size) {
  *set = 0;
  for (;; list++) {
    const size_t length = strcspn(list, ",");
    int channel = 0;
    while (channel < PAGS_CHANNEL_COUNT && !pags_text_is(list, length, channels[channel].name))
      channel++;
    if (channel == PAGS_CHANNEL_COUNT) {
      snprintf(unknown, unknown_size, "%.*s", (int)(length < 64 ? length : 64), list);
      return false;
    }
    *set |= 1u << channel;
    list += length;
    if (!*list)
      return true;
  }
}

pags_result pags_picture_writer_create(const pags_composition *composition, unsigned set, pags_picture_format format,
                                       int bits, pags_picture_writer *out) {
  const int64_t gaussians = pags_composition_gaussian_count(composition);
  *out = (pags_picture_writer){.channels = set, .format = format, .bits = bits};
  if (has(out, PAGS_CHANNEL_ID) && gaussians > largest_float_id)
    return pags_fail(PAGS_ERROR_LIMIT,
                     "--channel id: %lld Gaussians are more than the 2^24 ids that a float EXR can represent",
                     (long long)gaussians);
  if (has(out, PAGS_CHANNEL_OBJECT)) {
    out->object_of = malloc(((size_t)gaussians + 1) * sizeof *out->object_of);
    PAGS_CHECK_MEMORY(out->object_of, "the channels of %lld Gaussians", (long long)gaussians);
    pags_composition_objects(composition, out->object_of);
  }
  if (has(out, PAGS_CHANNEL_PRIORITY) || has(out, PAGS_CHANNEL_HEAT)) {
    out->priority_of = malloc(((size_t)gaussians + 1) * sizeof *out->priority_of);
    PAGS_CHECK_MEMORY(out->priority_of, "the channels of %lld Gaussians", (long long)gaussians);
    if (!pags_composition_priorities(composition, out->priority_of))
      return pags_fail(PAGS_ERROR_ARGUMENT,
                       "--channel priority: the scene holds neither priorities (property s_sem) nor objects");
  }
  for (int m = 0; m < 2; m++)
    if (has(out, m ? PAGS_CHANNEL_CRYPTO_CLASS : PAGS_CHANNEL_CRYPTO_OBJECT))
      PAGS_TRY(pags_matte_names_of_scene(pags_composition_scene(composition), m, &out->mattes[m]));
  return PAGS_OK;
}

void pags_picture_writer_destroy(pags_picture_writer *writer) {
  free(writer->object_of);
  free(writer->priority_of);
  for (int m = 0; m < 2; m++)
    pags_matte_names_destroy(&writer->mattes[m]);
}

/* ---- Conversion to images ---- */

/* Interleaves planes into an image, clamping to 0..1 and rounding to nearest; NaN becomes 0. */
static void fill(const float *const *planes, int stride, pags_image *image) {
  const int count = image->channels;
  for (int y = 0; y < image->height; y++)
    for (int c = 0; c < count; c++) {
      const float *row = planes[c] + (size_t)y * (size_t)stride;
      size_t at = (size_t)y * (size_t)image->width * (size_t)count + (size_t)c;
      for (int x = 0; x < image->width; x++, at += (size_t)count) {
        const float v = row[x] > 0 ? (row[x] < 1 ? row[x] : 1) : 0;
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
  PAGS_CHECK_MEMORY(*path, NULL);
  if (!strchr(file, '/'))
    return PAGS_OK;
  PAGS_AUTOFREE char *within = pags_path_folder(*path);
  PAGS_CHECK_MEMORY(within, NULL);
  return pags_make_dirs(within);
}

pags_result pags_image_save_in(const char *folder, const char *file, const pags_image *image) {
  PAGS_AUTOFREE char *path = NULL;
  PAGS_TRY(join(folder, file, &path));
  return pags_image_save(path, image);
}

static pags_result save_png(const pags_picture *picture, const float *const *planes, int count, int bits,
                            const char *path) {
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  PAGS_TRY(pags_image_create(&image, picture->width, picture->height, count, bits == 16 ? PAGS_U16 : PAGS_U8));
  fill(planes, picture->stride, &image);
  return pags_image_save(path, &image);
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

/* Finds the planes of a channel, computing them into `scratch` if neither picture nor passes have them. */
static void find_planes(const pags_picture_writer *writer, const pags_picture *picture, const pags_passes *passes,
                        const pags_camera *camera, pags_channel channel, float *scratch,
                        const float *planes[PAGS_MATTE_PLANES]) {
  const size_t count = (size_t)picture->stride * (size_t)picture->height;
  float *const own[3] = {scratch, scratch + count, scratch + 2 * count};
  const float *const computed[3] = {own[0], own[1], own[2]}, *const *from = computed;
  switch (channel) {
    case PAGS_CHANNEL_COLOR: from = picture->rgb; break;
    case PAGS_CHANNEL_DEPTH: from = &picture->depth; break;
    case PAGS_CHANNEL_NORMAL: pags_normals_from_depth(picture, camera, own); break;
    case PAGS_CHANNEL_HEAT: fill_heat(writer, picture, own); break;
    case PAGS_CHANNEL_CRYPTO_OBJECT: from = passes->matte[0]; break;
    case PAGS_CHANNEL_CRYPTO_CLASS: from = passes->matte[1]; break;
    case PAGS_CHANNEL_EXPECTED_NORMAL: from = passes->normal; break;
    case PAGS_CHANNEL_MOTION: from = passes->motion; break;
    case PAGS_CHANNEL_BLENDED: from = &passes->pairs[0]; break;
    case PAGS_CHANNEL_OVERDRAW: from = &passes->pairs[1]; break;
    default: fill_values(writer, picture, channel, scratch);
  }
  for (int c = 0; c < channels[channel].planes; c++)
    planes[c] = from[c];
}

/* ---- Writing ---- */

static pags_result write_exr(const pags_picture_writer *writer, const pags_picture *picture, const float *const *planes,
                             pags_channel channel, const char *path) {
  const int m = channel == PAGS_CHANNEL_CRYPTO_CLASS;
  char keys[4][40], hash[9];
  const char *texts[9] = {NULL};
  if (channel == PAGS_CHANNEL_CRYPTO_OBJECT || m) {
    /* The attributes by which other programs know a Cryptomatte (specification 1.2.0): name and value by turns. The key
     * is made of the first seven digits of the hash of the layer's name. */
    const char *const layer = m ? "CryptoClass" : "CryptoObject";
    const char *const attributes[4][2] = {{"name", layer},
                                          {"hash", "MurmurHash3_32"},
                                          {"conversion", "uint32_to_float32"},
                                          {"manifest", writer->mattes[m].manifest}};
    snprintf(hash, sizeof hash, "%08x", pags_cryptomatte_hash(layer, strlen(layer)));
    for (int k = 0; k < 4; k++) {
      snprintf(keys[k], sizeof keys[k], "cryptomatte/%.7s/%s", hash, attributes[k][0]);
      texts[2 * k] = keys[k];
      texts[2 * k + 1] = attributes[k][1];
    }
  }
  return pags_image_save_exr(path, picture->width, picture->height, channels[channel].planes, channels[channel].exr,
                             planes, picture->stride, texts);
}

pags_result pags_picture_write(const pags_picture_writer *writer, const pags_picture *picture,
                               const pags_passes *passes, const pags_camera *camera, pags_plane_scratch *scratch,
                               const char *folder, const char *name) {
  PAGS_CHECK_MEMORY(pags_grow(&scratch->data, (int64_t)3 * picture->stride * picture->height, &scratch->capacity,
                              sizeof *scratch->data),
                    "a picture of %dx%d", picture->width, picture->height);
  for (int c = 0; c < PAGS_CHANNEL_COUNT; c++) {
    const pags_channel channel = (pags_channel)c;
    const float *planes[PAGS_MATTE_PLANES];
    char file[PAGS_STEM + 24];
    PAGS_AUTOFREE char *path = NULL;
    if (!has(writer, channel))
      continue;
    const bool color = channel == PAGS_CHANNEL_COLOR;
    const bool png = channel == PAGS_CHANNEL_HEAT || (writer->format == PAGS_PICTURE_PNG && c <= PAGS_CHANNEL_ALPHA);
    snprintf(file, sizeof file, "%s%s%s%s", name, color ? "" : "_", color ? "" : channels[c].name,
             png ? ".png" : ".exr");
    PAGS_TRY(join(folder, file, &path));
    find_planes(writer, picture, passes, camera, channel, scratch->data, planes);
    PAGS_TRY(png ? save_png(picture, planes, channels[c].planes, writer->bits, path)
                 : write_exr(writer, picture, planes, channel, path));
  }
  return PAGS_OK;
}

bool pags_picture_writer_needs_extras(const pags_picture_writer *writer) {
  return (writer->channels & ~(1u << PAGS_CHANNEL_COLOR | 1u << PAGS_CHANNEL_ALPHA | PAGS_CHANNELS_PASSES)) != 0;
}
