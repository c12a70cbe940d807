#include "cage.h"
pags_result pags_surface_cage(const pags_surface *surface, int level, pags_surface *out) {
  (void)surface;(void)level;(void)out;
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "no cages yet");
}
