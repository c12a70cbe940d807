/* SPDX-License-Identifier: Apache-2.0 */
/* The words for Early-Z modes. */
#include <errno.h>
#include <pags/frame.h>
#include <stdlib.h>
#include <string.h>

static const char *const names[] = {"off", "lossless", "bounded", "paper"};
enum { MODES = sizeof names / sizeof *names };

const char *pags_early_z_name(pags_early_z mode) {
  return (size_t)mode < MODES ? names[mode] : "unknown";
}

static pags_result not_understood(const char *text) {
  return pags_fail(PAGS_ERROR_ARGUMENT,
                   "early-z: expected off, lossless, paper, bounded or bounded=EPS with 0 < EPS < 1, got '%s'", text);
}

pags_result pags_early_z_parse(const char *text, pags_frame_options *options) {
  const char *const equals = strchr(text, '=');
  const size_t length = equals ? (size_t)(equals - text) : strlen(text);
  float eps = pags_frame_options_default().early_z_eps;
  int mode = 0;
  while (mode < MODES && (strlen(names[mode]) != length || strncmp(names[mode], text, length) != 0))
    mode++;
  if (mode == MODES || (equals && mode != PAGS_EARLY_Z_BOUNDED))
    return not_understood(text);
  if (equals) {
    char *end;
    eps = strtof(equals + 1, &end);
    if (end == equals + 1 || *end != '\0' || !(eps > 0.0f && eps < 1.0f))
      return not_understood(text);
  }
  options->early_z = (pags_early_z)mode;
  options->early_z_eps = eps;
  return PAGS_OK;
}
