/* SPDX-License-Identifier: Apache-2.0 */
/* Functions that the decoders of all splat formats share: conversions, and the check of what was decoded. */
#include "scene/splat_formats.h"

#include <math.h>
#include <stdlib.h>

#include "base/log.h"
#include "base/memory.h"
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

/* Replaces infinite opacities and scales of -inf, which are limits of valid ones. Returns of how many Gaussians. */
static int64_t take_limits(pags_gaussians *g) {
  int64_t taken = 0;
  for (int64_t i = 0; i < g->count; i++) {
    bool limit = false;
    float *const opacity = pags_plane(g, PAGS_OPACITY) + i;
    if (isinf(*opacity)) {
      *opacity = *opacity > 0 ? PAGS_MOST_OPACITY : -PAGS_MOST_OPACITY;
      limit = true;
    }
    for (int k = 0; k < 3; k++) {
      float *const scale = pags_plane(g, PAGS_SCALE + k) + i;
      if (isinf(*scale) && *scale < 0) {
        *scale = PAGS_LEAST_SCALE;
        limit = true;
      }
    }
    taken += limit;
  }
  return taken;
}

/* The plane of the first value of row `i` that isn't finite, -1 for one of the Fourier terms. */
static int bad_plane(const pags_gaussians *g, int64_t i) {
  for (int p = 0; p < pags_plane_count(g->sh_degree); p++)
    if (!isfinite(pags_plane(g, p)[i]))
      return p;
  return -1;
}

/* Leaves out the `bad` rows that aren't finite. */
static pags_result leave_out(const char *path, pags_gaussians *g, int64_t bad) {
  int64_t *const good = malloc((size_t)g->count * sizeof *good);
  if (!good)
    return pags_out_of_memory("%s: %lld Gaussians", path, (long long)g->count);
  pags_gaussians_find_bad(g, good);
  int64_t first = 0;
  while (first < g->count - bad && good[first] == first)
    first++;
  const int plane = bad_plane(g, first);
  const char *const name = plane < 0 ? "colour over time" : plane_name(plane);
  pags_gaussians kept = {0};
  pags_result result =
      bad < g->count
          ? pags_gaussians_create_like(&kept, g->count - bad, g)
          : pags_fail(PAGS_ERROR_FORMAT,
                      "%s: Gaussian %lld: expected finite numbers for its %s, found none in any of %lld Gaussians",
                      path, (long long)first, name, (long long)g->count);
  if (result == PAGS_OK) {
    pags_log_message(PAGS_LOG_WARNING,
                     "%s: %lld of %lld Gaussians are left out, since a value isn't finite; the first is %lld (its %s)",
                     path, (long long)bad, (long long)g->count, (long long)first, name);
    pags_gaussians_gather(g, good, kept.count, &kept);
    pags_gaussians_destroy(g);
    *g = kept;
  }
  free(good);
  return result;
}

pags_result pags_splat_accept(const char *path, pags_gaussians *g) {
  if (g->count == 0 || pags_gaussians_find_bad(g, NULL) == 0)
    return PAGS_OK;
  const int64_t limits = take_limits(g), fixed = fix_rotations(g), bad = pags_gaussians_find_bad(g, NULL);
  if (limits)
    pags_log_message(PAGS_LOG_INFO, "%s: %lld Gaussians have an infinite opacity or scale, which is taken as its limit",
                     path, (long long)limits);
  if (fixed)
    pags_log_message(PAGS_LOG_WARNING, "%s: %lld all-zero quaternions taken as no rotation", path, (long long)fixed);
  return bad ? leave_out(path, g, bad) : PAGS_OK;
}
