/* SPDX-License-Identifier: Apache-2.0 */
/* What the street's surfaces are made of: reflectance from where on a surface a ray lands. Linear RGB. */
#ifndef PAGS_SYNTH_MATERIAL_H
#define PAGS_SYNTH_MATERIAL_H

#include <stdint.h>

#include "synth/stage.h"

/* Classes of Cityscapes, by train id. */
enum {
  PAGS_CLASS_ROAD = 0,
  PAGS_CLASS_SIDEWALK = 1,
  PAGS_CLASS_BUILDING = 2,
  PAGS_CLASS_WALL = 3,
  PAGS_CLASS_FENCE = 4,
  PAGS_CLASS_POLE = 5,
  PAGS_CLASS_LIGHT = 6,
  PAGS_CLASS_SIGN = 7,
  PAGS_CLASS_VEGETATION = 8,
  PAGS_CLASS_TERRAIN = 9,
  PAGS_CLASS_SKY = 10,
  PAGS_CLASS_PERSON = 11,
  PAGS_CLASS_RIDER = 12,
  PAGS_CLASS_CAR = 13,
  PAGS_CLASS_BICYCLE = 18
};

typedef enum pags_finish {
  PAGS_FINISH_PLAIN,   /* color */
  PAGS_FINISH_MOTTLED, /* color to second by noise of `size` in the mesh's frame */
  PAGS_FINISH_ASPHALT, /* with the lanes' markings, by world position */
  PAGS_FINISH_PAVING,  /* slabs of `size` with joints, by world position */
  PAGS_FINISH_BRICK,   /* by uv in metres; `second` is the mortar */
  PAGS_FINISH_PLASTER, /* by uv in metres, stained */
  PAGS_FINISH_TILES,   /* rows of roof tiles by uv */
  PAGS_FINISH_WINDOW,  /* panes and bars: uv in panes, its whole part is the window's number */
  PAGS_FINISH_LEAF,    /* light passes through */
  PAGS_FINISH_PAINT    /* of cars, with the seams of doors */
} pags_finish;

typedef struct pags_material {
  pags_finish finish;
  uint8_t label; /* PAGS_CLASS_* */
  float color[3], second[3];
  float size;  /* of the pattern, metres */
  float gloss; /* share of light mirrored when seen head-on */
} pags_material;

/* Lines across the road that the asphalt's markings leave room for. */
typedef struct pags_markings {
  float first_crossing, spacing; /* x of a zebra crossing's middle, metres between one and the next */
} pags_markings;

/* How much of a surface one sample stands for, metres: patterns finer than that fade to their mean. */
typedef struct pags_footprint {
  float mean; /* the geometric mean of its two sides */
  float x, y; /* its extent along the world's x and y */
} pags_footprint;

/* Reflectance. */
void pags_material_color(const pags_material *material, const pags_markings *markings, const pags_touch *touch,
                         const pags_footprint *footprint, uint64_t seed, float color[3]);

#endif
