/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the projection kernel. Compares each ISA with the scalar kernel (to the bit if the build allows that), and
 * all with double. */
#include "rows.h"

#include <math.h>
#include <string.h>

static const int counts[] = {0, 1, 7, 8, 9, 15, 16, 17, 63, 64, 255, 256};

typedef struct projection {
  pags_splat *splats;
  uint32_t *keys;
  pags_tile_box *boxes;
} projection;

static projection project_by(const pags_kernels *k, const pags_projection *view, const rows *r, const float *factor) {
  const projection p = {CHECK_NEW(pags_splat, r->count), CHECK_NEW(uint32_t, r->count),
                        CHECK_NEW(pags_tile_box, r->count)};
  k->project(view, r->data, r->stride, factor, r->count, p.splats, p.keys, false, p.boxes, NULL);
  return p;
}

static projection project(const pags_kernels *k, const pags_projection *view, const rows *r) {
  return project_by(k, view, r, NULL);
}

static void check_scalar(const projection *got, const projection *want, int count) {
  if (!CHECK_EXACT)
    return; /* fused builds are compared with double only */
  for (int i = 0; i < count; i++)
    if (got->keys[i] != want->keys[i] || memcmp(got->splats + i, want->splats + i, sizeof *got->splats) != 0)
      CHECK_FAIL("row %d: not the scalar kernel's splat (keys %08x, %08x)", i, got->keys[i], want->keys[i]);
}

static void check_field(const char *what, int row, float got, double want, double relative, double absolute) {
  if (!(fabs((double)got - want) <= relative * fabs(want) + absolute))
    CHECK_FAIL("row %d: %s is %.9g, should be %.9g (to %.3g)", row, what, (double)got, want,
               relative * fabs(want) + absolute);
}

/* The determinant D is a sum of squares of minors, each rounded relative to sqrt(A C): the thinner the ellipse, the
 * fewer digits are right. */
static void check_splat(const pags_splat *s, const pags_tile_box *box, uint32_t key, const plain_row *want,
                        const pags_projection *view, int row) {
  const double k = 0.5 * log2(exp(1.0)), thin = sqrt(want->a * want->c / want->d);
  const double near = 1e-5, shape = near + 1e-6 * thin, far = 1e-6 * (fabs(want->x) + fabs(want->y) + 1000.0);
  const double dim = view->antialiased ? 1e-6 * want->a * want->c / fmax(want->d0, 2.5e-5 * want->d) : 0.0;
  check_field("x", row, s->x, want->x, 0.0, far);
  check_field("y", row, s->y, want->y, 0.0, far);
  check_field("z", row, s->z, want->z, near, 0.0);
  check_field("p", row, s->p, sqrt(k * want->c / want->d), shape, 0.0);
  check_field("h", row, s->h, want->b / want->c, near, near * sqrt(want->a / want->c));
  check_field("w", row, s->w, sqrt(k / want->c), near, 0.0);
  check_field("slope", row, s->slope, want->b / want->a, near, near * sqrt(want->c / want->a));
  check_field("log2_opacity", row, s->log2_opacity, fmin(log2(want->opacity), 0.0) + (double)view->alpha.lift, 1e-6,
              1e-5 + dim);
  check_field("cut", row, s->cut, want->cut, 1e-6, 1e-6 + dim);
  check_field("floor", row, s->floor, want->floor, 1e-6 + dim, 0.0);
  const double reach = (1e-5 + dim) / (log(2.0) * (log2(want->opacity) + (double)view->alpha.lift - want->cut));
  check_field("extent_x", row, box->extent[0], want->extent_x, near + reach, 1e-4);
  check_field("extent_y", row, box->extent[1], want->extent_y, near + reach, 1e-4);
  uint32_t bits;
  memcpy(&bits, &s->z, sizeof bits);
  CHECK(key == bits && s->tiles == 0);
}

static void check_plainly(const projection *p, const pags_projection *view, const rows *r, int tally[3]) {
  for (int i = 0; i < r->count; i++) {
    const bool drawn = p->keys[i] != UINT32_MAX;
    double row[ROW_FLOATS];
    row_read(r, i, row);
    /* Splats that aren't drawn are untouched; colour and id of the others are zero. */
    unsigned char other[sizeof(pags_splat)];
    memset(other, drawn ? 0 : 0xA5, sizeof other);
    CHECK(memcmp(&p->splats[i].r, other, 12) == 0 && memcmp(&p->splats[i].id, other, 4) == 0 &&
          memcmp(&p->splats[i].clamped, other, 4) == 0 && (drawn || memcmp(p->splats + i, other, sizeof other) == 0));
    if (!row_usable(row, ROW_SH)) {
      if (drawn)
        CHECK_FAIL("row %d is drawn though a parameter is not a number or infinite", i);
      tally[2]++;
      continue;
    }
    const plain_row want = row_plainly(view, row);
    if (want.certain && drawn != want.drawn)
      CHECK_FAIL("row %d is %sdrawn: z %g at (%g, %g), A %g, C %g, opacity %g", i, drawn ? "" : "not ", want.z, want.x,
                 want.y, want.a, want.c, want.opacity);
    if (want.certain && drawn && want.drawn)
      check_splat(p->splats + i, p->boxes + i, p->keys[i], &want, view, i);
    tally[want.certain && want.drawn]++;
  }
}

static void check_kind(const pags_kernels *k, row_kind kind) {
  int tally[3] = {0, 0, 0};
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int antialiased = 0; antialiased < 2; antialiased++) {
      const pags_projection view = view_random(check_below(4), antialiased);
      const rows r = rows_random(&view, counts[n], kind);
      const projection got = project(k, &view, &r), want = project(&pags_kernels_scalar, &view, &r);
      check_scalar(&got, &want, r.count);
      check_plainly(&got, &view, &r, tally);
      check_release();
    }
  check_note("%d rows drawn, %d not or on a threshold, %d unusable", tally[1], tally[0], tally[2]);
  CHECK(tally[1] > 300);
}

static void test_ordinary(const pags_kernels *k) {
  check_kind(k, ROWS_ORDINARY);
}
static void test_needles(const pags_kernels *k) {
  check_kind(k, ROWS_NEEDLES);
}
static void test_awkward(const pags_kernels *k) {
  check_kind(k, ROWS_AWKWARD);
}

/* An opacity factor of 0 removes a row, a factor of 1 changes nothing, others shift the logarithm of the opacity and
 * change the extent accordingly. */
static void check_factor(const projection *by, const projection *without, float factor, int row) {
  const pags_splat *const got = by->splats + row, *const plain = without->splats + row;
  const double l = (double)got->log2_opacity - (double)got->cut;
  check_field("log2_opacity", row, got->log2_opacity, (double)plain->log2_opacity + log2((double)factor), 1e-5, 1e-5);
  const double grown = sqrt(l / fmax((double)plain->log2_opacity - (double)plain->cut, 1e-3));
  if (plain->log2_opacity > plain->cut + 1.0f)
    check_field("extent_x", row, by->boxes[row].extent[0], (double)without->boxes[row].extent[0] * grown, 1e-4, 1e-4);
  CHECK(got->x == plain->x && got->z == plain->z && got->p == plain->p && got->h == plain->h && got->w == plain->w);
}

static void test_factor(const pags_kernels *k) {
  int taken = 0, kept = 0;
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    const pags_projection view = view_random(0, n % 2);
    const rows r = rows_random(&view, counts[n], ROWS_ORDINARY);
    float *const factor = CHECK_NEW(float, (r.count + 15) / 16 * 16);
    for (int i = 0; i < (r.count + 15) / 16 * 16; i++)
      factor[i] = check_below(3) == 0 ? 0.0f : check_below(3) == 0 ? 1.0f : check_uniform(0.8f, 1.4f);
    check_freeze(factor);
    const projection got = project_by(k, &view, &r, factor), plain = project(k, &view, &r);
    const projection want = project_by(&pags_kernels_scalar, &view, &r, factor);
    check_scalar(&got, &want, r.count);
    for (int i = 0; i < r.count; i++) {
      const bool drawn = got.keys[i] != UINT32_MAX, before = plain.keys[i] != UINT32_MAX;
      CHECK(!drawn || factor[i] > 0.0f);
      CHECK(factor[i] != 1.0f || drawn == before);
      CHECK(!drawn || before || factor[i] > 1.0f);
      if (drawn && before)
        check_factor(&got, &plain, factor[i], i);
      taken += before && factor[i] == 0.0f;
      kept += drawn;
    }
    check_release();
  }
  check_note("%d rows taken out, %d drawn", taken, kept);
  CHECK(taken > 100 && kept > 200);
}

/* A splat and its box have the same bits if projection finds the tiles as if tile_boxes finds them afterwards. */
static void test_tiles(const pags_kernels *k) {
  int large = 0, few = 0;
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (row_kind kind = ROWS_ORDINARY; kind <= ROWS_AWKWARD; kind++) {
      const pags_projection view = view_random(0, n % 2);
      const rows r = rows_random(&view, counts[n], kind);
      const projection want = project(k, &view, &r);
      k->tile_boxes(want.splats, want.keys, r.count, ((int)view.width + PAGS_TILE - 1) / PAGS_TILE,
                    ((int)view.height + PAGS_TILE - 1) / PAGS_TILE, want.boxes);
      const projection got = {CHECK_NEW(pags_splat, r.count), CHECK_NEW(uint32_t, r.count),
                              CHECK_NEW(pags_tile_box, r.count)};
      k->project(&view, r.data, r.stride, NULL, r.count, got.splats, got.keys, true, got.boxes, NULL);
      CHECK(memcmp(got.keys, want.keys, (size_t)r.count * sizeof *got.keys) == 0);
      CHECK(memcmp(got.splats, want.splats, (size_t)r.count * sizeof *got.splats) == 0);
      CHECK(memcmp(got.boxes, want.boxes, (size_t)r.count * sizeof *got.boxes) == 0);
      for (int i = 0; i < r.count; i++)
        if (got.keys[i] != UINT32_MAX)
          got.splats[i].tiles > 9 ? large++ : few++;
      check_release();
    }
  check_note("%d splats of up to nine tiles, %d of more", few, large);
  CHECK(few > 300 && large > 100);
}

/* A depth exactly at the near plane isn't drawn, the next larger float is. NaNs of any payload in any parameter
 * aren't drawn. */
static void test_edges(const pags_kernels *k) {
  const pags_projection view = view_straight(0);
  float data[14][16] = {{0.0f}};
  for (int i = 0; i < 16; i++) {
    data[2][i] = i == 1 ? nextafterf(view.near_plane, 1.0f) : i == 0 ? view.near_plane : 2.0f;
    for (int c = 0; c < 3; c++)
      data[ROW_SCALE + c][i] = -4.0f;
    data[ROW_QUATERNION][i] = 1.0f;
    data[ROW_LOGIT][i] = 1.0f;
  }
  pags_splat splats[16];
  uint32_t keys[16];
  pags_tile_box boxes[16];
  k->project(&view, data[0], 16, NULL, 16, splats, keys, false, boxes, NULL);
  for (int i = 0; i < 16; i++)
    CHECK((keys[i] == UINT32_MAX) == (i == 0));
  for (int plane = 0; plane < ROW_SH; plane++) {
    float kept[16];
    memcpy(kept, data[plane], sizeof kept);
    for (int i = 0; i < 16; i++) {
      const uint32_t nan = (i & 1 ? 0x7FC00000u : 0xFFC00000u) | (check_u32() & 0x3FFFFFu);
      memcpy(&data[plane][i], &nan, sizeof nan);
    }
    k->project(&view, data[0], 16, NULL, 16, splats, keys, false, boxes, NULL);
    for (int i = 0; i < 16; i++)
      if (keys[i] != UINT32_MAX)
        CHECK_FAIL("drawn with NaN in plane %d", plane);
    memcpy(data[plane], kept, sizeof kept);
  }
}

/* Clipping planes in camera space remove the rows behind one of them and change nothing else. */
static void test_clips(const pags_kernels *k) {
  int tally[3] = {0, 0, 0}, clipped = 0;
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    pags_projection view = view_random(0, n % 2);
    const rows r = rows_random(&view, counts[n], ROWS_ORDINARY);
    const projection whole = project(k, &view, &r);
    view.clip_count = 3;
    for (int i = 0; i < view.clip_count; i++)
      for (int c = 0; c < 4; c++)
        view.clips[i][c] = c < 3 ? check_normal() : check_uniform(0.0f, 6.0f);
    const projection got = project(k, &view, &r), want = project(&pags_kernels_scalar, &view, &r);
    check_scalar(&got, &want, r.count);
    check_plainly(&got, &view, &r, tally);
    for (int i = 0; i < r.count; i++)
      if (got.keys[i] != UINT32_MAX)
        CHECK(got.keys[i] == whole.keys[i] && memcmp(got.splats + i, whole.splats + i, sizeof *got.splats) == 0);
      else
        clipped += whole.keys[i] != UINT32_MAX;
    check_release();
  }
  check_note("%d rows clipped, %d drawn", clipped, tally[1]);
  CHECK(clipped > 100 && tally[1] > 50);
}

/* A lens whose radius is the angle, with tangential terms; of kind 1 as clamped at a slope of 1; of kind 2 longitude
 * and latitude. */
static void lens_random(const pags_projection *view, int kind, pags_lens_table *out) {
  memset(out, 0, sizeof *out);
  *out = (pags_lens_table){.turn = kind == 2 ? 6.2831853f * view->fx : 0.0f,
                           .a = {view->fx, 0.1f, 0.2f, view->fy},
                           .farthest = kind == 2 ? INFINITY : 1.4f,
                           .clamps = kind == 1,
                           .least = {-1.0f, -1.0f},
                           .most = {1.0f, 1.0f},
                           .terms_of = 1 + (int32_t)check_below(3),
                           .p = {0.01f, -0.02f},
                           .prism = {0.01f, 0.0f, 0.003f, 0.001f},
                           .per_radian = (float)PAGS_LENS_STEPS / 1.4f};
  for (int i = 0; i < PAGS_LENS_STEPS; i++)
    out->radius[i][0] = (float)i / out->per_radian, out->radius[i][1] = 1.0f / out->per_radian;
}

/* With a lens, a rolling shutter or both every machine gives the scalar kernel's bits, and unusable rows aren't drawn.
 * tests/unit/frame/test_shutter.c and test_lens.c compare the values with the oracle's. */
static void check_moving(const pags_kernels *k, bool rolls, int kind) {
  static pags_lens_table lens;
  int drawn = 0, moved = 0, held = 0, beyond = 0;
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int awkward = ROWS_ORDINARY; awkward <= ROWS_AWKWARD; awkward++) {
      pags_projection view = view_random(check_below(4), n % 2);
      const pags_scan scan = scan_random(&view);
      const rows r = rows_random(&view, counts[n], (row_kind)awkward);
      if (kind >= 0) {
        lens_random(&view, kind, &lens);
        view.lens = &lens;
        view.turned = kind == 2 && n % 2;
      }
      const projection still = project(k, &view, &r);
      if (rolls)
        view.scan = &scan;
      const projection got = project(k, &view, &r), want = project(&pags_kernels_scalar, &view, &r);
      check_scalar(&got, &want, r.count);
      for (int i = 0; i < r.count; i++) {
        double row[ROW_FLOATS];
        row_read(&r, i, row);
        CHECK(got.keys[i] == UINT32_MAX || row_usable(row, ROW_SH));
        drawn += got.keys[i] != UINT32_MAX;
        moved += got.keys[i] != UINT32_MAX && still.keys[i] != UINT32_MAX && got.splats[i].x != still.splats[i].x;
      }
      const pags_project_counts here =
          k->project(&view, r.data, r.stride, NULL, r.count, got.splats, got.keys, false, got.boxes, NULL);
      const pags_project_counts there = pags_kernels_scalar.project(&view, r.data, r.stride, NULL, r.count, want.splats,
                                                                    want.keys, false, want.boxes, NULL);
      CHECK(!CHECK_EXACT || (here.held == there.held && here.beyond == there.beyond));
      held += here.held;
      beyond += here.beyond;
      check_release();
    }
  check_note("%d rows drawn, %d elsewhere than at mid-exposure, %d held, %d beyond", drawn, moved, held, beyond);
  CHECK(drawn > (kind < 0 ? 300 : 30) && held < drawn / 2);
  CHECK(rolls ? moved > drawn / 2 && (kind >= 0 || held > 0) : moved == 0 && held == 0);
  CHECK((beyond > 0) == (kind == 0 || kind == 1));
}

static void test_rolling(const pags_kernels *k) {
  check_moving(k, true, -1);
}

static void test_lens(const pags_kernels *k) {
  for (int kind = 0; kind < 6; kind++)
    check_moving(k, kind % 2, kind / 2);
}

/* A pinhole (-1) or the lens of a kind. */
static void bench_moving(const pags_kernels *k, const char *what, bool rolls, int kind) {
  static pags_lens_table lens;
  pags_projection view = view_random(3, false);
  const pags_scan scan = scan_random(&view);
  const rows r = rows_random(&view, 256, ROWS_ORDINARY);
  if (kind >= 0) {
    lens_random(&view, kind, &lens);
    lens.terms_of = PAGS_LENS_NO_TERMS;
    view.lens = &lens;
  }
  view.scan = rolls ? &scan : NULL;
  const projection p = project(k, &view, &r);
  CHECK_BENCH(what, r.count, "row")
  k->project(&view, r.data, r.stride, NULL, r.count, p.splats, p.keys, false, p.boxes, NULL);
}

static void test_rolling_bench(const pags_kernels *k) {
  bench_moving(k, "project, rolling", true, -1);
}

static void test_lens_bench(const pags_kernels *k) {
  bench_moving(k, "project, lens", false, 0);
  bench_moving(k, "project, rolling, lens", true, 0);
}

static void test_bench(const pags_kernels *k) {
  const pags_projection view = view_random(3, false);
  const rows r = rows_random(&view, 256, ROWS_ORDINARY);
  const projection p = project(k, &view, &r);
  CHECK_BENCH("project", r.count, "row")
  k->project(&view, r.data, r.stride, NULL, r.count, p.splats, p.keys, false, p.boxes, NULL);
  CHECK_BENCH("project with tiles", r.count, "row")
  k->project(&view, r.data, r.stride, NULL, r.count, p.splats, p.keys, true, p.boxes, NULL);
}

/* Checks one axis: blocks [first, end) must contain every pixel centre of the picture within `extent` of the mean,
 * and extend at most one block beyond on either side. */
static void check_reach_axis(int row, double mean, double extent, double size, int first, int end) {
  const double lo = fmax(ceil(mean - extent - 0.5), 0.0), hi = fmin(floor(mean + extent - 0.5), size - 1.0);
  if (lo > hi)
    return;
  if (first > (int)lo / 4 || end <= (int)hi / 4 || end > (int)ceil(size / 4))
    CHECK_FAIL("row %d: blocks %d to %d don't hold pixels %.0f to %.0f of %.0f", row, first, end, lo, hi, size);
  /* Slack for the rounding of the cut-off, for extents of at least a pixel. */
  const double wide = extent * 1.05 + 3.0;
  CHECK(extent < 1.0 || ((first + 1) * 4 >= mean - wide - 4.0 && (end - 1) * 4 <= mean + wide + 4.0) || first == 0);
}

/* The blocks that projection says a splat may reach contain all pixels where the rasteriser's form of the Gaussian
 * is above the cut-off. */
static void check_reaches(const pags_kernels *k, row_kind kind) {
  int64_t drawn = 0;
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++) {
    const pags_projection view = view_random(0, n % 2);
    const rows r = rows_random(&view, counts[n], kind);
    const projection p = {CHECK_NEW(pags_splat, r.count), CHECK_NEW(uint32_t, r.count),
                          CHECK_NEW(pags_tile_box, r.count)};
    pags_reach *const reaches = CHECK_NEW(pags_reach, r.count);
    k->project(&view, r.data, r.stride, NULL, r.count, p.splats, p.keys, false, p.boxes, reaches);
    for (int i = 0; i < r.count; i++) {
      if (p.keys[i] == UINT32_MAX)
        continue;
      const pags_splat *const s = p.splats + i;
      const double cut = (double)s->log2_opacity - (double)s->cut, inv_p = 1.0 / (double)s->p,
                   inv_w = 1.0 / (double)s->w;
      const double x = sqrt(cut * (inv_p * inv_p + (double)s->h * (double)s->h * inv_w * inv_w)), y = sqrt(cut) * inv_w;
      if (cut <= 0.0)
        continue;
      check_reach_axis(i, (double)s->x, x, (double)view.width, reaches[i].x0, reaches[i].x1);
      check_reach_axis(i, (double)s->y, y, (double)view.height, reaches[i].y0, reaches[i].y1);
      drawn++;
    }
    check_release();
  }
  CHECK(drawn > 100);
}

static void test_reaches(const pags_kernels *k) {
  check_reaches(k, ROWS_ORDINARY);
  check_reaches(k, ROWS_NEEDLES);
  check_reaches(k, ROWS_AWKWARD);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"project ordinary", test_ordinary},
      {"project needles", test_needles},
      {"project awkward", test_awkward},
      {"project clips", test_clips},
      {"project edges", test_edges},
      {"project factor", test_factor},
      {"project tiles", test_tiles},
      {"project reaches", test_reaches},
      {"project bench", test_bench},
      {"project lens", test_lens},
      {"project lens bench", test_lens_bench},
      {"project rolling", test_rolling},
      {"project rolling bench", test_rolling_bench},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
