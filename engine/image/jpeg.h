/* SPDX-License-Identifier: Apache-2.0 */
/* A check that OpenImageIO doesn't make. */
#ifndef PAGS_IMAGE_JPEG_H
#define PAGS_IMAGE_JPEG_H

#include <pags/base.h>

/* Fails for a JPEG file whose end is missing: the decoder would fill the rest with grey and say nothing. Files of other
 * formats pass. */
pags_result pags_jpeg_check_end(const char *path);

#endif
