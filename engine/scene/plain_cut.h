/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians with an alpha_min a, changed to look alike where alpha is cut at 1/255, and back. With opacity o and
 * x = o / a, the blended (o G - a) / (1 - a) is (o - a) / (1 - a) at the mean, and its integral over the picture is
 * that of a Gaussian of this opacity and of the variance times 1 - ln(x) / (x - 1). */
#ifndef PAGS_SCENE_PLAIN_CUT_H
#define PAGS_SCENE_PLAIN_CUT_H

#include <stdbool.h>

#include <pags/gaussians.h>

/* Changes row `i`; false, with the row as it was, if it is never seen. */
bool pags_plain_cut_make(pags_gaussians *g, int64_t i, double a);

/* Changes all rows back and sets alpha_min. */
void pags_plain_cut_undo(pags_gaussians *g, double a);

#endif
