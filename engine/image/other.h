/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures that the decoders here don't read, through the OpenImageIO module (module.h), where there is one. The same
 * layers and windows of EXR files are chosen as by the decoder here. */
#ifndef PAGS_IMAGE_OTHER_H
#define PAGS_IMAGE_OTHER_H

#include <pags/image.h>

#include "image/colour.h"

/* Reads the header or decodes at most `most` channels of a picture that was refused with PAGS_ERROR_UNSUPPORTED and a
 * message; without OpenImageIO the refusal stands. Errors as pags_image_load. */
pags_result pags_other_inspect(const char *path, pags_image_facts *facts);
pags_result pags_other_load(const char *path, int most, pags_image *out, pags_colour *colour);

#endif
