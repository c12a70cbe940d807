/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures and depths of a room. */
#ifndef PAGS_SYNTH_RENDER_H
#define PAGS_SYNTH_RENDER_H

#include <pags/image.h>
#include <pags/tasks.h>

#include "synth/tracer.h"

/* Direction in the world of the ray through pixel position (x, y), with a camera z of 1. */
void pags_camera_ray(const pags_camera *camera, double x, double y, float direction[3]);

/* Linear colour of what a ray meets; returns its camera z along pags_camera_ray, 0 for the sky. */
float pags_render_ray(const pags_tracer *tracer, const pags_room *room, const float origin[3], const float direction[3],
                      uint64_t seed, float color[3]);

/* Display-referred sRGB of a linear value, rounded to a byte. */
uint8_t pags_encode_srgb(float linear);

/* `image`: U8, 3 channels, of the camera's size. The mean of `samples` rays a pixel, linear. `depth` (may be NULL):
 * width * height camera z at pixel centres. PAGS_CANCELLED. */
pags_result pags_render_view(const pags_tracer *tracer, const pags_room *room, const pags_camera *camera, int samples,
                             uint64_t seed, pags_tasks *tasks, pags_image *image, float *depth);

#endif
