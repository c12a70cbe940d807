/* SPDX-License-Identifier: Apache-2.0 */
/* Occlusion between sparse LiDAR points in a picture, by a z-buffer of coarse cells. */
#ifndef PAGS_INIT_Z_BUFFER_H
#define PAGS_INIT_Z_BUFFER_H

#include <stdbool.h>

#include <pags/base.h>

typedef struct pags_z_buffer {
  int width, height; /* px of the picture */
  int columns, rows; /* cells of PAGS_OCCLUSION_CELL px */
  double focal;      /* focal length, px */
  float *depth;      /* camera z of the nearest point that covers the cell, metres; infinity: none */
  int64_t room;      /* cells allocated */
} pags_z_buffer;

enum { PAGS_OCCLUSION_CELL = 2 }; /* side of a cell, px */

typedef struct pags_seen_point {
  float u, v; /* px */
  float z;    /* camera z, metres, or the distance from a camera with a lens; 0: outside of the picture */
} pags_seen_point;

/* Sets the size and empties all cells. Memory is reused from call to call; `buffer` may be a zeroed struct. The focal
 * length (px) converts metres at a depth to pixels. */
pags_result pags_z_buffer_reset(pags_z_buffer *buffer, int width, int height, double focal);
void pags_z_buffer_destroy(pags_z_buffer *buffer);

/* Draws the points, so that they hide what lies behind them. Each covers a rectangle about its pixel: to either side
 * half the mean spacing of the points in the picture, but at least 0.08 m and at most 0.5 m or 16 px; twice as far
 * down, and a quarter as far up. The reason is that things stand on the ground: below a point there is more of the
 * same thing, while above a point of the road there is road further away. */
void pags_z_buffer_add(pags_z_buffer *buffer, const pags_seen_point *points, int64_t count);

/* Returns 1 if no drawn point is clearly nearer to the camera at this pixel, so that the point is visible. */
bool pags_z_buffer_visible(const pags_z_buffer *buffer, const pags_seen_point *point);

#endif
