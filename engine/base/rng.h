/* SPDX-License-Identifier: Apache-2.0 */
/* Random numbers without state: Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011),
 * a bijection of a 128-bit counter under a 64-bit key. The numbers depend on (seed, a, b) alone, so that neither thread
 * count nor resuming changes any: take a = the step or the purpose, b = the row.
 *
 * A pair (a, b) gives one draw: two draws for one row need two values of a (say, 16 * step + purpose). */
#ifndef PAGS_BASE_RNG_H
#define PAGS_BASE_RNG_H

#include <pags/base.h>

#ifdef __cplusplus
extern "C" {
#endif

/* key = seed (low word first); counter = a low, a high, b low, b high. */
void pags_rng_u32x4(uint64_t seed, uint64_t a, uint64_t b, uint32_t out[4]);
/* In [0, 1), a multiple of 2^-53. */
double pags_rng_uniform(uint64_t seed, uint64_t a, uint64_t b);
void pags_rng_uniform2(uint64_t seed, uint64_t a, uint64_t b, double out[2]); /* out[0] is pags_rng_uniform's */
/* Two independent normal deviates (Box-Muller in double, libm's log, sin and cos). */
void pags_rng_normal2(uint64_t seed, uint64_t a, uint64_t b, double out[2]);
/* In [0, n), n > 0. The bias is below n / 2^64. */
uint64_t pags_rng_below(uint64_t seed, uint64_t a, uint64_t b, uint64_t n);
/* Puts 0 .. count - 1 in random order into `index` (Fisher-Yates; draws (seed, a, 0 .. count - 1)). */
void pags_rng_permutation(uint64_t seed, uint64_t a, int64_t *index, int64_t count);

#ifdef __cplusplus
}
#endif
#endif
