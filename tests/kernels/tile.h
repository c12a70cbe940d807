/* SPDX-License-Identifier: Apache-2.0 */
/* A tile that the forward kernel has blended, for the tests of the kernels that go through it backwards. */
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
  float *gradient[5]; /* normally distributed; NaN outside of the picture, where kernels must not use them */
  float *plane[5];    /* planes that the forward kernel wrote: rgb, transmittance, depth sum */
  uint16_t *masks;
} tile;

/* Makes a tile of `count` splats. With a border the tile extends beyond the picture. The slots of other tiles lie
 * between its own. The gradients may be changed until tile_draw. */
tile tile_make(int64_t count, const splat_mix *mix, bool border);
void tile_draw(const pags_kernels *k, tile *t);
/* The drawn tile as the kernels read it, with `slots` as their output. */
pags_drawn_tile tile_drawn(const tile *t, float *slots);
/* Returns whether plane element i is a pixel of the picture, and that pixel's centre. */
bool tile_pixel(const tile *t, int i, float *px, float *py);
/* Returns the number of SIMD lanes that the backward pass processes. */
int64_t tile_lanes(const tile *t);

/* The expected values of an entry's slot, and for each the sum of its terms' magnitudes, to which the rounding error
 * is relative. */
typedef struct tile_sums {
  double value[PAGS_SLOT_FLOATS], size[PAGS_SLOT_FLOATS];
} tile_sums;

static inline void tile_add(tile_sums *s, int field, double term, double size) {
  s->value[field] += term;
  s->size[field] += size;
}

/* Compares the slots of `fields` floats with the entries' sums; one value in two hundred may differ by a term at the
 * cut-off or at the early stop. `choice` is printed in the message. */
void tile_check(const tile *t, const float *slots, int fields, const tile_sums *want, int choice);
/* Checks that the slots of other pairs still hold 0xA5 bytes. */
void tile_check_others(const tile *t, const float *slots, int fields);

#endif
