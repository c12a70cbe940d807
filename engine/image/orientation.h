/* SPDX-License-Identifier: Apache-2.0 */
/* The orientation that EXIF data (CIPA DC-008, tag 274) gives a picture, and turning a picture by it. */
#ifndef PAGS_IMAGE_ORIENTATION_H
#define PAGS_IMAGE_ORIENTATION_H

#include <pags/image.h>

#include <stddef.h>

/* Reads the orientation from EXIF data, which are a TIFF header and its directories: 1..8 as EXIF numbers them; 1 where
 * they have none or are damaged. */
int pags_orientation_of_exif(const uint8_t *bytes, size_t size);

/* Reads it from a JPEG file's first EXIF segment; 1 where there is none. */
int pags_orientation_of_jpeg(const uint8_t *bytes, size_t size);

#endif
