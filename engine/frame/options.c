/* SPDX-License-Identifier: Apache-2.0 */
/* The options of a frame: their defaults, setting the exposure, and names and parsing of the Early-Z modes. */
#include <errno.h>
#include <math.h>
#include <pags/frame.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "frame/stages.h"

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
  while (mode < MODES && !pags_text_is(text, length, names[mode]))
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

pags_frame_options pags_frame_options_default(void) {
  return (pags_frame_options){.near_plane = 0.01f,
                              .low_pass = 0.3f,
                              .sh_degree = 3,
                              .exp_degree = 5,
                              .early_z = PAGS_EARLY_Z_LOSSLESS,
                              .early_z_eps = 1.0f / 255.0f};
}

/* A pixel that closes at the transmittance t is off by t (c - d): c is the mean colour of what lies in front and at
 * least 0, d a colour behind, which only the sky and the background make negative. Light and exposure enlarge that. */
double pags_frame_enlargement(const pags_frame_options *options, const pags_camera *camera) {
  const bool sky = options->sky && options->sky->size > 0;
  double least = 0.0, most = 0.0, gain = options->exposed ? 0.0 : 1.0;
  for (int c = 0; c < 3; c++) {
    least = fmin(least, (double)options->background[c]);
    most = fmax(most, (double)options->background[c]);
    if (options->exposed)
      gain = fmax(gain, fabs((double)options->gain[c]) * pags_photometric_max_gain(&options->photometric, camera));
  }
  const double dip = sky ? (double)options->sky->dip : least < 0.0 ? fmin(-least / most, 1.0) : 0.0;
  return fmax(gain, 1.0) * (1.0 + dip);
}

int pags_frame_options_expose(pags_frame_options *options, const double gain[3], const double offset[3]) {
  options->exposed = !pags_photometric_is_identity(&options->photometric);
  for (int c = 0; c < 3; c++) {
    options->gain[c] = (float)gain[c];
    options->offset[c] = (float)offset[c];
    options->exposed |= options->gain[c] != 1.0f || options->offset[c] != 0.0f;
  }
  return options->exposed;
}
