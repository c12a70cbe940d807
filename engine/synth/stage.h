/* SPDX-License-Identifier: Apache-2.0 */
/* Traces rays, eight at a time, against meshes placed in the world, by Embree 3 or 4. */
#ifndef PAGS_SYNTH_STAGE_H
#define PAGS_SYNTH_STAGE_H

#include <pags/base.h>

#include "base/memory.h"
#include "synth/mesh.h"

enum { PAGS_PACKET = 8 };

typedef struct pags_stage_placement {
  int mesh;
  int actor;      /* index of the labelled object (pags_actor) that it is a part of; -1: none */
  float pose[12]; /* world from mesh, 3x4 in rows: rotation with an optional uniform scale, and translation */
} pags_stage_placement;

/* A packet of rays. Bit i of `active` is set if ray i is to be traced. Directions need not be of unit length. */
typedef struct pags_rays {
  float origin[PAGS_PACKET][3], direction[PAGS_PACKET][3];
  unsigned active;
} pags_rays;

/* The surface point that a ray hits. */
typedef struct pags_touch {
  float distance; /* from the ray's origin, in multiples of the direction's length */
  int placement;
  uint32_t face;
  uint16_t material;
  float point[3];  /* world */
  float flat[3];   /* the face's unit normal, on the side of the ray's origin; world */
  float normal[3]; /* the interpolated vertex normal, unit, on the side of the ray's origin; world */
  float local[3];  /* the point in the mesh's frame */
  float uv[2];     /* interpolated texture coordinates */
} pags_touch;

typedef struct pags_stage pags_stage;

/* Builds the stage. `meshes` and `placements` must outlive it: they are not copied, and pags_stage_commit reads the
 * placements' poses again. */
pags_result pags_stage_create(const pags_mesh *meshes, int mesh_count, const pags_stage_placement *placements,
                              int placement_count, pags_stage **out);
void pags_stage_destroy(pags_stage *stage); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_stage, pags_stage_destroy)
/* Takes over the current poses of placements first .. first + count - 1. Must not run while rays are traced. */
pags_result pags_stage_commit(pags_stage *stage, int first, int count);

/* Finds the nearest surface along each active ray and fills touches[i] for the rays that hit one; returns a bit for
 * each of those. Several threads may call this and pags_stage_blocked at once. */
unsigned pags_stage_trace(const pags_stage *stage, const pags_rays *rays, pags_touch touches[PAGS_PACKET]);
/* Returns a bit for each active ray that hits any surface beyond 1e-4 times its direction (0.1 mm for unit
 * directions). `parallel`: the rays have nearly one direction, which lets Embree trace them faster as a bundle. */
unsigned pags_stage_blocked(const pags_stage *stage, const pags_rays *rays, bool parallel);

#endif
