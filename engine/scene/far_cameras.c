/* SPDX-License-Identifier: Apache-2.0 */
/* Finds cameras far from all others (survey.h). */
#include "scene/survey.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"

pags_result pags_far_cameras_find(const double *positions, int64_t count, double size, bool *far,
                                  pags_far_cameras *out) {
  enum { LEAST_CAMERAS = 4, MOST_SHARE = 8 };
  static const double ratio = 20;
  *out = (pags_far_cameras){0};
  for (int64_t i = 0; i < count; i++)
    far[i] = false;
  if (count < LEAST_CAMERAS)
    return PAGS_OK;
  PAGS_AUTOFREE double *sorted = malloc(2 * (size_t)count * sizeof *sorted);
  PAGS_CHECK_MEMORY(sorted, "%lld cameras", (long long)count);
  double *const distances = sorted + count;
  for (int k = 0; k < 3; k++) {
    for (int64_t i = 0; i < count; i++)
      sorted[i] = positions[3 * i + k];
    pags_sort_doubles(sorted, count);
    out->middle[k] = sorted[count / 2];
  }
  for (int64_t i = 0; i < count; i++)
    sorted[i] = distances[i] = pags_distance3(positions + 3 * i, out->middle);
  pags_sort_doubles(sorted, count);
  out->near = sorted[3 * count / 4];
  for (int64_t i = 0; i < count; i++)
    out->count += far[i] = distances[i] > ratio * fmax(out->near, size);
  if (out->count > (count < MOST_SHARE ? 1 : count / MOST_SHARE)) {
    out->count = 0;
    memset(far, 0, (size_t)count * sizeof *far);
  }
  return PAGS_OK;
}
