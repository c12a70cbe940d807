/* SPDX-License-Identifier: Apache-2.0 */
/* What merging needs of the blocks of a split: the cells that they have, and the scenes that they were trained to.
 *
 * A place belongs to the block one of whose own time steps the rig stood nearest to it
 * at, the Voronoi cell of these stands. On a straight drive cells meet in a plane across the road half way between the
 * last stand of one block and the first of the next. */
#ifndef PAGS_BLOCKS_CELLS_H
#define PAGS_BLOCKS_CELLS_H

#include <pags/blocks.h>
#include <pags/scene.h>
typedef struct pags_cells {
  int64_t count;
  double (*stands)[3]; /* metres, absolute, in the order of the drive */
  int *blocks;         /* whose own each of them is */
  double (*boxes)[6];  /* lowest and highest corner of each run of stands, so that most are skipped */
} pags_cells;

/* PAGS_ERROR_FORMAT if a time step of the path is no block's own. The cells must be destroyed on failure, too. */
pags_result pags_cells_create(const pags_blocks *split, pags_cells *cells);
void pags_cells_destroy(pags_cells *cells);

/* Returns the block in whose cell a place lies (metres, absolute). If two stands are equally near, the first one
 * counts. */
int pags_cells_find(const pags_cells *cells, const double place[3]);

/* ---- The scenes of the blocks, without their Gaussians: trained.c ---- */

typedef struct pags_trained {
  int count;
  char **folders;    /* FOLDER/000/scene, ... */
  pags_scene *heads; /* what their scene.json say; models have no Gaussians */
} pags_trained;

/* Reads the scene.json of every block and checks that all are there, belong to this split, were trained to the end and
 * in the same way. Errors as pags_merge. Must be destroyed on failure, too. */
pags_result pags_trained_load(const pags_blocks *split, const char *folder, pags_trained *trained);
void pags_trained_destroy(pags_trained *trained);

#endif
