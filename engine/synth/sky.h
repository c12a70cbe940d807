/* SPDX-License-Identifier: Apache-2.0 */
/* The sky and the sun of the synthetic scenes, and the surroundings that glossy surfaces mirror. Linear RGB. */
#ifndef PAGS_SYNTH_SKY_H
#define PAGS_SYNTH_SKY_H

#include <stdint.h>

extern const float pags_sun[3];       /* unit vector towards the sun */
extern const float pags_sun_light[3]; /* the factor on the reflectance of a surface that faces the sun */

/* Sets `color` to the sky's colour in a unit direction: gradient, clouds, glow about the sun. */
void pags_sky_color(const float direction[3], uint64_t seed, float color[3]);
/* Sets `color` to what a mirror shows in a unit direction, without tracing a ray: sky above, dark house fronts near
 * the horizon, road below. */
void pags_sky_mirrored(const float direction[3], uint64_t seed, float color[3]);

#endif
