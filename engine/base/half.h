/* SPDX-License-Identifier: Apache-2.0 */
/* Converts between float and IEEE 754 binary16 (half) by integer operations on the bits, so that no half-precision
 * instructions are needed. */
#ifndef PAGS_BASE_HALF_H
#define PAGS_BASE_HALF_H

#include <stdint.h>
#include <string.h>

/* Converts a half to a float. Exact; infinities stay infinities, NaNs stay NaNs. */
static inline float pags_float_from_half(uint16_t half) {
  uint32_t sign = (uint32_t)(half & 0x8000) << 16, magnitude = half & 0x7FFFu;
  float value;
  if (magnitude < 0x0400) { /* zero and subnormal: a multiple of 2^-24 */
    value = (float)magnitude * 0x1p-24f;
    return sign ? -value : value;
  }
  uint32_t bits = sign | (magnitude >= 0x7C00 ? (magnitude << 13) + (255u - 31u) * 0x800000u
                                              : (magnitude << 13) + (127u - 15u) * 0x800000u);
  memcpy(&value, &bits, sizeof value);
  return value;
}

/* Rounds a float to the nearest half, ties to even. Magnitudes from 65520 on become infinity; a NaN gives a NaN. */
static inline uint16_t pags_half_from_float(float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  uint32_t sign = bits >> 16 & 0x8000u, magnitude = bits & 0x7FFFFFFFu, half;
  if (magnitude > 0x7F800000u)
    return (uint16_t)(sign | 0x7E00u);
  if (magnitude >= 0x477FF000u) /* 65520 */
    return (uint16_t)(sign | 0x7C00u);
  if (magnitude < 0x33000000u) /* below 2^-25, half of the smallest subnormal: 0 */
    return (uint16_t)sign;
  uint32_t dropped = 13, mantissa = magnitude - (127u - 15u) * 0x800000u;
  if (magnitude < 0x38800000u) { /* below 2^-14: a subnormal half, a multiple of 2^-24 */
    dropped = 126u - (magnitude >> 23);
    mantissa = (magnitude & 0x7FFFFFu) | 0x800000u;
  }
  uint32_t rest = mantissa & ((1u << dropped) - 1), tie = 1u << (dropped - 1);
  half = mantissa >> dropped;
  half += rest > tie || (rest == tie && (half & 1)); /* a carry into the exponent gives the right result, too */
  return (uint16_t)(sign | half);
}

#endif
