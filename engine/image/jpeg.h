/* SPDX-License-Identifier: Apache-2.0 */
/* A check of JPEG files that OpenImageIO does not make. */
#ifndef PAGS_IMAGE_JPEG_H
#define PAGS_IMAGE_JPEG_H

#include <pags/base.h>

/* Fails with PAGS_ERROR_FORMAT for a JPEG file that is cut off: the decoder would fill the rest of the picture with
 * grey and report no error. Files of other formats pass. */
pags_result pags_jpeg_check_end(const char *path);

#endif
