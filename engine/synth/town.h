/* SPDX-License-Identifier: Apache-2.0 */
/* A town: parallel streets with blocks of houses between them, cut by lanes, closed at both ends. */
#ifndef PAGS_SYNTH_TOWN_H
#define PAGS_SYNTH_TOWN_H

#include "synth/street.h"

#define PAGS_TOWN_LANE 8.0f         /* width of a lane between two blocks, metres */
#define PAGS_TOWN_BLOCK_DEPTH 22.0f /* two houses back to back */

/* Street s runs along +x with its middle line at y = s * pags_town_pitch(); x begins at 0. */
typedef struct pags_town_plan {
  int streets, columns; /* blocks along a street; of blocks there are (streets + 1) * columns */
  float block;          /* length of a block along x, metres */
} pags_town_plan;

float pags_town_pitch(void);
float pags_town_length(const pags_town_plan *plan); /* of each street */
/* Middle of the lane after column `column`. */
float pags_town_lane_x(const pags_town_plan *plan, int column);

/* Meshes and placements of the whole town in one pags_street; `options` (seed alone is used) must outlive it. */
pags_result pags_town_build(const pags_street_options *options, const pags_town_plan *plan, pags_street *town);

#endif
