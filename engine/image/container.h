/* SPDX-License-Identifier: Apache-2.0 */
/* The colour space that containers of pictures state which OpenImageIO (2.4) reads without it: WebP, JPEG 2000 and HEIF
 * with AVIF. */
#ifndef PAGS_IMAGE_CONTAINER_H
#define PAGS_IMAGE_CONTAINER_H

#include <stdbool.h>
#include <stddef.h>

#include "image/colour.h"

/* Looks for it in the first bytes of a file, of any kind. Returns whether it is stated there. */
bool pags_container_colour(const uint8_t *bytes, size_t size, pags_colour *colour);

#endif
