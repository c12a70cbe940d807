/* SPDX-License-Identifier: Apache-2.0 */
/* What EXIF data (CIPA DC-008) say of a picture: orientation and colours; and turning a picture by its orientation. */
#ifndef PAGS_IMAGE_ORIENTATION_H
#define PAGS_IMAGE_ORIENTATION_H

#include <pags/image.h>

#include <stdbool.h>
#include <stddef.h>

/* Reads the orientation from EXIF data, which are a TIFF header and its directories: 1..8 as EXIF numbers them; 1 where
 * they have none or are damaged. */
int pags_orientation_of_exif(const uint8_t *bytes, size_t size);

/* Whether they say that the colours are Adobe RGB, as cameras do (DCF: InteroperabilityIndex "R03"; or ColorSpace 2).
 */
bool pags_exif_says_adobe_rgb(const uint8_t *bytes, size_t size);

/* A JPEG file's first EXIF segment, without its name; NULL: not found. */
const uint8_t *pags_exif_of_jpeg(const uint8_t *bytes, size_t size, size_t *exif_size);

#endif
