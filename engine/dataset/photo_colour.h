/* SPDX-License-Identifier: Apache-2.0 */
/* Decodes the colours of a photograph to 8-bit display values, with alpha and light as the data set's options say. */
#ifndef PAGS_DATASET_PHOTO_COLOUR_H
#define PAGS_DATASET_PHOTO_COLOUR_H

#include <stdbool.h>

#include <pags/dataset.h>
#include <pags/image.h>

/* What to do with alpha, and the colour behind the photograph, display-referred. */
typedef struct pags_alpha_rule {
  pags_image_alpha what;
  uint8_t background[3];
} pags_alpha_rule;

/* Whether alpha is read: that of the file, or what the data window of an EXR file covers of its picture. */
bool pags_photo_has_alpha(const pags_image_facts *facts, pags_image_alpha what);

/* Loads a photograph: `colour` U8 RGB, and with PAGS_ALPHA_MASK, if the picture has alpha, `mask` U8 of one channel,
 * 255 where alpha is 128 or more, else 0; otherwise mask->data is NULL. Colours as pags_image_load_display. On failure
 * both are zeroed. */
pags_result pags_photo_colour_load(const char *path, const pags_image_facts *facts, const pags_alpha_rule *rule,
                                   pags_image *colour, pags_image *mask);

#endif
