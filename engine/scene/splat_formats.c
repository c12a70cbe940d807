/* SPDX-License-Identifier: Apache-2.0 */
/* Functions that the decoders of all splat formats share: conversions, and the check of what was decoded. */
#include "scene/splat_formats.h"

#include <math.h>

#include "base/log.h"
#include "maths/maths.h"

float pags_logit_of_byte(uint8_t alpha) {
  double p = fmin(fmax(alpha / 255.0, 1e-6), 1 - 1e-6);
  return (float)pags_log(p / (1 - p));
}

static const char *plane_name(int plane) {
  return plane < PAGS_SCALE      ? "position"
         : plane < PAGS_ROTATION ? "scale"
         : plane < PAGS_OPACITY  ? "rotation"
         : plane < PAGS_SH       ? "opacity"
                                 : "colour";
}

/* Replaces all-zero quaternions by the identity. Returns how many. */
static int64_t fix_rotations(pags_gaussians *g) {
  int64_t fixed = 0;
  float *q[4];
  for (int k = 0; k < 4; k++)
    q[k] = pags_plane(g, PAGS_ROTATION + k);
  for (int64_t i = 0; i < g->count; i++) {
    if (q[0][i] == 0 && q[1][i] == 0 && q[2][i] == 0 && q[3][i] == 0) {
      q[0][i] = 1;
      fixed++;
    }
  }
  return fixed;
}

pags_result pags_splat_accept(const char *path, pags_gaussians *g) {
  if (g->count == 0 || pags_gaussians_find_bad(g, NULL) == 0)
    return PAGS_OK;

  /* Names the first value that is not finite. */
  for (int64_t i = 0; i < g->count; i++)
    for (int p = 0; p < pags_plane_count(g->sh_degree); p++)
      if (!isfinite(pags_plane(g, p)[i]))
        return pags_fail(PAGS_ERROR_FORMAT, "%s: Gaussian %lld: expected finite numbers for its %s", path, (long long)i,
                         plane_name(p));

  int64_t fixed = fix_rotations(g);
  pags_log_message(PAGS_LOG_WARNING, "%s: %lld all-zero quaternions taken as no rotation", path, (long long)fixed);
  return PAGS_OK;
}

int pags_sh_degree_of(int rest_per_channel) {
  for (int degree = 0; degree <= 3; degree++)
    if (rest_per_channel == pags_sh_coefficients(degree) - 1)
      return degree;
  return -1;
}
