/* SPDX-License-Identifier: Apache-2.0 */
/* PNG files (ISO/IEC 15948), read and written through libpng. All functions may be called on any thread. */
#ifndef PAGS_IMAGE_PNG_H
#define PAGS_IMAGE_PNG_H

#include <pags/image.h>

#include "image/colour.h"
#include "image/encoded.h"

/* Reads what the header says. Errors as pags_png_decode. */
pags_result pags_png_inspect(const pags_encoded *file, pags_image_facts *facts, pags_colour *colour);

/* Decodes a picture: U16 for 16 bits a sample, else U8. Fewer bits are scaled to 8, a palette becomes RGB, a
 * transparent colour becomes alpha; alpha is straight. Gamma and colour profile are not applied. With `most` 3, alpha
 * is left out. With file->rows, the picture ends after that many rows, unless it is interlaced. PAGS_ERROR_FORMAT or
 * PAGS_ERROR_MEMORY; then `out` is zeroed. */
pags_result pags_png_decode(const pags_encoded *file, int most, pags_image *out);

/* Encodes a U8 or U16 picture, marked as sRGB. PAGS_ERROR_MEMORY or PAGS_ERROR_IO; the caller frees out->bytes in
 * either case. */
pags_result pags_png_encode(const char *path, const pags_image *image, pags_sink *out);

#endif
