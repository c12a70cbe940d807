/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the gradient of blending. Compares each ISA with the scalar kernel, and all with a direct loop in double
 * that runs back to front. The loop also adds up the terms' magnitudes, as the rounding error is relative to these. */
#include "check.h"
#include "tile.h"

#include <math.h>
#include <string.h>

typedef struct choice {
  bool transmittance, depth, counted;
} choice;

static pags_raster_back arguments(const tile *t, choice c, float *slots) {
  pags_raster_back in = {.tile = tile_drawn(t, slots), .transmittance = t->plane[3]};
  for (int j = 0; j < 3; j++) {
    in.rgb_gradient[j] = t->gradient[j];
  }
  if (c.transmittance)
    in.transmittance_gradient = t->gradient[3];
  if (c.depth) {
    in.depth_sum = t->plane[4];
    in.depth_gradient = t->gradient[4];
  }
  if (c.counted)
    in.counted = t->gradient[3];
  return in;
}

static float *backward(const pags_kernels *k, const tile *t, choice c) {
  float *const slots = CHECK_NEW(float, t->slot_count *PAGS_SLOT_FLOATS);
  const pags_raster_back in = arguments(t, c, slots);
  k->raster_backward(&in);
  return slots;
}

/* ---- The direct loop ---- */

typedef struct step { /* one splat blended into a pixel */
  int64_t entry;
  double alpha, t; /* transmittance in front */
  bool capped;
} step;

/* Adds the squared derivative of the pixel's colour by one step to its slot's sum. `light`: the colour that the splats
 * behind and the background add to the pixel; `total`: the pixel's colour. The cap on alpha counts as absent. */
static void add_square(tile_sums *s, const tile *t, const pags_splat *g, const step *at, int i, double light,
                       double total) {
  const double counted = (double)t->gradient[3][i], own = (double)g->r + (double)g->g + (double)g->b;
  const double opacity = exp2((double)g->log2_opacity);
  const double slope = opacity * (at->t * own - light / (1.0 - at->alpha));
  const double size = opacity * (at->t * (fabs((double)g->r) + fabs((double)g->g) + fabs((double)g->b)) +
                                 (fabs(light) + 0.01 * total) / (1.0 - at->alpha));
  tile_add(s, PAGS_SLOT_SQUARED, counted * slope * slope, fabs(counted) * size * size);
}

/* Adds the gradients of one step to its slot's sums. `total`: magnitude to which a float sum of all terms dL/dC . C
 * is rounded. */
static void add_step(tile_sums *s, const tile *t, choice c, const pags_splat *g, const step *at, int i, double behind,
                     double total, float px, float py) {
  const double dx = (double)px - (double)g->x, dy = (double)py - (double)g->y, w = at->alpha * at->t;
  const double u = (double)g->p * (dx - (double)g->h * dy), v = (double)g->w * dy;
  const double colour[4] = {(double)g->r, (double)g->g, (double)g->b, (double)g->z};
  double shine = 0.0, shine_size = 0.0;
  for (int j = 0; j < 3 + c.depth; j++) {
    const double gradient = (double)t->gradient[j == 3 ? 4 : j][i];
    shine += gradient * colour[j];
    shine_size += fabs(gradient * colour[j]);
    tile_add(s, PAGS_SLOT_R + j, w * gradient, fabs(w * gradient));
  }
  if (at->capped)
    return;
  const double raised = at->alpha + (double)g->floor;
  const double ds = raised * (at->t * shine - behind / (1.0 - at->alpha));
  const double size = raised * (at->t * shine_size + (fabs(behind) + 0.01 * total) / (1.0 - at->alpha));
  const double moment[6] = {1.0, u, v, u * u, u * v, v * v};
  for (int m = 0; m < 6; m++)
    tile_add(s, PAGS_SLOT_S + m, ds * moment[m], size * fmax(fabs(moment[m]), 0.01));
}

static int walk(const tile *t, float px, float py, bool fused, step *steps, double *left) {
  int n = 0;
  double through = 1.0;
  for (int64_t e = 0; e < t->count; e++) {
    const pags_splat *const g = t->splats + t->entries[e].splat;
    const float exponent = splat_exponent(g, px, py, fused);
    if (!(exponent >= g->cut))
      continue;
    const double raw = exp2((double)exponent) - (double)g->floor, alpha = fmin(raw, (double)PAGS_ALPHA_MAX);
    if (through * (1.0 - alpha) < (double)PAGS_T_STOP)
      break;
    steps[n++] = (step){e, alpha, through, raw > (double)PAGS_ALPHA_MAX};
    through *= 1.0 - alpha;
  }
  *left = through;
  return n;
}

static tile_sums *backward_plainly(const tile *t, choice c, bool fused) {
  tile_sums *const all = CHECK_NEW(tile_sums, t->count);
  step *const steps = CHECK_NEW(step, t->count);
  memset(all, 0, (size_t)t->count * sizeof *all);
  for (int i = 0; i < TILE_PLANE; i++) {
    float px, py;
    if (!tile_pixel(t, i, &px, &py))
      continue;
    double left, behind = 0.0;
    int n = walk(t, px, py, fused, steps, &left);
    for (int j = 0; j < 3; j++)
      behind += (double)t->gradient[j][i] * (double)tile_background[j] * left;
    if (c.transmittance)
      behind += (double)t->gradient[3][i] * left;
    double total = 0.0;
    for (int j = 0; j < 5; j++)
      total += (j < 3 || (j == 3 ? c.transmittance : c.depth))
                   ? fabs((double)t->gradient[j][i] * (double)t->plane[j][i])
                   : 0.0;
    double light = 0.0, all_light = 0.0;
    for (int j = 0; j < 3; j++) {
      light += (double)tile_background[j] * left;
      all_light += fabs((double)t->plane[j][i]);
    }
    while (n-- > 0) {
      const pags_splat *const g = t->splats + t->entries[steps[n].entry].splat;
      if (c.counted)
        add_square(all + steps[n].entry, t, g, steps + n, i, light, all_light);
      light += steps[n].alpha * steps[n].t * ((double)g->r + (double)g->g + (double)g->b);
      add_step(all + steps[n].entry, t, c, g, steps + n, i, behind, total, px, py);
      const double w = steps[n].alpha * steps[n].t, colour[3] = {(double)g->r, (double)g->g, (double)g->b};
      for (int j = 0; j < 3; j++)
        behind += w * colour[j] * (double)t->gradient[j][i];
      if (c.depth)
        behind += w * (double)g->z * (double)t->gradient[4][i];
    }
  }
  return all;
}

static void test_plainly(const pags_kernels *k) {
  static const int counts[] = {0, 1, 2, 7, 8, 9, 15, 16, 17, 63, 64, 255, 256, 257, 500};
  const splat_mix *const mixes[] = {&splats_translucent, &splats_opaque, &splats_awkward};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int which = 0; which < 8; which++) {
      const choice c = {which & 1, which & 2, which & 4};
      tile t = tile_make(counts[n], mixes[check_below(3)], check_below(2));
      tile_draw(k, &t);
      const float *const slots = backward(k, &t, c);
      const tile_sums *const want = backward_plainly(&t, c, splat_fused(k));
      tile_check(&t, slots, PAGS_SLOT_FLOATS, want, which);
      check_release();
    }
}

static void test_scalar(const pags_kernels *k) {
  for (int round = 0; round < 16; round++) {
    const choice c = {round & 1, round & 2, round & 4};
    tile t = tile_make(300, round & 8 ? &splats_awkward : &splats_opaque, round & 1);
    tile_draw(k, &t);
    const float *const got = backward(k, &t, c), *const want = backward(&pags_kernels_scalar, &t, c);
    tile_check_others(&t, got, PAGS_SLOT_FLOATS);
    if (CHECK_EXACT) /* in fused builds only the direct loop has the size of rounding errors */
      CHECK_SAME("slots", got, want, t.slot_count * PAGS_SLOT_FLOATS);
    check_release();
  }
}

static void test_bench(const pags_kernels *k) {
  static const splat_mix usual = {24, 40, 56, 72, 1.0f, 10, 4, 0.02f, 0.5f, false};
  tile t = tile_make(256, &usual, false);
  tile_draw(k, &t);
  float *const slots = CHECK_NEW(float, t.slot_count *PAGS_SLOT_FLOATS);
  static const choice choices[] = {{false, false, false}, {true, true, false}, {false, false, true}};
  static const char *const names[] = {"raster_backward, colour", "raster_backward, depth", "raster_backward, squares"};
  for (int i = 0; i < 3; i++) {
    const pags_raster_back in = arguments(&t, choices[i], slots);
    CHECK_BENCH(names[i], tile_lanes(&t), "lane") k->raster_backward(&in);
  }
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"raster_backward plainly", test_plainly},
      {"raster_backward scalar", test_scalar},
      {"raster_backward bench", test_bench},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
