/* SPDX-License-Identifier: Apache-2.0 */
/* Noise that varies surfaces and clouds. */
#ifndef PAGS_SYNTH_NOISE_H
#define PAGS_SYNTH_NOISE_H

#include <stdint.h>

/* Smooth noise in [0, 1] in a plane. */
float pags_noise2(float x, float y, uint32_t seed);

#endif
