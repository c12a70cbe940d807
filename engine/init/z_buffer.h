/* SPDX-License-Identifier: Apache-2.0 */
/* What hides what in a picture of sparse points: a depth buffer of coarse cells. */
#ifndef PAGS_INIT_Z_BUFFER_H
#define PAGS_INIT_Z_BUFFER_H

#include <pags/base.h>

typedef struct pags_z_buffer {
  int width, height; /* px of the picture */
  int columns, rows; /* cells of PAGS_OCCLUSION_CELL px */
  double focal;      /* px */
  float *depth;      /* the nearest point that covers the cell's middle, camera z; infinity: none */
  int64_t room;      /* cells allocated */
} pags_z_buffer;

enum { PAGS_OCCLUSION_CELL = 2 };

typedef struct pags_seen_point {
  float u, v; /* px */
  float z;    /* camera z, metres; 0: outside of the picture */
} pags_seen_point;

/* Buffers are reused from call to call; a zeroed struct is allowed. The focal length (px) turns metres into pixels. */
pags_result pags_z_buffer_reset(pags_z_buffer *self, int width, int height, double focal);
void pags_z_buffer_destroy(pags_z_buffer *self);

/* Lets the points hide what lies behind them. Each covers a rectangle: half the mean spacing of all points to either
 * side (at most 0.5 m), as much as that in metres allows, twice as far down but hardly up: things stand on the ground,
 * so below a point there is more of the same thing, while what lies above a point of the road is road further away. */
void pags_z_buffer_add(pags_z_buffer *self, const pags_seen_point *points, int64_t count);

/* 1: nothing lies clearly nearer. */
int pags_z_buffer_visible(const pags_z_buffer *self, const pags_seen_point *point);

#endif
