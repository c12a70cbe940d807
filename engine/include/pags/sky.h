/* SPDX-License-Identifier: Apache-2.0 */
/* The sky: a cube map at infinity, blended behind the Gaussians with the transmittance that they leave. */
#ifndef PAGS_SKY_H
#define PAGS_SKY_H

#include <pags/base.h>

PAGS_BEGIN_C

/* A cube map with the faces +X -X +Y -Y +Z -Z of the world's axes seen from inside, row 0 at the top, as in OpenGL.
 * The face of a direction (x, y, z) is that of its major axis m, the component of largest magnitude. The face's
 * texture coordinates, 0..1, are (sc / |m| + 1) / 2 and (tc / |m| + 1) / 2 with
 *
 *     face      +X         -X        +Y        -Y         +Z         -Z
 *     (sc, tc)  (-z, -y)   (z, -y)   (x, z)    (x, -z)    (x, -y)    (-x, -y)
 *
 * The centre of the texel in row i, column j lies at ((j + 0.5) / size, (i + 0.5) / size). Between centres the
 * colour is interpolated bilinearly within the face and clamped at its border. */
typedef struct pags_sky {
  int size;      /* texels per side of a face, 1..4096; 0: no sky */
  float *texels; /* [6][size][size][3] (face, row, column, channel), display-referred sRGB; NULL if size is 0 */
  float dip;     /* pags_sky_load: magnitude of the most negative texel as a fraction of the largest one, 0..1 */
} pags_sky;

/* Allocates a sky of 0..4096 texels per side, all 0; `sky` is overwritten without being freed. PAGS_ERROR_MEMORY;
 * then `sky` is zeroed. */
PAGS_API pags_result pags_sky_create(pags_sky *sky, int size);

/* Frees the texels and zeroes the struct. A zeroed struct is allowed. */
PAGS_API void pags_sky_destroy(pags_sky *sky);

/* Reads a NumPy array of little-endian float16 [6][size][size][3] in C order from a .npy file, or from member sky.npy
 * of a .npz archive. PAGS_ERROR_IO, PAGS_ERROR_FORMAT (wrong shape, cut off, values that are not finite),
 * PAGS_ERROR_UNSUPPORTED (another sample type or order) or PAGS_ERROR_MEMORY; then `sky` is zeroed. */
PAGS_API pags_result pags_sky_load(const char *path, pags_sky *sky);

/* Writes a sky of size > 0: as .npy if the path ends so, else as .npz, deflated, so that texels that no photograph
 * shows take no space. PAGS_ERROR_ARGUMENT for a texel that float16 can't hold (not finite or beyond 65504);
 * PAGS_ERROR_IO or _MEMORY. */
PAGS_API pags_result pags_sky_save(const char *path, const pags_sky *sky);

/* *bytes: the size of the .npz that pags_sky_save writes for this sky; 0 if its size is 0. Takes as long as saving it.
 * PAGS_ERROR_ARGUMENT, _MEMORY as pags_sky_save. */
PAGS_API pags_result pags_sky_file_size(const pags_sky *sky, uint64_t *bytes);

/* Returns the face (0..5) of the cube that `direction` (world, any length > 0) meets; at: the point's column and row on
 * it, as fractions of the face, 0..1. */
PAGS_API int pags_sky_face(const double direction[3], double at[2]);

/* Computes the colour of the sky (size > 0) in `direction` (world, any length > 0), display-referred sRGB. */
PAGS_API void pags_sky_sample(const pags_sky *sky, const double direction[3], float rgb[3]);

PAGS_END_C
#endif
