/* SPDX-License-Identifier: Apache-2.0 */
#ifndef PAGS_IMAGE_PNG_H
#define PAGS_IMAGE_PNG_H

#include <pags/base.h>

/* Checks that what comes before a PNG file's pixels is no longer than the file: libpng (1.6.39) makes room for up to 2
 * GB that a chunk's length claims before it reads it. Other files, what cannot be read, and the pixels themselves are
 * left to the decoder. Any thread. PAGS_ERROR_FORMAT. */
pags_result pags_png_check_chunks(const char *path);

#endif
