/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians in a render-ready packed form: 21 bytes of geometry and 6 + 3 ((degree + 1)^2 - 1) of colour each, laid out
 * by cluster.
 *
 * Clusters of 64 rows in memory order are unpacked one by one as a frame draws them; those that are culled are never
 * touched, and what is hidden has its colours left alone, for geometry and colours lie apart. A file (.pagsz) holds the
 * same bytes and is mapped, not read: of 50 million Gaussians only what is looked at becomes resident.
 *
 * attribute      stored as                                             largest error
 * mean           3 x 16 bits within the cluster's box                  1/131070 of the box's side
 * ln sigma       3 x 16 bits over -16..16                              2.5e-4: sigma to 0.025 %; beyond it: its end
 * rotation       unit quaternion, smallest three, 15 bits each + 2     2.2e-5 each, 4e-5 the largest: 1e-4 radians
 * opacity        16 bits of the logit over -16..16                     2.5e-4: opacity to 6.2e-5
 * colour, degree 0   3 x half                                          2^-12 relative
 * colour, others 8 bits by the largest in the cluster and plane        1/254 of that
 * s_sem          8 bits                                                1/510 */
#ifndef PAGS_PACKED_H
#define PAGS_PACKED_H

#include <pags/base.h>
#include <pags/clusters.h>
#include <pags/gaussians.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
  PAGS_PACKED_ROWS = 64,                       /* of a cluster */
  PAGS_PACKED_GEOMETRY = 21 * PAGS_PACKED_ROWS /* bytes of a cluster's geometry: uint16 [10][64] mean, ln sigma,
                                                  rotation, logit; uint8 [64] s_sem */
};

/* Bytes of a cluster's colours: half [3][64]; int8 [3 n][64], n coefficients after the first; float [3 n], what an 8
 * bit step is worth; zeros to a multiple of 64. */
static inline size_t pags_packed_colour_bytes(int sh_degree) {
  const size_t planes = 3 * ((size_t)pags_sh_coefficients(sh_degree) - 1);
  return (6 * (size_t)PAGS_PACKED_ROWS + planes * (PAGS_PACKED_ROWS + 4) + 63) / 64 * 64;
}

typedef struct pags_packed {
  pags_gaussians shape;    /* count and degree; no planes */
  pags_clusters clusters;  /* of 64 rows; bounds hold what unpacking gives */
  const uint8_t *geometry; /* PAGS_PACKED_GEOMETRY bytes a cluster */
  const uint8_t *colour;   /* pags_packed_colour_bytes(degree) a cluster */
  int has_s_sem;
  double origin[3];    /* of a file: as of the scene it was made from */
  int up, antialiased; /* up: a pags_up */
  float background[3];
  void *block; /* what is owned: a block of memory or a mapped file */
  size_t block_size;
  int mapped;
} pags_packed;

/* Packs the rows in the order they are in: Morton order makes clusters small. Fourier planes and object ids are left
 * out. Values that aren't finite are not allowed (pags_gaussians_find_bad). PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_packed_create(const pags_gaussians *gaussians, pags_packed *out);
PAGS_API void pags_packed_destroy(pags_packed *packed);       /* a zeroed struct is allowed */
PAGS_API size_t pags_packed_bytes(const pags_packed *packed); /* geometry, colours, bounds */

/* All rows as planes again; `out` is overwritten. */
PAGS_API pags_result pags_packed_unpack(const pags_packed *packed, pags_gaussians *out);

/* Packs rows of any order, which are put into Morton order first, and writes them. `head` (its origin, up, antialiased
 * and background) goes into the file. */
PAGS_API pags_result pags_packed_export(const char *path, const pags_gaussians *gaussians, const pags_packed *head);

/* Writes the file: `copies` times the same rows, copy c moved by offsets[3 c ..] metres, one after the other (1 and
 * NULL: as they are). Of several copies each has whole clusters only, so up to 63 rows are left out of each. */
PAGS_API pags_result pags_packed_save(const char *path, const pags_packed *packed, int64_t copies,
                                      const double *offsets);
/* Maps the file. PAGS_ERROR_IO, _FORMAT (sizes and bounds are checked; rows have no wrong values), _MEMORY. */
PAGS_API pags_result pags_packed_open(const char *path, pags_packed *out);
PAGS_API int pags_packed_is_file(const char *path); /* 1: begins as such a file does */

#ifdef __cplusplus
}
#endif
#endif
