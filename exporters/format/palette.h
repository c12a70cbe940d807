/* SPDX-License-Identifier: Apache-2.0 */
/* Palettes: few values that approximate many, in one dimension and in several. */
#ifndef PAGS_FORMAT_PALETTE_H
#define PAGS_FORMAT_PALETTE_H

#include <pags/base.h>

enum { PAGS_CODEBOOK = 256 };

/* Values between which 256 are to be chosen, with the sum of their weights in each of `bins` equal steps. */
typedef struct pags_codebook {
  double lo, hi;
  double *weight, *sum;        /* of the values in a bin */
  float values[PAGS_CODEBOOK]; /* ascending; filled in by pags_codebook_choose */
} pags_codebook;

/* Prepares a codebook for values of lo to hi; destroy frees it. PAGS_ERROR_MEMORY. */
pags_result pags_codebook_create(pags_codebook *book, double lo, double hi);
void pags_codebook_destroy(pags_codebook *book);
void pags_codebook_add(pags_codebook *book, double value, double weight);
/* Chooses the 256 values with the least weighted squares of the errors (optimal but for the width of a bin).
 * PAGS_ERROR_MEMORY. */
pags_result pags_codebook_choose(pags_codebook *book);
/* The index of the nearest value. */
uint8_t pags_codebook_index(const pags_codebook *book, double value);

/* Finds at most `most` vectors that approximate `count` rows of `width` numbers: the rows are cut in two at their
 * mean along their principal axis, again and again where the squares of the errors are largest. `entries` receives the
 * vectors, `most` * `width` numbers, *found how many; labels[i] is that of row i. PAGS_ERROR_MEMORY. */
pags_result pags_palette_make(const float *rows, int64_t count, int width, int64_t most, float *entries,
                              int32_t *labels, int64_t *found);

#endif
