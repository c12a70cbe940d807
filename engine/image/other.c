/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures through the OpenImageIO module pags_oiio.so (other.h). */
#include "image/other.h"

#include <pthread.h>
#include <stdio.h>
#include <strings.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"
#include "image/formats.h"
#include "image/layers.h"
#include "image/pixels.h"
#include "port/module.h"
#include "port/port.h"

/* ---- The module ---- */

#ifndef PAGS_IMAGES

pags_result pags_oiio_module(const pags_oiio **out) {
  *out = NULL;
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "this build leaves it out: configure with -DPAGS_IMAGES=ON (Debian: libopenimageio-dev)");
}

#else

#define MODULE_NAME "pags_oiio.so"

/* The loaded module, or why it is missing. Written once under pthread_once, constant afterwards. */
static pthread_once_t once = PTHREAD_ONCE_INIT;
static pags_port_module module;

static void find_module(void) {
  pags_port_load_module(MODULE_NAME, PAGS_MODULE_DIR, PAGS_OIIO_SYMBOL, PAGS_OIIO_VERSION, &module);
}

pags_result pags_oiio_module(const pags_oiio **out) {
  pthread_once(&once, find_module);
  *out = module.table;
  if (module.table)
    return PAGS_OK;
  if (module.no_memory)
    return pags_fail(PAGS_ERROR_MEMORY, "%s", module.reason);
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "%s; expected %s in the folder of the program or in ../lib/pags, and OpenImageIO (Debian: "
                   "libopenimageio2.4) installed",
                   module.reason, MODULE_NAME);
}

#endif

/* A file that OpenImageIO has opened, at the part that is read. */
typedef struct other_picture {
  const pags_oiio *oiio;
  void *reader;
  pags_oiio_info info; /* of that part */
  pags_layer layer;    /* the channels that are read */
  pags_image_window window;
  int width, height; /* of the picture */
  int left, top;     /* of the part's samples in it */
} other_picture;

static void close_other(other_picture *other) {
  if (other->reader)
    other->oiio->close(other->reader);
}

/* ---- Parts and layers of EXR files ---- */

enum { MOST_CHANNELS = 1024 };

/* The channels of all parts, with names of its own. */
typedef struct channel_list {
  int count;
  pags_layer_channel items[MOST_CHANNELS];
} channel_list;

static void free_channels(channel_list **list) {
  for (int i = 0; *list && i < (*list)->count; i++) {
    free((char *)(*list)->items[i].name);
    free((char *)(*list)->items[i].part);
  }
  free(*list);
}

static pags_result choose_layer(const char *path, other_picture *other) {
  pags_oiio_info info;
  PAGS_AUTO(free_channels) channel_list *list = calloc(1, sizeof *list);
  PAGS_CHECK_MEMORY(list, "%s", path);
  for (int part = 0; other->oiio->part(other->reader, part, &info); part++)
    for (int i = 0; i < info.channels; i++) {
      int number;
      const char *const name = other->oiio->channel(other->reader, i, &number);
      if (list->count == MOST_CHANNELS)
        return pags_fail_at(path, "more than %d channels", MOST_CHANNELS);
      pags_layer_channel *const c = &list->items[list->count++];
      *c = (pags_layer_channel){pags_text_copy(name), pags_text_copy(info.part), part, i, number};
      PAGS_CHECK_MEMORY(c->name && c->part, "%s", path);
    }
  return pags_layer_choose(path, list->items, list->count, &other->layer);
}

/* The picture of an EXR file: its layer and windows. */
static pags_result open_exr(const char *path, other_picture *other) {
  PAGS_TRY(choose_layer(path, other));
  if (!other->oiio->part(other->reader, other->layer.part, &other->info))
    return pags_fail_at(path, "part %d of it can't be read", other->layer.part);
  const pags_oiio_info *const info = &other->info;
  const pags_window_box data = {info->left, info->top, info->left + info->width, info->top + info->height};
  const pags_window_box shown = {info->shown_left, info->shown_top, info->shown_left + info->shown_width,
                                 info->shown_top + info->shown_height};
  PAGS_TRY(pags_window_compare(path, &data, &shown, &other->window));
  other->width = (int)info->shown_width;
  other->height = (int)info->shown_height;
  other->left = (int)(info->left - info->shown_left);
  other->top = (int)(info->top - info->shown_top);
  return PAGS_OK;
}

/* ---- Reading ---- */

/* Opens a picture; the caller closes it, also after a failure. */
static pags_result open_other(const char *path, other_picture *other) {
  char refusal[512];
  pags_oiio_message message;
  snprintf(refusal, sizeof refusal, "%s", pags_error_message());
  *other = (other_picture){.window = PAGS_WINDOW_WHOLE};
  const pags_result loaded = pags_oiio_module(&other->oiio);
  if (loaded != PAGS_OK)
    return pags_fail(loaded, "%s; OpenImageIO reads more: %s", refusal, pags_error_message());
  const pags_result opened = other->oiio->open(path, &other->reader, &other->info, &message);
  if (opened != PAGS_OK)
    return pags_fail(opened, "%s: not a readable picture: %s", path, message.text);
  const pags_oiio_info *const info = &other->info;
  if (info->shown_width > 0)
    return open_exr(path, other);
  /* The picture of any other format: the first channels of the first part. */
  if (info->width < 1 || info->width > PAGS_IMAGE_MAX_SIDE || info->height < 1 || info->height > PAGS_IMAGE_MAX_SIDE ||
      info->depth > 1 || info->channels < 1)
    return pags_fail_at(path, "%lld x %lld x %lld pixels with %d channels, expected sides of 1..%d",
                        (long long)info->width, (long long)info->height, (long long)info->depth, info->channels,
                        PAGS_IMAGE_MAX_SIDE);
  other->width = (int)info->width;
  other->height = (int)info->height;
  other->layer =
      (pags_layer){.channels = info->channels < 4 ? info->channels : 4, .order = {0, 1, 2, 3}, .alpha = info->alpha};
  return PAGS_OK;
}

/* Looks in the file itself, where OpenImageIO doesn't tell. */
static bool find_in_container(const char *path, pags_colour *colour) {
  enum { MOST = 1 << 20 }; /* bytes, in which headers lie */
  PAGS_AUTOFREE uint8_t *bytes = malloc(MOST);
  PAGS_AUTO(pags_file_close) FILE *file = pags_port_open(path, "rb");
  return bytes && file && pags_container_colour(bytes, fread(bytes, 1, MOST, file), colour);
}

/* The space of the colours. OpenImageIO's name for it counts where the file has neither profile nor numbers; names of
 * what it has converted itself, or assumes, mean nothing here. */
static void find_colour(const char *path, const pags_oiio_info *info, pags_colour *colour) {
  double xy[8], gamma;
  memset(colour, 0, sizeof *colour);
  for (int i = 0; i < 8; i++)
    xy[i] = (double)info->chromaticities[i];
  if (info->profile)
    pags_colour_set_icc(colour, info->profile, info->profile_size);
  else if (info->cicp[0] > 0)
    pags_colour_set_cicp(colour, info->cicp[0], info->cicp[1], info->cicp[3] != 0);
  else if (find_in_container(path, colour))
    return;
  else if (info->sample == PAGS_F32 && xy[7] > 0)
    pags_colour_set_primaries(colour, xy);
  else if (info->sample != PAGS_F32 && (strncasecmp(info->space, "lin", 3) == 0))
    pags_colour_set_gamma(colour, 1, NULL, NULL);
  else if (info->sample != PAGS_F32 && sscanf(info->space, "Gamma%lf", &gamma) == 1 && gamma > 0.1 && gamma < 10)
    pags_colour_set_gamma(colour, gamma, NULL, NULL);
  else if (strstr(info->space, "Log") || strstr(info->space, "LAB") || strstr(info->space, "Lab"))
    pags_colour_set_unknown(colour, info->space);
}

pags_result pags_other_inspect(const char *path, pags_image_facts *facts) {
  PAGS_AUTO(close_other) other_picture other = {0};
  pags_colour colour;
  PAGS_TRY(open_other(path, &other));
  find_colour(path, &other.info, &colour);
  *facts = (pags_image_facts){.width = other.width,
                              .height = other.height,
                              .alpha = other.layer.alpha,
                              .sample = other.info.sample,
                              .orientation = other.info.orientation,
                              .pixel_aspect = pags_pixel_aspect(other.info.pixel_aspect),
                              .window = other.window,
                              .layer_rule = other.layer.rule};
  memcpy(facts->layer, other.layer.name, sizeof facts->layer);
  pags_colour_state(&colour, facts);
  return PAGS_OK;
}

/* Reads all samples of the part. */
static pags_result read_samples(const char *path, const other_picture *other, int channels, pags_image *out) {
  pags_oiio_message message;
  const int stored = other->layer.channels < channels ? other->layer.channels : channels;
  PAGS_TRY(pags_image_create(out, (int)other->info.width, (int)other->info.height, channels, other->info.sample));
  const pags_result result =
      other->oiio->read(other->reader, other->layer.order, stored, other->info.sample, channels, out->data, &message);
  if (result != PAGS_OK)
    return pags_fail(result, "%s: can't be decoded: %s", path, message.text);
  if (channels > stored) { /* alpha of what has samples, of an EXR file */
    const size_t samples = (size_t)out->width * (size_t)out->height * (size_t)channels;
    for (size_t i = (size_t)channels - 1; i < samples; i += (size_t)channels)
      ((float *)out->data)[i] = 1;
  }
  return PAGS_OK;
}

/* Brings colours to the convention: straight of integers, multiplied by alpha of floats. */
static void multiply_by_alpha(const other_picture *other, pags_image *image) {
  const size_t count = (size_t)image->channels, pixels = (size_t)image->width * (size_t)image->height;
  const bool wide = image->sample == PAGS_U16;
  const unsigned full = wide ? 65535 : 255;
  const bool light = image->sample == PAGS_F32;
  if (!other->layer.alpha || count % 2 != 0 || light != (other->info.straight != 0))
    return;
  for (size_t i = 0; i < pixels; i++)
    for (size_t c = 0; c + 1 < count; c++) {
      const size_t at = i * count + c, last = i * count + count - 1;
      if (light) {
        ((float *)image->data)[at] *= ((float *)image->data)[last];
        continue;
      }
      const unsigned alpha = wide ? ((uint16_t *)image->data)[last] : ((uint8_t *)image->data)[last];
      const unsigned colour = wide ? ((uint16_t *)image->data)[at] : ((uint8_t *)image->data)[at];
      const uint64_t straight = alpha > 0 ? ((uint64_t)colour * full + alpha / 2) / alpha : colour;
      if (wide)
        ((uint16_t *)image->data)[at] = (uint16_t)(straight < full ? straight : full);
      else
        ((uint8_t *)image->data)[at] = (uint8_t)(straight < full ? straight : full);
    }
}

pags_result pags_other_load(const char *path, int most, pags_image *out, pags_colour *colour) {
  PAGS_AUTO(close_other) other_picture other = {0};
  PAGS_TRY(pags_tiff_check(path));
  PAGS_TRY(open_other(path, &other));
  find_colour(path, &other.info, colour);
  const bool straighten = other.layer.alpha && other.info.sample != PAGS_F32 && !other.info.straight;
  const int channels = pags_layer_channels(&other.layer, other.window, straighten ? 4 : most);
  if (other.window == PAGS_WINDOW_WHOLE) {
    PAGS_TRY(read_samples(path, &other, channels, out));
  } else { /* copy the samples of the data window to their place in the picture */
    PAGS_AUTO(pags_image_destroy) pags_image data = {0};
    PAGS_TRY(read_samples(path, &other, channels, &data));
    PAGS_TRY(pags_image_create(out, other.width, other.height, channels, other.info.sample));
    const size_t bytes = pags_pixel_bytes(out);
    const int begin = other.left < 0 ? -other.left : 0;
    const int end = data.width < out->width - other.left ? data.width : out->width - other.left;
    for (int y = 0; y < data.height; y++)
      if (other.top + y >= 0 && other.top + y < out->height)
        memcpy((uint8_t *)out->data +
                   ((size_t)(other.top + y) * (size_t)out->width + (size_t)(other.left + begin)) * bytes,
               (const uint8_t *)data.data + ((size_t)y * (size_t)data.width + (size_t)begin) * bytes,
               (size_t)(end - begin) * bytes);
  }
  multiply_by_alpha(&other, out);
  return PAGS_OK;
}
