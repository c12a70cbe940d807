/* SPDX-License-Identifier: Apache-2.0 */
/* Finds and loads the OpenImageIO module, once for the process. */
#ifndef PAGS_IMAGE_MODULE_H
#define PAGS_IMAGE_MODULE_H

#include "image/oiio.h"

/* Gives the module's table of functions. Errors: PAGS_ERROR_UNSUPPORTED if the module is missing or cannot be loaded
 * (the message names what to install), PAGS_ERROR_MEMORY if address space is too small for it. */
pags_result pags_oiio_module(const pags_oiio **out);

#endif
