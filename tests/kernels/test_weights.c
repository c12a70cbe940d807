/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the kernel of the splats' weights. Compares each ISA with a direct loop in double, and a list read in runs
 * with a list read at once. */
#include "check.h"
#include "tile.h"

#include <math.h>
#include <string.h>

enum { PIXELS = PAGS_TILE_PIXELS };

typedef struct weights {
  float *weights, *transmittance;
  uint16_t *blended;
} weights;

/* Reads the tile's list in runs of at most `run` entries. */
static weights walk(const pags_kernels *k, const tile *t, int64_t run, int degree) {
  const weights w = {CHECK_NEW(float, t->count *PIXELS), CHECK_NEW(float, PIXELS), CHECK_NEW(uint16_t, t->count)};
  for (int64_t i = 0; i < t->count; i += run) {
    const pags_raster_weights in = {.splats = t->splats,
                                    .entries = t->entries + i,
                                    .block_masks = t->masks + i,
                                    .count = t->count - i < run ? t->count - i : run,
                                    .x0 = t->x0,
                                    .y0 = t->y0,
                                    .width = t->width,
                                    .height = t->height,
                                    .exp_degree = degree,
                                    .first = i == 0,
                                    .transmittance = w.transmittance,
                                    .weights = w.weights + i * PIXELS,
                                    .blended = w.blended + i};
    k->raster_weights(&in);
  }
  return w;
}

/* Returns the position in the tile's planes of pixel p in the kernel's order. */
static int place_of(int p) {
  return (4 * (p >> 6) + (p >> 2 & 3)) * TILE_STRIDE + 4 * (p >> 4 & 3) + (p & 3);
}

/* The weights of a pixel's entries, in double. */
static void expect(const tile *t, float px, float py, bool fused, float *want) {
  double through = 1.0;
  bool stopped = false;
  for (int64_t e = 0; e < t->count; e++) {
    const pags_splat *const s = t->splats + t->entries[e].splat;
    const float exponent = splat_exponent(s, px, py, fused);
    want[e] = 0.0f;
    if (!(exponent >= s->cut))
      continue;
    const double alpha = fmin(exp2((double)exponent) - (double)s->floor, (double)PAGS_ALPHA_MAX);
    stopped = stopped || through * (1.0 - alpha) < (double)PAGS_T_STOP;
    if (stopped)
      continue;
    want[e] = (float)(alpha * through);
    through *= 1.0 - alpha;
  }
}

static void test_plainly(const pags_kernels *k) {
  static const int counts[] = {1, 2, 7, 8, 9, 16, 17, 63, 64, 257};
  const splat_mix *const mixes[] = {&splats_translucent, &splats_opaque, &splats_awkward};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    tile t = tile_make(counts[n], mixes[n % 3], n & 1);
    tile_draw(k, &t);
    const weights got = walk(k, &t, t.count, 5);
    float *const want = CHECK_NEW(float, t.count), *const have = CHECK_NEW(float, t.count);
    for (int p = 0; p < PIXELS; p++) {
      float px, py;
      if (!tile_pixel(&t, place_of(p), &px, &py))
        continue;
      expect(&t, px, py, splat_fused(k), want);
      for (int64_t e = 0; e < t.count; e++)
        have[e] = got.blended[e] >> (p / 16) & 1 ? got.weights[e * PIXELS + p] : 0.0f;
      /* Where rounding decides a threshold differently, a term may appear or disappear. */
      CHECK_NEAR("weights", have, want, t.count, .relative = 5e-5, .absolute = 1e-6, .flips = 0.05, .flip_size = 0.02);
      CHECK_NEAR("transmittance", &(float){fabsf(got.transmittance[p])}, t.plane[3] + place_of(p), 1, .absolute = 0);
    }
    check_release();
  }
}

static void test_runs(const pags_kernels *k) {
  for (int round = 0; round < 6; round++) {
    tile t = tile_make(150, round & 1 ? &splats_awkward : &splats_translucent, round & 2);
    tile_draw(k, &t);
    const int degree = round < 3 ? 5 : 3;
    const weights whole = walk(k, &t, t.count, degree), runs = walk(k, &t, 32, degree);
    CHECK(memcmp(whole.blended, runs.blended, (size_t)t.count * sizeof *whole.blended) == 0);
    CHECK_SAME("transmittance", whole.transmittance, runs.transmittance, PIXELS);
    CHECK_SAME("weights", whole.weights, runs.weights, t.count * PIXELS);
    int64_t blended = 0;
    for (int64_t e = 0; e < t.count; e++) {
      CHECK((runs.blended[e] & ~t.masks[e]) == 0);
      for (int b = 0; b < PAGS_TILE_BLOCKS; b++)
        if (!(t.masks[e] >> b & 1)) /* not written: still 0xA5 bytes */
          CHECK(memcmp(runs.weights + e * PIXELS + 16 * b, "\xA5\xA5\xA5\xA5", 4) == 0);
      blended += runs.blended[e];
    }
    CHECK(blended > 0);
    check_release();
  }
}

static void test_bench(const pags_kernels *k) {
  static const splat_mix usual = {24, 40, 56, 72, 1.0f, 10, 4, 0.02f, 0.5f, false};
  tile t = tile_make(256, &usual, false);
  tile_draw(k, &t);
  const weights w = walk(k, &t, t.count, 5);
  const pags_raster_weights in = {.splats = t.splats,
                                  .entries = t.entries,
                                  .block_masks = t.masks,
                                  .count = t.count,
                                  .x0 = t.x0,
                                  .y0 = t.y0,
                                  .width = t.width,
                                  .height = t.height,
                                  .exp_degree = 5,
                                  .first = true,
                                  .transmittance = w.transmittance,
                                  .weights = w.weights,
                                  .blended = w.blended};
  CHECK_BENCH("raster_weights", tile_lanes(&t), "lane") k->raster_weights(&in);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"raster_weights plainly", test_plainly},
      {"raster_weights in runs", test_runs},
      {"raster_weights bench", test_bench},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
