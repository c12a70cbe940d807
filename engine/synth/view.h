/* Pictures of the street, and what is exactly true of their pixels. */
#ifndef PAGS_SYNTH_VIEW_H
#define PAGS_SYNTH_VIEW_H

#include <pags/tasks.h>

#include "synth/stage.h"
#include "synth/street.h"

typedef struct pags_street_view {
  pags_camera camera;
  uint8_t *rgb; /* 3 a pixel: the mean of samples all over it */
  /* Of the ray through the pixel's centre; NULL where only the picture is wanted. */
  float *depth;    /* camera z, 0 for the sky */
  uint8_t *labels; /* PAGS_CLASS_* */
  int32_t *actors; /* -1: none */
} pags_street_view;

/* Draws all views at the time that the stage stands at. PAGS_CANCELLED. */
pags_result pags_street_draw(const pags_street *street, const pags_stage *stage, pags_street_view *views, int count,
                             pags_tasks *tasks);

#endif
