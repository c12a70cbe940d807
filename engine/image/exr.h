/* SPDX-License-Identifier: Apache-2.0 */
/* OpenEXR files (openexr.com/en/latest/OpenEXRFileLayout.html), read through OpenEXRCore and written here. All
 * functions may be called on any thread. */
#ifndef PAGS_IMAGE_EXR_H
#define PAGS_IMAGE_EXR_H

#include <pags/image.h>

#include "image/colour.h"
#include "image/encoded.h"

/* Reads what the header says of the layer that is the picture (layers.h); the size is that of the display window.
 * Errors as pags_exr_decode. */
pags_result pags_exr_inspect(const pags_encoded *file, pags_image_facts *facts, pags_colour *colour);

/* Decodes at most `most` (3 or 4) channels of the picture: F32, as they are stored, so alpha isn't divided out. Pixels
 * of the display window that the data window lacks are 0, and so is their alpha, which a layer without alpha gets then.
 *
 * Scan lines are read, uncompressed or compressed by RLE, ZIP, ZIPS or PIZ: PAGS_ERROR_UNSUPPORTED for others.
 * PAGS_ERROR_FORMAT or PAGS_ERROR_MEMORY. On failure `out` is zeroed. */
pags_result pags_exr_decode(const pags_encoded *file, int most, pags_image *out);

/* Float channels to write: sample (x, y) of channel c is planes[c][y * row_step + x * pixel_step]. */
typedef struct pags_exr_planes {
  int width, height, channels; /* 1..64 channels */
  const char *const *names;
  const float *const *planes;
  size_t pixel_step, row_step; /* floats */
  const char *const *texts;    /* string attributes: name and value by turns, ended by NULL; NULL: none */
} pags_exr_planes;

/* Encodes scan lines compressed by ZIP. PAGS_ERROR_MEMORY; the caller frees out->bytes in either case. */
pags_result pags_exr_encode(const char *path, const pags_exr_planes *picture, pags_sink *out);

#endif
