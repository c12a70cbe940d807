/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians on the surfaces of a town, where they are seen from its streets. */
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
  double area;            /* of all faces, by the weight their Gaussians get; square metres */
  double *placement_area; /* sums up to and with each placement */
  double **face_area;     /* of each mesh: sums up to and with each face; NULL for meshes that aren't placed */
} pags_surface;

pags_result pags_surface_create(const pags_street *town, const pags_town_plan *plan, const pags_stage *stage,
                                pags_surface *out);
void pags_surface_destroy(pags_surface *surface);

/* Weighted area that is seen from the streets, by `tries` random points. */
double pags_surface_seen(const pags_surface *surface, int tries);

/* Fills rows 0 .. count - 1, s_sem included; degree 1. Row i depends on the seed and i alone. PAGS_CANCELLED. */
pags_result pags_surface_sample(const pags_surface *surface, pags_gaussians *gaussians, pags_tasks *tasks,
                                pags_progress_fn *progress, void *user);

/* Display-referred sRGB of a linear value, cut to 0..1. */
float pags_surface_srgb(float linear);

#endif
