/* SPDX-License-Identifier: Apache-2.0 */
/* The colours of a photograph as display values: alpha composited in display values (as INRIA's trainer does it for its
 * synthetic scenes) or taken for a mask. */
#include "dataset/photo_colour.h"

#include <string.h>

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
  pags_image loaded;
  memset(colour, 0, sizeof *colour);
  memset(mask, 0, sizeof *mask);
  if (!pags_photo_has_alpha(facts, rule->what))
    return pags_image_load_display(path, 3, colour);
  PAGS_TRY(pags_image_load_display(path, 4, &loaded));
  const pags_result result = apply_alpha(&loaded, rule, colour, mask);
  pags_image_destroy(&loaded);
  if (result != PAGS_OK) {
    pags_image_destroy(colour);
    pags_image_destroy(mask);
  }
  return result;
}
