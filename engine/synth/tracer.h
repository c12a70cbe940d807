/* SPDX-License-Identifier: Apache-2.0 */
/* Rays against a room, by Embree 3 or 4. */
#ifndef PAGS_SYNTH_TRACER_H
#define PAGS_SYNTH_TRACER_H

#include <stdbool.h>

#include <pags/base.h>

#include "synth/room.h"

typedef struct pags_tracer pags_tracer;

/* `room` must outlive it. Rays may be traced by several threads at once. */
pags_result pags_tracer_create(const pags_room *room, pags_tracer **out);
void pags_tracer_destroy(pags_tracer *tracer);

typedef struct pags_hit {
  float distance; /* in lengths of the direction */
  float point[3];
  float normal[3]; /* unit, towards the ray's origin */
  const pags_texture *texture;
  float local[3]; /* where to look the texture up */
} pags_hit;

bool pags_tracer_hit(const pags_tracer *tracer, const float origin[3], const float direction[3], pags_hit *hit);
/* Whether anything lies on the ray beyond 0.1 mm. */
bool pags_tracer_blocked(const pags_tracer *tracer, const float origin[3], const float direction[3]);

#endif
