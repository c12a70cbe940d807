/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures in memory and in files. The only door to OpenImageIO, which is loaded when the first file is touched, so
 * that programs that read no picture don't pay its start-up. */
#ifndef PAGS_IMAGE_H
#define PAGS_IMAGE_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pags_sample { PAGS_U8, PAGS_U16, PAGS_F32 } pags_sample;

/* Interleaved samples, row 0 at the top, no padding: sample (x, y, c) is data[(y * width + x) * channels + c]. */
typedef struct pags_image {
  int width, height; /* 1..65535 */
  int channels;      /* 1..4: grey, grey+alpha, RGB, RGBA */
  pags_sample sample;
  void *data; /* freed by pags_image_destroy */
} pags_image;

PAGS_API pags_result pags_image_create(pags_image *image, int width, int height, int channels, pags_sample sample);
PAGS_API void pags_image_destroy(pags_image *image); /* frees and zeroes; a zeroed struct is allowed */

/* Width and height without decoding. */
PAGS_API pags_result pags_image_size(const char *path, int *width, int *height);

/* Reads PNG, JPEG, EXR or whatever else OpenImageIO reads. The samples are converted to `sample` (integers stay
 * display-referred; 255 or 65535 <-> 1.0) and to `channels` (0: as in the file, at most 4; 3 from grey repeats; alpha
 * is dropped, not multiplied). EXIF orientation is ignored, as structure-from-motion tools do. Errors: PAGS_ERROR_IO,
 * _FORMAT (with the decoder's message), _UNSUPPORTED (OpenImageIO module missing), _MEMORY. */
PAGS_API pags_result pags_image_load(const char *path, pags_sample sample, int channels, pags_image *out);

/* Writes by extension: .png (U8 or U16 as the image is; F32 is rounded to 8 bits), .jpg (quality 95), .exr (float). The
 * file appears complete or not at all: written beside and renamed. */
PAGS_API pags_result pags_image_save(const char *path, const pags_image *image);

/* An EXR with named float channels, e.g. {"R","G","B"} or {"Z"}; planes[c] has `stride` floats a row. */
PAGS_API pags_result pags_image_save_exr(const char *path, int width, int height, int channels,
                                         const char *const *names, const float *const *planes, int stride);

#ifdef __cplusplus
}
#endif
#endif
