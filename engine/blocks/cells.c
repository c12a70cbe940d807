/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the block whose cell a place lies in: the nearest stand of the rig (cells.h). */
#include "blocks/cells.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

enum { RUN = 16 }; /* stands that follow each other and share a box */

void pags_cells_destroy(pags_cells *cells) {
  free(cells->stands);
  free(cells->blocks);
  free(cells->boxes);
  *cells = (pags_cells){0};
}

static int block_of(const pags_blocks *split, int frame) {
  for (int b = 0; b < split->count; b++)
    if (frame >= split->ranges[b].own_first && frame <= split->ranges[b].own_last)
      return b;
  return -1;
}

pags_result pags_cells_create(const pags_blocks *split, pags_cells *cells) {
  const size_t count = (size_t)split->stand_count, runs = (count + RUN - 1) / RUN;
  *cells = (pags_cells){.count = split->stand_count,
                        .stands = malloc(count * sizeof *cells->stands),
                        .blocks = malloc(count * sizeof *cells->blocks),
                        .boxes = malloc(runs * sizeof *cells->boxes)};
  if (!cells->stands || !cells->blocks || !cells->boxes)
    return pags_out_of_memory("the path of %zu time steps", count);
  memcpy(cells->stands, split->stands, count * sizeof *cells->stands);
  for (int64_t i = 0; i < cells->count; i++) {
    double *box = cells->boxes[i / RUN];
    cells->blocks[i] = block_of(split, split->frames[i]);
    if (cells->blocks[i] < 0)
      return pags_fail(PAGS_ERROR_FORMAT, "split.json: time step %d of the path is no block's own; split it again",
                       split->frames[i]);
    for (int k = 0; k < 3; k++) {
      const double at = cells->stands[i][k];
      box[k] = i % RUN == 0 ? at : fmin(box[k], at);
      box[3 + k] = i % RUN == 0 ? at : fmax(box[3 + k], at);
    }
  }
  return PAGS_OK;
}

/* Returns the squared distance from a place to the nearest point of a box, 0 inside of it. */
static double from_box(const double box[6], const double place[3]) {
  double sum = 0;
  for (int k = 0; k < 3; k++) {
    const double out = fmax(fmax(box[k] - place[k], place[k] - box[3 + k]), 0);
    sum += out * out;
  }
  return sum;
}

int pags_cells_find(const pags_cells *cells, const double place[3]) {
  double least = (double)INFINITY;
  int found = 0;
  for (int64_t first = 0; first < cells->count; first += RUN) {
    if (from_box(cells->boxes[first / RUN], place) >= least)
      continue;
    const int64_t end = first + RUN < cells->count ? first + RUN : cells->count;
    for (int64_t i = first; i < end; i++) {
      double sum = 0;
      for (int k = 0; k < 3; k++)
        sum += (place[k] - cells->stands[i][k]) * (place[k] - cells->stands[i][k]);
      found = sum < least ? cells->blocks[i] : found;
      least = sum < least ? sum : least;
    }
  }
  return found;
}
