/* SPDX-License-Identifier: Apache-2.0 */
/* A set of 3D Gaussians as a structure of arrays.
 *
 * One allocation holds `plane_count(sh_degree)` planes of `stride` floats each; plane p of Gaussian (row) i is
 * data[p * stride + i]. Gradients and optimiser moments have the same layout, so the same loops over planes serve
 * all of them.
 *
 * Bytes per Gaussian: 4 * plane_count = 56, 92, 152 or 236 for SH degree 0..3. */
#ifndef PAGS_GAUSSIANS_H
#define PAGS_GAUSSIANS_H

#include <pags/base.h>

/* C0 = 1 / (2 sqrt pi), the value of the constant spherical harmonic: colour = 0.5 + C0 * dc + higher terms. */
#define PAGS_SH_C0 0.28209479177387814

/* The least value of pags_gaussians.alpha_min that isn't 0, with room for rounding: 1/255 is 0.00392. */
#define PAGS_LEAST_ALPHA_MIN 0.0039f

PAGS_BEGIN_C

/* The index of the first plane of each attribute, and counts of planes. */
enum {
  PAGS_MEAN = 0,     /* 3 planes: x, y, z, metres, relative to the scene's origin */
  PAGS_SCALE = 3,    /* 3 planes: ln sigma along the Gaussian's own axes, sigma in metres */
  PAGS_ROTATION = 6, /* 4 planes: quaternion w, x, y, z, not necessarily of unit length */
  PAGS_OPACITY = 10, /* 1 plane: logit of the opacity */
  /* Spherical harmonics of the colour, coefficient-major: plane PAGS_SH + 3*k + channel holds coefficient k; k =
   * 0 is the constant term (dc). */
  PAGS_SH = 11,
  PAGS_MAX_PLANES = 59,     /* planes in all for SH degree 3 */
  PAGS_FOURIER_PLANES = 12, /* planes of the member `fourier` per SH coefficient: terms k = 1..4 of three channels */
  PAGS_MAX_FOURIER = 192    /* planes of the member `fourier` for all coefficients of SH degree 3 */
};

/* Returns the number of SH coefficients per colour channel: (degree + 1)^2. */
static inline int pags_sh_coefficients(int degree) {
  return (degree + 1) * (degree + 1);
}
/* Returns the number of planes in all for an SH degree of 0..3: 14, 23, 38 or 59. */
static inline int pags_plane_count(int sh_degree) {
  return PAGS_SH + 3 * pags_sh_coefficients(sh_degree);
}

typedef struct pags_gaussians {
  int64_t count;  /* Gaussians (rows) in use */
  int64_t stride; /* floats from one plane to the next: the capacity, a multiple of 16; planes are 64-byte aligned */
  int sh_degree;  /* 0..3 */
  float *data;    /* plane_count * stride floats, zero from row `count` on; NULL if stride is 0 */
  float *s_sem;   /* semantic priority S_sem in [0, 1], `stride` floats; NULL if unknown */
  int32_t *object_id; /* index of the Gaussian's object in the scene, -1: none; `stride` entries; NULL if unknown */
  /* Fourier terms by which SH coefficients change over a track's time: pags_fourier_planes planes of `stride` floats,
   * plane 12 * c + 3 * (k - 1) + channel for term k = 1..4 of coefficient c; NULL if the colour doesn't change. See
   * pags_fourier_basis. */
  float *fourier;
  int fourier_degree; /* with `fourier`: the SH degree up to which coefficients change, 0..sh_degree; else 0 */
  /* The least alpha a that is drawn: a pixel blends (alpha - a) / (1 - a) where that is positive; from 1/255
   * (PAGS_LEAST_ALPHA_MIN) to 1. 0: as Kerbl et al. (2023) and most files expect, alpha itself where it is at least
   * 1/255. */
  float alpha_min;
} pags_gaussians;

/* Returns the number of planes of the member `fourier`: 0, 12, 48, 108 or 192. */
static inline int pags_fourier_planes(const pags_gaussians *g) {
  return g->fourier ? PAGS_FOURIER_PLANES * pags_sh_coefficients(g->fourier_degree) : 0;
}

/* Returns the first element of a plane: pags_plane(g, PAGS_MEAN + 1)[i] is the y coordinate of the mean of row i. */
static inline float *pags_plane(const pags_gaussians *g, int plane) {
  return g->data + (int64_t)plane * g->stride;
}

/* Reads the mean of row i. */
static inline void pags_gaussian_mean(const pags_gaussians *g, int64_t i, double mean[3]) {
  for (int k = 0; k < 3; k++)
    mean[k] = (double)pags_plane(g, PAGS_MEAN + k)[i];
}

/* Computes the normal of a Gaussian: the unit vector along its shortest axis (the first of equal ones), as of the flat
 * Gaussians of surfaces (2DGS, Huang et al. 2024). Its sign is arbitrary. The parameter of plane p lies at planes[p *
 * stride + row]. */
PAGS_API void pags_gaussian_normal(const float *planes, int64_t stride, int64_t row, double normal[3]);

/* Returns the lowest SH degree that represents the colour of a row exactly: all its terms of higher degrees, with
 * those of their Fourier series, are 0. */
PAGS_API int pags_gaussians_row_degree(const pags_gaussians *g, int64_t row);

/* Allocates `count` Gaussians whose parameters are all 0, with SH degree 0..3 and without s_sem, object_id and
 * fourier. `g` is overwritten without being freed. PAGS_ERROR_LIMIT if count > 2^31 - 64; PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_gaussians_create(pags_gaussians *g, int64_t count, int sh_degree);

/* Frees all planes and zeroes the struct. A zeroed struct is allowed. */
PAGS_API void pags_gaussians_destroy(pags_gaussians *g);

/* Grows the capacity (stride) to at least `capacity` rows and keeps the contents and `count`; never shrinks.
 * Pointers to planes become invalid. On failure `g` is unchanged. PAGS_ERROR_LIMIT if capacity > 2^31 - 64,
 * PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_gaussians_reserve(pags_gaussians *g, int64_t capacity);

/* Creates `count` Gaussians whose parameters are all 0, with the SH degree of `like`, and with s_sem (zeros),
 * object_id (-1) and Fourier planes (zeros) where `like` has them. Errors as pags_gaussians_create; then `g` is
 * empty. */
PAGS_API pags_result pags_gaussians_create_like(pags_gaussians *g, int64_t count, const pags_gaussians *like);

/* Add the array s_sem (zeros) or object_id (-1) unless `g` has it already or has no capacity. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_gaussians_add_s_sem(pags_gaussians *g);
PAGS_API pags_result pags_gaussians_add_object_id(pags_gaussians *g);

/* Copies rows: row i of `to` becomes row index[i] of `from`, i = 0..count - 1, in all planes of `data` and in
 * those of s_sem, object_id and fourier that both sets have. `to` must have been created with `count` rows and
 * the SH degree of `from`, and must not be `from`. */
PAGS_API void pags_gaussians_gather(const pags_gaussians *from, const int64_t *index, int64_t count,
                                    pags_gaussians *to);

/* Keeps the rows listed in `index`, in this order; with all of them, `g` isn't changed. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_gaussians_keep(pags_gaussians *g, const int64_t *index, int64_t count);

/* The colour over time of Street Gaussians (Yan et al. 2024, section 3.2). With u = (t - t0) / (t1 - t0) over the time
 * t0..t1 of the track, 0 if t1 = t0, an SH coefficient sh of degree 0..fourier_degree at time t is
 *
 *     sh(t) = sh + sum over k = 1..4 of basis[k] * fourier_k
 *     basis = 1, sin 2 pi u, cos 2 pi u, sin 4 pi u, cos 4 pi u
 *
 * pags_fourier_basis computes `basis` from u. */
PAGS_API void pags_fourier_basis(double u, double basis[5]);

/* Returns u for `time` on a track from `begin` to `end` (seconds), clamped to 0..1; 0 if end <= begin. */
PAGS_API double pags_fourier_phase(double begin, double end, double time);

/* Computes all SH coefficients of the rows [first, last) of a set with Fourier planes at one time. `sh` receives them
 * with the order and stride of the planes from PAGS_SH on, indexed by row. Results beyond the range of a float are
 * clamped to it, so that they are finite for finite terms of any size. */
PAGS_API void pags_fourier_colour(const pags_gaussians *g, const double basis[5], int64_t first, int64_t last,
                                  float *sh);

/* Computes the gradients by the first `planes` Fourier planes from those by the SH coefficients that
 * pags_fourier_colour gave, in the same order; all planes have `stride` floats. */
PAGS_API void pags_fourier_gradient(const double basis[5], const float *by_sh, int64_t stride, int planes,
                                    float *by_fourier);

/* Adds Fourier planes (zeros) for the coefficients of SH degree 0 to `degree` unless `g` has such planes already or has
 * no capacity. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_gaussians_add_fourier(pags_gaussians *g, int degree);

/* Computes the order of the rows along a Morton curve with 21 bits per axis over the bounding cube of the means:
 * index[i] is the row that comes i-th. Rows with equal codes keep their order; rows with a mean that isn't finite
 * come last. `index` has room for g->count entries. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_gaussians_morton_order(const pags_gaussians *g, int64_t *index);

/* Makes a copy of `from` with all its planes, s_sem, object_id and fourier, in Morton order. `out` is overwritten
 * and must not be `from`; on failure it is empty. PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_gaussians_sorted_copy(pags_gaussians *out, const pags_gaussians *from);

/* Returns the number of rows that can't be drawn: those with a value that isn't finite (parameters or Fourier
 * terms) or with an all-zero quaternion. Unless `index` is NULL, it receives the numbers of the rows that can be
 * drawn, in ascending order; it has room for g->count entries. */
PAGS_API int64_t pags_gaussians_find_bad(const pags_gaussians *g, int64_t *index);

PAGS_END_C
#endif
