/* SPDX-License-Identifier: Apache-2.0 */
/* The sky, the sun, and what glossy things mirror of them. Linear RGB. */
#ifndef PAGS_SYNTH_SKY_H
#define PAGS_SYNTH_SKY_H

#include <stdint.h>

extern const float pags_sun[3];       /* unit vector towards it */
extern const float pags_sun_light[3]; /* on a surface that faces it */

/* Of a unit direction: gradient, clouds, glow about the sun. */
void pags_sky_color(const float direction[3], uint64_t seed, float color[3]);
/* What is mirrored from a direction: sky, dark house fronts near the horizon, road. */
void pags_sky_mirrored(const float direction[3], uint64_t seed, float color[3]);

#endif
