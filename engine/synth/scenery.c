/* SPDX-License-Identifier: Apache-2.0 */
/* Builds the synthetic street from its options: its extent, then its unlabelled, static part (ground, houses on both
 * sides and across its end, trees, lamps, signs and bins), then parked and moving objects (actors.c). */
#include <math.h>

#include "base/memory.h"
#include "synth/street.h"

enum { STREAM_HOUSES = 1, STREAM_TREES, STREAM_PLANTS };

pags_ground pags_ground_make(pags_materials *materials) {
  return (pags_ground){.asphalt = pags_materials_add(materials, &(pags_material){.finish = PAGS_FINISH_ASPHALT,
                                                                                 .label = PAGS_CLASS_ROAD,
                                                                                 .color = {0.135f, 0.135f, 0.14f}}),
                       .slabs = pags_materials_add(materials, &(pags_material){.finish = PAGS_FINISH_PAVING,
                                                                               .label = PAGS_CLASS_SIDEWALK,
                                                                               .color = {0.36f, 0.34f, 0.31f},
                                                                               .second = {0.17f, 0.16f, 0.15f},
                                                                               .size = 0.6f}),
                       .stone = pags_materials_add(materials, &(pags_material){.finish = PAGS_FINISH_MOTTLED,
                                                                               .label = PAGS_CLASS_SIDEWALK,
                                                                               .color = {0.42f, 0.41f, 0.39f},
                                                                               .second = {0.33f, 0.32f, 0.31f},
                                                                               .size = 0.8f}),
                       .grass = pags_materials_add(materials, &(pags_material){.finish = PAGS_FINISH_MOTTLED,
                                                                               .label = PAGS_CLASS_TERRAIN,
                                                                               .color = {0.10f, 0.17f, 0.05f},
                                                                               .second = {0.17f, 0.20f, 0.08f},
                                                                               .size = 1.1f})};
}

void pags_ground_pave(pags_mesh *mesh, float x0, float x1, float y0, float y1, float z, uint16_t material) {
  pags_mesh_quad(mesh, (float[3]){x0, y0, z}, (float[3]){x1 - x0, 0, 0}, (float[3]){0, y1 - y0, 0}, NULL, material);
}

void pags_ground_kerb(pags_mesh *mesh, const pags_ground *ground, float x0, float x1, int left) {
  const float kerb = left ? PAGS_KERB_LEFT : PAGS_KERB_RIGHT, front = left ? PAGS_FRONT_LEFT : PAGS_FRONT_RIGHT;
  const float out = left ? 1.0f : -1.0f, h = PAGS_KERB_HEIGHT;
  pags_mesh_box(mesh, (float[3]){0.5f * (x0 + x1), kerb + 0.08f * out, 0.5f * h},
                (float[3]){0.5f * (x1 - x0), 0.08f, 0.5f * h}, ground->stone);
  pags_ground_pave(mesh, x0, x1, kerb + 0.16f * out, front, h, ground->slabs);
}

static void add_ground(pags_street *street, pags_mesh *mesh) {
  const float x0 = street->begin_x - 30.0f, x1 = street->end_x + 12.0f;
  const pags_ground ground = pags_ground_make(&street->materials);
  pags_ground_pave(mesh, x0, x1, PAGS_KERB_RIGHT, PAGS_KERB_LEFT, 0.0f, ground.asphalt);
  pags_ground_pave(mesh, street->end_x, x1, -60.0f, 60.0f, 0.001f, ground.asphalt);
  for (int left = 0; left < 2; left++) {
    const float front = left ? PAGS_FRONT_LEFT : PAGS_FRONT_RIGHT;
    pags_ground_kerb(mesh, &ground, x0, street->end_x, left);
    pags_ground_pave(mesh, x0, street->end_x, front, front + (left ? 45.0f : -45.0f), PAGS_KERB_HEIGHT - 0.01f,
                     ground.grass);
  }
}

/* Adds a row of houses along one side of the street, wall to wall with a gap here and there; some are set back. */
static void add_row(pags_street *street, pags_mesh *mesh, pags_dice *dice, int left) {
  const float front = left ? PAGS_FRONT_LEFT : PAGS_FRONT_RIGHT, out = left ? 1.0f : -1.0f;
  float x = street->begin_x + pags_dice_between(dice, 0.0f, 6.0f);
  while (x < street->end_x - 12.0f) {
    const float setback = pags_dice_pick(dice, 3) ? 0.0f : pags_dice_between(dice, 0.4f, 1.4f);
    const pags_plot plot = {.base = {x, front + out * setback, PAGS_KERB_HEIGHT - 0.02f},
                            .along = {1, 0, 0},
                            .into = {0, out, 0},
                            .width = pags_dice_between(dice, 8.0f, 15.0f),
                            .depth = pags_dice_between(dice, 9.0f, 12.0f)};
    pags_building_add(mesh, &street->materials, dice, &plot);
    x += plot.width + (pags_dice_pick(dice, 4) ? 0.0f : pags_dice_between(dice, 2.5f, 5.0f));
  }
}

/* Places trees, lamps, signs and bins along one kerb, every 9.5 m; trees keep away from crossings. */
static void plant_kerb(pags_street *street, pags_dice *dice, const pags_planting *kinds, int left) {
  const float kerb = left ? PAGS_KERB_LEFT : PAGS_KERB_RIGHT, out = left ? 1.0f : -1.0f, z = PAGS_KERB_HEIGHT;
  const float lamp_yaw = left ? 3.14159265f : 0.0f;
  int place = left;
  for (float x = street->begin_x + 3.0f + 4.0f * (float)left; x < street->end_x - 3.0f; x += 9.5f, place++) {
    const float y = kerb + 0.75f * out, jitter = pags_dice_between(dice, -0.8f, 0.8f);
    const int kind = pags_dice_pick(dice, PAGS_TREE_KINDS), what = pags_dice_pick(dice, 8);
    const float turn = pags_dice_between(dice, 0.0f, 6.28f), scale = pags_dice_between(dice, 0.85f, 1.2f);
    const float phase = (x - street->markings.first_crossing) / street->markings.spacing;
    const bool near_crossing = fabsf(phase - floorf(phase + 0.5f)) * street->markings.spacing < 6.0f;
    if (place % 3 == 0)
      pags_street_place(street, kinds->lamp, -1, x, y - 0.3f * out, z, lamp_yaw, 1.0f);
    else if (!near_crossing && what > 1)
      pags_street_place(street, kinds->trees[kind], -1, x + jitter, y, z, turn, scale);
    else if (what == 0)
      pags_street_place(street, kinds->signs[place % 2 ? 0 : 2], -1, x, y - 0.35f * out, z, left ? 3.14159265f : 0.0f,
                        1.0f);
    if (what == 3)
      pags_street_place(street, kinds->bin, -1, x + 2.5f, y, z, 0.0f, 1.0f);
  }
}

void pags_planting_make(pags_street *street, pags_dice *dice, pags_planting *out) {
  for (int i = 0; i < PAGS_TREE_KINDS; i++) {
    out->trees[i] = pags_street_mesh(street);
    pags_tree_add(&street->meshes[out->trees[i]], &street->materials, dice);
  }
  for (int i = 0; i < 3; i++) {
    out->signs[i] = pags_street_mesh(street);
    pags_sign_add(&street->meshes[out->signs[i]], &street->materials, i);
  }
  out->lamp = pags_street_mesh(street);
  out->bin = pags_street_mesh(street);
  pags_lamp_add(&street->meshes[out->lamp], &street->materials);
  pags_bin_add(&street->meshes[out->bin], &street->materials);
}

void pags_planting_add(pags_street *street, pags_dice *dice, const pags_planting *kinds) {
  plant_kerb(street, dice, kinds, 0);
  plant_kerb(street, dice, kinds, 1);

  /* Two signs at each zebra crossing, one for either direction of traffic. */
  const float spacing = street->markings.spacing;
  const int sign = kinds->signs[1];
  float x = street->markings.first_crossing;
  while (x - spacing > street->begin_x)
    x -= spacing;
  for (; x < street->end_x; x += spacing) {
    pags_street_place(street, sign, -1, x - 2.9f, PAGS_KERB_RIGHT - 0.45f, PAGS_KERB_HEIGHT, 0.0f, 1.0f);
    pags_street_place(street, sign, -1, x + 2.9f, PAGS_KERB_LEFT + 0.45f, PAGS_KERB_HEIGHT, 3.14159265f, 1.0f);
  }
}

static void add_scenery(pags_street *street) {
  pags_dice dice = {street->options->seed, STREAM_HOUSES, 0};
  const int ground = pags_street_mesh(street);
  pags_planting kinds;
  if (street->failed)
    return;
  add_ground(street, &street->meshes[ground]);
  add_row(street, &street->meshes[ground], &dice, 0);
  add_row(street, &street->meshes[ground], &dice, 1);

  /* The street ends in a T-junction: houses beyond the crossing road close the view. */
  for (float y = -62.0f; y < 60.0f;) {
    const pags_plot plot = {.base = {street->end_x + 16.0f, y, 0.0f},
                            .along = {0, 1, 0},
                            .into = {1, 0, 0},
                            .width = pags_dice_between(&dice, 10.0f, 16.0f),
                            .depth = 12.0f};
    pags_building_add(&street->meshes[ground], &street->materials, &dice, &plot);
    y += plot.width;
  }

  pags_street_place(street, ground, -1, 0, 0, 0, 0, 1);
  dice = (pags_dice){street->options->seed, STREAM_TREES, 0};
  pags_planting_make(street, &dice, &kinds);
  dice = (pags_dice){street->options->seed, STREAM_PLANTS, 0};
  pags_planting_add(street, &dice, &kinds);
}

pags_result pags_street_build(const pags_street_options *options, pags_street *street) {
  *street = (pags_street){.options = options, .begin_x = -45.0f};
  street->duration = (options->frames - 1) / options->fps;
  street->end = pags_street_ego_x(options, street->duration);
  street->end_x = (float)street->end + 130.0f;
  street->markings = (pags_markings){.first_crossing = (float)street->end + 22.0f, .spacing = 84.0f};
  add_scenery(street);
  pags_actors_add(street);
  PAGS_CHECK_MEMORY(pags_street_is_complete(street), "a street of %d frames", options->frames);
  return PAGS_OK;
}
