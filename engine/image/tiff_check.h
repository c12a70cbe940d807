/* SPDX-License-Identifier: Apache-2.0 */
/* Checks what readers of TIFF leave unchecked. */
#ifndef PAGS_IMAGE_TIFF_CHECK_H
#define PAGS_IMAGE_TIFF_CHECK_H

#include <pags/base.h>

/* Fails with PAGS_ERROR_FORMAT if a strip or tile of the first picture of a TIFF that is compressed by Deflate does not
 * inflate to its end, or to another checksum than it states: libtiff stops at the last pixel, before the checksum.
 * Anything that is not such a file passes, since the reader judges it. */
pags_result pags_tiff_check(const char *path);

#endif
