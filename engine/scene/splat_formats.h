/* SPDX-License-Identifier: Apache-2.0 */
/* The decoders of the splat formats. Each decodes the bytes of a whole file and creates `out`, in the file's axes; on
 * failure `out` is zeroed. `facts`, zeroed before, receives what the file says. */
#ifndef PAGS_SCENE_SPLAT_FORMATS_H
#define PAGS_SCENE_SPLAT_FORMATS_H

#include <pags/gaussians.h>

#include "scene/ply_table.h"

/* `bytes` must end with a zero byte that `size` doesn't count, as pags_file_read returns it. */
pags_result pags_ply_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                            pags_splat_facts *facts);
/* Refuses names that end in .compressed.ply, by which other programs know a form of PLY that isn't written. */
pags_result pags_ply_check_name(const char *path);
/* `origin` receives what is taken off all positions (scene/large.h). */
pags_result pags_compressed_ply_decode(const ply_table *table, pags_gaussians *out, double origin[3]);
pags_result pags_splat_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out);
pags_result pags_spz_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                            pags_splat_facts *facts);

/* SOG: the meta.json at `path`, whose pictures lie beside it; and a zip archive of both. */
pags_result pags_sog_decode(const char *path, const uint8_t *meta, size_t size, pags_gaussians *out,
                            pags_splat_facts *facts);
pags_result pags_sog_decode_zip(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                                pags_splat_facts *facts);
/* glTF with KHR_gaussian_splatting: a .glb, or the JSON of a .gltf, whose buffers lie beside it. The Gaussians are in
 * PLY's axes; those of a file that PAGS wrote in the axes of the scene it is of. */
pags_result pags_gltf_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                             pags_splat_facts *facts);

/* ln sigma, in metres, of an axis that has vanished: sigma is a thousandth of a nanometre. */
#define PAGS_LEAST_SCALE (-27.631021115928547f)
/* The logit that stands for an opacity of 1, negated for 0: its sigmoid rounds to them. */
#define PAGS_MOST_OPACITY 20.0f

/* Checks what a decoder has decoded; every decoder ends with it. Infinite opacities and scales of -inf get the two
 * values above. Other Gaussians with a value that is not finite are left out, with a warning; if all are, that is an
 * error. All-zero quaternions become the identity, with a warning. */
pags_result pags_splat_accept(const char *path, pags_gaussians *g);

/* Returns the logit of the opacity alpha / 255. 0 and 255 are taken as 1e-6 and 1 - 1e-6, whose logits are finite. */
float pags_logit_of_byte(uint8_t alpha);

#endif
