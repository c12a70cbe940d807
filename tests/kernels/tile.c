/* SPDX-License-Identifier: Apache-2.0 */
/* Tiles blended by the forward kernel, and the checks of gradient slots; see tile.h. */
#include "tile.h"

#include <math.h>
#include <string.h>

const float tile_background[3] = {0.25f, 0.5f, 0.125f};

tile tile_make(int64_t count, const splat_mix *mix, bool border) {
  tile t = {.splats = CHECK_NEW(pags_splat, count), .entries = CHECK_NEW(pags_entry, count), .count = count};
  t.slot_start = CHECK_NEW(int64_t, count);
  t.x0 = 32, t.y0 = 48, t.width = border ? 32 + 1 + check_below(15) : 100,
  t.height = border ? 48 + 1 + check_below(15) : 70;
  for (int64_t i = 0; i < count; i++) {
    t.splats[i] = splat_random(mix);
    t.entries[count - 1 - i] = (pags_entry){.splat = (uint32_t)i, .rank = (uint32_t)check_below(3)};
    t.slot_start[i] = t.slot_count;
    t.slot_count += (int64_t)t.entries[count - 1 - i].rank + 1 + check_below(2);
  }
  for (int j = 0; j < 5; j++) {
    float px, py;
    t.gradient[j] = CHECK_NEW(float, TILE_PLANE);
    for (int i = 0; i < TILE_PLANE; i++)
      t.gradient[j][i] = tile_pixel(&t, i, &px, &py) ? check_normal() : NAN;
  }
  check_freeze(t.splats);
  check_freeze(t.entries);
  check_freeze(t.slot_start);
  return t;
}

void tile_draw(const pags_kernels *k, tile *t) {
  for (int j = 0; j < 5; j++)
    t->plane[j] = CHECK_NEW(float, TILE_PLANE);
  t->masks = CHECK_NEW(uint16_t, t->count);
  const pags_raster_in in = {.splats = t->splats,
                             .entries = t->entries,
                             .count = t->count,
                             .x0 = t->x0,
                             .y0 = t->y0,
                             .width = t->width,
                             .height = t->height,
                             .exp_degree = 5,
                             .block_masks = t->masks};
  pags_raster_out out = {.rgb = {t->plane[0], t->plane[1], t->plane[2]},
                         .transmittance = t->plane[3],
                         .depth = CHECK_NEW(float, TILE_PLANE),
                         .depth_sum = t->plane[4],
                         .id = CHECK_NEW(int32_t, TILE_PLANE),
                         .stride = TILE_STRIDE};
  memcpy(out.background, tile_background, sizeof tile_background);
  k->raster(&in, &out);
  for (int j = 0; j < 5; j++) {
    check_freeze(t->plane[j]);
    check_freeze(t->gradient[j]);
  }
  check_freeze(t->masks);
}

pags_drawn_tile tile_drawn(const tile *t, float *slots) {
  return (pags_drawn_tile){.splats = t->splats,
                           .entries = t->entries,
                           .block_masks = t->masks,
                           .count = t->count,
                           .slot_start = t->slot_start,
                           .slots = slots,
                           .x0 = t->x0,
                           .y0 = t->y0,
                           .width = t->width,
                           .height = t->height,
                           .stride = TILE_STRIDE,
                           .rgb = {t->plane[0], t->plane[1], t->plane[2]}};
}

bool tile_pixel(const tile *t, int i, float *px, float *py) {
  *px = (float)(t->x0 + i % TILE_STRIDE) + 0.5f, *py = (float)(t->y0 + i / TILE_STRIDE) + 0.5f;
  return i % TILE_STRIDE < 16 && *px < (float)t->width && *py < (float)t->height;
}

int64_t tile_lanes(const tile *t) {
  int64_t lanes = 0;
  for (int64_t e = 0; e < t->count; e++)
    lanes += 16 * __builtin_popcount(t->masks[e]);
  return lanes;
}

static int64_t slot_of(const tile *t, int64_t e) {
  return t->slot_start[t->entries[e].splat] + t->entries[e].rank;
}

void tile_check(const tile *t, const float *slots, int fields, const tile_sums *want, int choice) {
  int64_t off = 0;
  for (int64_t e = 0; e < t->count; e++) {
    const float *const slot = slots + slot_of(t, e) * fields;
    for (int f = 0; f < fields; f++) {
      const double error = fabs((double)slot[f] - want[e].value[f]);
      if (!(error <= 5e-5 * want[e].size[f] + 1e-9))
        if (++off * 200 > t->count * fields)
          CHECK_FAIL("entry %lld, sum %d: %.9g, should be %.9g (terms of %.3g); choice %d", (long long)e, f,
                     (double)slot[f], want[e].value[f], want[e].size[f], choice);
    }
  }
}

void tile_check_others(const tile *t, const float *slots, int fields) {
  bool *const mine = CHECK_NEW(bool, t->slot_count);
  memset(mine, 0, (size_t)t->slot_count);
  for (int64_t e = 0; e < t->count; e++)
    mine[slot_of(t, e)] = true;
  for (int64_t s = 0; s < t->slot_count; s++)
    for (size_t b = 0; b < (size_t)fields * sizeof *slots && !mine[s]; b++)
      CHECK(((const unsigned char *)(slots + s * fields))[b] == 0xA5);
}
