/* SPDX-License-Identifier: Apache-2.0 */
/* Adds meshes of terraced houses: fronts with windows set back into the wall, doors, shops, balconies and cornices;
 * flat or tiled roofs. Measures and materials are drawn at random for each house. */
#include <math.h>

#include "synth/models.h"

/* The measures and materials of the house that is being built. Below, u is metres along the front from its corner, z
 * metres above the plot's ground. */
typedef struct house {
  pags_mesh *mesh;
  pags_dice *dice;
  const pags_plot *plot;
  int floors, bays;
  float ground, storey; /* height of the ground floor and of each floor above, metres */
  float window_width, window_height;
  float shade; /* random offset of the walls' u texture coordinate, so that no two houses share a pattern */
  uint16_t wall, trim, glass, door, roof, shop_glass, sign, iron;
} house;

static const float up[3] = {0.0f, 0.0f, 1.0f};

/* ---- Pieces of a front ---- */

/* World position of the point u metres along the front, d metres into the house and z metres up. */
static void at(const house *h, float u, float d, float z, float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = h->plot->base[k] + u * h->plot->along[k] + d * h->plot->into[k] + z * up[k];
}

/* Adds a quad from the point `from` (u, d, z) with two edges in the same coordinates. */
static void quad(const house *h, const float from[3], const float edge[3], const float rise[3], const float uv[2],
                 uint16_t material) {
  const float *ways[2] = {edge, rise};
  float corner[3], edges[2][3];
  at(h, from[0], from[1], from[2], corner);
  for (int i = 0; i < 2; i++)
    for (int k = 0; k < 3; k++)
      edges[i][k] = ways[i][0] * h->plot->along[k] + ways[i][1] * h->plot->into[k] + ways[i][2] * up[k];
  pags_mesh_quad(h->mesh, corner, edges[0], edges[1], uv, material);
}

/* Adds the wall rectangle [u0, u1] x [z0, z1], parallel to the front and d metres behind it, unless it is empty. */
static void piece(const house *h, float u0, float u1, float z0, float z1, float d, uint16_t material) {
  if (u1 > u0 && z1 > z0)
    quad(h, (float[3]){u0, d, z0}, (float[3]){u1 - u0, 0, 0}, (float[3]){0, 0, z1 - z0}, (float[2]){u0 + h->shade, z0},
         material);
}

/* Adds a box over [u0, u1] x [z0, z1] that reaches `out` metres from the front plane towards the street (into the
 * house where negative). */
static void block(const house *h, float u0, float u1, float z0, float z1, float out, uint16_t material) {
  float center[3], half[3];
  at(h, 0.5f * (u0 + u1), -0.5f * out, 0.5f * (z0 + z1), center);
  for (int k = 0; k < 3; k++)
    half[k] = fabsf(h->plot->along[k]) * 0.5f * (u1 - u0) + fabsf(h->plot->into[k]) * 0.5f * fabsf(out) +
              up[k] * 0.5f * (z1 - z0);
  pags_mesh_box(h->mesh, center, half, material);
}

/* Adds the four side faces (reveal) of an opening in the front that is `depth` metres deep. */
static void reveal(const house *h, float u0, float u1, float z0, float z1, float depth) {
  const float uv[2] = {u0 + h->shade, z0}, in[3] = {0, depth, 0}, rise[3] = {0, 0, z1 - z0}, wide[3] = {u1 - u0, 0, 0};
  quad(h, (float[3]){u0, 0, z0}, in, rise, uv, h->wall);
  quad(h, (float[3]){u0, 0, z0}, wide, in, uv, h->trim);
  quad(h, (float[3]){u1, 0, z0}, in, rise, uv, h->wall);
  quad(h, (float[3]){u0, 0, z1}, wide, in, uv, h->wall);
}

/* Adds a quad of glass that shows `panes` windows side by side. Each window covers one unit of u and v; the whole
 * parts of u and v are random numbers, from which the window's curtains are chosen (PAGS_FINISH_WINDOW). */
static void pane(const house *h, float u0, float u1, float z0, float z1, float depth, int panes, uint16_t material) {
  const float number = floorf(pags_dice_between(h->dice, 0.0f, 4096.0f)),
              row = floorf(pags_dice_between(h->dice, 0.0f, 4096.0f));
  uint32_t corner[4];
  for (int i = 0; i < 4; i++) {
    const int right = i == 1 || i == 2, high = i >= 2;
    float p[3];
    at(h, right ? u1 : u0, depth, high ? z1 : z0, p);
    corner[i] = pags_mesh_vertex(h->mesh, p, NULL, number + (right ? (float)panes - 1e-3f : 0.0f) + 5e-4f,
                                 row + (high ? 0.9995f : 5e-4f));
  }
  pags_mesh_face(h->mesh, corner[0], corner[1], corner[2], corner[3], material);
}

/* Adds the wall rectangle `wall` (u0, u1, z0, z1) without the opening `hole` (same order), `depth` metres deep, in it.
 */
static void wall_around(const house *h, const float wall[4], const float hole[4], float depth) {
  piece(h, wall[0], hole[0], wall[2], wall[3], 0.0f, h->wall);
  piece(h, hole[1], wall[1], wall[2], wall[3], 0.0f, h->wall);
  piece(h, hole[0], hole[1], wall[2], hole[2], 0.0f, h->wall);
  piece(h, hole[0], hole[1], hole[3], wall[3], 0.0f, h->wall);
  reveal(h, hole[0], hole[1], hole[2], hole[3], depth);
}

static void window_bay(const house *h, float u0, float u1, float z0, float z1) {
  const float middle = 0.5f * (u0 + u1), sill = z0 + 0.9f;
  const float hole[4] = {middle - 0.5f * h->window_width, middle + 0.5f * h->window_width, sill,
                         sill + h->window_height};
  const float wall[4] = {u0, u1, z0, z1};
  wall_around(h, wall, hole, 0.2f);
  pane(h, hole[0], hole[1], hole[2], hole[3], 0.2f, 1, h->glass);
  block(h, hole[0] - 0.08f, hole[1] + 0.08f, hole[2] - 0.09f, hole[2], 0.1f, h->trim);
  if (h->floors % 2)
    block(h, hole[0] - 0.08f, hole[1] + 0.08f, hole[3], hole[3] + 0.16f, 0.06f, h->trim);
}

static void door_bay(const house *h, float u0, float u1, float z1) {
  const float middle = 0.5f * (u0 + u1);
  const float hole[4] = {middle - 0.55f, middle + 0.55f, 0.15f, 2.35f}, wall[4] = {u0, u1, 0.0f, z1};
  wall_around(h, wall, hole, 0.3f);
  piece(h, hole[0], hole[1], hole[2], 1.95f, 0.3f, h->door);
  pane(h, hole[0], hole[1], 1.95f, hole[3], 0.3f, 1, h->glass);
  block(h, hole[0] - 0.15f, hole[1] + 0.15f, 0.0f, 0.15f, 0.5f, h->trim);
  block(h, hole[0] - 0.2f, hole[1] + 0.2f, 2.5f, 2.62f, 0.7f, h->trim);
}

/* Adds a row of blocks that resemble letters on the signboard of a shop. */
static void letters(const house *h, float z0, float z1) {
  const int count = 4 + pags_dice_pick(h->dice, 6);
  const float middle = h->plot->width * pags_dice_between(h->dice, 0.3f, 0.7f), step = 0.8f * (z1 - z0);
  for (int i = 0; i < count; i++) {
    const float u = middle + step * ((float)i - 0.5f * (float)count),
                wide = step * pags_dice_between(h->dice, 0.35f, 0.75f);
    const int shape = pags_dice_pick(h->dice, 3);
    if (u < 0.5f || u + wide > h->plot->width - 0.5f)
      continue;
    block(h, u, u + 0.25f * wide, z0, z1, 0.15f, h->trim);
    block(h, u, u + wide, shape == 1 ? z0 : z1 - 0.2f * (z1 - z0), shape == 1 ? z0 + 0.2f * (z1 - z0) : z1, 0.15f,
          h->trim);
    if (shape == 2)
      block(h, u + 0.75f * wide, u + wide, z0, z1, 0.15f, h->trim);
  }
}

/* Adds a balcony: a slab with a railing in front of a window. */
static void balcony(const house *h, float u0, float u1, float z) {
  block(h, u0, u1, z - 0.12f, z, 0.95f, h->trim);
  const float last = u1 - 0.03f;
  block(h, u0, u0 + 0.03f, z + 0.95f, z + 1.0f, 0.95f, h->iron); /* the rails at the sides */
  block(h, last, last + 0.03f, z + 0.95f, z + 1.0f, 0.95f, h->iron);
  for (float u = u0; u < u1; u += 0.13f) {
    float foot[3], top[3];
    at(h, u + 0.02f, -0.92f, z, foot);
    at(h, u + 0.02f, -0.92f, z + 0.95f, top);
    pags_mesh_tube(h->mesh, foot, top, 0.012f, 0.012f, 4, h->iron);
  }
  float from[3], to[3];
  at(h, u0, -0.92f, z + 0.97f, from);
  at(h, u1, -0.92f, z + 0.97f, to);
  pags_mesh_tube(h->mesh, from, to, 0.03f, 0.03f, 6, h->iron);
}

/* ---- Floors ---- */

/* Adds a ground floor with a shop over the whole front: panes between pillars, a signboard above, an awning on half
 * of the shops. */
static void shop_floor(const house *h) {
  const float step = h->plot->width / (float)h->bays;
  for (int i = 0; i < h->bays; i++) {
    const float u0 = step * (float)i, u1 = u0 + step;
    const float hole[4] = {u0 + 0.18f, u1 - 0.18f, i == h->bays / 2 ? 0.05f : 0.5f, h->ground - 0.85f};
    const float wall[4] = {u0, u1, 0.0f, h->ground};
    wall_around(h, wall, hole, 0.25f);
    pane(h, hole[0], hole[1], hole[2], hole[3], 0.25f, 2, h->shop_glass);
  }
  block(h, 0.3f, h->plot->width - 0.3f, h->ground - 0.75f, h->ground - 0.2f, 0.12f, h->sign);
  letters(h, h->ground - 0.64f, h->ground - 0.32f);
  if (pags_dice_pick(h->dice, 2))
    quad(h, (float[3]){0.4f, 0, h->ground - 0.85f}, (float[3]){h->plot->width - 0.8f, 0, 0},
         (float[3]){0, -1.1f, -0.45f}, NULL, h->sign);
}

/* ---- Walls and roofs ---- */

/* Adds a gable roof whose ridge runs along the front, the gable walls at both sides and a chimney. */
static void tiled_roof(const house *h, float top) {
  const pags_plot *plot = h->plot;
  const float rise = 0.32f * plot->depth, half = 0.5f * plot->depth;
  float corner[3], apex[3], a[3], b[3];
  for (int side = 0; side < 2; side++) {
    quad(h, (float[3]){0, side ? plot->depth + 0.35f : -0.35f, top - 0.2f}, (float[3]){plot->width, 0, 0},
         (float[3]){0, (side ? -1.0f : 1.0f) * (half + 0.35f), rise + 0.2f}, (float[2]){h->shade, 0}, h->roof);
    const float u = side ? plot->width : 0.0f;
    at(h, u, 0.0f, top, a);
    at(h, u, plot->depth, top, b);
    at(h, u, half, top + rise, apex);
    const uint32_t first = pags_mesh_vertex(h->mesh, a, NULL, 0.0f, top),
                   second = pags_mesh_vertex(h->mesh, b, NULL, plot->depth, top);
    const uint32_t third = pags_mesh_vertex(h->mesh, apex, NULL, half, top + rise);
    pags_mesh_face(h->mesh, first, second, third, third, h->wall);
  }
  at(h, 0.3f * plot->width, 0.55f * plot->depth, top + rise, corner);
  pags_mesh_box(h->mesh, corner, (float[3]){0.35f, 0.35f, 0.9f}, h->wall);
}

/* ---- Materials and the whole house ---- */

static void choose_wall(pags_material *wall, pags_dice *dice) {
  static const float bricks[4][3] = {
      {0.33f, 0.13f, 0.08f}, {0.42f, 0.24f, 0.13f}, {0.46f, 0.36f, 0.22f}, {0.26f, 0.14f, 0.11f}};
  static const float washes[6][3] = {{0.62f, 0.55f, 0.42f}, {0.60f, 0.46f, 0.30f}, {0.55f, 0.57f, 0.55f},
                                     {0.62f, 0.40f, 0.30f}, {0.42f, 0.50f, 0.52f}, {0.66f, 0.62f, 0.56f}};
  const int brick = pags_dice_pick(dice, 2);
  const float *color = brick ? bricks[pags_dice_pick(dice, 4)] : washes[pags_dice_pick(dice, 6)];
  *wall = (pags_material){.finish = brick ? PAGS_FINISH_BRICK : PAGS_FINISH_PLASTER, .label = PAGS_CLASS_BUILDING};
  for (int c = 0; c < 3; c++) {
    wall->color[c] = color[c] * pags_dice_between(dice, 0.9f, 1.1f);
    wall->second[c] = 0.42f - 0.03f * (float)c;
  }
}

static void choose_materials(house *h, pags_materials *materials) {
  static const float signs[6][3] = {{0.55f, 0.06f, 0.05f}, {0.05f, 0.20f, 0.42f}, {0.06f, 0.30f, 0.14f},
                                    {0.60f, 0.45f, 0.06f}, {0.10f, 0.10f, 0.11f}, {0.50f, 0.48f, 0.44f}};
  static const float doors[4][3] = {
      {0.20f, 0.06f, 0.04f}, {0.04f, 0.14f, 0.10f}, {0.05f, 0.08f, 0.18f}, {0.24f, 0.14f, 0.07f}};
  pags_material wall;
  choose_wall(&wall, h->dice);
  h->wall = pags_materials_add(materials, &wall);
  const float trim = pags_dice_between(h->dice, 0.38f, 0.66f);
  h->trim = pags_materials_plain(materials, PAGS_CLASS_BUILDING, trim, 0.97f * trim, 0.9f * trim);
  const float bar = pags_dice_pick(h->dice, 3) ? 0.62f : 0.08f;
  pags_material glass = {.finish = PAGS_FINISH_WINDOW,
                         .label = PAGS_CLASS_BUILDING,
                         .color = {0.035f, 0.04f, 0.045f},
                         .second = {bar, bar, bar},
                         .size = h->window_width,
                         .gloss = 0.06f};
  h->glass = pags_materials_add(materials, &glass);
  glass.size = h->plot->width / (float)h->bays / 2.0f;
  memcpy(glass.second, (float[3]){0.09f, 0.09f, 0.09f}, sizeof glass.second);
  h->shop_glass = pags_materials_add(materials, &glass);
  const float *door = doors[pags_dice_pick(h->dice, 4)], *sign = signs[pags_dice_pick(h->dice, 6)];
  h->door = pags_materials_plain(materials, PAGS_CLASS_BUILDING, door[0], door[1], door[2]);
  h->iron = pags_materials_plain(materials, PAGS_CLASS_BUILDING, 0.05f, 0.055f, 0.055f);
  h->sign = pags_materials_plain(materials, PAGS_CLASS_BUILDING, sign[0], sign[1], sign[2]);
}

void pags_building_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice, const pags_plot *plot) {
  house h = {.mesh = mesh, .dice = dice, .plot = plot};
  h.floors = 2 + pags_dice_pick(dice, 4);
  h.bays = (int)(plot->width / pags_dice_between(dice, 2.3f, 3.2f));
  h.bays = h.bays < 2 ? 2 : h.bays;
  h.storey = pags_dice_between(dice, 2.9f, 3.4f);
  h.window_width = pags_dice_between(dice, 1.0f, 1.45f);
  h.window_height = pags_dice_between(dice, 1.3f, 1.75f);
  h.shade = pags_dice_between(dice, 0.0f, 900.0f);
  choose_materials(&h, materials);
  const bool shop = pags_dice_pick(dice, 5) < 2, tiled = h.floors <= 3 && pags_dice_pick(dice, 3) < 2;
  h.ground = shop ? 3.9f : h.storey;

  /* Roof material: red tiles on a gable roof, plain grey on a flat one. */
  const float red = pags_dice_between(h.dice, 0.18f, 0.34f);
  const pags_material roof = {.finish = tiled ? PAGS_FINISH_TILES : PAGS_FINISH_PLAIN,
                              .label = PAGS_CLASS_BUILDING,
                              .color = {red, tiled ? 0.45f * red : red, tiled ? 0.3f * red : red}};
  h.roof = pags_materials_add(materials, &roof);

  const float step = plot->width / (float)h.bays;
  if (shop)
    shop_floor(&h);
  else {
    const int door = pags_dice_pick(dice, h.bays);
    for (int i = 0; i < h.bays; i++)
      if (i == door)
        door_bay(&h, step * (float)i, step * (float)(i + 1), h.ground);
      else
        window_bay(&h, step * (float)i, step * (float)(i + 1), 0.0f, h.ground);
    block(&h, 0.0f, plot->width, 0.0f, 0.45f, 0.04f, h.trim);
  }
  const int balconies = pags_dice_pick(dice, 3) ? -1 : pags_dice_pick(dice, h.bays); /* their bay; -1: none */
  const float top = h.ground + h.storey * (float)(h.floors - 1) + (tiled ? 0.2f : 0.9f);
  for (int f = 1; f < h.floors; f++)
    for (int i = 0; i < h.bays; i++) {
      const float z = h.ground + h.storey * (float)(f - 1);
      window_bay(&h, step * (float)i, step * (float)(i + 1), z, z + h.storey);
      if (i == balconies)
        balcony(&h, step * (float)i + 0.2f, step * (float)(i + 1) - 0.2f, z + 0.1f);
    }
  float foot[3], gutter[3];
  at(&h, 0.12f, -0.07f, 0.0f, foot);
  at(&h, 0.12f, -0.07f, top - 0.3f, gutter);
  pags_mesh_tube(mesh, foot, gutter, 0.05f, 0.05f, 8, h.iron);
  piece(&h, 0.0f, plot->width, h.ground + h.storey * (float)(h.floors - 1), top, 0.0f, h.wall);
  block(&h, -0.02f, plot->width + 0.02f, h.ground - 0.1f, h.ground + 0.08f, 0.1f, h.trim);
  block(&h, -0.03f, plot->width + 0.03f, top - 0.35f, top - 0.12f, 0.22f, h.trim);

  /* Plain walls at both sides and the back. */
  const float uv[2] = {h.shade, 0}, rise[3] = {0, 0, top}, in[3] = {0, plot->depth, 0}, wide[3] = {plot->width, 0, 0};
  quad(&h, (float[3]){0, 0, 0}, in, rise, uv, h.wall);
  quad(&h, wide, in, rise, uv, h.wall);
  quad(&h, in, wide, rise, uv, h.wall);
  if (tiled)
    tiled_roof(&h, top);
  else {
    quad(&h, (float[3]){0, 0, top - 0.5f}, wide, in, NULL, h.roof);
    block(&h, -0.02f, plot->width + 0.02f, top - 0.12f, top + 0.08f, -0.35f, h.trim);
  }
}
