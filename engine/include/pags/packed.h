/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians in a render-ready packed form, stored cluster by cluster. A Gaussian takes 21 bytes of geometry, and of
 * colour
 *     6 + 3 ((degree + 1)^2 - 1) bytes.
 *
 * A cluster is 64 rows that follow each other in memory. A frame unpacks the clusters that it draws one by one.
 * Culled clusters are never touched, and the colours of hidden clusters aren't either, since geometry and colours
 * are stored separately. A file (.pagsz) holds the same bytes and is mapped into memory instead of read, so that of 50
 * million Gaussians only the part in view becomes resident.
 *
 * attribute          stored as                                           largest error
 * mean               3 x 16 bits within the cluster's bounding box       1/131070 of the box's side
 * ln sigma           3 x 16 bits over -16..16, clamped beyond            2.5e-4 (0.025 % of sigma)
 * rotation           unit quaternion: smallest three components,         2.2e-5 per component, 4e-5 the largest one:
 *                    15 bits each, and 2 bits for the index of the       1e-4 radians
 *                    largest
 * opacity            16 bits of the logit over -16..16, clamped beyond   2.5e-4 (6.2e-5 of opacity)
 * colour, degree 0   3 x half float                                      2^-12 relative
 * colour, others     8 bits, scaled by the largest magnitude in the      1/254 of that magnitude
 *                    cluster's plane
 * s_sem              8 bits over 0..1                                    1/510
 *
 * A row that lies far from the others of its cluster, or has far larger harmonics, would cost them accuracy. It is
 * stored whole, as floats, except ln sigma and opacity, which are clamped as above, and counts neither for the box
 * of the means nor for the magnitudes. Few clusters of few scenes have such rows. */
#ifndef PAGS_PACKED_H
#define PAGS_PACKED_H

#include <pags/base.h>
#include <pags/clusters.h>
#include <pags/gaussians.h>

PAGS_BEGIN_C

enum {
  PAGS_PACKED_ROWS = 64, /* Gaussians per cluster */
  /* Bytes of geometry per cluster: uint16 [10][64] (mean, ln sigma, rotation, logit), then uint8 [64] (s_sem). */
  PAGS_PACKED_GEOMETRY = 21 * PAGS_PACKED_ROWS
};

/* Returns the bytes of colour per cluster for an SH degree of 0..3. With n = (degree + 1)^2 - 1 higher coefficients
 * per channel, a cluster's colours are:
 *     half [3][64]     the constant terms
 *     int8 [3 n][64]   the higher terms, in steps
 *     float [3 n]      the value of one step in each of these planes
 *     zeros up to a multiple of 64 bytes */
static inline size_t pags_packed_colour_bytes(int sh_degree) {
  const size_t planes = 3 * ((size_t)pags_sh_coefficients(sh_degree) - 1);
  return (6 * (size_t)PAGS_PACKED_ROWS + planes * (PAGS_PACKED_ROWS + 4) + 63) / 64 * 64;
}

/* A cluster with rows that are stored whole. */
typedef struct pags_packed_mixed {
  uint32_t cluster;
  uint32_t first;     /* number of its first whole row, of those of all clusters; they go on to the next cluster's */
  float lo[3], hi[3]; /* the box of the means of its other rows */
} pags_packed_mixed;

typedef struct pags_packed {
  pags_gaussians shape;           /* only count, sh_degree and alpha_min are set; it has no planes */
  pags_clusters clusters;         /* bounds of the clusters of 64 rows; they bound the unpacked values */
  const uint8_t *geometry;        /* PAGS_PACKED_GEOMETRY bytes per cluster */
  const uint8_t *colour;          /* pags_packed_colour_bytes(sh_degree) bytes per cluster */
  const pags_packed_mixed *mixed; /* clusters with whole rows, in ascending order */
  const uint8_t *whole;           /* whole rows: a uint32, the row in its cluster, and all planes of means to SH */
  int64_t mixed_count, whole_count;
  int has_s_sem; /* non-zero: s_sem is known */
  /* The next three are set by pags_packed_open, from the scene that the file was made of. */
  double origin[3];    /* metres */
  int up, antialiased; /* a pags_up; 1: opacities expect the antialiased projection */
  float background[3]; /* display-referred sRGB, 0..1 */
  void *block;         /* the memory that the struct owns: an allocation or a mapped file */
  size_t block_size;   /* bytes */
  int mapped;          /* 1: `block` is a mapped file */
} pags_packed;

/* Packs Gaussians in the order of their rows; Morton order (pags_gaussians_sorted_copy) gives small clusters and
 * so small errors of the means. Fourier planes and object ids are dropped. All values must be finite
 * (pags_gaussians_find_bad). `out` is overwritten. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_packed_create(const pags_gaussians *gaussians, pags_packed *out);

/* Frees or unmaps the block and zeroes the struct. A zeroed struct is allowed. */
PAGS_API void pags_packed_destroy(pags_packed *packed);

/* Returns the size of the block in bytes: geometry, colours and bounds. */
PAGS_API size_t pags_packed_bytes(const pags_packed *packed);

/* Unpacks all rows into planes, with s_sem if it is known; `out` is overwritten without being freed.
 * PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_packed_unpack(const pags_packed *packed, pags_gaussians *out);

/* Sorts a copy of the Gaussians in Morton order, packs it and writes it to a file. The file's origin, up,
 * antialiased and background are those of `head`, whose other members are ignored. PAGS_ERROR_ARGUMENT for values
 * that aren't finite; PAGS_ERROR_IO, PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_packed_export(const char *path, const pags_gaussians *gaussians, const pags_packed *head);

/* Writes a file that holds the rows `copies` times in sequence, copy c moved by the three numbers (metres) from
 * offsets[3 c] on. One copy and NULL offsets write the rows as they are. With several copies each copy must
 * consist of whole clusters, so that up to 63 rows at its end are left out. PAGS_ERROR_LIMIT beyond 2^31 - 64
 * rows in all; PAGS_ERROR_IO. */
PAGS_API pags_result pags_packed_save(const char *path, const pags_packed *packed, int64_t copies,
                                      const double *offsets);

/* Maps a packed file; `out` is overwritten. Sizes and bounds are checked; the packed rows need no check, since
 * any bytes unpack to finite values. Files without whole rows have no lists of them. PAGS_ERROR_IO, PAGS_ERROR_FORMAT
 * or PAGS_ERROR_MEMORY; then `out` is zeroed. */
PAGS_API pags_result pags_packed_open(const char *path, pags_packed *out);

/* Returns 1 if a file exists and begins with the signature of a packed file, otherwise 0. */
PAGS_API int pags_packed_is_file(const char *path);

PAGS_END_C
#endif
