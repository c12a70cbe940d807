/* SPDX-License-Identifier: Apache-2.0 */
/* Picture files in memory: the bytes that a decoder reads, a growing block that an encoder writes into, and the formats
 * that are decoded and encoded here. All functions may be called on any thread. */
#ifndef PAGS_IMAGE_FORMATS_H
#define PAGS_IMAGE_FORMATS_H

#include <stdlib.h>

#include <pags/image.h>

#include "image/colour.h"

/* The largest width and height of a picture, pixels. */
#define PAGS_IMAGE_MAX_SIDE 65535

/* The bytes of a file, borrowed. */
typedef struct pags_encoded {
  const char *path; /* names the file in messages */
  const uint8_t *bytes;
  size_t size;
  int rows; /* enough rows from the top: a decoder that can stops there; 0: all are wanted */
} pags_encoded;

/* Size and samples of a picture as its decoder gives them. */
typedef struct pags_picture_info {
  int64_t width, height; /* pixels */
  int channels;
} pags_picture_info;

/* Fails with PAGS_ERROR_FORMAT if a side is not 1..PAGS_IMAGE_MAX_SIDE, or if the file is too short for the picture:
 * `least` is the fewest bytes that can hold it. Called before memory for the samples is allocated. */
pags_result pags_encoded_check(const pags_encoded *file, const pags_picture_info *info, uint64_t least);

/* Fails with PAGS_ERROR_FORMAT and "path: WHAT: NAME: text", for a header or samples that can't be read. NAME is the
 * format's. */
#define PAGS_BAD_HEADER "not a readable picture"
#define PAGS_BAD_SAMPLES "can't be decoded"
pags_result pags_encoded_bad(const pags_encoded *file, const char *what, const char *name, const char *text);

/* The ratio that a file states of a pixel's sides, or 1 for an invalid one: not finite, not positive, or within 1 %
 * of a square. */
static inline double pags_pixel_aspect(double stated) {
  return stated > 0.05 && stated < 20 && (stated < 0.99 || stated > 1.01) ? stated : 1;
}

/* A block that grows as it is written to. Zeros are an empty one. */
typedef struct pags_sink {
  uint8_t *bytes; /* freed by the owner, or by pags_sink_destroy */
  size_t size, capacity;
} pags_sink;

static inline void pags_sink_destroy(pags_sink *sink) {
  free(sink->bytes);
}

/* Appends bytes; returns false if there is no memory for them. */
bool pags_sink_put(pags_sink *sink, const void *bytes, size_t size);

/* ---- EXIF data (CIPA DC-008), which are a TIFF header and its directories ---- */

/* Reads the orientation from EXIF data: 1..8 as EXIF numbers them; 1 where they have none or are damaged. */
int pags_orientation_of_exif(const uint8_t *bytes, size_t size);

/* Whether they say that the colours are Adobe RGB, as cameras do (DCF: InteroperabilityIndex "R03"; or ColorSpace 2).
 */
bool pags_exif_says_adobe_rgb(const uint8_t *bytes, size_t size);

/* A JPEG file's first EXIF segment, without its name; NULL: not found. */
const uint8_t *pags_exif_of_jpeg(const uint8_t *bytes, size_t size, size_t *exif_size);

/* ---- PNG (ISO/IEC 15948), through libpng ---- */

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

/* ---- JPEG (ITU-T T.81), through libjpeg-turbo ---- */

/* Returns the segment of a JPEG file that begins at byte *at, a marker and the segment's length, and moves *at behind
 * it. Begin with *at = 2. NULL at the first scan, and where segments are malformed; *at stays there. */
const uint8_t *pags_jpeg_segment(const uint8_t *bytes, size_t size, size_t *at, size_t *length);

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

/* ---- OpenEXR (openexr.com/en/latest/OpenEXRFileLayout.html), read through OpenEXRCore ---- */

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
