/* SPDX-License-Identifier: Apache-2.0 */
/* The plan of the ground: which cells are road, pavement or verge, and the corners between them. */
#ifndef PAGS_PROXY_GROUND_PLAN_H
#define PAGS_PROXY_GROUND_PLAN_H

#include "exporters/proxy/background.h"

enum { PAGS_GROUND_ROAD, PAGS_GROUND_PAVEMENT, PAGS_GROUND_VERGE, PAGS_GROUND_KINDS, PAGS_GROUND_NONE };

/* The cells of the ground's lattice with their kinds, and the corners between them: corner (i, j) is the lower left one
 * of cell (i, j). */
typedef struct pags_ground_plan {
  const pags_ground *ground;
  int64_t nx, ny;                                                 /* cells; there is one more corner each way */
  uint8_t *kind;                                                  /* of each cell */
  float *z;                                                       /* height of each cell, metres */
  float (*corner)[2];                                             /* x, y of each corner, metres */
  uint8_t *fixed;                                                 /* 1: the corner's place was measured */
  uint32_t (*top)[PAGS_GROUND_KINDS], (*foot)[PAGS_GROUND_KINDS]; /* the vertex of each kind at a corner, and the foot
                                                                     of a kerb that is of this kind; UINT32_MAX: none */
  uint8_t *pure;                                                  /* 1: the cell's height is of its kind alone */
  int64_t *scratch;                                               /* a number for each corner */
} pags_ground_plan;

/* The kind of a cell; NONE outside. */
static inline uint8_t pags_ground_kind(const pags_ground_plan *p, int64_t x, int64_t y) {
  return x >= 0 && y >= 0 && x < p->nx && y < p->ny ? p->kind[y * p->nx + x] : PAGS_GROUND_NONE;
}

/* Finds where kerbs are by the pictures (ground_kerbs.c). `move` false: gives cells on the wrong side the other kind;
 * true: moves corners onto the kerb and fixes them. */
pags_result pags_ground_kerbs_fit(const pags_proxy_maker *w, const pags_background *b, bool move,
                                  pags_ground_plan *plan);

#endif
