/* SPDX-License-Identifier: Apache-2.0 */
/* Adds meshes of people made of ellipsoids and tubes: a body with head and hair, and one arm and one leg that
 * actors.c places twice and swings. Clothes and skin are chosen at random. */
#include "synth/models.h"

typedef struct clothes {
  uint16_t skin, hair, shirt, trousers, shoe;
} clothes;

static uint16_t tinted(pags_materials *materials, uint8_t label, const float (*colors)[3], int count, pags_dice *dice) {
  const float *c = colors[pags_dice_pick(dice, count)], light = pags_dice_between(dice, 0.85f, 1.15f);
  return pags_materials_plain(materials, label, c[0] * light, c[1] * light, c[2] * light);
}

static void choose_clothes(clothes *out, pags_materials *materials, pags_dice *dice, uint8_t label) {
  static const float skins[4][3] = {
      {0.56f, 0.36f, 0.26f}, {0.42f, 0.25f, 0.16f}, {0.24f, 0.13f, 0.08f}, {0.60f, 0.42f, 0.32f}};
  static const float hairs[4][3] = {
      {0.03f, 0.02f, 0.015f}, {0.12f, 0.07f, 0.03f}, {0.35f, 0.25f, 0.12f}, {0.25f, 0.25f, 0.25f}};
  static const float shirts[7][3] = {{0.50f, 0.06f, 0.06f}, {0.07f, 0.16f, 0.42f}, {0.60f, 0.58f, 0.54f},
                                     {0.06f, 0.30f, 0.18f}, {0.62f, 0.44f, 0.06f}, {0.30f, 0.10f, 0.32f},
                                     {0.08f, 0.08f, 0.09f}};
  static const float trousers[4][3] = {
      {0.04f, 0.07f, 0.16f}, {0.05f, 0.05f, 0.05f}, {0.30f, 0.25f, 0.17f}, {0.14f, 0.15f, 0.17f}};
  static const float shoes[2][3] = {{0.05f, 0.035f, 0.03f}, {0.5f, 0.5f, 0.5f}};
  out->skin = tinted(materials, label, skins, 4, dice);
  out->hair = tinted(materials, label, hairs, 4, dice);
  out->shirt = tinted(materials, label, shirts, 7, dice);
  out->trousers = tinted(materials, label, trousers, 4, dice);
  out->shoe = tinted(materials, label, shoes, 2, dice);
}

void pags_person_add(const pags_person *person, pags_materials *materials, pags_dice *dice, uint8_t label) {
  clothes wear;
  choose_clothes(&wear, materials, dice, label);
  pags_mesh *body = person->body, *arm = person->arm, *leg = person->leg;
  pags_mesh_ellipsoid(body, (float[3]){0, 0, 1.17f}, (float[3]){0.125f, 0.185f, 0.32f}, 14, wear.shirt);
  pags_mesh_ellipsoid(body, (float[3]){0, 0, 1.36f}, (float[3]){0.10f, 0.21f, 0.10f}, 14, wear.shirt);
  pags_mesh_ellipsoid(body, (float[3]){0, 0, 0.90f}, (float[3]){0.12f, 0.17f, 0.14f}, 14, wear.trousers);
  pags_mesh_tube(body, (float[3]){0, 0, 1.40f}, (float[3]){0.01f, 0, 1.54f}, 0.055f, 0.05f, 10, wear.skin);
  pags_mesh_ellipsoid(body, (float[3]){0.015f, 0, 1.62f}, (float[3]){0.095f, 0.078f, 0.12f}, 14, wear.skin);
  pags_mesh_ellipsoid(body, (float[3]){-0.012f, 0, 1.66f}, (float[3]){0.095f, 0.085f, 0.10f}, 14, wear.hair);
  pags_mesh_tube(arm, (float[3]){0, 0, 0}, (float[3]){0, 0, -0.30f}, 0.058f, 0.048f, 10, wear.shirt);
  pags_mesh_tube(arm, (float[3]){0, 0, -0.29f}, (float[3]){0.08f, 0, -0.54f}, 0.044f, 0.034f, 10, wear.skin);
  pags_mesh_ellipsoid(arm, (float[3]){0.10f, 0, -0.60f}, (float[3]){0.035f, 0.028f, 0.07f}, 8, wear.skin);
  pags_mesh_tube(leg, (float[3]){0, 0, 0.03f}, (float[3]){0.02f, 0, -0.42f}, 0.095f, 0.062f, 12, wear.trousers);
  pags_mesh_tube(leg, (float[3]){0.02f, 0, -0.41f}, (float[3]){0, 0, -0.82f}, 0.062f, 0.048f, 12, wear.trousers);
  pags_mesh_ellipsoid(leg, (float[3]){0.05f, 0, -0.84f}, (float[3]){0.13f, 0.05f, 0.045f}, 10, wear.shoe);
}
