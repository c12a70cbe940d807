/* SPDX-License-Identifier: Apache-2.0 */
/* Pictures of the synthetic street, with the exact depth, semantic class and object of each pixel. */
#ifndef PAGS_SYNTH_VIEW_H
#define PAGS_SYNTH_VIEW_H

#include <pags/tasks.h>

#include "synth/stage.h"
#include "synth/street.h"

typedef struct pags_street_view {
  pags_camera camera;
  uint8_t *rgb; /* 3 bytes a pixel (sRGB): the mean of samples spread over the pixel */
  /* Truth by the ray through the pixel's centre; NULL where only the picture is wanted. */
  float *depth;    /* camera z, metres; 0 for the sky */
  uint8_t *labels; /* PAGS_CLASS_* */
  int32_t *actors; /* index of the labelled object; -1: none */
} pags_street_view;

/* Draws all views, with objects where the stage has them. Error: PAGS_CANCELLED. */
pags_result pags_street_draw(const pags_street *street, const pags_stage *stage, pags_street_view *views, int count,
                             pags_tasks *tasks);

/* Sets `color` to the linear colour of the surface point `touch` (whose `distance` is not used), lit by the sun and
 * by all eight sky directions, with textures filtered over `footprint`. Patterns of roads and pavements follow the
 * mesh's own frame instead of the world. Several threads may call this at once. */
void pags_street_shade(const pags_street *street, const pags_stage *stage, const pags_touch *touch,
                       const pags_footprint *footprint, float color[3]);

#endif
