/* SPDX-License-Identifier: Apache-2.0 */
/* The decoders of the splat formats. Each decodes the bytes of a whole file and creates `out`; on failure `out` is
 * zeroed. `kind` receives the name of the format, a static string. */
#ifndef PAGS_SCENE_SPLAT_FORMATS_H
#define PAGS_SCENE_SPLAT_FORMATS_H

#include <pags/gaussians.h>

#include "scene/ply_table.h"

/* `bytes` must end with a zero byte that `size` doesn't count, as pags_file_read returns it. */
pags_result pags_ply_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out, const char **kind,
                            int *antialiased);
pags_result pags_compressed_ply_decode(const ply_table *table, pags_gaussians *out);
pags_result pags_splat_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out);
pags_result pags_spz_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out, const char **kind,
                            int *antialiased);

/* Checks what a decoder has decoded; every decoder ends with it. A value that is not finite is an error; all-zero
 * quaternions become the identity, with a warning. */
pags_result pags_splat_accept(const char *path, pags_gaussians *g);

/* Returns the SH degree (0..3) that has `rest_per_channel` coefficients per channel besides the constant one (0, 3, 8
 * or 15); -1 for other numbers. */
int pags_sh_degree_of(int rest_per_channel);

/* Returns the logit of the opacity alpha / 255. 0 and 255 are taken as 1e-6 and 1 - 1e-6, whose logits are finite. */
float pags_logit_of_byte(uint8_t alpha);

#endif
