/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle's sky: the definition in pags/sky.h, evaluated in double. */
#include "reference/reference.h"

#include <math.h>

reference_sky_taps reference_sky_look(const pags_sky *sky, const pags_camera *camera, int x, int y) {
  double ray[3] = {(x + 0.5 - camera->cx) / camera->fx, (y + 0.5 - camera->cy) / camera->fy, 1};
  if (reference_has_lens(camera) && !reference_lens_ray(camera, x + 0.5, y + 0.5, ray))
    ray[0] = ray[1] = 0, ray[2] = 1;
  double d[3], length[3];
  for (int k = 0; k < 3; k++) {
    d[k] = 0;
    for (int j = 0; j < 3; j++)
      d[k] += camera->world_from_camera[4 * k + j] * ray[j];
    length[k] = fabs(d[k]);
  }
  const int axis = length[0] >= length[1] && length[0] >= length[2] ? 0 : length[1] >= length[2] ? 1 : 2;
  const int face = 2 * axis + (d[axis] < 0), n = sky->size;
  const double s[6] = {-d[2], d[2], d[0], d[0], d[0], -d[0]}, t[6] = {-d[1], -d[1], d[2], -d[2], -d[1], -d[1]};
  reference_sky_taps taps;
  taps.margin = 1 - fmax(length[(axis + 1) % 3], length[(axis + 2) % 3]) / length[axis];
  double at[2] = {(s[face] / length[axis] + 1) / 2 * n - 0.5, (t[face] / length[axis] + 1) / 2 * n - 0.5};
  int64_t first[2], second[2];
  for (int k = 0; k < 2; k++) {
    at[k] = fmin(fmax(at[k], 0), n - 1);
    first[k] = (int64_t)at[k];
    second[k] = first[k] + 1 < n ? first[k] + 1 : first[k];
    at[k] -= (double)first[k];
  }
  for (int k = 0; k < 4; k++) {
    const int64_t column = k & 1 ? second[0] : first[0], row = k & 2 ? second[1] : first[1];
    taps.texel[k] = ((int64_t)face * n + row) * n + column;
    taps.weight[k] = (k & 1 ? at[0] : 1 - at[0]) * (k & 2 ? at[1] : 1 - at[1]);
  }
  return taps;
}

void reference_sky_colour(const pags_sky *sky, const reference_sky_taps *taps, double rgb[3]) {
  for (int channel = 0; channel < 3; channel++) {
    rgb[channel] = 0;
    for (int k = 0; k < 4; k++)
      rgb[channel] += taps->weight[k] * (double)sky->texels[3 * taps->texel[k] + channel];
  }
}
