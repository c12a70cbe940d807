/* SPDX-License-Identifier: Apache-2.0 */
/* What stands in the courtyard. Everything is a box turned about the vertical, or a ball. */
#ifndef PAGS_SYNTH_ROOM_H
#define PAGS_SYNTH_ROOM_H

#include <pags/camera.h>

#include "synth/texture.h"

typedef struct pags_box {
  float center[3], half[3]; /* metres */
  float yaw;                /* radians, about +z */
  pags_texture texture;     /* in the box's own frame */
} pags_box;

typedef struct pags_ball {
  float center[3], radius; /* metres */
  pags_texture texture;
} pags_ball;

typedef struct pags_room {
  int box_count, ball_count;
  const pags_box *boxes;
  const pags_ball *balls;
  float sun[3];       /* unit vector towards it */
  float sun_light[3]; /* linear, on a surface that faces it */
  float sky_light[3]; /* linear, on one that faces up; half of it on a vertical one */
} pags_room;

const pags_room *pags_room_get(void);

/* World point to the box's frame. */
void pags_box_local(const pags_box *box, const float world[3], float local[3]);
/* Corner `index` (bit k: the upper end of axis k) in the world. */
void pags_box_corner(const pags_box *box, int index, float world[3]);

/* The camera of view `index` of `views`. */
pags_camera pags_room_camera(int index, int views, int width, int height);

#endif
