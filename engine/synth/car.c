/* SPDX-License-Identifier: Apache-2.0 */
/* Adds meshes of cars (a body lofted along x, a cabin lofted upwards, wheels, lamps) and of bicycles (tubes). */
#include <math.h>

#include "maths/maths.h"
#include "synth/models.h"

enum { STATIONS = 12, AROUND = 20, LEVELS = 6 };

typedef struct car_parts {
  uint16_t paint, glass, black, hub, white, red, plate;
} car_parts;

static uint16_t all_paint(void *user, PAGS_UNUSED int ring, PAGS_UNUSED int column) {
  return ((const car_parts *)user)->paint;
}

/* The body's cross-sections from the tail to the nose. In each row: x (as a fraction of half the length), z of the
 * bottom and of the top (metres), half width (as a fraction of half the car's width). */
static const float side_view[STATIONS][4] = {
    {-1.000f, 0.48f, 0.70f, 0.80f}, {-0.985f, 0.36f, 0.86f, 0.90f}, {-0.93f, 0.27f, 0.94f, 0.96f},
    {-0.75f, 0.21f, 0.96f, 0.99f},  {-0.40f, 0.19f, 0.95f, 1.00f},  {0.00f, 0.19f, 0.94f, 1.00f},
    {0.32f, 0.19f, 0.93f, 1.00f},   {0.55f, 0.20f, 0.88f, 0.99f},   {0.80f, 0.22f, 0.80f, 0.96f},
    {0.93f, 0.25f, 0.73f, 0.91f},   {0.98f, 0.32f, 0.66f, 0.82f},   {1.000f, 0.42f, 0.58f, 0.70f}};

/* The left half of the cabin's outline seen from above, from the windscreen to the rear window: x and y as fractions
 * of half the cabin's length and width. */
enum { HALF_OUTLINE = 12, OUTLINE = 2 * HALF_OUTLINE };
static const float outline[HALF_OUTLINE][2] = {{1.0f, 0.35f},    {0.99f, 0.70f},  {0.95f, 0.90f},  {0.88f, 0.985f},
                                               {0.45f, 1.0f},    {0.03f, 1.0f},   {-0.07f, 1.0f},  {-0.50f, 1.0f},
                                               {-0.88f, 0.985f}, {-0.95f, 0.90f}, {-0.99f, 0.70f}, {-1.0f, 0.35f}};

/* Material of a cabin face (a callback of pags_mesh_loft): glass between the belt line and the roof, except for the
 * painted pillars at the corners and between the doors. */
static uint16_t cabin_material(void *user, int ring, int column) {
  const car_parts *parts = user;
  const int mirrored = column < HALF_OUTLINE ? column : OUTLINE - 2 - column;
  if (ring < 1 || ring >= LEVELS - 3)
    return parts->paint;
  return mirrored == 2 || mirrored == 5 || mirrored == 8 ? parts->paint : parts->glass;
}

/* Lofts the cabin through rings from the belt line to the roof. In each row of `levels`: height (metres), rear and
 * front end (as fractions of half the car's length), half width (as a fraction of half the car's width). */
static void add_cabin(pags_mesh *mesh, car_parts *parts, float length, float width, float height, int estate) {
  const float back = estate ? -0.93f : -0.72f, roof_back = estate ? -0.84f : -0.38f;
  const float levels[LEVELS][4] = {{0.90f, back, 0.44f, 0.93f},
                                   {0.95f, back + 0.02f, 0.41f, 0.92f},
                                   {0.5f * (0.95f + height - 0.12f), 0.5f * (back + 0.02f + roof_back), 0.27f, 0.86f},
                                   {height - 0.10f, roof_back, 0.13f, 0.79f},
                                   {height - 0.03f, roof_back + 0.05f, 0.08f, 0.72f},
                                   {height, roof_back + 0.16f, -0.03f, 0.55f}};
  float points[LEVELS * OUTLINE * 3];
  for (int i = 0; i < LEVELS; i++)
    for (int j = 0; j < OUTLINE; j++) {
      const float *l = levels[i], *o = outline[j < HALF_OUTLINE ? j : OUTLINE - 1 - j];
      float *p = points + 3 * (i * OUTLINE + j);
      p[0] = 0.5f * length * (0.5f * (l[1] + l[2]) + 0.5f * (l[2] - l[1]) * o[0]);
      p[1] = 0.5f * width * l[3] * (j < HALF_OUTLINE ? o[1] : -o[1]);
      p[2] = l[0];
    }
  pags_mesh_loft(mesh, LEVELS, OUTLINE, points, cabin_material, parts);
}

static void choose_parts(car_parts *parts, pags_materials *materials, pags_dice *dice, int kind) {
  static const float paints[10][3] = {{0.62f, 0.62f, 0.60f}, {0.03f, 0.03f, 0.035f}, {0.28f, 0.29f, 0.31f},
                                      {0.45f, 0.03f, 0.03f}, {0.04f, 0.10f, 0.32f},  {0.09f, 0.10f, 0.11f},
                                      {0.44f, 0.45f, 0.46f}, {0.05f, 0.17f, 0.12f},  {0.50f, 0.34f, 0.07f},
                                      {0.16f, 0.29f, 0.40f}};
  const float *color = paints[kind % 10];
  pags_material paint = {.finish = PAGS_FINISH_PAINT, .label = PAGS_CLASS_CAR, .gloss = 0.05f};
  for (int c = 0; c < 3; c++)
    paint.color[c] = color[c] * pags_dice_between(dice, 0.9f, 1.1f);
  const pags_material glass = {.label = PAGS_CLASS_CAR, .color = {0.025f, 0.03f, 0.032f}, .gloss = 0.08f};
  parts->paint = pags_materials_add(materials, &paint);
  parts->glass = pags_materials_add(materials, &glass);
  parts->black = pags_materials_plain(materials, PAGS_CLASS_CAR, 0.025f, 0.025f, 0.027f);
  parts->hub = pags_materials_plain(materials, PAGS_CLASS_CAR, 0.34f, 0.35f, 0.37f);
  parts->white = pags_materials_plain(materials, PAGS_CLASS_CAR, 0.85f, 0.85f, 0.80f);
  parts->red = pags_materials_plain(materials, PAGS_CLASS_CAR, 0.52f, 0.02f, 0.02f);
  parts->plate = pags_materials_plain(materials, PAGS_CLASS_CAR, 0.70f, 0.70f, 0.62f);
}

void pags_car_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice, int kind, float size[3]) {
  car_parts parts;
  const float length = pags_dice_between(dice, 4.1f, 4.75f), width = pags_dice_between(dice, 1.74f, 1.86f);
  const float height = pags_dice_between(dice, 1.42f, 1.56f);
  choose_parts(&parts, materials, dice, kind);

  /* The body: superellipses of exponent 4.5 across x, joined from tail to nose. */
  float points[STATIONS * AROUND * 3];
  for (int i = 0; i < STATIONS; i++)
    for (int j = 0; j < AROUND; j++) {
      /* The point of the superellipse |y|^n + |z|^n = 1 at this parameter. */
      const float *s = side_view[i], angle = 6.2831853f * ((float)j + 0.5f) / AROUND, n = 4.5f;
      const float cosine = pags_cosf(angle), sine = pags_sinf(angle);
      const float y = copysignf(pags_powf(fabsf(cosine), 2.0f / n), cosine);
      const float z = copysignf(pags_powf(fabsf(sine), 2.0f / n), sine);
      float *p = points + 3 * (i * AROUND + j);
      p[0] = 0.5f * length * s[0];
      p[1] = 0.5f * width * s[3] * y * (z > 0.0f ? 1.0f - 0.06f * z : 1.0f); /* sides lean inwards at the top */
      p[2] = 0.5f * (s[1] + s[2]) + 0.5f * (s[2] - s[1]) * z;
    }
  pags_mesh_loft(mesh, STATIONS, AROUND, points, all_paint, &parts);

  add_cabin(mesh, &parts, length, width, height, pags_dice_pick(dice, 2));

  /* The wheels: dark wheel arch, tyre and hub, as discs one before another. */
  for (int i = 0; i < 4; i++) {
    const float x = (i & 1 ? 0.30f : -0.30f) * length, side = i & 2 ? 1.0f : -1.0f, outer = 0.5f * width * side;
    const float inner[3] = {x, outer - 0.24f * side, 0.32f}, rim[3] = {x, outer + 0.010f * side, 0.32f};
    const float arch[3] = {x, outer + 0.004f * side, 0.34f}, behind[3] = {x, outer - 0.3f * side, 0.34f};
    pags_mesh_tube(mesh, behind, arch, 0.38f, 0.38f, 20, parts.black);
    pags_mesh_tube(mesh, inner, rim, 0.32f, 0.32f, 20, parts.black);
    pags_mesh_tube(mesh, rim, (float[3]){x, outer + 0.014f * side, 0.32f}, 0.22f, 0.20f, 16, parts.hub);
    pags_mesh_tube(mesh, rim, (float[3]){x, outer + 0.016f * side, 0.32f}, 0.17f, 0.17f, 16, parts.black);
    pags_mesh_tube(mesh, rim, (float[3]){x, outer + 0.020f * side, 0.32f}, 0.14f, 0.06f, 16, parts.hub);
  }

  /* Head and tail lamps, side mirrors, door handles, grille, number plates. */
  const float nose = 0.5f * length, y = 0.33f * width;
  for (int side = -1; side <= 1; side += 2) {
    const float s = (float)side;
    pags_mesh_ellipsoid(mesh, (float[3]){nose - 0.10f, s * y, 0.63f}, (float[3]){0.09f, 0.17f, 0.075f}, 10,
                        parts.white);
    pags_mesh_ellipsoid(mesh, (float[3]){-nose + 0.045f, s * y * 1.05f, 0.78f}, (float[3]){0.06f, 0.13f, 0.09f}, 10,
                        parts.red);
    pags_mesh_box(mesh, (float[3]){nose * 0.36f, s * (0.5f * width + 0.06f), 0.99f}, (float[3]){0.05f, 0.075f, 0.055f},
                  parts.paint);
    pags_mesh_box(mesh, (float[3]){-0.42f, s * (0.5f * width - 0.012f), 0.80f}, (float[3]){0.09f, 0.012f, 0.018f},
                  parts.hub);
  }
  pags_mesh_box(mesh, (float[3]){nose - 0.060f, 0, 0.36f}, (float[3]){0.03f, 0.46f, 0.06f}, parts.black);
  pags_mesh_box(mesh, (float[3]){nose + 0.004f, 0, 0.50f}, (float[3]){0.008f, 0.26f, 0.055f}, parts.plate);
  pags_mesh_box(mesh, (float[3]){-nose - 0.004f, 0, 0.60f}, (float[3]){0.008f, 0.26f, 0.055f}, parts.plate);

  size[0] = length + 0.04f;
  size[1] = width + 0.32f; /* with the side mirrors */
  size[2] = height + 0.02f;
}

static void rod(pags_mesh *mesh, float x0, float z0, float x1, float z1, uint16_t material) {
  pags_mesh_tube(mesh, (float[3]){x0, 0, z0}, (float[3]){x1, 0, z1}, 0.02f, 0.02f, 6, material);
}

/* Adds a bicycle wheel in the plane y = 0: the tyre as a ring of short tubes, and spokes. */
static void wheel(pags_mesh *mesh, float x, float radius, uint16_t tyre, uint16_t spoke) {
  enum { PARTS = 20 };
  for (int i = 0; i < PARTS; i++) {
    const float a = 6.2831853f * (float)i / PARTS, b = 6.2831853f * (float)(i + 1) / PARTS;
    const float from[3] = {x + radius * pags_cosf(a), 0, radius + 0.02f + radius * pags_sinf(a)};
    const float to[3] = {x + radius * pags_cosf(b), 0, radius + 0.02f + radius * pags_sinf(b)};
    pags_mesh_tube(mesh, from, to, 0.02f, 0.02f, 6, tyre);
    if (i % 2 == 0)
      pags_mesh_tube(mesh, from, (float[3]){x, 0, radius + 0.02f}, 0.004f, 0.004f, 3, spoke);
  }
}

void pags_bicycle_add(pags_mesh *mesh, pags_materials *materials, pags_dice *dice) {
  /* One after the other: C leaves the order of a call's arguments to the compiler. */
  const float blue = pags_dice_between(dice, 0.05f, 0.3f);
  const float green = pags_dice_between(dice, 0.05f, 0.3f);
  const float red = pags_dice_between(dice, 0.05f, 0.6f);
  const uint16_t frame = pags_materials_plain(materials, PAGS_CLASS_BICYCLE, red, green, blue);
  const uint16_t tyre = pags_materials_plain(materials, PAGS_CLASS_BICYCLE, 0.02f, 0.02f, 0.02f);
  const uint16_t metal = pags_materials_plain(materials, PAGS_CLASS_BICYCLE, 0.4f, 0.4f, 0.4f);
  wheel(mesh, -0.52f, 0.33f, tyre, metal);
  wheel(mesh, 0.52f, 0.33f, tyre, metal);
  rod(mesh, -0.52f, 0.35f, -0.05f, 0.30f, frame);
  rod(mesh, -0.52f, 0.35f, -0.18f, 0.80f, frame);
  rod(mesh, -0.05f, 0.30f, -0.20f, 0.92f, frame);
  rod(mesh, -0.05f, 0.30f, 0.38f, 0.82f, frame);
  rod(mesh, -0.17f, 0.80f, 0.38f, 0.86f, frame);
  rod(mesh, 0.52f, 0.35f, 0.36f, 1.02f, frame);
  pags_mesh_tube(mesh, (float[3]){0.36f, -0.26f, 1.03f}, (float[3]){0.36f, 0.26f, 1.03f}, 0.015f, 0.015f, 6, metal);
  pags_mesh_ellipsoid(mesh, (float[3]){-0.21f, 0, 0.94f}, (float[3]){0.14f, 0.08f, 0.04f}, 10, tyre);
}
