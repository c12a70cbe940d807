/* SPDX-License-Identifier: Apache-2.0 */
/* Small picture files of every kind of PNG, JPEG and EXR, written by libpng, libjpeg and OpenEXRCore without the
 * engine's help. */
#ifndef PAGS_TESTS_PICTURE_FILES_H
#define PAGS_TESTS_PICTURE_FILES_H

#include "splat_files.h"

typedef enum picture_format { PICTURE_PNG, PICTURE_JPEG, PICTURE_EXR } picture_format;

/* Makes the file of kind `kind` (0, 1, ...) with the given size, and a name that describes its contents and ends in
 * ".png", ".jpg" or ".exr". Returns 0 without a file if there are no more kinds. Stops the program on errors. */
int picture_file(picture_format format, int kind, int width, int height, file_bytes *out, char name[96]);

#endif
