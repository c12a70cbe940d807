/* SPDX-License-Identifier: Apache-2.0 */
/* Models of the synthetic street: houses, trees, street furniture, cars, bicycles, people. Each function appends a
 * model to a mesh, and its materials to a list that all models share. */
#ifndef PAGS_SYNTH_MODELS_H
#define PAGS_SYNTH_MODELS_H

#include "base/rng.h"
#include "synth/material.h"

/* A counter on one stream of the engine's random numbers (base/rng.h). The builders of the synthetic scenes draw from
 * it one number after another. */
typedef struct pags_dice {
  uint64_t seed, stream, count;
} pags_dice;

/* Uniform in [lo, hi). */
static inline float pags_dice_between(pags_dice *dice, float lo, float hi) {
  return lo + (hi - lo) * (float)pags_rng_uniform(dice->seed, dice->stream, dice->count++);
}

/* A uniformly drawn integer in 0 .. count - 1. */
static inline int pags_dice_pick(pags_dice *dice, int count) {
  return (int)pags_rng_below(dice->seed, dice->stream, dice->count++, (uint64_t)count);
}
typedef struct pags_materials {
  pags_material *list;
  int count;
  int64_t capacity;
  bool failed; /* out of memory, or more than 65,536 materials */
} pags_materials;

void pags_materials_destroy(pags_materials *materials);
/* Appends a material and returns its number. */
uint16_t pags_materials_add(pags_materials *materials, const pags_material *material);
/* Appends a matt material of a single colour (linear RGB) and returns its number. */
uint16_t pags_materials_plain(pags_materials *materials, uint8_t label, float r, float g, float b);

/* The plot of a house: `base` is the corner of the front on the ground, the unit vector `along` runs along the front,
 * the unit vector `into` points away from the street. Metres. */
typedef struct pags_plot {
  float base[3], along[3], into[3];
  float width, depth;
} pags_plot;
void pags_building_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice, const pags_plot *plot);

/* Adds a tree whose trunk stands on the ground at the origin. */
void pags_tree_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice);
/* Adds a street lamp at the origin whose arm reaches along +y. */
void pags_lamp_add(pags_mesh *mesh, pags_materials *materials);
/* Adds a traffic sign on a post at the origin that faces -x. `kind` 0: speed limit, 1: crossing, 2: no parking. */
void pags_sign_add(pags_mesh *mesh, pags_materials *materials, int kind);
void pags_bin_add(pags_mesh *mesh, pags_materials *materials);

/* Adds a car on the ground z = 0, its middle at x = y = 0, its front towards +x. `kind` (modulo 10) chooses the
 * paint. `size` receives length, width and height of a box around the car, metres. */
void pags_car_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice, int kind, float size[3]);
void pags_bicycle_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice);

/* The meshes of a person: the body (trunk and head) with the origin on the ground between the feet; one arm and one
 * leg that hang down from the origin, which is the shoulder or hip joint. */
typedef struct pags_person {
  pags_mesh *body, *arm, *leg;
} pags_person;
#define PAGS_SHOULDER_HEIGHT 1.40f
#define PAGS_HIP_HEIGHT 0.88f
void pags_person_add(const pags_person *person, pags_materials *materials, pags_dice *dice, uint8_t label);

#endif
