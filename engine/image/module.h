/* SPDX-License-Identifier: Apache-2.0 */
/* Finds and opens the OpenImageIO module, once for the process. */
#ifndef PAGS_IMAGE_MODULE_H
#define PAGS_IMAGE_MODULE_H

#include "image/oiio.h"

/* PAGS_ERROR_UNSUPPORTED, naming what to install, where the module isn't there or can't be loaded. */
pags_result pags_oiio_module(const pags_oiio **out);

#endif
