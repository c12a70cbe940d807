/* SPDX-License-Identifier: Apache-2.0 */
/* Materials of the synthetic street: the reflectance (linear RGB) at the point of a surface where a ray lands; and
 * noise for the procedural textures of surfaces and clouds. */
#ifndef PAGS_SYNTH_MATERIAL_H
#define PAGS_SYNTH_MATERIAL_H

#include <stdint.h>

#include "synth/stage.h"

/* Semantic classes: train ids of Cityscapes. */
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
  PAGS_FINISH_PLAIN,   /* `color` everywhere */
  PAGS_FINISH_MOTTLED, /* blends `color` and `second` by noise with cells of `size`, in the mesh's frame */
  PAGS_FINISH_ASPHALT, /* asphalt with road markings, by world position */
  PAGS_FINISH_PAVING,  /* slabs of `size` with joints of colour `second`, by world position */
  PAGS_FINISH_BRICK,   /* bricks, by uv in metres; `second` is the mortar's colour */
  PAGS_FINISH_PLASTER, /* stained plaster, by uv in metres */
  PAGS_FINISH_TILES,   /* rows of roof tiles, by uv in metres */
  PAGS_FINISH_WINDOW,  /* panes and bars; one window per unit of u and v, whose whole parts are the window's number */
  PAGS_FINISH_LEAF,    /* a leaf: light passes through it; u is its number */
  PAGS_FINISH_PAINT    /* car paint with door seams, by position in the mesh's frame */
} pags_finish;

typedef struct pags_material {
  pags_finish finish;
  uint8_t label; /* PAGS_CLASS_* */
  float color[3], second[3];
  float size;  /* length of the pattern's cells, slabs or windows, metres */
  float gloss; /* share of light, 0..1, that is mirrored when the surface is seen at a right angle */
} pags_material;

/* Where the zebra crossings are; the markings along the road stop before them. */
typedef struct pags_markings {
  float first_crossing, spacing; /* x of the middle of one crossing; metres from each crossing to the next */
} pags_markings;

/* The size, in metres, of the piece of surface that one sample represents. Finer patterns fade to their mean. */
typedef struct pags_footprint {
  float mean; /* geometric mean of the piece's two sides */
  float x, y; /* extents of the piece along the world's x and y */
} pags_footprint;

/* Sets `color` to the reflectance (linear RGB, 0..1) of `material` at the surface point `touch`, filtered over
 * `footprint`. `seed` chooses the random patterns. */
void pags_material_color(const pags_material *material, const pags_markings *markings, const pags_touch *touch,
                         const pags_footprint *footprint, uint64_t seed, float color[3]);

/* Smooth value noise in [0, 1] at (x, y), with cells of side 1. */
float pags_noise2(float x, float y, uint32_t seed);

#endif
