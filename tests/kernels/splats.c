/* SPDX-License-Identifier: Apache-2.0 */
#include "splats.h"

#include <math.h>
#include <string.h>

const splat_mix splats_translucent = {20, 36, 60, 76, 0.3f, 12, 8, 0.004f, 0.08f, false};
const splat_mix splats_opaque = {20, 36, 60, 76, 0.3f, 20, 30, 0.1f, 1.0f, false};
const splat_mix splats_awkward = {28, 44, 52, 68, 0.3f, 20, 30, 0.004f, 1.0f, true};

pags_splat splat_make(double x, double y, double a, double b, double c, double alpha) {
  const double k = 0.5 * log2(exp(1.0)), d = a * c - b * b;
  pags_splat s = {.x = (float)x, .y = (float)y, .cut = -PAGS_LOG2_255};
  s.p = (float)sqrt(k * c / d);
  s.h = (float)(b / c);
  s.w = (float)sqrt(k / c);
  s.slope = (float)(b / a);
  s.log2_opacity = (float)fmin(log2(alpha), 0.0);
  s.r = check_uniform(0.0f, 1.0f);
  s.g = check_uniform(0.0f, 1.0f);
  s.b = check_uniform(0.0f, 1.0f);
  s.z = check_uniform(0.5f, 4.0f);
  s.id = check_below(1 << 20);
  return s;
}

static float log_uniform(float lo, float hi) {
  return lo * powf(hi / lo, check_uniform(0.0f, 1.0f));
}

/* A splat with axes of `major` and `minor` px (standard deviations) at a random angle; low_pass is added to the
 * variances as by projection. */
static pags_splat from_axes(double x, double y, double minor, double major, double low_pass, double alpha) {
  const double angle = (double)check_uniform(0.0f, 6.2831853f), co = cos(angle), si = sin(angle);
  const double l1 = major * major, l2 = minor * minor;
  return splat_make(x, y, l1 * co * co + l2 * si * si + low_pass, (l1 - l2) * co * si,
                    l1 * si * si + l2 * co * co + low_pass, alpha);
}

pags_splat splat_awkward(const splat_mix *mix) {
  const double x = (double)check_uniform(mix->x0, mix->x1), y = (double)check_uniform(mix->y0, mix->y1);
  const double at = (double)check_uniform(0.05f, 0.95f), cut = 1.0 / 255.0;
  switch (check_below(9)) {
    case 0: return from_axes(x, y, 0.02, 200.0, 0.3, at); /* a needle */
    case 1: return from_axes(x, y, 0.3, 3000.0, 0.0, at); /* a needle without the low-pass filter */
    case 2: return from_axes(floor(x) + 0.5, floor(y) + 0.5, 2.0, 5.0, 0.3, cut * (1.0 + 3e-7 * (check_below(5) - 2)));
    case 3: return from_axes(x, y, 3.0, 9.0, 0.3, 1.0);       /* alpha is capped around its mean */
    case 4: return from_axes(x, y, 3.0, 3.0, 0.3, 0.9900001); /* alpha is capped at the mean only */
    case 5: return from_axes(x + 1000.0, y - 1500.0, 400.0, 900.0, 0.3, at);
    case 6: return from_axes(x, y, 1e8, 1e8, 0.3, at); /* a splat that is constant over the whole picture */
    case 7:
      return from_axes(x, y, 0.0, 0.0, 0.3, at); /* a splat as small as the low-pass filter allows */
    /* The exponent's powers of two exceed the range of float. */
    default: return from_axes(x + 1e9, y, 1.0, 1.0, 0.3, at);
  }
}

pags_alpha_cut alpha_cut_continuous(double least) {
  const double floor = least / (1.0 - least);
  return (pags_alpha_cut){(float)least, (float)(log2(floor) + 2e-4), (float)floor, (float)-log2(1.0 - least)};
}

void splat_extent(const pags_splat *s, float extent[2]) {
  const double k = 0.5 * log2(exp(1.0)), c = k / ((double)s->w * (double)s->w), b = (double)s->h * c;
  const double a = (k * c / ((double)s->p * (double)s->p) + b * b) / c;
  const double reach = fmax((double)s->log2_opacity - (double)s->cut, 0.0) / k;
  extent[0] = (float)sqrt(reach * a);
  extent[1] = (float)sqrt(reach * c);
}

/* Gives every third splat a continuous cut. */
static pags_splat with_cut(pags_splat s) {
  if (check_below(3) == 0) {
    const pags_alpha_cut cut = alpha_cut_continuous((double)check_uniform(1.0f, 8.0f) / 255.0);
    s.log2_opacity += cut.lift;
    s.cut = cut.cut;
    s.floor = cut.floor;
  }
  return s;
}

pags_splat splat_random(const splat_mix *mix) {
  if (mix->awkward && check_below(4) == 0)
    return with_cut(splat_awkward(mix));
  const double minor = (double)log_uniform(mix->sigma_min, mix->sigma_max);
  return with_cut(from_axes((double)check_uniform(mix->x0, mix->x1), (double)check_uniform(mix->y0, mix->y1), minor,
                            minor * (double)log_uniform(1.0f, mix->stretch), 0.3,
                            (double)check_uniform(mix->alpha_min, mix->alpha_max)));
}

static float fnma(float a, float b, float c, bool fused) {
  return fused ? fmaf(-a, b, c) : c - a * b;
}

float splat_exponent(const pags_splat *s, float px, float py, bool fused) {
  const float dx = px - s->x, dy = py - s->y;
  const float u = s->p * fnma(s->h, dy, dx, fused), v = s->w * dy;
  return fnma(u, u, fnma(v, v, s->log2_opacity, fused), fused);
}

bool splat_fused(const pags_kernels *k) {
  return !CHECK_EXACT && strcmp(k->name, "scalar") != 0;
}
