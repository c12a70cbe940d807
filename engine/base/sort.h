/* SPDX-License-Identifier: Apache-2.0 */
/* Sorting: qsort for lists that may be empty, and of numbers in ascending order, none of which may be NaN. */
#ifndef PAGS_BASE_SORT_H
#define PAGS_BASE_SORT_H

#include <stdint.h>
#include <stdlib.h>

static inline int pags_compare_doubles(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static inline int pags_compare_floats(const void *a, const void *b) {
  const float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

/* Sorts as qsort does, which must not be called with NULL even for 0 items; this function may. */
static inline void pags_sort(void *items, int64_t count, size_t size, int (*compare)(const void *, const void *)) {
  if (count > 1)
    qsort(items, (size_t)count, size, compare);
}

static inline void pags_sort_doubles(double *values, int64_t count) {
  pags_sort(values, count, sizeof *values, pags_compare_doubles);
}

static inline void pags_sort_floats(float *values, int64_t count) {
  pags_sort(values, count, sizeof *values, pags_compare_floats);
}

#endif
