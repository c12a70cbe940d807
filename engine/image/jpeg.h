/* SPDX-License-Identifier: Apache-2.0 */
/* JPEG files (ITU-T T.81), read and written through libjpeg-turbo. All functions may be called on any thread. */
#ifndef PAGS_IMAGE_JPEG_H
#define PAGS_IMAGE_JPEG_H

#include <pags/image.h>

#include "image/colour.h"
#include "image/encoded.h"

/* Reads what the header says. Errors as pags_jpeg_decode. */
pags_result pags_jpeg_inspect(const pags_encoded *file, pags_image_facts *facts, pags_colour *colour);

/* Decodes a picture: U8, grey or RGB. CMYK, which Adobe's programs store inverted, becomes RGB by multiplying each
 * colour with black. Nothing is turned. No file has alpha: `most` (3 or 4) only bounds the channels of
 * files of an unknown colour space.
 *
 * PAGS_ERROR_FORMAT, also for a file that is cut off: libjpeg would fill the rest of the picture with grey.
 * PAGS_ERROR_MEMORY. On failure `out` is zeroed. */
pags_result pags_jpeg_decode(const pags_encoded *file, int most, pags_image *out);

/* Encodes a U8 picture of 1 or 3 channels, marked as sRGB. The quality is libjpeg's, 1..100; from 90 on chroma keeps
 * its resolution, below it is halved.
 * PAGS_ERROR_MEMORY or PAGS_ERROR_IO; the caller frees out->bytes in either case. */
pags_result pags_jpeg_encode(const char *path, const pags_image *image, int quality, pags_sink *out);

#endif
