/* SPDX-License-Identifier: Apache-2.0 */
/* Brings the Gaussians of several parts into one frame, rotating their spherical harmonics, and saves such a set as
 * .splat or .spz. */
#ifndef PAGS_FORMAT_BAKE_H
#define PAGS_FORMAT_BAKE_H

#include <pags/export.h>
#include <pags/frame.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The rotation of spherical harmonics of degrees 1, 2 and 3 that goes with a rotation R of directions (row-major
 * 3x3): the rotated function has in direction R d the value that the function had in direction d. */
typedef struct pags_sh_rotation {
  double m1[3][3], m2[5][5], m3[7][7];
} pags_sh_rotation;
void pags_sh_rotation_make(const double rotation[9], pags_sh_rotation *out);
/* Rotates the coefficients of one colour channel in place. `rest` begins with term 1: the constant term 0 is the same
 * in all directions and isn't in it. */
void pags_sh_rotation_apply(const pags_sh_rotation *turn, int degree, double *rest);

/* Joins all parts into one set of Gaussians in the world's frame with harmonics of `sh_degree` (higher terms are cut,
 * missing ones are zero). s_sem is kept if all parts have it. */
pags_result pags_splats_bake(const pags_part *parts, int count, int sh_degree, pags_gaussians *out);

/* Save Gaussians as .splat (no view-dependent colour), or as SPZ of version 3 (gzip) or 4 (zstd). */
pags_result pags_splat_save(const char *path, const pags_gaussians *g);
pags_result pags_spz_save(const char *path, const pags_gaussians *g, int version, int antialiased);

#ifdef __cplusplus
}
#endif
#endif
