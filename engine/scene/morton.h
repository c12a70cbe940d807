/* SPDX-License-Identifier: Apache-2.0 */
/* The Morton order of pags_gaussians_morton_order on a pool; the same order for any number of threads. */
#ifndef PAGS_SCENE_MORTON_H
#define PAGS_SCENE_MORTON_H

#include <stdbool.h>

#include <pags/gaussians.h>
#include <pags/tasks.h>

/* As pags_gaussians_morton_order. `tasks` NULL: on the calling thread alone. PAGS_ERROR_MEMORY or PAGS_CANCELLED. */
pags_result pags_morton_order(const pags_gaussians *g, pags_tasks *tasks, int64_t *index);

/* The box of all finite means, in metres; without any, lo is infinite and hi -infinite. The box of rows that lie in
 * several places is that around the boxes of each. */
typedef struct pags_morton_cube {
  double lo[3], hi[3];
} pags_morton_cube;
pags_morton_cube pags_morton_bounds(const pags_gaussians *g);

/* A few stray rows far away would leave all others in one cell. Where the box is wide, `counts` (zeros) receives how
 * many rows lie in which part of each axis; counts of several places are added. tighten then shrinks the box if nearly
 * all rows lie in a small part of it; rows outside of the box get the codes of its border. */
enum { PAGS_MORTON_COUNTS = 3 * 2048 };
bool pags_morton_is_wide(const pags_morton_cube *bounds);
void pags_morton_count(const pags_gaussians *g, int64_t counts[PAGS_MORTON_COUNTS]);
void pags_morton_tighten(const int64_t counts[PAGS_MORTON_COUNTS], pags_morton_cube *bounds);
/* The Morton code of row i in the cube over the box of all rows; UINT64_MAX if its mean isn't finite. */
uint64_t pags_morton_code(const pags_gaussians *g, int64_t i, const pags_morton_cube *bounds);

#endif
