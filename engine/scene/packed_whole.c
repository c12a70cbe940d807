/* SPDX-License-Identifier: Apache-2.0 */
/* Which rows of a cluster are packed whole, and how they are read (packed_whole.h).
 *
 * A cluster's means are packed within the box of its rows, and the harmonics of a plane in steps of their largest
 * magnitude. Whole rows count for neither. Distances are compared with the size of the cluster's middle half, and with
 * the sigmas of its Gaussians; harmonics with their median. */
#include "scene/packed_whole.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/sort.h"
#include "maths/maths.h"
#include "scene/packed_rows.h"

enum { ROWS = PAGS_PACKED_ROWS };

/* ---- Choosing ---- */

/* Copies the values of the rows that aren't whole and sorts them. Returns their number. */
static int sort_others(const float *values, int count, uint64_t whole, float sorted[ROWS]) {
  int n = 0;
  for (int i = 0; i < count; i++)
    if (!(whole >> i & 1))
      sorted[n++] = values[i];
  pags_sort_floats(sorted, n);
  return n;
}

/* The largest side that the box may have: 32 times that of the box of the middle half, and such that 16 bits move a
 * Gaussian by at most a quarter of its largest sigma, of the median one. */
static float largest_side(const pags_gaussians *g, int64_t first, int count) {
  float sigma[ROWS], sorted[ROWS], core = 0.0f;
  for (int i = 0; i < count; i++)
    sigma[i] = fmaxf(fmaxf(pags_plane(g, PAGS_SCALE)[first + i], pags_plane(g, PAGS_SCALE + 1)[first + i]),
                     pags_plane(g, PAGS_SCALE + 2)[first + i]);
  pags_sort_floats(sigma, count);
  for (int a = 0; a < 3; a++) {
    const int n = sort_others(pags_plane(g, PAGS_MEAN + a) + first, count, 0, sorted);
    core = fmaxf(core, sorted[3 * n / 4] - sorted[n / 4]);
  }
  const float by_sigma = 32767.0f * pags_expf(fminf(fmaxf(sigma[count / 2], PAGS_PACKED_LOWEST), -PAGS_PACKED_LOWEST));
  return core > 0.0f ? fminf(32.0f * core, by_sigma) : by_sigma;
}

/* Takes out the row that lies farthest from the median along the longest side, until no side is too long. */
static uint64_t choose_far(const pags_gaussians *g, int64_t first, int count) {
  float sorted[ROWS];
  uint64_t whole = 0;
  const float most = largest_side(g, first, count);
  for (int taken = 0; taken < count; taken++) {
    int axis = -1;
    float longest = most, middle = 0.0f;
    for (int a = 0; a < 3; a++) {
      const int n = sort_others(pags_plane(g, PAGS_MEAN + a) + first, count, whole, sorted);
      if (sorted[n - 1] - sorted[0] > longest) {
        longest = sorted[n - 1] - sorted[0];
        middle = sorted[n / 2];
        axis = a;
      }
    }
    if (axis < 0)
      break;
    const float *const mean = pags_plane(g, PAGS_MEAN + axis) + first;
    int farthest = -1;
    for (int i = 0; i < count; i++)
      if (!(whole >> i & 1) && (farthest < 0 || fabsf(mean[i] - middle) > fabsf(mean[farthest] - middle)))
        farthest = i;
    whole |= UINT64_C(1) << farthest;
  }
  return whole;
}

uint64_t pags_packed_choose_whole(const pags_gaussians *g, int64_t first, int count) {
  uint64_t whole = choose_far(g, first, count);
  for (int p = PAGS_SH + 3; p < pags_plane_count(g->sh_degree); p++) {
    const float *const values = pags_plane(g, p) + first;
    float magnitudes[ROWS], sorted[ROWS], most = 0.0f;
    for (int i = 0; i < count; i++) {
      magnitudes[i] = fabsf(values[i]);
      most = fmaxf(most, magnitudes[i]);
    }
    if (most <= 2.0f) /* off by less than 0.4 % of full scale */
      continue;
    sort_others(magnitudes, count, 0, sorted);
    for (int i = 0; i < count; i++)
      if (magnitudes[i] > fmaxf(2.0f, 8.0f * sorted[count / 2]))
        whole |= UINT64_C(1) << i;
  }
  return whole;
}

/* ---- Reading ---- */

const pags_packed_mixed *pags_packed_find_mixed(const pags_packed *packed, int64_t cluster, int64_t *count) {
  int64_t begin = 0, end = packed->mixed_count;
  while (begin < end) {
    const int64_t middle = begin + (end - begin) / 2;
    if (packed->mixed[middle].cluster < cluster)
      begin = middle + 1;
    else
      end = middle;
  }
  if (begin == packed->mixed_count || packed->mixed[begin].cluster != cluster)
    return NULL;
  *count = (begin + 1 < packed->mixed_count ? packed->mixed[begin + 1].first : packed->whole_count) -
           packed->mixed[begin].first;
  return packed->mixed + begin;
}

void pags_packed_put_whole(const pags_packed *packed, int64_t cluster, int begin, int end, float *planes) {
  int64_t count;
  const pags_packed_mixed *const mixed = pags_packed_find_mixed(packed, cluster, &count);
  const size_t bytes = pags_packed_whole_bytes(packed->shape.sh_degree);
  for (int64_t i = 0; mixed && i < count; i++) {
    const uint8_t *const at = packed->whole + (size_t)(mixed->first + i) * bytes;
    uint32_t row;
    memcpy(&row, at, sizeof row);
    for (int p = begin; p < end; p++)
      memcpy(planes + (p - begin) * ROWS + row, at + sizeof row + (size_t)p * sizeof(float), sizeof(float));
  }
}

/* Whether a row's number and values may be in `cluster`; *last: the row before it. */
static bool is_sound(const pags_packed *packed, int64_t cluster, const uint8_t *at, int64_t *last) {
  const int planes = pags_plane_count(packed->shape.sh_degree);
  const int64_t rows = packed->shape.count - cluster * ROWS < ROWS ? packed->shape.count - cluster * ROWS : ROWS;
  uint32_t row;
  memcpy(&row, at, sizeof row);
  bool good = row < rows && (int64_t)row > *last, turned = false;
  for (int p = 0; p < planes; p++) {
    float value;
    memcpy(&value, at + sizeof row + (size_t)p * sizeof value, sizeof value);
    good = good && isfinite(value);
    turned = turned || (p >= PAGS_ROTATION && p < PAGS_OPACITY && value != 0);
    if (p < 3)
      good = good && value >= packed->clusters.lo[p][cluster] && value <= packed->clusters.hi[p][cluster];
  }
  *last = row;
  return good && turned;
}

pags_result pags_packed_check_whole(const char *path, const pags_packed *packed) {
  const size_t bytes = pags_packed_whole_bytes(packed->shape.sh_degree);
  int64_t before = -1, next = 0;
  bool good = true;
  for (int64_t m = 0; good && m < packed->mixed_count; m++) {
    const pags_packed_mixed mixed = packed->mixed[m];
    const int64_t end = m + 1 < packed->mixed_count ? packed->mixed[m + 1].first : packed->whole_count;
    good = mixed.cluster > before && mixed.cluster < packed->clusters.count && mixed.first == next && end > next &&
           end <= packed->whole_count && end - next <= ROWS;
    for (int k = 0; good && k < 3; k++)
      good = mixed.lo[k] <= mixed.hi[k] && isfinite(mixed.hi[k] - mixed.lo[k]) &&
             mixed.lo[k] >= packed->clusters.lo[k][mixed.cluster] &&
             mixed.hi[k] <= packed->clusters.hi[k][mixed.cluster];
    int64_t last = -1;
    for (; good && next < end; next++)
      good = is_sound(packed, mixed.cluster, packed->whole + (size_t)next * bytes, &last);
    before = mixed.cluster;
  }
  return good && next == packed->whole_count
             ? PAGS_OK
             : pags_fail(PAGS_ERROR_FORMAT, "%s: cluster %lld: expected whole rows within its bounds, in order", path,
                         (long long)before);
}
