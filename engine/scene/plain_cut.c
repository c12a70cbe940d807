/* SPDX-License-Identifier: Apache-2.0 */
/* See plain_cut.h. */
#include "scene/plain_cut.h"

#include <math.h>

#include "maths/maths.h"

static double opacity_of(const pags_gaussians *g, int64_t i) {
  return 1 / (1 + pags_exp(-(double)pags_plane(g, PAGS_OPACITY)[i]));
}

static void change(pags_gaussians *g, int64_t i, double opacity, double log_scale) {
  pags_plane(g, PAGS_OPACITY)[i] = (float)pags_log(opacity / (1 - opacity));
  for (int k = 0; k < 3; k++)
    pags_plane(g, PAGS_SCALE + k)[i] += (float)log_scale;
}

/* What is added to the logarithms of the scales. */
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
