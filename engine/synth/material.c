/* SPDX-License-Identifier: Apache-2.0 */
/* Procedural textures of the street: reflectance of asphalt, brick, plaster, roof tiles, windows and so on. Patterns
 * are sums of box-filtered pulses and of noise that fade to their mean where the sample's footprint becomes wider
 * than the pattern, so that they do not alias. */
#include "synth/material.h"

#include <math.h>

#include "base/vec3.h"
#include "maths/maths.h"
#include "synth/street.h"

/* ---- Filtered pulses and noise ---- */

static float mix(float a, float b, float t) {
  return a + (b - a) * t;
}

static void mix_color(const float a[3], const float b[3], float t, float out[3]) {
  for (int c = 0; c < 3; c++)
    out[c] = mix(a[c], b[c], t);
}

static float clamp01(float v) {
  return v < 0.0f ? 0.0f : v > 1.0f ? 1.0f : v;
}

static float fraction(float v) {
  return v - floorf(v);
}

/* A hashed random value at an integer position. */
static float lattice2(int32_t x, int32_t y, uint32_t seed) {
  uint32_t h = seed + (uint32_t)x * 0x9e3779b1u + (uint32_t)y * 0x85ebca77u;
  h = (h ^ h >> 15) * 0x2c1b3c6du;
  h = (h ^ h >> 12) * 0x297a2d39u;
  return (float)((h ^ h >> 15) >> 8) * 0x1p-24f;
}

/* Interpolates them by the smoothstep 3 t^2 - 2 t^3. */
float pags_noise2(float x, float y, uint32_t seed) {
  const float lowx = floorf(x), lowy = floorf(y), fx = x - lowx, fy = y - lowy;
  const int32_t i = (int32_t)lowx, j = (int32_t)lowy;
  const float u = fx * fx * (3.0f - 2.0f * fx), v = fy * fy * (3.0f - 2.0f * fy);
  return mix(mix(lattice2(i, j, seed), lattice2(i + 1, j, seed), u),
             mix(lattice2(i, j + 1, seed), lattice2(i + 1, j + 1, seed), u), v);
}

/* Value noise in the plane with cells of side `size`, in [-1, 1]. It fades to 0, its mean, as the filter width grows
 * from half a cell to a whole one. */
static float noise2(float x, float y, float size, float width, uint64_t seed) {
  const float keep = clamp01(2.0f - 2.0f * width / size);
  if (keep <= 0.0f)
    return 0.0f;
  return keep * (2.0f * pags_noise2(x / size, y / size, (uint32_t)seed * 0x9e3779b1u) - 1.0f);
}

/* Random number in [0, 1) for the unit cell that contains (x, y): a hash of the cell and the seed. */
static float cell_value(float x, float y, uint64_t seed) {
  uint64_t h =
      seed + (uint32_t)(int32_t)floorf(x) * 0x9e3779b97f4a7c15u + (uint32_t)(int32_t)floorf(y) * 0xc2b2ae3d27d4eb4fu;
  h = (h ^ h >> 33) * 0xff51afd7ed558ccdu;
  h = (h ^ h >> 33) * 0xc4ceb9fe1a85ec53u;
  return (float)(h >> 40) * 0x1p-24f;
}

/* Share, 0..1, of the interval [x - width/2, x + width/2] that lies within [lo, hi]: a box-filtered pulse. */
static float pulse(float x, float lo, float hi, float width) {
  const float w = width > 1e-4f ? width : 1e-4f, half = 0.5f * w;
  const float from = fmaxf(x - half, lo), to = fminf(x + half, hi);
  return to > from ? (to - from) / w : 0.0f;
}

/* Integral from 0 to x of the pulse train that is 1 in the first `duty` (0..1) of each unit interval, else 0. */
static float train_integral(float x, float duty) {
  return floorf(x) * duty + fminf(fraction(x), duty);
}

/* Mean of that pulse train, whose period is 1, over [x - width/2, x + width/2]. */
static float pulse_train(float x, float duty, float width) {
  const float w = width > 1e-4f ? width : 1e-4f;
  return (train_integral(x + 0.5f * w, duty) - train_integral(x - 0.5f * w, duty)) / w;
}

/* ---- Road and pavement ---- */

/* Share of the footprint whose y, across the road, lies within [lo, hi]: a marking along the road. */
static float line(const pags_touch *touch, const pags_footprint *print, float lo, float hi) {
  return pulse(touch->point[1], lo, hi, print->y);
}

/* Share of the footprint that is covered by road markings: lane lines, parking bays, zebra crossings, stop lines. */
static float marking_share(const pags_markings *markings, const pags_touch *touch, const pags_footprint *print) {
  const float x = touch->point[0], phase = (x - markings->first_crossing) / markings->spacing;
  const float from_zebra = (phase - floorf(phase + 0.5f)) * markings->spacing, half = 0.5f * PAGS_ZEBRA;
  const float clear = 1.0f - pulse(from_zebra, -half - 2.0f, half + 2.0f, print->x);
  const float dashes = pulse_train(x / 9.0f, 0.4f, print->x / 9.0f);
  const float bays = pulse_train(x / PAGS_PARKING_BAY, 0.1f / PAGS_PARKING_BAY, print->x / PAGS_PARKING_BAY);
  float share = pulse(from_zebra, -half, half, print->x) *
                line(touch, print, PAGS_PARKING_RIGHT + 0.2f, PAGS_PARKING_LEFT - 0.2f) *
                pulse_train(touch->point[1] / 1.1f + 0.2f, 0.5f, print->y / 1.1f);
  share +=
      clear * (line(touch, print, 0.08f, 0.2f) + line(touch, print, -0.2f, -0.08f)); /* double line in the middle */
  share += clear * dashes * line(touch, print, PAGS_LANE_EDGE - 0.07f, PAGS_LANE_EDGE + 0.07f);
  share += clear * (line(touch, print, PAGS_PARKING_LEFT - 0.1f, PAGS_PARKING_LEFT) +
                    line(touch, print, PAGS_PARKING_RIGHT, PAGS_PARKING_RIGHT + 0.1f));
  share +=
      pulse(from_zebra, -half - 1.5f, -half - 1.1f, print->x) * line(touch, print, PAGS_PARKING_RIGHT + 0.2f, -0.25f);
  share +=
      clear * bays *
      (line(touch, print, PAGS_PARKING_LEFT, PAGS_KERB_LEFT) + line(touch, print, PAGS_KERB_RIGHT, PAGS_PARKING_RIGHT));
  return clamp01(share);
}

static void asphalt(const pags_material *m, const pags_markings *markings, const pags_touch *touch,
                    const pags_footprint *print, uint64_t seed, float color[3]) {
  static const float paint[3] = {0.70f, 0.69f, 0.65f};
  const float x = touch->point[0], y = touch->point[1];
  const float coarse = noise2(x, y * 3.0f, 5.0f, print->x, seed), fine = noise2(x, y, 0.07f, print->x, seed + 1);
  const float patch = cell_value(x / 7.0f, y / 3.3f, seed + 2) < 0.12f ? 0.82f : 1.0f; /* darker repairs */
  const float tracks = 0.06f * pags_cosf(3.8080f * (y + 1.65f));                       /* two wheel tracks a lane */
  const float light = patch * (1.0f + 0.16f * coarse + 0.14f * fine + tracks);
  pags_scale3f(light, m->color, color);
  const float worn = clamp01(0.9f + 0.35f * noise2(x, y, 0.35f, print->x, seed + 3));
  mix_color(color, paint, worn * marking_share(markings, touch, print), color);
}

static void paving(const pags_material *m, const pags_touch *touch, const pags_footprint *print, uint64_t seed,
                   float color[3]) {
  const float row = touch->point[1] / m->size, shift = 0.5f * fmodf(floorf(row), 2.0f), length = 1.5f * m->size;
  const float column = touch->point[0] / length + shift, keep = clamp01(1.5f - print->x / m->size);
  const float joint =
      fmaxf(pulse_train(row, 0.035f, print->y / m->size), pulse_train(column, 0.025f, print->x / length));
  const float tone = keep * (cell_value(column, row, seed + 4) - 0.5f);
  const float dirt = noise2(touch->point[0], touch->point[1], 1.7f, print->x, seed + 5);
  for (int c = 0; c < 3; c++)
    color[c] = mix(m->color[c] * (1.0f + 0.22f * tone + 0.14f * dirt), m->second[c], joint);
}

/* ---- Houses ---- */

enum { BRICK_LENGTH_MM = 250, BRICK_HEIGHT_MM = 83 };

static void brick(const pags_material *m, const pags_touch *touch, float width, uint64_t seed, float color[3]) {
  const float row = touch->uv[1] / (BRICK_HEIGHT_MM * 1e-3f);
  const float column = touch->uv[0] / (BRICK_LENGTH_MM * 1e-3f) + 0.5f * fmodf(floorf(row), 2.0f);
  const float w = width / (BRICK_HEIGHT_MM * 1e-3f), wide = width / (BRICK_LENGTH_MM * 1e-3f);
  const float mortar = 1.0f - (1.0f - pulse_train(row, 0.15f, w)) * (1.0f - pulse_train(column, 0.05f, wide));
  const float tone = clamp01(1.5f - wide) * (cell_value(column, row, seed + 6) - 0.5f);
  const float stain = noise2(touch->uv[0], touch->uv[1], 2.3f, width, seed + 7);
  for (int c = 0; c < 3; c++)
    color[c] = mix(m->color[c] * (1.0f + 0.55f * tone), m->second[c], mortar) * (1.0f + 0.15f * stain);
}

static void plaster(const pags_material *m, const pags_touch *touch, float width, uint64_t seed, float color[3]) {
  const float u = touch->uv[0], v = touch->uv[1];
  const float streak = noise2(3.0f * u, 0.4f * v, 0.9f, width, seed + 8), blot = noise2(u, v, 2.9f, width, seed + 9);
  const float grain = noise2(u, v, 0.09f, width, seed + 10);
  const float light = 1.0f + 0.09f * streak + 0.12f * blot + 0.06f * grain;
  pags_scale3f(light, m->color, color);
}

static void tiles(const pags_material *m, const pags_touch *touch, float width, uint64_t seed, float color[3]) {
  const float row = touch->uv[1] / 0.3f, column = touch->uv[0] / 0.22f + 0.5f * fmodf(floorf(row), 2.0f),
              w = width / 0.25f;
  const float keep = clamp01(1.5f - w), tone = keep * (cell_value(column, row, seed + 11) - 0.5f);
  const float light =
      1.0f + 0.4f * tone - 0.45f * (pulse_train(row, 0.15f, w) - 0.15f) + keep * 0.25f * (fraction(row) - 0.5f);
  pags_scale3f(light, m->color, color);
}

/* A window: curtains, blinds or a dark room behind the panes, chosen by the window's number; `second` is the colour
 * of its bars. */
static void window(const pags_material *m, const pags_touch *touch, float width, uint64_t seed, float color[3]) {
  const float u = touch->uv[0], v = touch->uv[1], w = width / m->size;
  const float kind = cell_value(u, v, seed + 12), tone = cell_value(u, v, seed + 13);
  const float x = fraction(u), y = fraction(v);
  const float bars = fmaxf(1.0f - pulse(x, 0.05f, 0.95f, w) * pulse(y, 0.04f, 0.96f, w),
                           fmaxf(pulse(x, 0.475f, 0.525f, w), pulse(y, 0.66f, 0.70f, w)));
  const float open = 0.2f + 0.3f * tone, curtain = kind < 0.55f ? 1.0f - pulse(x, open, 1.0f - open, 0.06f + w) : 0.0f;
  const float blind = kind > 0.8f ? 1.0f - pulse(y, -1.0f, 0.35f + 0.5f * tone, 0.02f + w) : 0.0f;
  const float fold = 0.75f + 0.2f * pags_sinf(70.0f * x) * clamp01(1.0f - 12.0f * w);
  const float cloth[3] = {0.50f * fold, 0.46f * fold, 0.38f * fold};
  mix_color(m->color, cloth, fmaxf(curtain, blind), color);
  mix_color(color, m->second, bars, color);
}

/* ---- Cars, plants and the choice of the pattern ---- */

/* Car paint with thin dark seams: upright door gaps at three positions along x, and one line along each sill. */
static void paint(const pags_material *m, const pags_touch *touch, float width, float color[3]) {
  static const float seams[3] = {-0.95f, -0.02f, 0.95f}, dark[3] = {0.03f, 0.03f, 0.03f};
  const float *p = touch->local;
  float seam = 0.0f;
  for (int i = 0; i < 3; i++)
    seam = fmaxf(seam, pulse(p[0], seams[i] - 0.008f, seams[i] + 0.008f, width));
  seam *= pulse(fabsf(p[1]), 0.6f, 2.0f, width) * pulse(p[2], 0.3f, 0.96f, width);
  seam = fmaxf(seam, pulse(p[2], 0.30f, 0.36f, width) * pulse(p[0], -9.0f, 9.0f, width));
  mix_color(m->color, dark, 0.85f * seam, color);
}

void pags_material_color(const pags_material *material, const pags_markings *markings, const pags_touch *touch,
                         const pags_footprint *footprint, uint64_t seed, float color[3]) {
  const float width = footprint->mean;
  switch (material->finish) {
    case PAGS_FINISH_ASPHALT: asphalt(material, markings, touch, footprint, seed, color); break;
    case PAGS_FINISH_PAVING: paving(material, touch, footprint, seed, color); break;
    case PAGS_FINISH_BRICK: brick(material, touch, width, seed, color); break;
    case PAGS_FINISH_PLASTER: plaster(material, touch, width, seed, color); break;
    case PAGS_FINISH_TILES: tiles(material, touch, width, seed, color); break;
    case PAGS_FINISH_WINDOW: window(material, touch, width, seed, color); break;
    case PAGS_FINISH_PAINT: paint(material, touch, width, color); break;
    case PAGS_FINISH_MOTTLED: {
      const float *p = touch->local, x = p[0] + 0.6f * p[2], y = p[1] + 0.8f * p[2];
      const float t = 0.5f + 0.5f * noise2(x, y, material->size, width, seed + 14);
      mix_color(material->color, material->second, t, color);
      break;
    }
    case PAGS_FINISH_LEAF: /* each leaf has a random shade between the two colours; u is the leaf's number */
      mix_color(material->color, material->second, cell_value(touch->uv[0], touch->uv[1], seed + 15), color);
      break;
    case PAGS_FINISH_PLAIN: pags_copy3f(material->color, color); break;
  }
  for (int c = 0; c < 3; c++)
    color[c] = clamp01(color[c]);
}
