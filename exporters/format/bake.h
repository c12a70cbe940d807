/* SPDX-License-Identifier: Apache-2.0 */
/* Brings the Gaussians of several parts into one frame, rotating their spherical harmonics, and saves such a set as
 * .splat. */
#ifndef PAGS_FORMAT_BAKE_H
#define PAGS_FORMAT_BAKE_H

#include <stdbool.h>

#include <pags/export.h>
#include <pags/frame.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Joins all parts into one set of Gaussians in the world's frame with harmonics of `sh_degree` (higher terms are cut,
 * missing ones are zero). s_sem is kept if all parts have it. With keep_cut an alpha_min that all parts have is kept;
 * else Gaussians with an alpha_min become ones that look alike where alpha is cut at 1/255, as other programs do, and
 * those that are never seen are left out. After a failure, too, the caller destroys `out`. */
pags_result pags_splats_bake(const pags_part *parts, int count, int sh_degree, bool keep_cut, pags_gaussians *out);

/* The alpha_min of all parts; 0 if they differ. */
float pags_splats_alpha_min(const pags_part *parts, int count);

/* Saves Gaussians as .splat (no view-dependent colour). */
pags_result pags_splat_save(const char *path, const pags_gaussians *g);

/* The rotation of Gaussian `i` as a unit quaternion w, x, y, z, and its opacity, 0 to 1. */
void pags_splat_rotation(const pags_gaussians *g, int64_t i, double q[4]);
double pags_splat_opacity(const pags_gaussians *g, int64_t i);
/* `value` rounded to a byte, clamped. */
uint8_t pags_splat_byte(double value);
/* Converts an sRGB value, clamped to 0..1, to linear light (IEC 61966-2-1), which glTF and USD have in colours. */
double pags_splat_linear(double value);

#ifdef __cplusplus
}
#endif
#endif
