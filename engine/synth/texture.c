/* SPDX-License-Identifier: Apache-2.0 */
/* Checkers, stripes, marble, each under three octaves of value noise. */
#include "synth/texture.h"

#include <math.h>

/* A hash of a lattice point to [0, 1): Murmur3's finaliser over the mixed coordinates. */
static float lattice(int32_t x, int32_t y, int32_t z, uint64_t seed) {
  uint64_t h =
      seed + (uint32_t)x * 0x9e3779b97f4a7c15u + (uint32_t)y * 0xc2b2ae3d27d4eb4fu + (uint32_t)z * 0x165667b19e3779f9u;
  h = (h ^ h >> 33) * 0xff51afd7ed558ccdu;
  h = (h ^ h >> 33) * 0xc4ceb9fe1a85ec53u;
  return (float)(h >> 40) * 0x1p-24f;
}

static float mix(float a, float b, float t) {
  return a + (b - a) * t;
}

float pags_noise(const float p[3], uint64_t seed) {
  int32_t cell[3];
  float t[3], corner[8];
  for (int k = 0; k < 3; k++) {
    const float low = floorf(p[k]), f = p[k] - low;
    cell[k] = (int32_t)low;
    t[k] = f * f * (3.0f - 2.0f * f);
  }
  for (int i = 0; i < 8; i++)
    corner[i] = lattice(cell[0] + (i & 1), cell[1] + (i >> 1 & 1), cell[2] + (i >> 2), seed);
  for (int i = 0; i < 4; i++)
    corner[i] = mix(corner[2 * i], corner[2 * i + 1], t[0]);
  return mix(mix(corner[0], corner[1], t[1]), mix(corner[2], corner[3], t[1]), t[2]);
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

/* Octaves of halving size and weight, in [0, 1]. */
static float layered_noise(const float p[3], float size, int octaves, uint64_t seed) {
  float sum = 0.0f, weight = 1.0f, total = 0.0f;
  for (int i = 0; i < octaves; i++, size *= 0.5f, weight *= 0.5f) {
    const float q[3] = {p[0] / size, p[1] / size, p[2] / size};
    sum += weight * pags_noise(q, seed + (uint64_t)i);
    total += weight;
  }
  return sum / total;
}

/* How much of the second colour. Cells are shifted by 0.37 of their size, so that no face of an object lies on a
 * border, where rounding would choose the colour. */
static float blend(const pags_texture *texture, const float p[3], uint64_t seed) {
  const float s = 1.0f / texture->size;
  const float x = p[0] * s + 0.37f, y = p[1] * s + 0.37f, z = p[2] * s + 0.37f;
  switch (texture->pattern) {
    case PAGS_PATTERN_CHECKER: return ((int)floorf(x) + (int)floorf(y) + (int)floorf(z)) & 1 ? 1.0f : 0.0f;
    case PAGS_PATTERN_STRIPES: {
      const float along = x + y + 0.5f * z;
      return along - floorf(along) < 0.5f ? 1.0f : 0.0f;
    }
    default: return 0.5f + 0.5f * sinf(6.2831853f * (x + 2.0f * layered_noise(p, texture->size, 3, seed + 77)));
  }
}

void pags_texture_at(const pags_texture *texture, const float p[3], uint64_t seed, float color[3]) {
  const float t = blend(texture, p, seed);
  const float light = 1.0f + texture->grain * (2.0f * layered_noise(p, 0.35f, 3, seed) - 1.0f);
  for (int c = 0; c < 3; c++) {
    const float v = mix(texture->color[0][c], texture->color[1][c], t) * light;
    color[c] = v < 0.0f ? 0.0f : v > 1.0f ? 1.0f : v;
  }
}
