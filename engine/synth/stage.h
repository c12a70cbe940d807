/* SPDX-License-Identifier: Apache-2.0 */
/* Rays against placed meshes, eight at a time, by Embree 3 or 4. */
#ifndef PAGS_SYNTH_STAGE_H
#define PAGS_SYNTH_STAGE_H

#include <pags/base.h>

#include "synth/mesh.h"

enum { PAGS_PACKET = 8 };

typedef struct pags_stage_placement {
  int mesh;
  int actor;      /* whom it belongs to; -1: the street */
  float pose[12]; /* world from mesh: a rotation, maybe scaled evenly, and a translation */
} pags_stage_placement;

/* Rays, and a bit each for those that count. Directions need not be of unit length. */
typedef struct pags_rays {
  float origin[PAGS_PACKET][3], direction[PAGS_PACKET][3];
  unsigned active;
} pags_rays;

typedef struct pags_touch {
  float distance; /* in lengths of the direction */
  int placement;
  uint32_t face;
  uint16_t material;
  float point[3];  /* world */
  float flat[3];   /* the face's unit normal, towards the ray's origin; world */
  float normal[3]; /* the smooth one, on the same side */
  float local[3];  /* in the mesh's frame */
  float uv[2];
} pags_touch;

typedef struct pags_stage pags_stage;

/* All must outlive it; placements are read again by pags_stage_commit. */
pags_result pags_stage_create(const pags_mesh *meshes, int mesh_count, const pags_stage_placement *placements,
                              int placement_count, pags_stage **out);
void pags_stage_destroy(pags_stage *stage);
/* Takes over the poses of placements first .. first + count - 1. Not while rays are traced. */
pags_result pags_stage_commit(pags_stage *stage, int first, int count);

/* The nearest surfaces; returns a bit for each ray that met one. By several threads at once, as is blocked. */
unsigned pags_stage_trace(const pags_stage *stage, const pags_rays *rays, pags_touch touches[PAGS_PACKET]);
/* Bits of the rays that meet anything beyond 0.1 mm; `parallel` rays are traced faster as one bundle. */
unsigned pags_stage_blocked(const pags_stage *stage, const pags_rays *rays, bool parallel);

#endif
