/* SPDX-License-Identifier: Apache-2.0 */
/* A procedural sky: a clear blue gradient, a glow about the sun and fair-weather clouds in a flat layer above. */
#include <math.h>

#include "base/vec3.h"
#include "maths/maths.h"
#include "synth/view.h"

const float pags_sun[3] = {-0.42f, 0.50f, 0.7573639f}; /* behind the car on its left, 49 degrees high */
const float pags_sun_light[3] = {1.42f, 1.30f, 1.10f};

static float mix(float a, float b, float t) {
  return a + (b - a) * t;
}

static float smooth(float lo, float hi, float v) {
  const float t = v <= lo ? 0.0f : v >= hi ? 1.0f : (v - lo) / (hi - lo);
  return t * t * (3.0f - 2.0f * t);
}

/* Cloud cover, 0..1, in the unit direction d: four octaves of value noise on a horizontal plane one unit above. */
static float clouds(const float d[3], uint64_t seed) {
  const float height = d[2] + 0.12f;
  float sum = 0.0f, weight = 0.5f, size = 0.9f;
  for (int i = 0; i < 4; i++, weight *= 0.5f, size *= 0.48f) {
    sum += weight *
           pags_noise2(d[0] / height / size, d[1] / height / size, (uint32_t)seed * 0x9e3779b1u + 101u + (uint32_t)i);
  }
  return smooth(0.44f, 0.68f, sum) * smooth(0.02f, 0.2f, d[2]);
}

void pags_sky_color(const float direction[3], uint64_t seed, float color[3]) {
  static const float zenith[3] = {0.13f, 0.29f, 0.66f}, horizon[3] = {0.62f, 0.72f, 0.84f},
                     cloud[3] = {0.93f, 0.93f, 0.95f};
  const float up = direction[2] > 0.0f ? direction[2] : 0.0f, t = pags_powf(1.0f - up, 3.0f);
  const float cosine = pags_dot3f(direction, pags_sun);
  const float glow = cosine > 0.0f ? 0.5f * pags_powf(cosine, 40.0f) : 0.0f;
  const float share = direction[2] > 0.0f ? 0.85f * clouds(direction, seed) : 0.0f;
  for (int c = 0; c < 3; c++)
    color[c] = mix(mix(zenith[c], horizon[c], t), cloud[c], share) + glow * pags_sun_light[c];
}

void pags_sky_mirrored(const float direction[3], uint64_t seed, float color[3]) {
  static const float ground[3] = {0.13f, 0.13f, 0.13f}, front[3] = {0.20f, 0.18f, 0.16f};
  float sky[3];
  pags_sky_color(direction, seed, sky);
  const float above = smooth(0.15f, 0.45f, direction[2]), below = smooth(-0.05f, 0.05f, direction[2]);
  for (int c = 0; c < 3; c++)
    color[c] = mix(mix(ground[c], front[c], below), sky[c], above);
}
