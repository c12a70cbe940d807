/* SPDX-License-Identifier: Apache-2.0 */
/* The choice of an OpenEXR file's picture (layers.h). */
#include "image/layers.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "base/file.h"
#include "image/formats.h"

/* ---- Names ---- */

/* Length of LAYER in LAYER.SUFFIX, 0 where none exists. */
static size_t layer_length(const char *name) {
  const char *const dot = strrchr(name, '.');
  return dot ? (size_t)(dot - name) : 0;
}

static bool same_layer(const pags_layer_channel *a, const pags_layer_channel *b) {
  const size_t length = layer_length(a->name);
  return a->part_index == b->part_index && length == layer_length(b->name) && memcmp(a->name, b->name, length) == 0;
}

/* The channel of a layer that has one of two suffixes; -1: none. */
static int find(const pags_layer_channel *channels, int count, const pags_layer_channel *like, const char *suffix,
                const char *other) {
  for (int i = 0; i < count; i++) {
    const char *const dot = strrchr(channels[i].name, '.'), *const found = dot ? dot + 1 : channels[i].name;
    if ((strcasecmp(found, suffix) == 0 || strcasecmp(found, other) == 0) && same_layer(&channels[i], like))
      return i;
  }
  return -1;
}

/* Whether one of the words between the dots of a name of `length` bytes is `word`; only the last one, if `last`. */
static bool has_word(const char *name, size_t length, const char *word, bool last) {
  const size_t size = strlen(word);
  for (size_t begin = 0, end; begin <= length; begin = end + 1) {
    for (end = begin; end < length && name[end] != '.';)
      end++;
    if (end - begin == size && strncasecmp(name + begin, word, size) == 0 && (!last || end == length))
      return true;
  }
  return false;
}

static bool layer_has_word(const pags_layer_channel *c, const char *word, bool last) {
  const size_t length = layer_length(c->name);
  return has_word(c->name, length, word, last) ||
         ((!last || length == 0) && has_word(c->part, strlen(c->part), word, last));
}

static void write_name(const pags_layer_channel *c, char name[PAGS_IMAGE_NAME]) {
  const int length = (int)layer_length(c->name);
  if (length > 0)
    snprintf(name, PAGS_IMAGE_NAME, "%.*s", length, c->name);
  else
    snprintf(name, PAGS_IMAGE_NAME, "%s", c->part);
}

/* ---- Choice ---- */

/* How likely a layer is the picture. */
enum { NO_COLOUR, GREY, COLOUR, NAMED, COMBINED, FIRST_VIEW, COMPOSITE, WITHOUT_LAYER };

/* The channels of a layer that has colours, and their rank. */
typedef struct candidate {
  int rank;
  int channels[4], count;
  bool alpha;
} candidate;

static candidate judge(const pags_layer_channel *all, int count, const pags_layer_channel *like, bool parts) {
  static const char *const known[] = {"rgba", "rgb", "beauty", "main", "color", "colour", "image", "composite"};
  const int red = find(all, count, like, "R", "Red"), green = find(all, count, like, "G", "Green");
  const int blue = find(all, count, like, "B", "Blue"), grey = find(all, count, like, "Y", "Y");
  const int alpha = find(all, count, like, "A", "Alpha");
  candidate c = {.rank = NO_COLOUR};
  const bool position = find(all, count, like, "X", "X") >= 0 || find(all, count, like, "Z", "Z") >= 0;
  if (red >= 0 && green >= 0 && blue >= 0)
    c = (candidate){.rank = COLOUR, .channels = {red, green, blue}, .count = 3};
  else if (grey >= 0 && (!position || (layer_length(like->name) == 0 && find(all, count, like, "X", "X") < 0)))
    c = (candidate){.rank = GREY, .channels = {grey}, .count = 1};
  else
    return c;
  if (alpha >= 0) {
    c.channels[c.count++] = alpha;
    c.alpha = true;
  }
  if (!parts && layer_length(like->name) == 0)
    c.rank = WITHOUT_LAYER;
  else if (layer_has_word(like, "Combined", false))
    c.rank = layer_has_word(like, "Composite", false)                                                 ? COMPOSITE
             : layer_has_word(like, "ViewLayer", false) || layer_has_word(like, "RenderLayer", false) ? FIRST_VIEW
                                                                                                      : COMBINED;
  else
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
      if (layer_has_word(like, known[i], true))
        c.rank = NAMED;
  return c;
}

/* Fails with the names of layers that have colours, or else of all channels. */
static pags_result refuse(const char *path, const pags_layer_channel *all, int count, bool layers, bool parts) {
  char name[PAGS_IMAGE_NAME], names[400] = "";
  size_t used = 0;
  for (int i = 0; i < count && used + 8 < sizeof names; i++) {
    bool first = true;
    for (int k = 0; layers && k < i && first; k++)
      first = !same_layer(&all[k], &all[i]);
    if (!first || (layers && judge(all, count, &all[i], parts).rank == NO_COLOUR))
      continue;
    write_name(&all[i], name);
    const int wrote =
        snprintf(names + used, sizeof names - used, "%s%s", used ? ", " : "", layers ? name : all[i].name);
    used += wrote > 0 ? (size_t)wrote : 0;
  }
  if (!layers)
    return pags_fail_at(path, "no colours among the channels of this EXR file: %s; expected R, G and B, or Y", names);
  return pags_fail_at(
      path,
      "several layers of this EXR file may be its picture: %s; expected R, G and B without a layer, or a layer named "
      "Combined. Write the one you mean alone (oiiotool IN.exr --ch R=LAYER.R,G=LAYER.G,B=LAYER.B -o OUT.exr)",
      names);
}

/* Sets the channels of the picture from a candidate. */
static pags_result accept(const char *path, const pags_layer_channel *all, const candidate *c, pags_layer *out) {
  out->part = all[c->channels[0]].part_index;
  out->channels = c->count;
  out->alpha = c->alpha;
  write_name(&all[c->channels[0]], out->name);
  for (int i = 0; i < c->count; i++) {
    const pags_layer_channel *const channel = &all[c->channels[i]];
    if (channel->number)
      return pags_fail_at(
          path, "the channel %s of this EXR file holds integers without a value for white; expected half or float",
          channel->name);
    out->order[i] = channel->index;
  }
  return PAGS_OK;
}

pags_result pags_layer_choose(const char *path, const pags_layer_channel *channels, int count, pags_layer *out) {
  const bool parts = count > 0 && channels[count - 1].part_index > 0;
  candidate best = {.rank = NO_COLOUR};
  int alike = 0, coloured = 0, combined = 0;
  memset(out, 0, sizeof *out);
  if (count == 1)
    return accept(path, channels, &(candidate){.channels = {0}, .count = 1}, out);
  for (int i = 0; i < count; i++) {
    const candidate c = judge(channels, count, &channels[i], parts);
    if (c.rank == NO_COLOUR || c.channels[0] != i) /* each layer once, at its first colour */
      continue;
    coloured++;
    combined += c.rank == COMBINED || c.rank == FIRST_VIEW;
    alike = c.rank > best.rank ? 1 : alike + (c.rank == best.rank);
    if (c.rank > best.rank)
      best = c;
  }
  if (best.rank == NO_COLOUR)
    return refuse(path, channels, count, false, parts);
  const pags_layer_channel *const first = &channels[best.channels[0]];
  const bool leading = parts && first->part_index == 0 && layer_length(first->name) == 0;
  if (alike > 1 && best.rank < NAMED && !leading)
    return refuse(path, channels, count, true, parts);
  if (find(channels, count, first, "RY", "BY") >= 0)
    return pags_fail_at(path,
                        "this EXR file holds luminance and chroma (Y, RY, BY), which is not supported; expected R, G "
                        "and B. Write it as RGB");
  out->rule = alike > 1 || (best.rank == FIRST_VIEW && combined > 1) ? PAGS_LAYER_FIRST
              : coloured > 1 || best.rank < WITHOUT_LAYER            ? PAGS_LAYER_NAMED
                                                                     : PAGS_LAYER_ONLY;
  return accept(path, channels, &best, out);
}

/* ---- Windows ---- */

/* A display window of this number of pixels is taken whatever the data window has; a larger one, up to that many times
 * its pixels: a few bytes must not make the reader allocate gigabytes. */
enum { PIXELS = 1 << 24, TIMES = 64 };

pags_result pags_window_compare(const char *path, const pags_window_box *data, const pags_window_box *display,
                                pags_image_window *out) {
  const int64_t width = display->right - display->left, height = display->bottom - display->top;
  const int64_t data_width = data->right - data->left, data_height = data->bottom - data->top;
  const int64_t most = PAGS_IMAGE_MAX_SIDE;
  if (width < 1 || height < 1 || data_width < 1 || data_height < 1 || width > most || height > most ||
      data_width > most || data_height > most)
    return pags_fail_at(path,
                        "a display window of %lld x %lld pixels and a data window of %lld x %lld, expected sides of "
                        "1..%d",
                        (long long)width, (long long)height, (long long)data_width, (long long)data_height,
                        PAGS_IMAGE_MAX_SIDE);
  if (data->right <= display->left || display->right <= data->left || data->bottom <= display->top ||
      display->bottom <= data->top || (width * height > PIXELS && width * height / TIMES > data_width * data_height))
    return pags_fail_at(path,
                        "the data window (%lld,%lld to %lld,%lld) has no part, or next to none, of the display window "
                        "(%lld,%lld to %lld,%lld); expected the picture to lie there",
                        (long long)data->left, (long long)data->top, (long long)data->right - 1,
                        (long long)data->bottom - 1, (long long)display->left, (long long)display->top,
                        (long long)display->right - 1, (long long)display->bottom - 1);
  const bool covers = data->left <= display->left && data->top <= display->top && data->right >= display->right &&
                      data->bottom >= display->bottom;
  *out = !covers                                      ? PAGS_WINDOW_PARTIAL
         : data_width > width || data_height > height ? PAGS_WINDOW_LARGER
                                                      : PAGS_WINDOW_WHOLE;
  return PAGS_OK;
}
