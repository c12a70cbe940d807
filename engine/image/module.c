/* SPDX-License-Identifier: Apache-2.0 */
/* Loads the OpenImageIO module pags_oiio.so (port/module.h). */
#include "image/module.h"

#ifndef PAGS_IMAGES

pags_result pags_oiio_module(const pags_oiio **out) {
  *out = NULL;
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "this build leaves it out: configure with -DPAGS_IMAGES=ON (Debian: libopenimageio-dev)");
}

#else

#include <pthread.h>

#include "port/module.h"

#define MODULE_NAME "pags_oiio.so"

/* The loaded module, or why it is missing. Written once under pthread_once, constant afterwards. */
static pthread_once_t once = PTHREAD_ONCE_INIT;
static pags_port_module module;

static void find_module(void) {
  pags_port_load_module(MODULE_NAME, PAGS_MODULE_DIR, PAGS_OIIO_SYMBOL, PAGS_OIIO_VERSION, &module);
}

pags_result pags_oiio_module(const pags_oiio **out) {
  pthread_once(&once, find_module);
  *out = module.table;
  if (module.table)
    return PAGS_OK;
  if (module.no_memory)
    return pags_fail(PAGS_ERROR_MEMORY, "%s", module.reason);
  return pags_fail(PAGS_ERROR_UNSUPPORTED,
                   "%s; expected %s beside the program or in ../lib/pags, and OpenImageIO (Debian: libopenimageio2.4) "
                   "installed",
                   module.reason, MODULE_NAME);
}

#endif
