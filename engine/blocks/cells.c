/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the block whose cell a place lies in: the nearest stand of the rig (cells.h). */
#include "blocks/cells.h"

#include <math.h>

#include "base/memory.h"
#include "base/vec3.h"

enum { RUN = 16 }; /* stands that follow each other and share a box */

void pags_cells_destroy(pags_cells *cells) {
  free(cells->stands);
  free(cells->blocks);
  free(cells->boxes);
  *cells = (pags_cells){0};
}

pags_result pags_cells_create(const pags_blocks *split, pags_cells *cells) {
  const size_t count = (size_t)split->stand_count, runs = (count + RUN - 1) / RUN;
  *cells = (pags_cells){.count = split->stand_count,
                        .stands = malloc(count * sizeof *cells->stands),
                        .blocks = malloc(count * sizeof *cells->blocks),
                        .boxes = malloc(runs * sizeof *cells->boxes)};
  PAGS_CHECK_MEMORY(cells->stands && cells->blocks && cells->boxes, "the path of %zu time steps", count);
  memcpy(cells->stands, split->stands, count * sizeof *cells->stands);
  for (int64_t i = 0; i < cells->count; i++) {
    const int frame = split->frames[i];
    int b = 0;
    while (b < split->count && (frame < split->ranges[b].own_first || frame > split->ranges[b].own_last))
      b++;
    if (b == split->count)
      return pags_fail(PAGS_ERROR_FORMAT, "split.json: time step %d of the path is no block's own; split it again",
                       frame);
    cells->blocks[i] = b;
    double *box = cells->boxes[i / RUN];
    if (i % RUN == 0) {
      pags_copy3(cells->stands[i], box);
      pags_copy3(cells->stands[i], box + 3);
    }
    pags_box_add3(cells->stands[i], box, box + 3);
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
      const double sum = pags_distance_squared3(place, cells->stands[i]);
      found = sum < least ? cells->blocks[i] : found;
      least = sum < least ? sum : least;
    }
  }
  return found;
}
