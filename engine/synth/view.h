/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures of the street, and what is exactly true of their pixels. */
#ifndef PAGS_SYNTH_VIEW_H
#define PAGS_SYNTH_VIEW_H

#include <pags/tasks.h>

#include "synth/stage.h"
#include "synth/street.h"

typedef struct pags_street_view {
  pags_camera camera;
  uint8_t *rgb; /* 3 bytes a pixel: the mean of samples spread over the pixel */
  /* Of the ray through the pixel's centre; NULL where only the picture is wanted. */
  float *depth;    /* camera z, 0 for the sky */
  uint8_t *labels; /* PAGS_CLASS_* */
  int32_t *actors; /* -1: none */
} pags_street_view;

/* Draws all views at the time that the stage stands at. PAGS_CANCELLED. */
pags_result pags_street_draw(const pags_street *street, const pags_stage *stage, pags_street_view *views, int count,
                             pags_tasks *tasks);

/* Linear colour of a surface point that `touch` describes (its `distance` isn't used), filtered over `footprint`: the
 * sun and all of the sky's directions. Patterns of roads and pavements follow the mesh's own frame. By several threads
 * at once. */
void pags_street_shade(const pags_street *street, const pags_stage *stage, const pags_touch *touch,
                       const pags_footprint *footprint, float color[3]);

#endif
