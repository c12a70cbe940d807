/* SPDX-License-Identifier: Apache-2.0 */
/* Value noise: hashed random values at integer positions, interpolated by the smoothstep 3 t^2 - 2 t^3. */
#include "synth/noise.h"

#include <math.h>

static float mix(float a, float b, float t) {
  return a + (b - a) * t;
}

static float lattice2(int32_t x, int32_t y, uint32_t seed) {
  uint32_t h = seed + (uint32_t)x * 0x9e3779b1u + (uint32_t)y * 0x85ebca77u;
  h = (h ^ h >> 15) * 0x2c1b3c6du;
  h = (h ^ h >> 12) * 0x297a2d39u;
  return (float)((h ^ h >> 15) >> 8) * 0x1p-24f;
}

float pags_noise2(float x, float y, uint32_t seed) {
  const float lowx = floorf(x), lowy = floorf(y), fx = x - lowx, fy = y - lowy;
  const int32_t i = (int32_t)lowx, j = (int32_t)lowy;
  const float u = fx * fx * (3.0f - 2.0f * fx), v = fy * fy * (3.0f - 2.0f * fy);
  return mix(mix(lattice2(i, j, seed), lattice2(i + 1, j, seed), u),
             mix(lattice2(i, j + 1, seed), lattice2(i + 1, j + 1, seed), u), v);
}
