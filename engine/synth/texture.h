/* SPDX-License-Identifier: Apache-2.0 */
/* Solid textures: colour as a function of a point in space. Linear RGB, reflectances in [0, 1]. */
#ifndef PAGS_SYNTH_TEXTURE_H
#define PAGS_SYNTH_TEXTURE_H

#include <stdint.h>

typedef enum pags_pattern { PAGS_PATTERN_CHECKER, PAGS_PATTERN_STRIPES, PAGS_PATTERN_MARBLE } pags_pattern;

typedef struct pags_texture {
  pags_pattern pattern;
  float size;        /* of a cell, a pair of stripes or the marble's veins; metres */
  float color[2][3]; /* the pattern's two */
  float grain;       /* smooth noise on top: share of the brightness it moves, 0..1 */
} pags_texture;

/* Smooth noise in [0, 1]: random values at whole numbers, blended by smooth steps. */
float pags_noise(const float p[3], uint64_t seed);
/* The same in a plane, of other random values. */
float pags_noise2(float x, float y, uint32_t seed);

/* The colour at `p`, metres. */
void pags_texture_at(const pags_texture *texture, const float p[3], uint64_t seed, float color[3]);

#endif
