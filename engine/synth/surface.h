/* SPDX-License-Identifier: Apache-2.0 */
/* Covers the surfaces of a town with Gaussians where they are visible from its streets. */
#ifndef PAGS_SYNTH_SURFACE_H
#define PAGS_SYNTH_SURFACE_H

#include <pags/gaussians.h>
#include <pags/synth.h>

#include "synth/stage.h"
#include "synth/town.h"

typedef struct pags_surface {
  const pags_street *town;
  const pags_town_plan *plan;
  const pags_stage *stage;
  double area;            /* of all faces, weighted by density relative to PAGS_TRAINED_DENSITY; square metres */
  double *placement_area; /* cumulative weighted areas of the placements */
  double **face_area;     /* for each mesh the cumulative weighted areas of its faces; NULL where it is not placed */
} pags_surface;

pags_result pags_surface_create(const pags_street *town, const pags_town_plan *plan, const pags_stage *stage,
                                pags_surface *out);
void pags_surface_destroy(pags_surface *surface);

/* Estimates the weighted area that is visible from the streets, square metres, from `tries` random points. */
double pags_surface_seen(const pags_surface *surface, int tries);

/* Fills all rows of `gaussians` (SH degree 1, with s_sem). Row i depends only on the seed and i. Error:
 * PAGS_CANCELLED. */
pags_result pags_surface_sample(const pags_surface *surface, pags_gaussians *gaussians, pags_tasks *tasks,
                                pags_progress_fn *progress, void *user);

#endif
