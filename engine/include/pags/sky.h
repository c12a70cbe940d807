/* SPDX-License-Identifier: Apache-2.0 */
/* The sky: a cube map at infinity, blended by the transmittance that the Gaussians leave. */
#ifndef PAGS_SKY_H
#define PAGS_SKY_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Faces +X -X +Y -Y +Z -Z of the world's axes seen from inside, row 0 at the top, as in OpenGL cube maps: for the major
 * axis m of a direction r, with (sc, tc) = +X (-z, -y), -X (z, -y), +Y (x, z), -Y (x, -z), +Z (x, -y), -Z (-x, -y), the
 * texture coordinates are (sc / |m| + 1) / 2 and (tc / |m| + 1) / 2. Texel (row i, column j) lies at ((j + 0.5) / size,
 * (i + 0.5) / size); values between are bilinear within the face, clamped at its border. */
typedef struct pags_sky {
  int size;      /* texels a side, 1..4096; 0: no sky */
  float *texels; /* [6][size][size][3] display-referred sRGB; NULL when size is 0 */
} pags_sky;

PAGS_API pags_result pags_sky_create(pags_sky *sky, int size); /* zeros */
PAGS_API void pags_sky_destroy(pags_sky *sky);                 /* frees and zeroes; a zeroed struct is allowed */

/* sky.npy: float16 [6][size][size][3], C order. */
PAGS_API pags_result pags_sky_load(const char *path, pags_sky *sky);
/* Bytes of what pags_sky_save writes. */
PAGS_API uint64_t pags_sky_file_size(const pags_sky *sky);
PAGS_API pags_result pags_sky_save(const char *path, const pags_sky *sky);

/* Colour towards `direction` (world, any length > 0). */
PAGS_API void pags_sky_sample(const pags_sky *sky, const double direction[3], float rgb[3]);

#ifdef __cplusplus
}
#endif
#endif
