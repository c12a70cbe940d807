/* SPDX-License-Identifier: Apache-2.0 */
/* The set of Gaussians (pags/gaussians.h): allocation and growth, copying of chosen rows, the Fourier series of a
 * colour that changes over time, and the search for rows that cannot be drawn. */
#include <pags/camera.h>
#include <pags/gaussians.h>

#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "maths/maths.h"
#include "port/port.h"

enum { LANES = 16, ALIGNMENT = 64 };
enum { NO_OBJECT = 0xFF }; /* in all bytes of an object's number: -1 */
/* Row numbers are stored in 32 bits and must not overflow when a count is rounded up to a multiple of 64. */
static const int64_t count_limit = INT64_C(0x7FFFFFFF) - 63;

/* Allocates `planes` planes of `stride` 4-byte values, aligned to 64 bytes, and copies the first `count` values of each
 * plane of `from`; the others get `byte` in all of their bytes. `stride` must be a multiple of 16, so that the size is
 * a multiple of 64 bytes, as aligned memory needs. NULL if out of memory or if `stride` is 0. */
static void *make_planes(int64_t stride, int planes, int byte, const void *from, int64_t from_stride, int64_t count) {
  if (stride == 0 || (uint64_t)stride > SIZE_MAX / 4 / (uint64_t)planes)
    return NULL;
  const size_t size = (size_t)stride * 4, kept = (size_t)count * 4;
  uint8_t *const to = pags_port_aligned_alloc(ALIGNMENT, size * (size_t)planes);
  for (size_t p = 0; to && p < (size_t)planes; p++) {
    if (count)
      memcpy(to + p * size, (const uint8_t *)from + p * (size_t)from_stride * 4, kept);
    memset(to + p * size + kept, byte, size - kept);
  }
  return to;
}

static pags_result fail_memory(int64_t count, int64_t planes) {
  return pags_out_of_memory("%lld Gaussians (%.1f MB)", (long long)count, (double)count * (double)planes * 4e-6);
}

static pags_result check_count(int64_t count) {
  assert(count >= 0);
  if (count > count_limit)
    return pags_fail(PAGS_ERROR_LIMIT, "%lld Gaussians are more than the limit of %lld", (long long)count,
                     (long long)count_limit);
  return PAGS_OK;
}

/* ---- Allocation ---- */

pags_result pags_gaussians_create(pags_gaussians *g, int64_t count, int sh_degree) {
  assert(sh_degree >= 0 && sh_degree <= 3);
  *g = (pags_gaussians){.sh_degree = sh_degree};
  PAGS_TRY(check_count(count));
  PAGS_TRY(pags_gaussians_reserve(g, count));
  g->count = count;
  return PAGS_OK;
}

static pags_result create_like(pags_gaussians *g, int64_t count, const pags_gaussians *like) {
  PAGS_TRY(pags_gaussians_create(g, count, like->sh_degree));
  PAGS_TRY(pags_gaussians_reserve(g, 1)); /* without room there would be no columns */
  g->alpha_min = like->alpha_min;
  if (like->s_sem)
    PAGS_TRY(pags_gaussians_add_s_sem(g));
  if (like->object_id)
    PAGS_TRY(pags_gaussians_add_object_id(g));
  return like->fourier ? pags_gaussians_add_fourier(g, like->fourier_degree) : PAGS_OK;
}

pags_result pags_gaussians_create_like(pags_gaussians *g, int64_t count, const pags_gaussians *like) {
  const pags_result result = create_like(g, count, like);
  if (result != PAGS_OK)
    pags_gaussians_destroy(g);
  return result;
}

void pags_gaussians_destroy(pags_gaussians *g) {
  pags_port_aligned_free(g->data);
  pags_port_aligned_free(g->s_sem);
  pags_port_aligned_free(g->object_id);
  pags_port_aligned_free(g->fourier);
  *g = (pags_gaussians){0};
}

pags_result pags_gaussians_add_s_sem(pags_gaussians *g) {
  if (!g->s_sem)
    g->s_sem = make_planes(g->stride, 1, 0, NULL, 0, 0);
  return g->s_sem || g->stride == 0 ? PAGS_OK : fail_memory(g->stride, 1);
}

pags_result pags_gaussians_add_object_id(pags_gaussians *g) {
  if (!g->object_id)
    g->object_id = make_planes(g->stride, 1, NO_OBJECT, NULL, 0, 0);
  return g->object_id || g->stride == 0 ? PAGS_OK : fail_memory(g->stride, 1);
}

pags_result pags_gaussians_add_fourier(pags_gaussians *g, int degree) {
  const int planes = PAGS_FOURIER_PLANES * pags_sh_coefficients(degree);
  assert(degree >= 0 && degree <= g->sh_degree);
  if (g->fourier || g->stride == 0)
    return PAGS_OK;
  g->fourier = make_planes(g->stride, planes, 0, NULL, 0, 0);
  g->fourier_degree = g->fourier ? degree : 0;
  return g->fourier ? PAGS_OK : fail_memory(g->stride, planes);
}

/* ---- Colour: Fourier series over time, SH degree ---- */

void pags_fourier_basis(double u, double basis[5]) {
  const double turn = 6.283185307179586477;
  basis[0] = 1;
  basis[1] = pags_sin(turn * u);
  basis[2] = pags_cos(turn * u);
  basis[3] = pags_sin(2 * turn * u);
  basis[4] = pags_cos(2 * turn * u);
}

void pags_gaussian_normal(const float *planes, int64_t stride, int64_t row, double normal[3]) {
  const float *const at = planes + row;
  double q[4], r[9];
  int shortest = 0;
  for (int k = 1; k < 3; k++)
    if (at[(PAGS_SCALE + k) * stride] < at[(PAGS_SCALE + shortest) * stride])
      shortest = k;
  for (int k = 0; k < 4; k++)
    q[k] = (double)at[(PAGS_ROTATION + k) * stride];
  pags_rotation_from_quaternion(q, r);
  for (int k = 0; k < 3; k++)
    normal[k] = r[3 * k + shortest];
}

int pags_gaussians_row_degree(const pags_gaussians *g, int64_t row) {
  int degree = g->sh_degree;
  for (int k = 3 * pags_sh_coefficients(degree) - 1; k >= 3; k--) {
    bool used = pags_plane(g, PAGS_SH + k)[row] != 0;
    for (int t = 0, plane = 12 * (k / 3) + k % 3; t < 4 && plane < pags_fourier_planes(g); t++, plane += 3)
      used = used || g->fourier[plane * g->stride + row] != 0;
    if (used)
      return degree;
    if (k == 3 * pags_sh_coefficients(degree - 1))
      degree--;
  }
  return 0;
}

double pags_fourier_phase(double begin, double end, double time) {
  return end > begin ? fmin(fmax((time - begin) / (end - begin), 0.0), 1.0) : 0.0;
}

/* Sums in double and clamps to the range of float, so that no terms add up to infinity. */
void pags_fourier_colour(const pags_gaussians *g, const double basis[5], int64_t first, int64_t last, float *sh) {
  const double most = (double)FLT_MAX;
  const int changing = 3 * pags_sh_coefficients(g->fourier_degree), all = 3 * pags_sh_coefficients(g->sh_degree);
  for (int p = 0; p < changing; p++) {
    const float *const constant = pags_plane(g, PAGS_SH + p);
    const float *const terms = g->fourier + (PAGS_FOURIER_PLANES * (p / 3) + p % 3) * g->stride;
    float *const out = sh + p * g->stride;
    for (int64_t i = first; i < last; i++) {
      double sum = (double)constant[i];
      for (int k = 1; k < 5; k++)
        sum += basis[k] * (double)terms[3 * (k - 1) * g->stride + i];
      out[i] = (float)fmin(fmax(sum, -most), most);
    }
  }
  for (int p = changing; p < all && first < last; p++)
    memcpy(sh + p * g->stride + first, pags_plane(g, PAGS_SH + p) + first, (size_t)(last - first) * sizeof *sh);
}

void pags_fourier_gradient(const double basis[5], const float *by_sh, int64_t stride, int planes, float *by_fourier) {
  for (int p = 0; p < planes; p++) {
    const int coefficient = p / PAGS_FOURIER_PLANES, k = 1 + p % PAGS_FOURIER_PLANES / 3;
    const float *const from = by_sh + (3 * coefficient + p % 3) * stride;
    for (int64_t i = 0; i < stride; i++)
      by_fourier[p * stride + i] = (float)basis[k] * from[i];
  }
}

/* ---- Growing and copying ---- */

pags_result pags_gaussians_reserve(pags_gaussians *g, int64_t capacity) {
  PAGS_TRY(check_count(capacity));
  const int64_t stride = (capacity + LANES - 1) / LANES * LANES;
  if (stride <= g->stride)
    return PAGS_OK;
  const int planes = pags_plane_count(g->sh_degree);
  pags_gaussians grown = *g, old = *g;
  grown.stride = stride;
  grown.data = make_planes(stride, planes, 0, g->data, g->stride, g->count);
  grown.s_sem = g->s_sem ? make_planes(stride, 1, 0, g->s_sem, g->stride, g->count) : NULL;
  grown.object_id = g->object_id ? make_planes(stride, 1, NO_OBJECT, g->object_id, g->stride, g->count) : NULL;
  grown.fourier = g->fourier ? make_planes(stride, pags_fourier_planes(g), 0, g->fourier, g->stride, g->count) : NULL;
  if (!grown.data || (g->s_sem && !grown.s_sem) || (g->object_id && !grown.object_id) ||
      (g->fourier && !grown.fourier)) {
    pags_gaussians_destroy(&grown);
    return fail_memory(stride, planes);
  }
  *g = grown;
  pags_gaussians_destroy(&old);
  return PAGS_OK;
}

static void gather_plane(const float *from, const int64_t *index, int64_t count, float *to) {
  for (int64_t i = 0; i < count; i++)
    to[i] = from[index[i]];
}

void pags_gaussians_gather(const pags_gaussians *from, const int64_t *index, int64_t count, pags_gaussians *to) {
  assert(from != to && to->count == count && to->sh_degree == from->sh_degree);
  for (int p = 0; p < pags_plane_count(from->sh_degree) && count; p++)
    gather_plane(pags_plane(from, p), index, count, pags_plane(to, p));
  if (from->s_sem && to->s_sem)
    gather_plane(from->s_sem, index, count, to->s_sem);
  for (int p = 0; p < pags_fourier_planes(from) && p < pags_fourier_planes(to); p++)
    gather_plane(from->fourier + p * from->stride, index, count, to->fourier + p * to->stride);
  for (int64_t i = 0; i < count && from->object_id && to->object_id; i++)
    to->object_id[i] = from->object_id[index[i]];
}

pags_result pags_gaussians_keep(pags_gaussians *g, const int64_t *index, int64_t count) {
  pags_gaussians kept;
  if (count == g->count)
    return PAGS_OK;
  PAGS_TRY(pags_gaussians_create_like(&kept, count, g));
  pags_gaussians_gather(g, index, count, &kept);
  pags_gaussians_destroy(g);
  *g = kept;
  return PAGS_OK;
}

/* ---- Rows that cannot be drawn ---- */

enum { BLOCK = 256 };

/* Sets bad[i] where plane[i] is not finite. */
static void mark_not_finite(const float *plane, int count, uint8_t bad[BLOCK]) {
  for (int i = 0; i < count; i++)
    bad[i] = bad[i] || !isfinite(plane[i]);
}

int64_t pags_gaussians_find_bad(const pags_gaussians *g, int64_t *index) {
  int64_t bad_count = 0, good_count = 0;
  uint8_t bad[BLOCK];
  for (int64_t first = 0; first < g->count; first += BLOCK) {
    int count = g->count - first < BLOCK ? (int)(g->count - first) : BLOCK;

    /* A row is bad if one of its values is not finite or its quaternion is zero. */
    memset(bad, 0, BLOCK);
    for (int p = 0; p < pags_plane_count(g->sh_degree); p++)
      mark_not_finite(pags_plane(g, p) + first, count, bad);
    for (int p = 0; p < pags_fourier_planes(g); p++)
      mark_not_finite(g->fourier + p * g->stride + first, count, bad);
    const float *q[4];
    for (int k = 0; k < 4; k++)
      q[k] = pags_plane(g, PAGS_ROTATION + k) + first;
    for (int i = 0; i < count; i++)
      bad[i] = bad[i] || (q[0][i] == 0 && q[1][i] == 0 && q[2][i] == 0 && q[3][i] == 0);

    for (int i = 0; i < count; i++) {
      if (bad[i])
        bad_count++;
      else if (index)
        index[good_count++] = first + i;
    }
  }
  return bad_count;
}
