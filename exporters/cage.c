#include "cage.h"
pags_result pags_shell_cage(const pags_shell *surface, int level, pags_shell *out) {
  (void)surface;(void)level;(void)out;
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "no cages yet");
}
