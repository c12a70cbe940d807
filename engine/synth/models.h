/* SPDX-License-Identifier: Apache-2.0 */
/* What stands and moves in the street. Each function adds to a mesh; materials go into a shared list. */
#ifndef PAGS_SYNTH_MODELS_H
#define PAGS_SYNTH_MODELS_H

#include "synth/dice.h"
#include "synth/material.h"

typedef struct pags_materials {
  pags_material *list;
  int count, capacity;
  bool failed; /* memory ran out, or 65,535 are not enough */
} pags_materials;

void pags_materials_destroy(pags_materials *materials);
/* Returns its number. */
uint16_t pags_materials_add(pags_materials *materials, const pags_material *material);
/* One of a single colour. */
uint16_t pags_materials_plain(pags_materials *materials, uint8_t label, float r, float g, float b);

/* A house: `base` is the corner of its front on the ground, fronts run along `along`, `into` points away from the
 * street. */
typedef struct pags_plot {
  float base[3], along[3], into[3];
  float width, depth;
} pags_plot;
void pags_building_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice, const pags_plot *plot);

/* Trunk on the ground at the origin. */
void pags_tree_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice);
/* Its arm reaches along +y. */
void pags_lamp_add(pags_mesh *mesh, pags_materials *materials);
/* Faces -x. */
void pags_sign_add(pags_mesh *mesh, pags_materials *materials, int kind);
void pags_bin_add(pags_mesh *mesh, pags_materials *materials);

/* Ground at z = 0, middle at x = y = 0, front at +x. Of 10 paints by `kind`. `size` receives length, width, height of a
 * box around it. */
void pags_car_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice, int kind, float size[3]);
void pags_bicycle_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice);

/* A person in parts, each in its own mesh: trunk and head about the feet's middle; an arm and a leg hanging from the
 * origin. */
typedef struct pags_person {
  pags_mesh *body, *arm, *leg;
} pags_person;
#define PAGS_SHOULDER_HEIGHT 1.40f
#define PAGS_HIP_HEIGHT 0.88f
void pags_person_add(const pags_person *person, pags_materials *materials, pags_dice *dice, uint8_t label);

#endif
