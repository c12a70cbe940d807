/* SPDX-License-Identifier: Apache-2.0 */
/* A colour map for semantic priorities, 0..1: piecewise linear from dark violet (0) over red to pale yellow (1). */
#include <pags/compose.h>

void pags_colormap_heat(float value, float rgb[3]) {
  static const float stops[5][3] = {{0.05f, 0.03f, 0.20f},
                                    {0.42f, 0.06f, 0.43f},
                                    {0.83f, 0.21f, 0.30f},
                                    {0.98f, 0.58f, 0.15f},
                                    {0.99f, 0.97f, 0.65f}};
  float at = value > 0 ? (value < 1 ? 4 * value : 4) : 0; /* 0..4, clamped; NaN becomes 0 */
  int first = at < 3 ? (int)at : 3;
  for (int c = 0; c < 3; c++)
    rgb[c] = stops[first][c] + (at - (float)first) * (stops[first + 1][c] - stops[first][c]);
}
