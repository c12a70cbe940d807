/* SPDX-License-Identifier: Apache-2.0 */
/* Noise for the procedural textures of surfaces and clouds. */
#ifndef PAGS_SYNTH_NOISE_H
#define PAGS_SYNTH_NOISE_H

#include <stdint.h>

/* Smooth value noise in [0, 1] at (x, y), with cells of side 1. */
float pags_noise2(float x, float y, uint32_t seed);

#endif
