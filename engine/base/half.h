/* SPDX-License-Identifier: Apache-2.0 */
/* IEEE 754 binary16 from and to float, by bits, so that no instruction set of its own is asked for. */
#ifndef PAGS_BASE_HALF_H
#define PAGS_BASE_HALF_H

#include <stdint.h>
#include <string.h>

/* Exact; infinities and NaNs stay what they are. */
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

/* The nearest, ties to even; from 65520 on infinity; a NaN gives a NaN. */
static inline uint16_t pags_half_from_float(float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  uint32_t sign = bits >> 16 & 0x8000u, magnitude = bits & 0x7FFFFFFFu, half;
  if (magnitude > 0x7F800000u)
    return (uint16_t)(sign | 0x7E00u);
  if (magnitude >= 0x477FF000u) /* 65520 */
    return (uint16_t)(sign | 0x7C00u);
  if (magnitude < 0x33000000u) /* below 2^-25, half the smallest subnormal; the tie at 2^-25 goes to even below */
    return (uint16_t)sign;
  uint32_t dropped = 13, mantissa = magnitude - (127u - 15u) * 0x800000u;
  if (magnitude < 0x38800000u) { /* below 2^-14: subnormal, its unit 2^-24 */
    dropped = 126u - (magnitude >> 23);
    mantissa = (magnitude & 0x7FFFFFu) | 0x800000u;
  }
  uint32_t rest = mantissa & ((1u << dropped) - 1), tie = 1u << (dropped - 1);
  half = mantissa >> dropped;
  half += rest > tie || (rest == tie && (half & 1)); /* a carry into the exponent is what rounding up means */
  return (uint16_t)(sign | half);
}

#endif
