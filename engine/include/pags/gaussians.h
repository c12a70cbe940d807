/* SPDX-License-Identifier: Apache-2.0 */
/* A set of 3D Gaussians as a structure of arrays.
 *
 * One allocation holds `plane_count(sh_degree)` planes of `stride` floats each; plane p of Gaussian i is
 * data[p * stride + i]. Gradients and optimiser moments use the same layout, so whatever walks planes serves all of
 * them.
 *
 * Bytes per Gaussian: 4 * plane_count = 56, 92, 152 or 236 for SH degree 0..3. */
#ifndef PAGS_GAUSSIANS_H
#define PAGS_GAUSSIANS_H

#include <pags/base.h>

/* C0 = 1 / (2 sqrt pi): the constant basis function; colour = 0.5 + C0 * dc. */
#define PAGS_SH_C0 0.28209479177387814

#ifdef __cplusplus
extern "C" {
#endif

enum {
  PAGS_MEAN = 0,     /* x y z, metres, relative to the scene's origin */
  PAGS_SCALE = 3,    /* ln sigma along the Gaussian's own axes */
  PAGS_ROTATION = 6, /* quaternion w x y z, not necessarily of unit length */
  PAGS_OPACITY = 10, /* logit */
  PAGS_SH = 11, /* spherical harmonics, coefficient-major: plane PAGS_SH + 3*k + channel, k = 0 the constant term */
  PAGS_MAX_PLANES = 59,
  PAGS_FOURIER_PLANES = 12 /* of `fourier`: k = 1..4, three channels each */
};

/* Coefficients per channel, planes in all. */
static inline int pags_sh_coefficients(int degree) {
  return (degree + 1) * (degree + 1);
}
static inline int pags_plane_count(int sh_degree) {
  return PAGS_SH + 3 * pags_sh_coefficients(sh_degree);
}

typedef struct pags_gaussians {
  int64_t count;      /* Gaussians in use */
  int64_t stride;     /* floats from one plane to the next: capacity, a multiple of 16; planes are 64-byte aligned */
  int sh_degree;      /* 0..3 */
  float *data;        /* plane_count * stride floats, zero beyond count; NULL when stride is 0 */
  float *s_sem;       /* semantic priority in [0, 1], `stride` floats; NULL when unknown */
  int32_t *object_id; /* per Gaussian: index of the scene's object, -1 for none, `stride` entries; NULL when unknown */
  float *fourier; /* colour over a track's time: 12 planes of `stride` floats, plane 3 * (k - 1) + channel for k = 1..4;
                     NULL: the colour doesn't change. See pags_fourier_basis */
} pags_gaussians;

static inline float *pags_plane(const pags_gaussians *g, int plane) {
  return g->data + (int64_t)plane * g->stride;
}

/* The lowest degree that shows a row's colour as it is: no term beyond it differs from 0. */
PAGS_API int pags_gaussians_row_degree(const pags_gaussians *g, int64_t row);

/* Makes room for `count` Gaussians of zeros; `g` is overwritten. PAGS_ERROR_MEMORY or PAGS_ERROR_LIMIT (2^31 - 64). */
PAGS_API pags_result pags_gaussians_create(pags_gaussians *g, int64_t count, int sh_degree);
PAGS_API void pags_gaussians_destroy(pags_gaussians *g); /* frees and zeroes; a zeroed struct is allowed */

/* Grows the capacity to at least `capacity`, keeping contents. */
PAGS_API pags_result pags_gaussians_reserve(pags_gaussians *g, int64_t capacity);

/* Makes room for `count` Gaussians of zeros with the degree, s_sem, object_id (-1) and Fourier planes that `like` has.
 */
PAGS_API pags_result pags_gaussians_create_like(pags_gaussians *g, int64_t count, const pags_gaussians *like);

/* Adds s_sem (zeros) or object_id (-1) where they are missing. */
PAGS_API pags_result pags_gaussians_add_s_sem(pags_gaussians *g);
PAGS_API pags_result pags_gaussians_add_object_id(pags_gaussians *g);

/* Row i of the result is row index[i] of `from` (all planes, and those of s_sem, object_id and fourier that both have).
 * `to` must have been created with `count` rows and from's degree and must not be `from`. */
PAGS_API void pags_gaussians_gather(const pags_gaussians *from, const int64_t *index, int64_t count,
                                    pags_gaussians *to);

/* Street Gaussians (Yan et al. 2024): constant term at u = dc + sum_k basis[k] fourier_k, u = (t - t0) / (t1 - t0) over
 * the track's time, 0 where t1 = t0: basis = 1, sin 2 pi u, cos 2 pi u, sin 4 pi u, cos 4 pi u. */
PAGS_API void pags_fourier_basis(double u, double basis[5]);
/* u of `time`, held to 0..1. */
PAGS_API double pags_fourier_phase(double begin, double end, double time);
/* Constant terms of rows [first, last) of a model with Fourier planes, to three planes g->stride floats apart; finite
 * for any terms. */
PAGS_API void pags_fourier_colour(const pags_gaussians *g, const double basis[5], int64_t first, int64_t last,
                                  float *dc);

/* Adds the Fourier planes (zeros) where they are missing. */
PAGS_API pags_result pags_gaussians_add_fourier(pags_gaussians *g);

/* The order of the Gaussians along a Morton curve of 21 bits an axis over their bounding box: index[i] is the row that
 * comes i-th; ties by row. Rows with a non-finite mean come last. `index` has g->count entries. */
PAGS_API pags_result pags_gaussians_morton_order(const pags_gaussians *g, int64_t *index);
/* A copy, all planes of it, in that order; on failure `out` is empty. `out` is not `from`. */
PAGS_API pags_result pags_gaussians_sorted_copy(pags_gaussians *out, const pags_gaussians *from);

/* Counts rows that can't be drawn: a non-finite value or an all-zero quaternion. `index`, when not NULL, receives the
 * rows that can, in order (room for g->count). Returns the number of bad rows. */
PAGS_API int64_t pags_gaussians_find_bad(const pags_gaussians *g, int64_t *index);

#ifdef __cplusplus
}
#endif
#endif
