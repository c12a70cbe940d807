/* SPDX-License-Identifier: Apache-2.0 */
/* Conversion of sample types and channels, by the rules of pags_image_load. */
#ifndef PAGS_IMAGE_CONVERT_H
#define PAGS_IMAGE_CONVERT_H

#include <pags/image.h>

/* Creates `to`, a copy of `from` with that sample type and that number of channels. PAGS_ERROR_MEMORY; then `to` is
 * zeroed. */
pags_result pags_image_converted(const pags_image *from, pags_sample sample, int channels, pags_image *to);

/* Converts `image` in place, unless it has the sample type and the channels already. PAGS_ERROR_MEMORY; then `image`
 * is as it was. */
pags_result pags_image_convert(pags_image *image, pags_sample sample, int channels);

#endif
