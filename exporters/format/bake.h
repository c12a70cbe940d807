/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians brought into one frame, and files of them. */
#ifndef PAGS_FORMAT_BAKE_H
#define PAGS_FORMAT_BAKE_H

#include <pags/export.h>
#include <pags/frame.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Turns spherical harmonics with a rotation (row-major 3x3): `to` shows in direction R d what `from` shows in direction
 * d. */
typedef struct pags_sh_rotation {
  double m1[3][3], m2[5][5], m3[7][7];
} pags_sh_rotation;
void pags_sh_rotation_make(const double rotation[9], pags_sh_rotation *out);
/* Coefficients 1.. of one channel, in place; the constant one doesn't turn. */
void pags_sh_rotation_apply(const pags_sh_rotation *turn, int degree, double *rest);

/* All parts as one set in the world's frame, of `sh_degree` (higher terms are cut, missing ones zero). Their s_sem and
 * object_id are kept where all have them. */
pags_result pags_splats_bake(const pags_part *parts, int count, int sh_degree, pags_gaussians *out);

pags_result pags_splat_save(const char *path, const pags_gaussians *g);
pags_result pags_spz_save(const char *path, const pags_gaussians *g, int version, int antialiased);

#ifdef __cplusplus
}
#endif
#endif
