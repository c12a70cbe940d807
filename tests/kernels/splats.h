/* SPDX-License-Identifier: Apache-2.0 */
/* Projected Gaussians for the tests of binning and blending, made without the kernels. */
#ifndef PAGS_TESTS_SPLATS_H
#define PAGS_TESTS_SPLATS_H

#include "check.h"

typedef struct splat_mix {
  float x0, y0, x1, y1;       /* where means lie, px */
  float sigma_min, sigma_max; /* shorter axis, px; log-uniform */
  float stretch;              /* longer axis over shorter: 1 .. stretch, log-uniform */
  float alpha_min, alpha_max;
  bool awkward; /* one in four is made by splat_awkward() */
} splat_mix;

/* About the tile of pixels 32..47, 48..63: none to fill it, soon full, and both with a border and awkward ones. */
extern const splat_mix splats_translucent, splats_opaque, splats_awkward;

/* alpha > 0 at the mean, covariance [a b; b c] in px^2. Depth, colour and id are random. */
pags_splat splat_make(double x, double y, double a, double b, double c, double alpha);
pags_splat splat_random(const splat_mix *mix);
/* Needles of 1:1e4, alpha at the cut-off and at the cap, far means, covariances beyond anything, pixel-sized dots. */
pags_splat splat_awkward(const splat_mix *mix);

/* What the kernels call the exponent, in their own operations. */
float splat_exponent(const pags_splat *s, float px, float py, bool fused);
/* True where this table's v_fma is fused. */
bool splat_fused(const pags_kernels *k);

#endif
