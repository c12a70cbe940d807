/* SPDX-License-Identifier: Apache-2.0 */
/* A synthetic town: parallel streets with rows of house blocks between them; lanes between the blocks join the
 * streets, and houses close the streets at both ends. */
#ifndef PAGS_SYNTH_TOWN_H
#define PAGS_SYNTH_TOWN_H

#include "synth/street.h"

#define PAGS_TOWN_LANE 8.0f         /* width of a lane between two blocks, metres */
#define PAGS_TOWN_BLOCK_DEPTH 22.0f /* two houses back to back, metres */

/* Street s runs along +x with its middle line at y = s * pags_town_pitch(); x begins at 0. */
typedef struct pags_town_plan {
  int streets, columns; /* number of streets; of blocks along each street: (streets + 1) * columns in all */
  float block;          /* length of a block along x, metres */
} pags_town_plan;

/* Distance between the middle lines of neighbouring streets, metres. */
float pags_town_pitch(void);
float pags_town_length(const pags_town_plan *plan); /* length of each street, metres */
/* The x of the middle of the lane that follows block column `column`. */
float pags_town_lane_x(const pags_town_plan *plan, int column);

/* Builds the meshes and placements of the whole town as one pags_street. Only the seed of `options` is used; they
 * must outlive the town. */
pags_result pags_town_build(const pags_street_options *options, const pags_town_plan *plan, pags_street *town);

#endif
