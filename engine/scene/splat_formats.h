/* SPDX-License-Identifier: Apache-2.0 */
/* The decoders of the splat formats, and what they share: large positions, missing values, extension records. */
#ifndef PAGS_SCENE_SPLAT_FORMATS_H
#define PAGS_SCENE_SPLAT_FORMATS_H

#include <stdbool.h>

#include <pags/gaussians.h>

#include "scene/ply_table.h"

/* Decodes the bytes of a whole file and creates `out`, in the file's axes; the caller destroys it, also on failure.
 * `out` and `facts`, which receives what the file says, are zeroed before. */
typedef pags_result pags_splat_decoder(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                                       pags_splat_facts *facts);

/* `bytes` must end with a zero byte that `size` doesn't count, as pags_file_read returns it. */
pags_splat_decoder pags_ply_decode;
pags_splat_decoder pags_spz_decode;
pags_splat_decoder pags_splat_decode; /* antimatter15's .splat */
/* SOG: the meta.json at `path`, whose pictures lie in the same folder; and a zip archive of both. */
pags_splat_decoder pags_sog_decode, pags_sog_decode_zip;
/* glTF with KHR_gaussian_splatting: a .glb, or the JSON of a .gltf, whose buffers lie in the same folder. The Gaussians
 * are in PLY's axes; those of a file written by PAGS, in the axes of its scene. */
pags_splat_decoder pags_gltf_decode;

/* Calls a decoder and checks what it has decoded. Infinite opacities and scales of -inf get PAGS_MOST_OPACITY and
 * PAGS_LEAST_SCALE. Other Gaussians with a value that is not finite are left out, with a warning; if all are, that is
 * an error. All-zero quaternions become the identity, with a warning. On failure `out` is zeroed. */
pags_result pags_splat_run(pags_splat_decoder *decoder, const char *path, const uint8_t *bytes, size_t size,
                           pags_gaussians *out, pags_splat_facts *facts);

/* For decoders: creates Gaussians of a file with harmonics of degree 0 to 4; those of degree 4 are dropped, with a
 * warning. */
pags_result pags_splat_create(const char *path, int64_t count, int stored_degree, pags_gaussians *out);

/* Refuses names that end in .compressed.ply, by which other programs know a form of PLY that isn't written. */
pags_result pags_ply_check_name(const char *path);
/* `origin` receives the origin subtracted from all positions. */
pags_result pags_compressed_ply_decode(const ply_table *table, pags_gaussians *out, double origin[3]);

/* ln sigma, in metres, of an axis that has vanished: sigma is a thousandth of a nanometre. */
#define PAGS_LEAST_SCALE (-27.631021115928547f)
/* The logit of opacity 1, negated for 0: its sigmoid rounds to them. */
#define PAGS_MOST_OPACITY 20.0f

/* Completes a unit quaternion by its component `largest` and stores it as the rotation of row `i`. */
void pags_splat_put_rotation(double q[4], int largest, int64_t i, pags_gaussians *out);

/* Returns the logit of the opacity alpha / 255. 0 and 255 are taken as 1e-6 and 1 - 1e-6, whose logits are finite. */
float pags_logit_of_byte(uint8_t alpha);

/* SPZ_ADOBE_coordinate_system (nianticlabs/spz, extensions/README.md): one u32, a pags_axes. */
#define PAGS_SPZ_AXES_RECORD 0xADBE0003u

/* PAGS' own: the up axis of the scene in PLY's axes (u32, a pags_up), and its origin (three doubles). */
#define PAGS_SPZ_SCENE_RECORD 0x50470001u
enum { PAGS_SPZ_SCENE_BYTES = 28 };

/* PAGS' own: converted_from of pags_splat_facts (f32). */
#define PAGS_SPZ_CUT_RECORD 0x50470002u

/* Changes row `i`, of Gaussians with the alpha_min `a`, to look alike where alpha is cut at 1/255. Returns false, with
 * the row unchanged, if it is invisible. */
bool pags_plain_cut_make(pags_gaussians *g, int64_t i, double a);

/* Reverses this for all rows and sets alpha_min. */
void pags_plain_cut_undo(pags_gaussians *g, double a);

/* From 4096 m on, floats have a spacing of half a millimetre (2^-11 m) or more: positions beyond it are taken
 * relative to an origin of whole metres. */
#define PAGS_LARGE_COORDINATE 4096.0

/* The origin along one axis of which `values` are positions, in metres: their median, which a few stray ones don't
 * move, rounded to whole metres; 0 if that isn't large. Values that aren't finite are ignored. Sorts them. */
double pags_large_origin(double *values, int count);

/* Adds `origin` to all means; they lose digits. */
void pags_large_put_back(pags_gaussians *g, const double origin[3]);

#endif
