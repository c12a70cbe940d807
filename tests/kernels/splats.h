/* SPDX-License-Identifier: Apache-2.0 */
/* Random projected Gaussians (splats) for the tests of binning and blending, made without the kernels. */
#ifndef PAGS_TESTS_SPLATS_H
#define PAGS_TESTS_SPLATS_H

#include "check.h"

typedef struct splat_mix {
  float x0, y0, x1, y1;       /* range of the means, px */
  float sigma_min, sigma_max; /* range of the shorter axis, px; log-uniform */
  float stretch;              /* largest ratio of the longer to the shorter axis; log-uniform from 1 */
  float alpha_min, alpha_max;
  bool awkward; /* one in four is made by splat_awkward() */
} splat_mix;

/* Splats around the tile of pixels 32..47, 48..63: never saturating it, soon saturating it, and both with awkward
 * splats. */
extern const splat_mix splats_translucent, splats_opaque, splats_awkward;

/* Makes a splat with alpha > 0 at its mean and covariance [a b; b c] in px^2, with the cut at 1/255. Depth, colour and
 * id are random. Every third of splat_random has a continuous cut. */
pags_splat splat_make(double x, double y, double a, double b, double c, double alpha);
pags_splat splat_random(const splat_mix *mix);
/* Returns the continuous cut with the least alpha `least`, 0..1. */
pags_alpha_cut alpha_cut_continuous(double least);
/* Half the size of the box in which a splat is blended, px. */
void splat_extent(const pags_splat *s, float extent[2]);
/* An awkward splat: needles of 1:1e4, alpha at the cut-off or at the cap, means far away, extreme covariances, dots
 * of a pixel. */
pags_splat splat_awkward(const splat_mix *mix);

/* Returns the exponent of a splat at a pixel (log2 of its alpha), by the kernels' sequence of float operations. */
float splat_exponent(const pags_splat *s, float px, float py, bool fused);
/* Returns whether this table's v_fma is a fused multiply-add. */
bool splat_fused(const pags_kernels *k);

#endif
