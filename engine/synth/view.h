/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures of the synthetic street, with the exact depth, semantic class and object of each pixel; its sky; and its
 * LiDAR, by the same ray tracer. Linear RGB. */
#ifndef PAGS_SYNTH_VIEW_H
#define PAGS_SYNTH_VIEW_H

#include <pags/tasks.h>

#include "synth/stage.h"
#include "synth/street.h"

typedef struct pags_street_view {
  pags_camera camera;
  int sensor;   /* the camera of the car whose lens and light the picture has (faults.h); -1: a perfect pinhole */
  uint8_t *rgb; /* 3 bytes a pixel (sRGB): the mean of samples spread over the pixel */
  /* Truth by the ray through the pixel's centre; NULL where only the picture is wanted. */
  float *depth;    /* camera z, metres; 0 for the sky */
  uint8_t *labels; /* PAGS_CLASS_* */
  int32_t *actors; /* index of the labelled object; -1: none */
} pags_street_view;

/* Pixels [x[0], x[1]) of rows [y[0], y[1]). */
typedef struct pags_street_window {
  int x[2], y[2];
} pags_street_window;

/* Draws the part `window` (NULL: all) of all views, with objects where the stage has them. Error: PAGS_CANCELLED. */
pags_result pags_street_draw(const pags_street *street, const pags_stage *stage, pags_street_view *views, int count,
                             const pags_street_window *window, pags_tasks *tasks);

/* Draws the photographs and the truth of the time step `frame` as the car's cameras take them, each line of a rolling
 * shutter at its own time: sets cameras and sensors of the views, one for each camera of the car. Leaves the moving
 * objects of the street and the stage at some time within the exposures. Errors: PAGS_CANCELLED, or the stage's. */
pags_result pags_street_expose(pags_street *street, pags_stage *stage, int frame, pags_street_view *views,
                               pags_tasks *tasks);

/* Sets `color` to the linear colour of the surface point `touch` (whose `distance` is not used), lit by the sun and
 * by all eight sky directions, with textures filtered over `footprint`. Patterns of roads and pavements follow the
 * mesh's own frame instead of the world. Several threads may call this at once. */
void pags_street_shade(const pags_street *street, const pags_stage *stage, const pags_touch *touch,
                       const pags_footprint *footprint, float color[3]);

/* Converts a linear value, clamped to 0..1, to display-referred sRGB. */
float pags_display_srgb(float linear);

/* ---- Sky and sun ---- */

extern const float pags_sun[3];       /* unit vector towards the sun */
extern const float pags_sun_light[3]; /* the factor on the reflectance of a surface that faces the sun */

/* Sets `color` to the sky's colour in a unit direction: gradient, clouds, glow about the sun. */
void pags_sky_color(const float direction[3], uint64_t seed, float color[3]);
/* Sets `color` to what a mirror shows in a unit direction, without tracing a ray: sky above, dark house fronts near
 * the horizon, road below. */
void pags_sky_mirrored(const float direction[3], uint64_t seed, float color[3]);

/* ---- LiDAR ---- */

/* Traces one sweep of the LiDAR with objects where the stage has them. Writes 4 floats a point (x, y, z in the ego
 * frame, metres; intensity 0..1) to `points`, which has room for street->options->lidar_points points, and returns
 * the number of points. */
int64_t pags_sweep_trace(const pags_street *street, const pags_stage *stage, int frame, pags_tasks *tasks,
                         float *points);

#endif
