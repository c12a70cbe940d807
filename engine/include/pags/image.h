/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures in memory, and reading and writing them as files. PNG, JPEG and EXR are read and written here; OpenImageIO,
 * if there is one, reads other formats, and is loaded when the first such file is read. */
#ifndef PAGS_IMAGE_H
#define PAGS_IMAGE_H

#include <pags/base.h>

PAGS_BEGIN_C

/* The type of a sample: uint8_t, uint16_t or float. */
typedef enum pags_sample { PAGS_U8, PAGS_U16, PAGS_F32 } pags_sample;

/* Interleaved samples, row 0 at the top, no padding: sample (x, y, c) is data[(y * width + x) * channels + c]. */
typedef struct pags_image {
  int width, height; /* pixels, 1..65535 */
  int channels;      /* 1..4: grey, grey+alpha, RGB, RGBA */
  pags_sample sample;
  void *data; /* freed by pags_image_destroy */
} pags_image;

/* Allocates a picture whose samples are all 0; `image` is overwritten without being freed. PAGS_ERROR_ARGUMENT
 * for a size or a number of channels out of range; PAGS_ERROR_MEMORY. On failure `image` is zeroed. */
PAGS_API pags_result pags_image_create(pags_image *image, int width, int height, int channels, pags_sample sample);

/* Frees the samples and zeroes the struct. A zeroed struct is allowed. */
PAGS_API void pags_image_destroy(pags_image *image);

/* Reads the width and height of a picture file (pixels) without decoding its samples. Errors as pags_image_load. */
PAGS_API pags_result pags_image_size(const char *path, int *width, int *height);

/* Bytes of a name in pags_image_facts, with the 0 at its end; longer names are cut. */
#define PAGS_IMAGE_NAME 64

/* Whether the samples of an EXR file cover its picture, which is the display window. Samples outside of it aren't
 * read; where the data window has no samples, all channels are 0. */
typedef enum pags_image_window { PAGS_WINDOW_WHOLE, PAGS_WINDOW_LARGER, PAGS_WINDOW_PARTIAL } pags_image_window;

/* How the layer of an EXR file was chosen: there is no other with colours; by its name; it is one of several that are
 * as likely. */
typedef enum pags_layer_rule { PAGS_LAYER_ONLY, PAGS_LAYER_NAMED, PAGS_LAYER_FIRST } pags_layer_rule;

/* Whether colours are display-referred sRGB, or linear light with its primaries, or nothing is said; of another space,
 * which is known; of one that is not. */
typedef enum pags_colour_kind { PAGS_COLOUR_SRGB, PAGS_COLOUR_OTHER, PAGS_COLOUR_UNKNOWN } pags_colour_kind;

/* What the header of a picture file says. */
typedef struct pags_image_facts {
  int width, height; /* pixels as stored; of an EXR file its display window */
  int alpha;         /* 1: the last of 2 or 4 channels is alpha, or a colour is transparent */
  /* As pags_image_load decodes them before it converts. By convention U8 and U16 are display-referred with straight
   * alpha, and F32 is linear light with colours multiplied by alpha. */
  pags_sample sample;
  int orientation;     /* as EXIF numbers them, 1..8; 1: stored as it is looked at, or unknown */
  double pixel_aspect; /* width of a pixel over its height; 1: square, or unknown */
  pags_image_window window;
  pags_layer_rule layer_rule;
  pags_colour_kind colour;
  char space[PAGS_IMAGE_NAME]; /* name of the colour space; "": none is stated */
  char layer[PAGS_IMAGE_NAME]; /* of an EXR file: the layer that is read; "": the channels without a layer */
} pags_image_facts;

/* Reads these facts without decoding the samples. Errors as pags_image_load. */
PAGS_API pags_result pags_image_inspect(const char *path, pags_image_facts *facts);

/* Turns a picture that is stored with this orientation (1..8) to how it is looked at; 5..8 exchange width and height.
 * PAGS_ERROR_MEMORY; then it stays as it was. */
PAGS_API pags_result pags_image_turn(pags_image *image, int orientation);

/* Reads PNG, JPEG and EXR, and any other format that OpenImageIO reads where it is there. The format is found by the
 * file's first bytes, whatever its name. Alpha is straight or not as the file has it, and nothing is multiplied by it.
 *
 * The samples are converted to `sample`: 0..255 or 0..65535 correspond to 0..1 of a float. No transfer curve or colour
 * profile is applied: masks and labels are numbers. They are converted to `channels` (0: as in
 * the file, at most 4): RGB from grey repeats the grey; grey from RGB is the Rec. 709 luma of the display-referred
 * samples; alpha that isn't wanted is dropped, not multiplied in; alpha that is missing is opaque. Nothing is
 * turned by an EXIF orientation (pags_image_turn does that).
 *
 * PAGS_ERROR_IO (no readable file), PAGS_ERROR_FORMAT (with the decoder's message, or a side beyond 1..65535),
 * PAGS_ERROR_UNSUPPORTED (another format, and the OpenImageIO module is missing) or PAGS_ERROR_MEMORY; then `out` is
 * zeroed. */
PAGS_API pags_result pags_image_load(const char *path, pags_sample sample, int channels, pags_image *out);

/* Reads a photograph for what compares it with renders: as U8 of 3 or 4 `channels`, display-referred sRGB with straight
 * alpha. Colours of another space are converted by the ICC profile or what else the file says; linear light is encoded
 * by the curve of sRGB (IEC 61966-2-1), values over 1 as 255. Errors as pags_image_load, and PAGS_ERROR_FORMAT for a
 * space that is not converted: HDR, CMYK with a profile, profiles of tables alone. */
PAGS_API pags_result pags_image_load_display(const char *path, int channels, pags_image *out);

/* The same as pags_image_load for a look at a picture: of a PNG that isn't interlaced only the first `rows` rows are
 * decoded, and out->height is their number; of another picture, or where `rows` is 0 or less or the height or more, all
 * are. */
PAGS_API pags_result pags_image_load_top(const char *path, pags_sample sample, int channels, int rows, pags_image *out);

/* Writes a picture in the format of the extension: .png (8 or 16 bits as the image has; float samples are clamped
 * to 0..1 and rounded to 8 bits), .jpg or .jpeg (8 bits, quality 95, alpha dropped) or .exr (float). The file is
 * written under another name in the same folder and then renamed: it appears complete or not at all.
 * PAGS_ERROR_ARGUMENT for another extension, PAGS_ERROR_IO or PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_image_save(const char *path, const pags_image *image);

/* Writes an EXR file with `channels` (1..64) float channels of the given names, e.g. {"R","G","B"} or {"Z"}.
 * planes[c] holds channel c as `height` rows with a stride of `stride` floats. `texts`: string attributes of the
 * header, name and value by turns, ended by NULL; names of at most 31 bytes; NULL: none. The file appears complete or
 * not at all. Errors as pags_image_save. */
PAGS_API pags_result pags_image_save_exr(const char *path, int width, int height, int channels,
                                         const char *const *names, const float *const *planes, int stride,
                                         const char *const *texts);

PAGS_END_C
#endif
