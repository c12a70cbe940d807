/* SPDX-License-Identifier: Apache-2.0 */
/* The growing list of materials, and the meshes of trees, street lamps, traffic signs and bins. */
#include <math.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"
#include "synth/models.h"

enum { MOST_MATERIALS = 65536, LEAVES = 5400 };

void pags_materials_destroy(pags_materials *materials) {
  free(materials->list);
  *materials = (pags_materials){0};
}

uint16_t pags_materials_add(pags_materials *materials, const pags_material *material) {
  if (materials->count >= MOST_MATERIALS ||
      !pags_grow(&materials->list, materials->count + 1, &materials->capacity, sizeof *material)) {
    materials->failed = true;
    return 0;
  }
  materials->list[materials->count] = *material;
  return (uint16_t)materials->count++;
}

uint16_t pags_materials_plain(pags_materials *materials, uint8_t label, float r, float g, float b) {
  return pags_materials_add(materials,
                            &(pags_material){.finish = PAGS_FINISH_PLAIN, .label = label, .color = {r, g, b}});
}

/* Draws a point uniformly in the unit ball, by rejection. */
static void ball_point(pags_dice *dice, float out[3]) {
  do {
    for (int k = 0; k < 3; k++)
      out[k] = pags_dice_between(dice, -1.0f, 1.0f);
  } while (pags_dot3f(out, out) > 1.0f);
}

/* A ball of leaves; a crown consists of several. */
typedef struct clump {
  float center[3], radius;
} clump;

/* Adds a leaf to a clump: a lozenge of random orientation. Its shading normal points away from the crown's centre,
 * with some jitter, so that the crown is shaded like a solid surface. */
static void add_leaf(pags_mesh *mesh, pags_dice *dice, const clump *part, const float crown[3], int number,
                     uint16_t material) {
  float at[3], x[3], y[3], normal[3];
  ball_point(dice, at);
  ball_point(dice, x);
  ball_point(dice, y);
  const float push = pags_powf(pags_dot3f(at, at) + 1e-6f, -0.3f); /* towards the surface */
  const float size = pags_dice_between(dice, 0.10f, 0.19f);
  for (int k = 0; k < 3; k++)
    at[k] = part->center[k] + part->radius * at[k] * push;
  pags_subtract3f(at, crown, normal);
  pags_divide3f(normal, sqrtf(pags_dot3f(normal, normal) + 1e-6f));
  pags_add_scaled3f(0.5f, x, normal);
  uint32_t corner[4];
  for (int i = 0; i < 4; i++) {
    float p[3];
    for (int k = 0; k < 3; k++)
      p[k] = at[k] + size * (i == 0 ? x[k] : i == 1 ? y[k] : i == 2 ? -x[k] : -y[k]);
    corner[i] = pags_mesh_vertex(mesh, p, normal, (float)number + 0.5f, 0.5f);
  }
  pags_mesh_face(mesh, corner[0], corner[1], corner[2], corner[3], material);
}

void pags_tree_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice) {
  enum { CLUMPS = 13 };
  const float green = pags_dice_between(dice, 0.14f, 0.22f),
              crown[3] = {0.0f, 0.0f, pags_dice_between(dice, 4.5f, 5.2f)};
  const pags_material bark = {.finish = PAGS_FINISH_MOTTLED,
                              .label = PAGS_CLASS_VEGETATION,
                              .color = {0.16f, 0.11f, 0.07f},
                              .second = {0.08f, 0.055f, 0.035f},
                              .size = 0.12f};
  const pags_material leaves = {.finish = PAGS_FINISH_LEAF,
                                .label = PAGS_CLASS_VEGETATION,
                                .color = {0.62f * green, green, 0.28f * green},
                                .second = {0.92f * green, 1.3f * green, 0.38f * green}};
  const uint16_t wood = pags_materials_add(materials, &bark), leaf = pags_materials_add(materials, &leaves);
  const float root[3] = {0.0f, 0.0f, 0.0f}, fork[3] = {0.06f, -0.04f, 2.7f};
  pags_mesh_tube(mesh, root, fork, 0.17f, 0.11f, 9, wood);
  for (int i = 0; i < CLUMPS; i++) {
    clump part;
    float offset[3];
    ball_point(dice, offset);
    part.radius = pags_dice_between(dice, 0.65f, 1.1f);
    for (int k = 0; k < 3; k++)
      part.center[k] = crown[k] + offset[k] * (k == 2 ? 1.5f : 1.6f);
    pags_mesh_tube(mesh, fork, part.center, 0.06f, 0.02f, 5, wood);
    for (int j = 0; j < LEAVES / CLUMPS; j++)
      add_leaf(mesh, dice, &part, crown, i * LEAVES + j, leaf);
  }
}

void pags_lamp_add(pags_mesh *mesh, pags_materials *materials) {
  const uint16_t metal = pags_materials_plain(materials, PAGS_CLASS_POLE, 0.16f, 0.18f, 0.18f);
  const uint16_t glass = pags_materials_plain(materials, PAGS_CLASS_POLE, 0.75f, 0.73f, 0.66f);
  const float foot[3] = {0, 0, 0}, knee[3] = {0, 0, 0.9f}, top[3] = {0, 0, 6.6f}, arm[3] = {0, 1.9f, 7.0f};
  pags_mesh_tube(mesh, foot, knee, 0.11f, 0.10f, 10, metal);
  pags_mesh_tube(mesh, knee, top, 0.075f, 0.05f, 10, metal);
  pags_mesh_tube(mesh, top, arm, 0.05f, 0.04f, 8, metal);
  pags_mesh_box(mesh, (float[3]){0, 2.2f, 7.03f}, (float[3]){0.14f, 0.42f, 0.06f}, metal);
  pags_mesh_box(mesh, (float[3]){0, 2.2f, 6.96f}, (float[3]){0.11f, 0.36f, 0.015f}, glass);
}

/* Adds a round sign at height z that faces -x: a disc of material `rim`, and before it a smaller one of `face`. */
static void disc(pags_mesh *mesh, float z, float radius, int sides, uint16_t rim, uint16_t face) {
  pags_mesh_tube(mesh, (float[3]){-0.045f, 0, z}, (float[3]){-0.03f, 0, z}, radius, radius, sides, rim);
  pags_mesh_tube(mesh, (float[3]){-0.052f, 0, z}, (float[3]){-0.04f, 0, z}, 0.78f * radius, 0.78f * radius, sides,
                 face);
}

void pags_sign_add(pags_mesh *mesh, pags_materials *materials, int kind) {
  const uint16_t metal = pags_materials_plain(materials, PAGS_CLASS_POLE, 0.38f, 0.39f, 0.40f);
  const uint16_t red = pags_materials_plain(materials, PAGS_CLASS_SIGN, 0.62f, 0.03f, 0.03f);
  const uint16_t white = pags_materials_plain(materials, PAGS_CLASS_SIGN, 0.80f, 0.80f, 0.78f);
  const uint16_t blue = pags_materials_plain(materials, PAGS_CLASS_SIGN, 0.03f, 0.14f, 0.48f);
  pags_mesh_tube(mesh, (float[3]){0, 0, 0}, (float[3]){0, 0, 2.75f}, 0.035f, 0.035f, 8, metal);
  if (kind == 0) { /* speed limit */
    disc(mesh, 2.4f, 0.32f, 20, red, white);
  } else if (kind == 1) { /* crossing */
    pags_mesh_box(mesh, (float[3]){-0.04f, 0, 2.4f}, (float[3]){0.01f, 0.32f, 0.32f}, blue);
    const uint32_t a = pags_mesh_vertex(mesh, (float[3]){-0.055f, -0.24f, 2.18f}, NULL, 0, 0);
    const uint32_t b = pags_mesh_vertex(mesh, (float[3]){-0.055f, 0.24f, 2.18f}, NULL, 0, 0);
    const uint32_t c = pags_mesh_vertex(mesh, (float[3]){-0.055f, 0.0f, 2.62f}, NULL, 0, 0);
    pags_mesh_face(mesh, a, b, c, c, white);
  } else { /* no parking */
    disc(mesh, 2.4f, 0.30f, 20, red, blue);
  }
}

void pags_bin_add(pags_mesh *mesh, pags_materials *materials) {
  const uint16_t green = pags_materials_plain(materials, PAGS_CLASS_POLE, 0.05f, 0.13f, 0.08f);
  const uint16_t lid = pags_materials_plain(materials, PAGS_CLASS_POLE, 0.03f, 0.03f, 0.03f);
  pags_mesh_tube(mesh, (float[3]){0, 0, 0}, (float[3]){0, 0, 0.85f}, 0.22f, 0.27f, 14, green);
  pags_mesh_tube(mesh, (float[3]){0, 0, 0.85f}, (float[3]){0, 0, 0.95f}, 0.29f, 0.2f, 14, lid);
}
