/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the kernel of the splats' scores. Compares each ISA with a direct loop in double that runs back to front.
 * The loop also adds up the terms' magnitudes, as the rounding error is relative to these. */
#include "check.h"
#include "tile.h"

#include <math.h>
#include <string.h>

typedef enum choice { SEEN, OVERLAP, CHOICES } choice;

/* A tile in which a pixel's weight is 1 or 1/4, and its criticality 1 or 0. */
static tile make_tile(int64_t count, const splat_mix *mix, bool border) {
  tile t = tile_make(count, mix, border);
  for (int i = 0; i < TILE_PLANE; i++)
    if (!isnan(t.gradient[3][i])) {
      t.gradient[3][i] = t.gradient[3][i] > 0.0f ? 1.0f : 0.25f;
      t.gradient[4][i] = t.gradient[4][i] > 0.0f ? 1.0f : 0.0f;
    }
  return t;
}

static pags_raster_score arguments(const tile *t, choice c, float *slots) {
  return (pags_raster_score){
      .tile = tile_drawn(t, slots), .counted = t->gradient[3], .critical = t->gradient[4], .overlap = c == OVERLAP};
}

static float *score(const pags_kernels *k, const tile *t, choice c) {
  float *const slots = CHECK_NEW(float, t->slot_count *PAGS_SCORE_SUMS);
  const pags_raster_score in = arguments(t, c, slots);
  k->raster_score(&in);
  return slots;
}

/* ---- The direct loop ---- */

typedef struct step { /* one splat blended into a pixel */
  int64_t entry;
  double alpha, t; /* transmittance in front */
} step;

/* Adds the scores of one step to its slot's sums. `total`: magnitude to which a float sum of all terms dL/dC . C is
 * rounded. */
static void add_step(tile_sums *s, const tile *t, choice c, const pags_splat *g, const step *at, int i, double behind,
                     double total) {
  const double counted = (double)t->gradient[3][i], critical = (double)t->gradient[4][i];
  const double colour[3] = {(double)g->r, (double)g->g, (double)g->b}, w = at->alpha * at->t;
  double shine = 0.0, shine_size = 0.0;
  for (int j = 0; j < 3; j++) {
    shine += colour[j];
    shine_size += fabs(colour[j]);
  }
  const double opacity = exp2((double)g->log2_opacity);
  const double by_value = opacity * (at->t * shine - behind / (1.0 - at->alpha));
  const double size = opacity * (at->t * shine_size + (fabs(behind) + 0.01 * total) / (1.0 - at->alpha));
  tile_add(s, PAGS_SCORE_SQUARED, counted * by_value * by_value, counted * size * size);
  if (c == OVERLAP)
    return;
  tile_add(s, PAGS_SCORE_SEEN, w * counted, w * counted);
  tile_add(s, PAGS_SCORE_CRITICAL, w * counted * critical, w * counted);
}

static int walk(const tile *t, choice c, int i, float px, float py, bool fused, step *steps, tile_sums *all,
                double *left) {
  const double counted = (double)t->gradient[3][i], critical = (double)t->gradient[4][i];
  int n = 0;
  bool stopped = false;
  double through = 1.0;
  for (int64_t e = 0; e < t->count; e++) {
    const pags_splat *const g = t->splats + t->entries[e].splat;
    const float exponent = splat_exponent(g, px, py, fused);
    if (!(exponent >= g->cut))
      continue;
    const double alpha = fmin(exp2((double)exponent) - (double)g->floor, (double)PAGS_ALPHA_MAX);
    if (c == OVERLAP) {
      tile_add(all + e, PAGS_SCORE_SEEN, alpha * counted, alpha * counted);
      tile_add(all + e, PAGS_SCORE_CRITICAL, alpha * counted * critical, alpha * counted);
    }
    stopped = stopped || through * (1.0 - alpha) < (double)PAGS_T_STOP;
    if (stopped)
      continue;
    steps[n++] = (step){e, alpha, through};
    through *= 1.0 - alpha;
  }
  *left = through;
  return n;
}

static tile_sums *score_plainly(const tile *t, choice c, bool fused) {
  tile_sums *const all = CHECK_NEW(tile_sums, t->count);
  step *const steps = CHECK_NEW(step, t->count);
  memset(all, 0, (size_t)t->count * sizeof *all);
  for (int i = 0; i < TILE_PLANE; i++) {
    float px, py;
    if (!tile_pixel(t, i, &px, &py))
      continue;
    double left, behind = 0.0, total = 0.0;
    int n = walk(t, c, i, px, py, fused, steps, all, &left);
    for (int j = 0; j < 3; j++) {
      behind += (double)tile_background[j] * left;
      total += fabs((double)t->plane[j][i]);
    }
    while (n-- > 0) {
      const pags_splat *const g = t->splats + t->entries[steps[n].entry].splat;
      add_step(all + steps[n].entry, t, c, g, steps + n, i, behind, total);
      const double w = steps[n].alpha * steps[n].t, colour[3] = {(double)g->r, (double)g->g, (double)g->b};
      for (int j = 0; j < 3; j++)
        behind += w * colour[j];
    }
  }
  return all;
}

static void test_plainly(const pags_kernels *k) {
  static const int counts[] = {0, 1, 2, 7, 8, 9, 15, 16, 17, 63, 64, 255, 256, 257, 500};
  const splat_mix *const mixes[] = {&splats_translucent, &splats_opaque, &splats_awkward};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int c = 0; c < CHOICES; c++) {
      tile t = make_tile(counts[n], mixes[check_below(3)], check_below(2));
      tile_draw(k, &t);
      const float *const slots = score(k, &t, (choice)c);
      const tile_sums *const want = score_plainly(&t, (choice)c, splat_fused(k));
      tile_check(&t, slots, PAGS_SCORE_SUMS, want, c);
      check_release();
    }
}

static void test_scalar(const pags_kernels *k) {
  for (int round = 0; round < 3 * CHOICES; round++) {
    const choice c = (choice)(round % CHOICES);
    tile t = make_tile(300, round & 1 ? &splats_awkward : &splats_opaque, round & 2);
    tile_draw(k, &t);
    const float *const got = score(k, &t, c), *const want = score(&pags_kernels_scalar, &t, c);
    tile_check_others(&t, got, PAGS_SCORE_SUMS);
    if (CHECK_EXACT) /* in fused builds only the direct loop has the size of rounding errors */
      CHECK_SAME("slots", got, want, t.slot_count * PAGS_SCORE_SUMS);
    check_release();
  }
}

static void test_bench(const pags_kernels *k) {
  static const splat_mix usual = {24, 40, 56, 72, 1.0f, 10, 4, 0.02f, 0.5f, false};
  tile t = make_tile(256, &usual, false);
  tile_draw(k, &t);
  float *const slots = CHECK_NEW(float, t.slot_count *PAGS_SCORE_SUMS);
  const pags_raster_score in = arguments(&t, SEEN, slots);
  CHECK_BENCH("raster_score", tile_lanes(&t), "lane") k->raster_score(&in);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"raster_score plainly", test_plainly},
      {"raster_score scalar", test_scalar},
      {"raster_score bench", test_bench},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
