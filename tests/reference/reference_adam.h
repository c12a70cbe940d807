/* SPDX-License-Identifier: Apache-2.0 */
/* Dense Adam in double precision, as in torch.optim.Adam without weight decay (Kingma and Ba 2015): the oracle for an
 * optimiser that defers the updates of rows that no view sees.
 *
 * Every step updates every row, also rows with a zero gradient (their moments decay and still move them). One step
 * counter serves all rows, also those appended later, whose moments start at zero. */
#ifndef PAGS_TESTS_REFERENCE_ADAM_H
#define PAGS_TESTS_REFERENCE_ADAM_H

#include <stdint.h>

typedef struct reference_adam {
  int planes;
  int64_t count;
  int64_t step; /* number of steps done */
  double beta1, beta2, epsilon;
  double *value, *first, *second; /* plane p of row i at [i * planes + p] */
} reference_adam;

/* betas 0.9 and 0.999, epsilon 1e-15 as in 3DGS; no rows yet. */
reference_adam reference_adam_create(int planes);
void reference_adam_destroy(reference_adam *adam);

/* Appends rows with zero moments. `value` is laid out like adam->value. */
void reference_adam_append(reference_adam *adam, const double *value, int64_t count);
/* Removes the rows whose `keep` is zero; the others keep their order and moments. */
void reference_adam_remove(reference_adam *adam, const uint8_t *keep);
/* Row i becomes the old row from[i] with its moments; `from` may be any selection of `count` rows. */
void reference_adam_gather(reference_adam *adam, const int64_t *from, int64_t count);
/* Zeroes both moments of one plane, as the opacity reset of 3DGS does. */
void reference_adam_forget(reference_adam *adam, int plane);

/* One step: m = b1 m + (1-b1) g, v = b2 v + (1-b2) g^2,
 * value -= rate[plane] * m / (1 - b1^t) / (sqrt(v / (1 - b2^t)) + epsilon). `gradient` is laid out like adam->value. */
void reference_adam_step(reference_adam *adam, const double *gradient, const double *rate);

#endif
