/* SPDX-License-Identifier: Apache-2.0 */
/* Dense Adam in double precision; see reference_adam.h. */
#include "reference/reference_adam.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/reference.h"

reference_adam reference_adam_create(int planes) {
  return (reference_adam){.planes = planes, .beta1 = 0.9, .beta2 = 0.999, .epsilon = 1e-15};
}

void reference_adam_destroy(reference_adam *adam) {
  free(adam->value);
  free(adam->first);
  free(adam->second);
  *adam = (reference_adam){0};
}

/* Replaces an array by its rows from[0..count); a negative index makes a new row of zeros. */
static void gather_rows(double **array, int planes, const int64_t *from, int64_t count) {
  double *gathered = reference_alloc(count * planes, sizeof(double));
  for (int64_t i = 0; i < count; i++) {
    if (from[i] >= 0)
      memcpy(&gathered[i * planes], &(*array)[from[i] * planes], (size_t)planes * sizeof(double));
  }
  free(*array);
  *array = gathered;
}

void reference_adam_gather(reference_adam *adam, const int64_t *from, int64_t count) {
  gather_rows(&adam->value, adam->planes, from, count);
  gather_rows(&adam->first, adam->planes, from, count);
  gather_rows(&adam->second, adam->planes, from, count);
  adam->count = count;
}

void reference_adam_append(reference_adam *adam, const double *value, int64_t count) {
  int64_t old = adam->count;
  int64_t *from = reference_alloc(old + count, sizeof *from);
  for (int64_t i = 0; i < old + count; i++)
    from[i] = i < old ? i : -1;
  reference_adam_gather(adam, from, old + count);
  if (count > 0)
    memcpy(&adam->value[old * adam->planes], value, (size_t)(count * adam->planes) * sizeof(double));
  free(from);
}

void reference_adam_remove(reference_adam *adam, const uint8_t *keep) {
  int64_t *from = reference_alloc(adam->count, sizeof *from), kept = 0;
  for (int64_t i = 0; i < adam->count; i++) {
    if (keep[i])
      from[kept++] = i;
  }
  reference_adam_gather(adam, from, kept);
  free(from);
}

void reference_adam_forget(reference_adam *adam, int plane) {
  for (int64_t i = 0; i < adam->count; i++)
    adam->first[i * adam->planes + plane] = adam->second[i * adam->planes + plane] = 0;
}

void reference_adam_step(reference_adam *adam, const double *gradient, const double *rate) {
  adam->step++;
  double correction1 = 1 - pow(adam->beta1, (double)adam->step);
  double correction2 = 1 - pow(adam->beta2, (double)adam->step);
  for (int64_t k = 0; k < adam->count * adam->planes; k++) {
    double g = gradient[k];
    adam->first[k] = adam->beta1 * adam->first[k] + (1 - adam->beta1) * g;
    adam->second[k] = adam->beta2 * adam->second[k] + (1 - adam->beta2) * g * g;
    double denominator = sqrt(adam->second[k] / correction2) + adam->epsilon;
    adam->value[k] -= rate[k % adam->planes] * (adam->first[k] / correction1) / denominator;
  }
}
