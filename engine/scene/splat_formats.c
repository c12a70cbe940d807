/* SPDX-License-Identifier: Apache-2.0 */
/* Functions that the decoders of all splat formats share: conversions, the check of decoded Gaussians, origins of large
 * positions, and the change between cuts of alpha. */
#include "scene/splat_formats.h"

#include <math.h>
#include <stdlib.h>

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "maths/maths.h"

float pags_logit_of_byte(uint8_t alpha) {
  double p = fmin(fmax(alpha / 255.0, 1e-6), 1 - 1e-6);
  return (float)pags_log(p / (1 - p));
}

void pags_splat_put_rotation(double q[4], int largest, int64_t i, pags_gaussians *out) {
  double sum = 0;
  q[largest] = 0;
  for (int k = 0; k < 4; k++)
    sum += q[k] * q[k];
  q[largest] = sqrt(fmax(0, 1 - sum));
  for (int k = 0; k < 4; k++)
    pags_plane(out, PAGS_ROTATION + k)[i] = (float)q[k];
}

pags_result pags_splat_create(const char *path, int64_t count, int stored_degree, pags_gaussians *out) {
  if (stored_degree > 3)
    PAGS_WARN("%s: spherical harmonics of degree 4 are dropped, degrees 0 to 3 kept", path);
  return pags_gaussians_create(out, count, stored_degree > 3 ? 3 : stored_degree);
}

/* ---- The check of decoded Gaussians ---- */

/* Replaces infinite opacities and scales of -inf, which are limits of valid ones, and all-zero quaternions by the
 * identity. *limits, *fixed: of how many Gaussians. */
static void mend_rows(pags_gaussians *g, int64_t *limits, int64_t *fixed) {
  *limits = *fixed = 0;
  for (int64_t i = 0; i < g->count; i++) {
    float *const opacity = pags_plane(g, PAGS_OPACITY) + i;
    bool limit = isinf(*opacity), turned = false;
    if (limit)
      *opacity = copysignf(PAGS_MOST_OPACITY, *opacity);
    for (int k = 0; k < 3; k++) {
      float *const scale = pags_plane(g, PAGS_SCALE + k) + i;
      if (*scale == -INFINITY) {
        *scale = PAGS_LEAST_SCALE;
        limit = true;
      }
    }
    for (int k = 0; k < 4; k++)
      turned = turned || pags_plane(g, PAGS_ROTATION + k)[i] != 0;
    if (!turned)
      pags_plane(g, PAGS_ROTATION)[i] = 1;
    *limits += limit;
    *fixed += !turned;
  }
}

/* Leaves out the `bad` rows that aren't finite. */
static pags_result leave_out(const char *path, pags_gaussians *g, int64_t bad) {
  PAGS_AUTOFREE int64_t *good = malloc((size_t)g->count * sizeof *good);
  PAGS_CHECK_MEMORY(good, "%s: %lld Gaussians", path, (long long)g->count);
  pags_gaussians_find_bad(g, good);
  int64_t first = 0;
  while (first < g->count - bad && good[first] == first)
    first++;
  const int planes = pags_plane_count(g->sh_degree);
  int plane = 0; /* with the first value that isn't finite */
  while (plane < planes && isfinite(pags_plane(g, plane)[first]))
    plane++;
  const char *const name = plane == planes         ? "colour over time"
                           : plane < PAGS_SCALE    ? "position"
                           : plane < PAGS_ROTATION ? "scale"
                           : plane < PAGS_OPACITY  ? "rotation"
                           : plane < PAGS_SH       ? "opacity"
                                                   : "colour";
  if (bad == g->count)
    return pags_fail_at(path, "Gaussian %lld: expected finite numbers for its %s, found none in any of %lld Gaussians",
                        (long long)first, name, (long long)g->count);
  PAGS_WARN("%s: %lld of %lld Gaussians are left out, since a value isn't finite; the first is %lld (its %s)", path,
            (long long)bad, (long long)g->count, (long long)first, name);
  return pags_gaussians_keep(g, good, g->count - bad);
}

static pags_result accept(const char *path, pags_gaussians *g) {
  if (g->count == 0 || pags_gaussians_find_bad(g, NULL) == 0)
    return PAGS_OK;
  int64_t limits, fixed;
  mend_rows(g, &limits, &fixed);
  const int64_t bad = pags_gaussians_find_bad(g, NULL);
  if (limits)
    pags_log_message(PAGS_LOG_INFO, "%s: %lld Gaussians have an infinite opacity or scale, which is taken as its limit",
                     path, (long long)limits);
  if (fixed)
    PAGS_WARN("%s: %lld all-zero quaternions taken as no rotation", path, (long long)fixed);
  return bad ? leave_out(path, g, bad) : PAGS_OK;
}

pags_result pags_splat_run(pags_splat_decoder *decoder, const char *path, const uint8_t *bytes, size_t size,
                           pags_gaussians *out, pags_splat_facts *facts) {
  *out = (pags_gaussians){0};
  pags_result result = decoder(path, bytes, size, out, facts);
  facts->left_out = out->count;
  if (result == PAGS_OK)
    result = accept(path, out);
  if (result != PAGS_OK)
    pags_gaussians_destroy(out);
  facts->left_out -= out->count;
  return result;
}

/* ---- Large positions ---- */

double pags_large_origin(double *values, int count) {
  int finite = 0;
  for (int i = 0; i < count; i++)
    if (isfinite(values[i]))
      values[finite++] = values[i];
  if (finite == 0)
    return 0;
  pags_sort_doubles(values, finite);
  const double middle = values[finite / 2];
  return fabs(middle) > PAGS_LARGE_COORDINATE ? pags_round(middle) : 0;
}

void pags_large_put_back(pags_gaussians *g, const double origin[3]) {
  for (int k = 0; k < 3; k++)
    for (int64_t i = 0; origin[k] != 0 && i < g->count; i++)
      pags_plane(g, PAGS_MEAN + k)[i] = (float)((double)pags_plane(g, PAGS_MEAN + k)[i] + origin[k]);
}

/* ---- Cuts of alpha ----
 *
 * Gaussians with an alpha_min a are changed to look alike where alpha is cut at 1/255, and back. With opacity o and
 * x = o / a, the blended (o G - a) / (1 - a) is (o - a) / (1 - a) at the mean, and its integral over the picture is
 * that of a Gaussian with this opacity and with the variance times 1 - ln(x) / (x - 1). */

static double opacity_of(const pags_gaussians *g, int64_t i) {
  return 1 / (1 + pags_exp(-(double)pags_plane(g, PAGS_OPACITY)[i]));
}

static void change(pags_gaussians *g, int64_t i, double opacity, double log_scale) {
  pags_plane(g, PAGS_OPACITY)[i] = (float)pags_log(opacity / (1 - opacity));
  for (int k = 0; k < 3; k++)
    pags_plane(g, PAGS_SCALE + k)[i] += (float)log_scale;
}

/* The difference of ln sigma. */
static double shrinking(double x) {
  return 0.5 * pags_log(1 - pags_log(x) / (x - 1));
}

bool pags_plain_cut_make(pags_gaussians *g, int64_t i, double a) {
  const double o = opacity_of(g, i), x = o / a;
  if (!(x > 1.001))
    return false;
  change(g, i, fmin((o - a) / (1 - a), 1 - 1e-6), shrinking(x));
  return true;
}

void pags_plain_cut_undo(pags_gaussians *g, double a) {
  for (int64_t i = 0; i < g->count; i++) {
    /* A byte's opacity may have become 0. */
    const double o = fmin(fmax(opacity_of(g, i) * (1 - a) + a, 1.001 * a), 1 - 1e-6);
    change(g, i, o, -shrinking(o / a));
  }
  g->alpha_min = (float)a;
}
