/* SPDX-License-Identifier: Apache-2.0 */
/* One decoder per splat format, from the bytes of a whole file. Each creates `out`; on failure `out` is zeroed. */
#ifndef PAGS_SCENE_SPLAT_FORMATS_H
#define PAGS_SCENE_SPLAT_FORMATS_H

#include <pags/gaussians.h>

#include "scene/ply_table.h"

/* `bytes` ends with a zero byte that `size` doesn't count, as pags_file_read leaves it. */
pags_result pags_ply_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out, const char **kind,
                            int *antialiased);
pags_result pags_compressed_ply_decode(const ply_table *table, pags_gaussians *out);
pags_result pags_splat_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out);
pags_result pags_spz_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out, const char **kind,
                            int *antialiased);

/* What every decoder ends with: a row with a non-finite value is an error, all-zero quaternions become the identity. */
pags_result pags_splat_accept(const char *path, pags_gaussians *g);

/* The degree that has so many coefficients a channel beyond the constant one (0, 3, 8, 15), -1 for other counts. */
int pags_sh_degree_of(int rest_per_channel);

/* Logit of a byte of opacity; 0 and 255 stand for 1e-6 and 1 - 1e-6, whose logits are finite. */
float pags_logit_of_byte(uint8_t alpha);

#endif
