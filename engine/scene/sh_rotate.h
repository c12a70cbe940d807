/* SPDX-License-Identifier: Apache-2.0 */
/* The rotation of spherical harmonics of degrees 1, 2 and 3 that goes with a rotation of directions. */
#ifndef PAGS_SCENE_SH_ROTATE_H
#define PAGS_SCENE_SH_ROTATE_H

#include <pags/gaussians.h>

/* The rotation R of directions is row-major 3x3: the rotated function has in direction R d the value that the function
 * had in direction d. */
typedef struct pags_sh_rotation {
  double m[3][7][7]; /* of degree l: m[l - 1], its first 2 l + 1 rows and columns */
} pags_sh_rotation;
void pags_sh_rotation_make(const double rotation[9], pags_sh_rotation *out);
/* Rotates the coefficients of one colour channel in place. `rest` begins with term 1: the constant term 0 is the same
 * in all directions and isn't in it. */
void pags_sh_rotation_apply(const pags_sh_rotation *turn, int degree, double *rest);
/* The same for all channels of a row. */
void pags_sh_rotation_apply_row(const pags_sh_rotation *turn, int degree, pags_gaussians *g, int64_t row);

#endif
