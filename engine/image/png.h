/* SPDX-License-Identifier: Apache-2.0 */
/* A check of PNG files that libpng does not make. */
#ifndef PAGS_IMAGE_PNG_H
#define PAGS_IMAGE_PNG_H

#include <pags/base.h>

/* Fails with PAGS_ERROR_FORMAT if a chunk before a PNG file's pixels claims to reach beyond the end of the file:
 * libpng (1.6.39) would allocate the length that a chunk claims, up to 2 GB, before it reads the chunk. Files of
 * other formats, unreadable files and the pixels themselves are left to the decoder. May be called on any thread. */
pags_result pags_png_check_chunks(const char *path);

#endif
