/* SPDX-License-Identifier: Apache-2.0 */
/* The origin of positions that are too large for floats (large.h). */
#include "scene/large.h"

#include <math.h>

#include "base/sort.h"
#include "maths/maths.h"

double pags_large_origin(double *values, int count) {
  int finite = 0;
  for (int i = 0; i < count; i++)
    if (isfinite(values[i]))
      values[finite++] = values[i];
  if (finite == 0)
    return 0;
  pags_sort_doubles(values, finite);
  const double middle = values[finite / 2];
  return fabs(middle) > PAGS_LARGE_COORDINATE ? pags_round(middle) : 0;
}

void pags_large_put_back(pags_gaussians *g, const double origin[3]) {
  for (int k = 0; k < 3; k++)
    for (int64_t i = 0; origin[k] != 0 && i < g->count; i++)
      pags_plane(g, PAGS_MEAN + k)[i] = (float)((double)pags_plane(g, PAGS_MEAN + k)[i] + origin[k]);
}
