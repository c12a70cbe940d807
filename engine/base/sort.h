/* Numbers in ascending order; none of them may be NaN. */
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

static inline void pags_sort_doubles(double *values, int64_t count) {
  qsort(values, (size_t)count, sizeof *values, pags_compare_doubles);
}

static inline void pags_sort_floats(float *values, int64_t count) {
  qsort(values, (size_t)count, sizeof *values, pags_compare_floats);
}

#endif
