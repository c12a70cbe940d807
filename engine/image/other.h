/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures that the decoders here don't read, through the OpenImageIO module (oiio.h), where there is one. The same
 * layers and windows of EXR files are chosen as by the decoder here. And what OpenImageIO leaves to us: colour spaces
 * of containers, and checksums of TIFF. */
#ifndef PAGS_IMAGE_OTHER_H
#define PAGS_IMAGE_OTHER_H

#include <pags/image.h>

#include "image/colour.h"
#include "image/oiio.h"

/* Reads the header or decodes at most `most` channels of a picture that was refused with PAGS_ERROR_UNSUPPORTED and a
 * message; without OpenImageIO the refusal stands. Errors as pags_image_load. */
pags_result pags_other_inspect(const char *path, pags_image_facts *facts);
pags_result pags_other_load(const char *path, int most, pags_image *out, pags_colour *colour);

/* Finds and loads the module, once for the process, and gives its table of functions. Errors: PAGS_ERROR_UNSUPPORTED if
 * the module is missing or cannot be loaded (the message names what to install), PAGS_ERROR_MEMORY if address space is
 * too small for it. */
pags_result pags_oiio_module(const pags_oiio **out);

/* Looks for the colour space in the first bytes of a file, of any kind; WebP, JPEG 2000 and HEIF with AVIF state it,
 * and OpenImageIO (2.4) reads them without it. Returns whether it is stated there. */
bool pags_container_colour(const uint8_t *bytes, size_t size, pags_colour *colour);

/* Fails with PAGS_ERROR_FORMAT if a strip or tile of the first picture of a TIFF that is compressed by Deflate does not
 * inflate to its end, or to another checksum than it states: libtiff stops at the last pixel, before the checksum.
 * Anything that is not such a file passes, since the reader judges it. */
pags_result pags_tiff_check(const char *path);

#endif
