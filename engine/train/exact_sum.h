/* SPDX-License-Identifier: Apache-2.0 */
/* Sums of six numbers that are the same bits in any order, and for any share of the numbers that each rank adds: every
 * number is rounded to a multiple of 2^-53 once, and these multiples are added as whole numbers, in two halves, as in
 * reproducible summation with fixed bins (Demmel and Nguyen 2015). Up to 2^26 numbers below 2^20 can be added. */
#ifndef PAGS_TRAIN_EXACT_SUM_H
#define PAGS_TRAIN_EXACT_SUM_H

#include <math.h>
#include <stdint.h>

typedef struct pags_exact_sum {
  int64_t coarse[6], fine[6]; /* multiples of 2^-16 and of 2^-53 */
  int64_t left_out;           /* sixes with a number that isn't finite or not below 2^20 */
} pags_exact_sum;

static inline void pags_exact_sum_add(pags_exact_sum *sum, const double six[6]) {
  for (int k = 0; k < 6; k++)
    if (!(fabs(six[k]) < 0x1p20)) {
      sum->left_out++;
      return;
    }
  for (int k = 0; k < 6; k++) {
    const double coarse = rint(six[k] * 0x1p16);
    sum->coarse[k] += (int64_t)coarse;
    sum->fine[k] += (int64_t)rint((six[k] - coarse * 0x1p-16) * 0x1p53);
  }
}

/* Adds another's sum. */
static inline void pags_exact_sum_join(pags_exact_sum *sum, const pags_exact_sum *other) {
  for (int k = 0; k < 6; k++) {
    sum->coarse[k] += other->coarse[k];
    sum->fine[k] += other->fine[k];
  }
  sum->left_out += other->left_out;
}

/* All six are NaN if a number was left out. */
static inline void pags_exact_sum_value(const pags_exact_sum *sum, double out[6]) {
  for (int k = 0; k < 6; k++)
    out[k] = sum->left_out ? (double)NAN : (double)sum->coarse[k] * 0x1p-16 + (double)sum->fine[k] * 0x1p-53;
}

#endif
