/* SPDX-License-Identifier: Apache-2.0 */
/* WebP pictures as tables of bytes, through libwebp. A build without it fails with PAGS_ERROR_UNSUPPORTED. */
#ifndef PAGS_SCENE_WEBP_H
#define PAGS_SCENE_WEBP_H

#include <stdbool.h>
#include <stdlib.h>

#include <pags/base.h>

typedef struct pags_webp {
  int width, height;
  bool lossy;    /* its values have been changed by compression */
  uint8_t *rgba; /* 4 * width * height bytes, row by row from the top */
} pags_webp;

/* Frees the pixels; a zeroed struct is allowed. */
static inline void pags_webp_destroy(pags_webp *picture) {
  free(picture->rgba);
}

/* Decodes a picture of `least` to `most` pixels, exactly as it was stored: colours aren't touched by alpha. `path`
 * names it in messages. PAGS_ERROR_FORMAT, _LIMIT, _UNSUPPORTED or _MEMORY; then `out` is zeroed. */
pags_result pags_webp_decode(const char *path, const uint8_t *bytes, size_t size, int64_t least, int64_t most,
                             pags_webp *out);

/* Encodes RGBA losslessly, colours below alpha 0 included; the same bytes for the same version of libwebp. *bytes is
 * freed by the caller. A side has 1 to 16383 pixels. PAGS_ERROR_UNSUPPORTED or _MEMORY. */
pags_result pags_webp_encode(const uint8_t *rgba, int width, int height, uint8_t **bytes, size_t *size);

#endif
