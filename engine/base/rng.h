/* SPDX-License-Identifier: Apache-2.0 */
/* Random numbers without state: Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC
 * 2011), a bijection of a 128-bit counter under a 64-bit key. A number depends on (seed, a, b) alone, so that neither
 * the number of threads nor a resumed run changes it. Usually a is the step or the purpose of the number, b the row.
 *
 * Each pair (a, b) gives one draw: two draws for the same row need different a (say, 16 * step + purpose). */
#ifndef PAGS_BASE_RNG_H
#define PAGS_BASE_RNG_H

#include <pags/base.h>

/* Computes 128 random bits. The key is the seed, low word first; the counter is a low, a high, b low, b high. */
void pags_rng_u32x4(uint64_t seed, uint64_t a, uint64_t b, uint32_t out[4]);
/* Returns a uniform number in [0, 1), a multiple of 2^-53. */
double pags_rng_uniform(uint64_t seed, uint64_t a, uint64_t b);
void pags_rng_uniform2(uint64_t seed, uint64_t a, uint64_t b, double out[2]); /* out[0] is pags_rng_uniform's */
/* Computes two independent standard normal numbers (Box and Muller 1958, in double, with libm's functions). */
void pags_rng_normal2(uint64_t seed, uint64_t a, uint64_t b, double out[2]);
/* Returns an integer in [0, n), n > 0. Probabilities are biased by less than n / 2^64, relatively. */
uint64_t pags_rng_below(uint64_t seed, uint64_t a, uint64_t b, uint64_t n);
/* Fills `index` with a random permutation of 0 .. count - 1 (Fisher-Yates shuffle). Uses the draws (seed, a, b),
 * b from 1 to count - 1. */
void pags_rng_permutation(uint64_t seed, uint64_t a, int64_t *index, int64_t count);

#endif
