/* SPDX-License-Identifier: Apache-2.0 */
/* The Morton order of pags_gaussians_morton_order on a pool; the same order for any number of threads. */
#ifndef PAGS_SCENE_MORTON_H
#define PAGS_SCENE_MORTON_H

#include <pags/gaussians.h>
#include <pags/tasks.h>

/* As pags_gaussians_morton_order. `tasks` NULL: on the calling thread alone. PAGS_ERROR_MEMORY or PAGS_CANCELLED. */
pags_result pags_morton_order(const pags_gaussians *g, pags_tasks *tasks, int64_t *index);

#endif
