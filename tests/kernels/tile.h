/* SPDX-License-Identifier: Apache-2.0 */
/* A tile that the forward kernel has blended, for the tests of the kernels that go back through it. */
#ifndef PAGS_TESTS_TILE_H
#define PAGS_TESTS_TILE_H

#include "splats.h"

enum { TILE_STRIDE = 18, TILE_PLANE = 15 * TILE_STRIDE + 16 };

extern const float tile_background[3];

typedef struct tile {
  pags_splat *splats;
  pags_entry *entries;
  int64_t count, *slot_start, slot_count;
  int x0, y0, width, height;
  float *gradient[5]; /* normal numbers; outside of the picture NaN, which must not come in */
  float *plane[5];    /* as forward left them: rgb, transmittance, depth sum */
  uint16_t *masks;
} tile;

/* With a border it reaches out of the picture. Slots of other tiles lie between its own. The gradients may be changed
 * until it is drawn. */
tile tile_make(int64_t count, const splat_mix *mix, bool border);
void tile_draw(const pags_kernels *k, tile *t);
/* Whether plane element i is a pixel of the picture, and the pixel's middle. */
bool tile_pixel(const tile *t, int i, float *px, float *py);
/* Lanes that going back through it works on. */
int64_t tile_lanes(const tile *t);

/* What the slot of an entry should hold, and how large the terms were that each sum came from: rounding may cost a
 * share of those. */
typedef struct tile_sums {
  double value[PAGS_SLOT_FLOATS], size[PAGS_SLOT_FLOATS];
} tile_sums;

static inline void tile_add(tile_sums *s, int field, double term, double size) {
  s->value[field] += term;
  s->size[field] += size;
}

/* Slots of `fields` floats against the entries' sums; one value in two hundred may have lost a term at the cut-off or
 * the stop. `choice` is for the message. */
void tile_check(const tile *t, const float *slots, int fields, const tile_sums *want, int choice);
/* Slots of other pairs stay as they were: 0xA5 all over. */
void tile_check_others(const tile *t, const float *slots, int fields);

#endif
