/* What hides what in a picture of sparse points: a depth buffer of coarse cells. */
#ifndef PAGS_INIT_Z_BUFFER_H
#define PAGS_INIT_Z_BUFFER_H

#include <pags/base.h>

typedef struct pags_occlusion {
  int width, height; /* px of the picture */
  int columns, rows; /* cells of PAGS_OCCLUSION_CELL px */
  double focal;      /* px */
  float *depth;      /* the nearest point that covers the cell's middle, camera z; infinity: none */
  int64_t room;      /* cells allocated */
} pags_occlusion;

enum { PAGS_OCCLUSION_CELL = 2 };

typedef struct pags_seen_point {
  float u, v; /* px */
  float z;    /* camera z, metres; 0: outside of the picture */
} pags_seen_point;

/* Buffers are reused from call to call; a zeroed struct is allowed. The focal length (px) turns metres into pixels. */
pags_result pags_occlusion_reset(pags_occlusion *self, int width, int height, double focal);
void pags_occlusion_destroy(pags_occlusion *self);

/* Lets the points hide what lies behind them. Each covers a rectangle: half the mean spacing of all points to either
 * side (at most 0.5 m), as much as that in metres allows, twice as far down but hardly up: things stand on the ground,
 * so below a point there is more of the same thing, while what lies above a point of the road is road further away. */
void pags_occlusion_add(pags_occlusion *self, const pags_seen_point *points, int64_t count);

/* 1: nothing lies clearly nearer. */
int pags_occlusion_visible(const pags_occlusion *self, const pags_seen_point *point);

#endif
