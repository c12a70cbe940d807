/* SPDX-License-Identifier: Apache-2.0 */
/* Unpacks one cluster of packed Gaussians into planes of floats, and chooses, reads and checks whole rows. Plain loops
 * over arrays, which the compiler vectorises; it must not fuse products and sums (-ffp-contract=off), so that every
 * machine gives the same bits.
 *
 * A cluster's means are packed within the box of its rows, and the harmonics of a plane in steps of their largest
 * magnitude. Whole rows are excluded from both. Distances are compared with the size of the cluster's middle half and
 * with the sigmas of its Gaussians; harmonics with their median. */
#include "scene/packed_rows.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/file.h"
#include "base/sort.h"
#include "maths/maths.h"

enum { ROWS = PAGS_PACKED_ROWS };

/* ---- Choosing whole rows ---- */

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

/* ---- Reading whole rows ---- */

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

/* Writes planes [begin, end) of a cluster's whole rows over planes of ROWS floats, the first being plane `begin`. */
static void put_whole(const pags_packed *packed, int64_t cluster, int begin, int end, float *planes) {
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
             : pags_fail_at(path, "cluster %lld: expected whole rows within its bounds, in order", (long long)before);
}

/* ---- Unpacking ---- */

/* Converts a half float: its exponent and mantissa bits are moved to their places in a float, which is then
 * multiplied by 2^112 to correct the exponent's bias. This is exact, also for zeros and subnormals. Infinities and
 * NaNs, which only a damaged file has, become large finite numbers, so that no NaN reaches the picture. */
static inline float half_to_float(uint32_t half) {
  const uint32_t bits = (half & 0x7FFFu) << 13, sign = (half & 0x8000u) << 16;
  float value;
  uint32_t out;
  memcpy(&value, &bits, sizeof value);
  value *= 0x1p112f;
  memcpy(&out, &value, sizeof out);
  out |= sign;
  memcpy(&value, &out, sizeof value);
  return value;
}

/* Unpacks the means; clamped to the upper bound, beyond which rounding could take them. */
static void unpack_means(const uint16_t words[][ROWS], const pags_packed *packed, int64_t cluster, float *planes) {
  const pags_clusters *const clusters = &packed->clusters;
  int64_t unused;
  const pags_packed_mixed *const mixed = pags_packed_find_mixed(packed, cluster, &unused);
  for (int a = 0; a < 3; a++) {
    const float from = mixed ? mixed->lo[a] : clusters->lo[a][cluster],
                to = mixed ? mixed->hi[a] : clusters->hi[a][cluster], step = (to - from) * (1.0f / 65535.0f);
    float *const out = planes + a * ROWS;
    for (int i = 0; i < ROWS; i++) {
      const float v = from + (float)words[a][i] * step;
      out[i] = v < to ? v : to;
    }
  }
}

/* Unpacks ln sigma or an opacity logit: 16 bits over -16..16. */
static void unpack_scaled(const uint16_t words[ROWS], float *out) {
  for (int i = 0; i < ROWS; i++)
    out[i] = (float)words[i] * PAGS_PACKED_STEP + PAGS_PACKED_LOWEST;
}

/* Unpacks quaternions w, x, y, z from three words each: 15 bits of a component, while the top bits of the first two
 * words are the index of the component that was left out, the largest, which follows from the unit length. */
static void unpack_rotations(const uint16_t words[3][ROWS], float *q) {
  float part[3][ROWS], largest[ROWS];
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < ROWS; i++)
      part[k][i] = (float)(words[k][i] & 0x7FFF) * PAGS_PACKED_TURN - PAGS_PACKED_HALF_ROOT;
  for (int i = 0; i < ROWS; i++) {
    const float rest = 1.0f - part[0][i] * part[0][i] - part[1][i] * part[1][i] - part[2][i] * part[2][i];
    largest[i] = sqrtf(rest > 0.0f ? rest : 0.0f);
  }
  for (int i = 0; i < ROWS; i++) {
    const int which = words[0][i] >> 15 | (words[1][i] >> 15) << 1;
    q[i] = which == 0 ? largest[i] : part[0][i];
    q[ROWS + i] = which == 1 ? largest[i] : which == 0 ? part[0][i] : part[1][i];
    q[2 * ROWS + i] = which == 2 ? largest[i] : which == 3 ? part[2][i] : part[1][i];
    q[3 * ROWS + i] = which == 3 ? largest[i] : part[2][i];
  }
}

void pags_packed_geometry(const pags_packed *packed, int64_t cluster, float *planes) {
  uint16_t words[PAGS_PACKED_WORDS][ROWS];
  memcpy(words, packed->geometry + cluster * PAGS_PACKED_GEOMETRY, sizeof words);
  unpack_means((const uint16_t(*)[ROWS])words, packed, cluster, planes);
  for (int k = 0; k < 3; k++)
    unpack_scaled(words[3 + k], planes + (PAGS_SCALE + k) * ROWS);
  unpack_rotations((const uint16_t(*)[ROWS])words + 6, planes + PAGS_ROTATION * ROWS);
  unpack_scaled(words[9], planes + PAGS_OPACITY * ROWS);
  put_whole(packed, cluster, PAGS_MEAN, PAGS_SH, planes);
}

void pags_packed_means(const pags_packed *packed, int64_t cluster, float *planes) {
  uint16_t words[3][ROWS];
  memcpy(words, packed->geometry + cluster * PAGS_PACKED_GEOMETRY, sizeof words);
  unpack_means((const uint16_t(*)[ROWS])words, packed, cluster, planes);
  put_whole(packed, cluster, PAGS_MEAN, PAGS_MEAN + 3, planes);
}

void pags_packed_colours(const pags_packed *packed, int64_t cluster, int sh_degree, float *planes) {
  const int rest = 3 * (pags_sh_coefficients(sh_degree) - 1);
  const uint8_t *const block = packed->colour + (size_t)cluster * pags_packed_colour_bytes(packed->shape.sh_degree);
  const uint8_t *const steps = block + pags_packed_steps_at(packed->shape.sh_degree);
  uint16_t words[3][ROWS];
  int8_t bytes[ROWS];
  memcpy(words, block, sizeof words);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < ROWS; i++)
      planes[c * ROWS + i] = half_to_float(words[c][i]);
  for (int p = 0; p < rest; p++) {
    float step;
    memcpy(&step, steps + 4 * p, sizeof step);
    step = fabsf(step) < 2.6e36f ? step : 0.0f; /* larger in a damaged file only */
    memcpy(bytes, block + (6 + p) * ROWS, sizeof bytes);
    for (int i = 0; i < ROWS; i++)
      planes[(3 + p) * ROWS + i] = (float)bytes[i] * step;
  }
  put_whole(packed, cluster, PAGS_SH, PAGS_SH + 3 + rest, planes);
}

float pags_packed_s_sem(const pags_packed *packed, int64_t row) {
  const uint8_t *const block = packed->geometry + row / ROWS * PAGS_PACKED_GEOMETRY;
  return packed->has_s_sem ? (float)block[2 * PAGS_PACKED_WORDS * ROWS + row % ROWS] * (1.0f / 255.0f) : 0.0f;
}
