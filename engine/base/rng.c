/* SPDX-License-Identifier: Apache-2.0 */
/* The counter-based random number generator Philox4x32-10, with the constants of Salmon et al. 2011, table 2, and
 * uniform, normal and bounded integer numbers and permutations from it. */
#include "base/rng.h"

#include <math.h>

#include "maths/maths.h"

/* Returns the high 32 bits of a * b; *low receives the low ones. */
static uint32_t multiply_high_low(uint32_t a, uint32_t b, uint32_t *low) {
  uint64_t product = (uint64_t)a * b;
  *low = (uint32_t)product;
  return (uint32_t)(product >> 32);
}

void pags_rng_u32x4(uint64_t seed, uint64_t a, uint64_t b, uint32_t out[4]) {
  uint32_t k0 = (uint32_t)seed, k1 = (uint32_t)(seed >> 32);
  uint32_t c0 = (uint32_t)a, c1 = (uint32_t)(a >> 32), c2 = (uint32_t)b, c3 = (uint32_t)(b >> 32);
  for (int round = 0; round < 10; round++) {
    uint32_t low0, low1;
    uint32_t high0 = multiply_high_low(0xD2511F53u, c0, &low0);
    uint32_t high1 = multiply_high_low(0xCD9E8D57u, c2, &low1);
    c0 = high1 ^ c1 ^ k0;
    c1 = low1;
    c2 = high0 ^ c3 ^ k1;
    c3 = low0;
    k0 += 0x9E3779B9u; /* golden ratio */
    k1 += 0xBB67AE85u; /* sqrt(3) - 1 */
  }
  out[0] = c0;
  out[1] = c1;
  out[2] = c2;
  out[3] = c3;
}

/* Returns the top 53 of the 64 bits as a number in [0, 1). */
static double unit_from_words(uint32_t high, uint32_t low) {
  uint64_t bits = ((uint64_t)high << 32 | low) >> 11;
  return (double)bits * 0x1p-53;
}

void pags_rng_uniform2(uint64_t seed, uint64_t a, uint64_t b, double out[2]) {
  uint32_t words[4];
  pags_rng_u32x4(seed, a, b, words);
  out[0] = unit_from_words(words[0], words[1]);
  out[1] = unit_from_words(words[2], words[3]);
}

double pags_rng_uniform(uint64_t seed, uint64_t a, uint64_t b) {
  double pair[2];
  pags_rng_uniform2(seed, a, b, pair);
  return pair[0];
}

void pags_rng_normal2(uint64_t seed, uint64_t a, uint64_t b, double out[2]) {
  double pair[2];
  pags_rng_uniform2(seed, a, b, pair);
  /* 1 - pair[0] is in (0, 1], so that its logarithm is finite. */
  double radius = sqrt(-2.0 * pags_log(1.0 - pair[0]));
  double angle = 6.283185307179586477 * pair[1];
  out[0] = radius * pags_cos(angle);
  out[1] = radius * pags_sin(angle);
}

uint64_t pags_rng_below(uint64_t seed, uint64_t a, uint64_t b, uint64_t n) {
  uint32_t words[4];
  pags_rng_u32x4(seed, a, b, words);
  /* The high 64 bits of the 128-bit product of 64 random bits and n, computed from 32-bit halves. */
  uint64_t x1 = words[0], x0 = words[1], n1 = n >> 32, n0 = (uint32_t)n;
  uint64_t middle = x1 * n0 + (x0 * n0 >> 32);
  uint64_t middle_low = (middle & 0xFFFFFFFFu) + x0 * n1;
  return x1 * n1 + (middle >> 32) + (middle_low >> 32);
}

void pags_rng_permutation(uint64_t seed, uint64_t a, int64_t *index, int64_t count) {
  for (int64_t i = 0; i < count; i++)
    index[i] = i;
  for (int64_t i = count - 1; i > 0; i--) {
    int64_t j = (int64_t)pags_rng_below(seed, a, (uint64_t)i, (uint64_t)i + 1);
    int64_t swapped = index[i];
    index[i] = index[j];
    index[j] = swapped;
  }
}
