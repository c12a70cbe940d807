/* SPDX-License-Identifier: Apache-2.0 */
/* The colours of a photograph as display values: sRGB encoding of linear light, alpha composited in display values (as
 * INRIA's trainer does it for its synthetic scenes) or taken for a mask. */
#include "dataset/photo_colour.h"

#include "maths/maths.h"

#include <stdbool.h>
#include <string.h>

/* ---- Linear light ---- */

/* limit[k]: the smallest linear light whose display value rounds to k + 1 of 255. */
static void make_limits(float limit[255]) {
  for (int k = 0; k < 255; k++) {
    const double v = (k + 0.5) / 255;
    limit[k] = (float)(v <= 0.04045 ? v / 12.92 : pags_pow((v + 0.055) / 1.055, 2.4));
  }
}

static uint8_t encode(const float limit[255], float light) {
  int low = 0, high = 255;
  while (low < high) { /* the number of limits that the light reaches; NaN reaches none */
    const int middle = (low + high) / 2;
    if (light >= limit[middle])
      low = middle + 1;
    else
      high = middle;
  }
  return (uint8_t)low;
}

/* Converts F32 of 3 or 4 channels to U8 of as many; alpha becomes straight. */
static pags_result encode_all(pags_image *image) {
  float limit[255];
  pags_image out;
  make_limits(limit);
  PAGS_TRY(pags_image_create(&out, image->width, image->height, image->channels, PAGS_U8));
  const size_t pixels = (size_t)image->width * (size_t)image->height, channels = (size_t)image->channels;
  const float *from = image->data;
  uint8_t *to = out.data;
  for (size_t i = 0; i < pixels; i++, from += channels, to += channels) {
    const float alpha = channels == 4 ? (from[3] > 0 ? (from[3] < 1 ? from[3] : 1) : 0) : 1;
    for (size_t c = 0; c < 3; c++)
      to[c] = encode(limit, alpha > 0 ? from[c] / alpha : from[c]);
    if (channels == 4)
      to[3] = (uint8_t)(alpha * 255 + 0.5f);
  }
  pags_image_destroy(image);
  *image = out;
  return PAGS_OK;
}

/* ---- Alpha ---- */

/* Splits U8 RGBA into colour and, for PAGS_ALPHA_MASK, mask. */
static pags_result apply_alpha(const pags_image *rgba, const pags_alpha_rule *rule, pags_image *colour,
                               pags_image *mask) {
  PAGS_TRY(pags_image_create(colour, rgba->width, rgba->height, 3, PAGS_U8));
  if (rule->what == PAGS_ALPHA_MASK)
    PAGS_TRY(pags_image_create(mask, rgba->width, rgba->height, 1, PAGS_U8));
  const size_t pixels = (size_t)rgba->width * (size_t)rgba->height;
  const uint8_t *from = rgba->data;
  uint8_t *to = colour->data, *used = mask->data;
  for (size_t i = 0; i < pixels; i++, from += 4, to += 3) {
    const unsigned alpha = used ? 255 : from[3];
    for (int c = 0; c < 3; c++)
      to[c] = (uint8_t)((alpha * from[c] + (255 - alpha) * rule->background[c] + 127) / 255);
    if (used)
      *used++ = from[3] >= 128 ? 255 : 0;
  }
  return PAGS_OK;
}

bool pags_photo_has_alpha(const pags_image_facts *facts, pags_image_alpha what) {
  return (facts->alpha || facts->window == PAGS_WINDOW_PARTIAL) && what != PAGS_ALPHA_IGNORE;
}

pags_result pags_photo_colour_load(const char *path, const pags_image_facts *facts, const pags_alpha_rule *rule,
                                   pags_image *colour, pags_image *mask) {
  const bool alpha = pags_photo_has_alpha(facts, rule->what), light = facts->sample == PAGS_F32;
  pags_image loaded;
  memset(colour, 0, sizeof *colour);
  memset(mask, 0, sizeof *mask);
  PAGS_TRY(pags_image_load(path, light ? PAGS_F32 : PAGS_U8, alpha ? 4 : 3, &loaded));
  pags_result result = light ? encode_all(&loaded) : PAGS_OK;
  if (result == PAGS_OK && alpha) {
    result = apply_alpha(&loaded, rule, colour, mask);
  } else if (result == PAGS_OK) {
    *colour = loaded;
    return PAGS_OK;
  }
  pags_image_destroy(&loaded);
  if (result != PAGS_OK) {
    pags_image_destroy(colour);
    pags_image_destroy(mask);
  }
  return result;
}
