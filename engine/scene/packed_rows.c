/* SPDX-License-Identifier: Apache-2.0 */
/* Unpacks one cluster of packed Gaussians into planes of floats. Plain loops over arrays, which the compiler
 * vectorises; it must not fuse products and sums (-ffp-contract=off), so that every machine gives the same bits. */
#include "scene/packed_rows.h"

#include <math.h>
#include <string.h>

#include "scene/packed_whole.h"

enum { ROWS = PAGS_PACKED_ROWS };

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
  const pags_packed_mixed *const mixed = packed->mixed_count ? pags_packed_find_mixed(packed, cluster, &unused) : NULL;
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
  if (packed->mixed_count)
    pags_packed_put_whole(packed, cluster, PAGS_MEAN, PAGS_SH, planes);
}

void pags_packed_means(const pags_packed *packed, int64_t cluster, float *planes) {
  uint16_t words[3][ROWS];
  memcpy(words, packed->geometry + cluster * PAGS_PACKED_GEOMETRY, sizeof words);
  unpack_means((const uint16_t(*)[ROWS])words, packed, cluster, planes);
  if (packed->mixed_count)
    pags_packed_put_whole(packed, cluster, PAGS_MEAN, PAGS_MEAN + 3, planes);
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
  if (packed->mixed_count)
    pags_packed_put_whole(packed, cluster, PAGS_SH, PAGS_SH + 3 + rest, planes);
}

float pags_packed_s_sem(const pags_packed *packed, int64_t row) {
  const uint8_t *const block = packed->geometry + row / ROWS * PAGS_PACKED_GEOMETRY;
  return packed->has_s_sem ? (float)block[2 * PAGS_PACKED_WORDS * ROWS + row % ROWS] * (1.0f / 255.0f) : 0.0f;
}
