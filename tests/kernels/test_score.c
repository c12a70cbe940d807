/* Scores of splats: each ISA against a plain loop in double that goes back to front, with how large the terms were beside each sum: rounding
 * may cost a share of those. */
#include "check.h"
#include "splats.h"

#include <math.h>
#include <string.h>

enum { STRIDE = 18, PLANE = 15 * STRIDE + 16 };

static const float background[3] = {0.25f, 0.5f, 0.125f};

typedef enum choice { SEEN, OVERLAP, LOSS, CHOICES } choice;

typedef struct tile {
  pags_splat *splats;
  pags_entry *entries;
  int64_t count, *slot_start, slot_count;
  int x0, y0, width, height;
  float *gradient[5]; /* rgb, how much a pixel counts, how critical it is */
  float *plane[5];    /* as forward left them */
  float *depth;
  int32_t *id;
  uint16_t *masks;
} tile;

static tile make_tile(int64_t count, const splat_mix *mix, bool border) {
  tile t = {.splats = CHECK_NEW(pags_splat, count), .entries = CHECK_NEW(pags_entry, count), .count = count};
  t.slot_start = CHECK_NEW(int64_t, count);
  t.x0 = 32, t.y0 = 48, t.width = border ? 32 + 1 + check_below(15) : 100,
  t.height = border ? 48 + 1 + check_below(15) : 70;
  for (int64_t i = 0; i < count; i++) {
    t.splats[i] = splat_random(mix);
    t.entries[count - 1 - i] = (pags_entry){(uint32_t)i, (uint32_t)check_below(3)};
    t.slot_start[i] = t.slot_count; /* slots of other tiles lie in between */
    t.slot_count += (int64_t)t.entries[count - 1 - i].rank + 1 + check_below(2);
  }
  for (int j = 0; j < 5; j++) {
    t.gradient[j] = CHECK_NEW(float, PLANE);
    for (int i = 0; i < PLANE; i++) /* outside of the picture: NaN, which must not come in */
      t.gradient[j][i] =
          i % STRIDE < 16 && t.x0 + i % STRIDE < t.width && t.y0 + i / STRIDE < t.height ? check_normal() : NAN;
    for (int i = 0; j >= 3 && i < PLANE; i++)
      t.gradient[j][i] = isnan(t.gradient[j][i]) ? NAN : t.gradient[j][i] > 0.0f ? 1.0f : j == 4 ? 0.0f : 0.25f;
    check_freeze(t.gradient[j]);
  }
  check_freeze(t.splats);
  check_freeze(t.entries);
  check_freeze(t.slot_start);
  return t;
}

static void forward(const pags_kernels *k, tile *t) {
  for (int j = 0; j < 5; j++)
    t->plane[j] = CHECK_NEW(float, PLANE);
  t->masks = CHECK_NEW(uint16_t, t->count);
  t->depth = CHECK_NEW(float, PLANE);
  t->id = CHECK_NEW(int32_t, PLANE);
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
                         .depth = t->depth,
                         .depth_sum = t->plane[4],
                         .id = t->id,
                         .stride = STRIDE};
  memcpy(out.background, background, sizeof background);
  k->raster(&in, &out);
  for (int j = 0; j < 5; j++)
    check_freeze(t->plane[j]);
  check_freeze(t->masks);
}

static pags_raster_score arguments(const tile *t, choice c, float *slots) {
  pags_raster_score in = {.splats = t->splats,
                          .entries = t->entries,
                          .block_masks = t->masks,
                          .count = t->count,
                          .slot_start = t->slot_start,
                          .slots = slots,
                          .x0 = t->x0,
                          .y0 = t->y0,
                          .width = t->width,
                          .height = t->height,
                          .stride = STRIDE,
                          .counted = t->gradient[3],
                          .critical = t->gradient[4],
                          .overlap = c == OVERLAP};
  for (int j = 0; j < 3; j++) {
    in.rgb[j] = t->plane[j];
    in.rgb_gradient[j] = c == LOSS ? t->gradient[j] : NULL;
  }
  return in;
}

static float *score(const pags_kernels *k, const tile *t, choice c) {
  float *const slots = CHECK_NEW(float, t->slot_count *PAGS_SCORE_SUMS);
  const pags_raster_score in = arguments(t, c, slots);
  k->raster_score(&in);
  return slots;
}

/* ---- The plain loop ---- */

typedef struct sums {
  double value[PAGS_SCORE_SUMS], size[PAGS_SCORE_SUMS];
} sums;

typedef struct step { /* of a pixel through one splat */
  int64_t entry;
  double alpha, t; /* transmittance in front */
} step;

static void add(sums *s, int field, double term, double size) {
  s->value[field] += term;
  s->size[field] += size;
}

/* `total`: what a float sum of all terms of dL/dC . C is rounded to. */
static void add_step(sums *s, const tile *t, choice c, const pags_splat *g, const step *at, int i, double behind,
                     double total) {
  const double counted = (double)t->gradient[3][i], critical = (double)t->gradient[4][i];
  const double colour[3] = {(double)g->r, (double)g->g, (double)g->b}, w = at->alpha * at->t;
  double shine = 0.0, shine_size = 0.0;
  for (int j = 0; j < 3; j++) {
    const double gradient = c == LOSS ? (double)t->gradient[j][i] : 1.0;
    shine += gradient * colour[j];
    shine_size += fabs(gradient * colour[j]);
  }
  const double opacity = exp2((double)g->log2_opacity);
  const double by_value = opacity * (at->t * shine - behind / (1.0 - at->alpha));
  const double size = opacity * (at->t * shine_size + (fabs(behind) + 0.01 * total) / (1.0 - at->alpha));
  add(s, PAGS_SCORE_SQUARED, counted * by_value * by_value, counted * size * size);
  if (c == OVERLAP)
    return;
  add(s, PAGS_SCORE_SEEN, w * counted, w * counted);
  add(s, PAGS_SCORE_CRITICAL, w * counted * critical, w * counted);
}

static int walk(const tile *t, choice c, int i, float px, float py, bool fused, step *steps, sums *all, double *left) {
  const double counted = (double)t->gradient[3][i], critical = (double)t->gradient[4][i];
  int n = 0;
  bool stopped = false;
  double through = 1.0;
  for (int64_t e = 0; e < t->count; e++) {
    const float exponent = splat_exponent(t->splats + t->entries[e].splat, px, py, fused);
    if (!(exponent >= -PAGS_LOG2_255))
      continue;
    const double alpha = fmin(exp2((double)exponent), (double)PAGS_ALPHA_MAX);
    if (c == OVERLAP) {
      add(all + e, PAGS_SCORE_SEEN, alpha * counted, alpha * counted);
      add(all + e, PAGS_SCORE_CRITICAL, alpha * counted * critical, alpha * counted);
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

static sums *score_plainly(const tile *t, choice c, bool fused) {
  sums *const all = CHECK_NEW(sums, t->count);
  step *const steps = CHECK_NEW(step, t->count);
  memset(all, 0, (size_t)t->count * sizeof *all);
  for (int i = 0; i < PLANE; i++) {
    const float px = (float)(t->x0 + i % STRIDE) + 0.5f, py = (float)(t->y0 + i / STRIDE) + 0.5f;
    if (i % STRIDE >= 16 || px > (float)t->width || py > (float)t->height)
      continue;
    double left, behind = 0.0, total = 0.0;
    int n = walk(t, c, i, px, py, fused, steps, all, &left);
    for (int j = 0; j < 3; j++) {
      const double gradient = c == LOSS ? (double)t->gradient[j][i] : 1.0;
      behind += gradient * (double)background[j] * left;
      total += fabs(gradient * (double)t->plane[j][i]);
    }
    while (n-- > 0) {
      const pags_splat *const g = t->splats + t->entries[steps[n].entry].splat;
      add_step(all + steps[n].entry, t, c, g, steps + n, i, behind, total);
      const double w = steps[n].alpha * steps[n].t, colour[3] = {(double)g->r, (double)g->g, (double)g->b};
      for (int j = 0; j < 3; j++)
        behind += w * colour[j] * (c == LOSS ? (double)t->gradient[j][i] : 1.0);
    }
  }
  return all;
}

/* One value in two hundred may have lost a term at the cut-off or the stop. */
static void check_plainly(const tile *t, choice c, const float *slots, const sums *want) {
  int64_t off = 0;
  for (int64_t e = 0; e < t->count; e++) {
    const float *const slot = slots + (t->slot_start[t->entries[e].splat] + t->entries[e].rank) * PAGS_SCORE_SUMS;
    for (int f = 0; f < PAGS_SCORE_SUMS; f++) {
      const double error = fabs((double)slot[f] - want[e].value[f]);
      if (!(error <= 5e-5 * want[e].size[f] + 1e-9))
        if (++off * 200 > t->count * PAGS_SCORE_SUMS)
          CHECK_FAIL("entry %lld, sum %d: %.9g, should be %.9g (terms of %.3g); choice %d", (long long)e, f,
                     (double)slot[f], want[e].value[f], want[e].size[f], (int)c);
    }
  }
}

static const splat_mix translucent = {20, 36, 60, 76, 0.3f, 12, 8, 0.004f, 0.08f, false};
static const splat_mix opaque = {20, 36, 60, 76, 0.3f, 20, 30, 0.1f, 1.0f, false};
static const splat_mix awkward = {28, 44, 52, 68, 0.3f, 20, 30, 0.004f, 1.0f, true};

static void test_plainly(const pags_kernels *k) {
  static const int counts[] = {0, 1, 2, 7, 8, 9, 15, 16, 17, 63, 64, 255, 256, 257, 500};
  const splat_mix *const mixes[] = {&translucent, &opaque, &awkward};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int c = 0; c < CHOICES; c++) {
      tile t = make_tile(counts[n], mixes[check_below(3)], check_below(2));
      forward(k, &t);
      const float *const slots = score(k, &t, (choice)c);
      const sums *const want = score_plainly(&t, (choice)c, splat_fused(k));
      check_plainly(&t, (choice)c, slots, want);
      check_release();
    }
}

/* Slots of other pairs stay as they were: 0xA5 all over. */
static void check_others(const tile *t, const float *slots) {
  bool *const mine = CHECK_NEW(bool, t->slot_count);
  memset(mine, 0, (size_t)t->slot_count);
  for (int64_t e = 0; e < t->count; e++)
    mine[t->slot_start[t->entries[e].splat] + t->entries[e].rank] = true;
  for (int64_t s = 0; s < t->slot_count; s++)
    for (size_t b = 0; b < PAGS_SCORE_SUMS * sizeof *slots && !mine[s]; b++)
      CHECK(((const unsigned char *)(slots + s * PAGS_SCORE_SUMS))[b] == 0xA5);
}

static void test_scalar(const pags_kernels *k) {
  for (int round = 0; round < 3 * CHOICES; round++) {
    const choice c = (choice)(round % CHOICES);
    tile t = make_tile(300, round & 1 ? &awkward : &opaque, round & 2);
    forward(k, &t);
    const float *const got = score(k, &t, c), *const want = score(&pags_kernels_scalar, &t, c);
    check_others(&t, got);
    if (CHECK_EXACT) /* else only the plain loop knows how much rounding may cost */
      CHECK_SAME("slots", got, want, t.slot_count * PAGS_SCORE_SUMS);
    check_release();
  }
}

static void test_bench(const pags_kernels *k) {
  static const splat_mix usual = {24, 40, 56, 72, 1.0f, 10, 4, 0.02f, 0.5f, false};
  tile t = make_tile(256, &usual, false);
  forward(k, &t);
  int64_t lanes = 0;
  for (int64_t e = 0; e < t.count; e++)
    lanes += 16 * __builtin_popcount(t.masks[e]);
  float *const slots = CHECK_NEW(float, t.slot_count *PAGS_SCORE_SUMS);
  const pags_raster_score in = arguments(&t, SEEN, slots);
  CHECK_BENCH("raster_score", lanes, "lane") k->raster_score(&in);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"raster_score plainly", test_plainly},
      {"raster_score scalar", test_scalar},
      {"raster_score bench", test_bench},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
