/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the colour kernel. Compares each ISA with the scalar kernel (to the bit if the build allows that), and all
 * with double. */
#include "rows.h"

#include <math.h>
#include <string.h>

static const int counts[] = {0, 1, 7, 8, 9, 15, 16, 17, 63, 64, 255, 256};

/* Makes depth keys: one in three rows, and one whole SIMD vector, aren't drawn. */
static uint32_t *make_keys(int count) {
  uint32_t *const keys = CHECK_NEW(uint32_t, count);
  for (int i = 0; i < count; i++)
    keys[i] = (i >= 32 && i < 48) || check_below(3) == 0 ? UINT32_MAX : 0x3F800000u;
  check_freeze(keys);
  return keys;
}

static pags_splat *shade(const pags_kernels *k, const pags_projection *view, const rows *r, const uint32_t *keys) {
  pags_splat *const splats = CHECK_NEW(pags_splat, r->count);
  k->shade(view, r->data, r->stride, NULL, r->count, keys, splats);
  return splats;
}

/* SH coefficients in separate planes give the same bits as those in the rows. */
static void test_other_sh(const pags_kernels *k) {
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int degree = 0; degree <= 3; degree++) {
      const pags_projection view = view_random(degree, false);
      rows r = rows_random(&view, counts[n], ROWS_ORDINARY);
      const uint32_t *const keys = make_keys(r.count);
      pags_splat *const want = shade(k, &view, &r, keys), *const got = CHECK_NEW(pags_splat, r.count);
      const int64_t padded = round_up_16(r.count), size = (r.planes - 1) * r.stride + padded;
      float *const data = CHECK_NEW(float, size);
      const int planes = r.planes - ROW_SH;
      float *const sh = CHECK_NEW(float, r.count ? (planes - 1) * r.stride + padded : 0);
      for (int64_t i = 0; i < (r.count ? size : 0); i++)
        data[i] = r.data[i];
      for (int c = 0; c < planes && r.count; c++)
        for (int64_t i = 0; i < padded; i++) {
          sh[c * r.stride + i] = data[(ROW_SH + c) * r.stride + i];
          data[(ROW_SH + c) * r.stride + i] = 7.0f * check_normal();
        }
      k->shade(&view, data, r.stride, sh, r.count, keys, got);
      CHECK(memcmp(got, want, (size_t)r.count * sizeof *got) == 0);
      check_release();
    }
}

/* Only the colour of a splat may change; a splat that isn't drawn may not change at all. */
static void check_untouched(const pags_splat *s, bool drawn) {
  pags_splat want;
  memset(&want, 0xA5, sizeof want);
  if (drawn)
    want.r = s->r, want.g = s->g, want.b = s->b, want.clamped = s->clamped;
  CHECK(memcmp(s, &want, sizeof want) == 0);
}

static void check_colour(const pags_splat *s, const double row[ROW_FLOATS], const plain_row *want, int planes,
                         int index) {
  const float got[3] = {s->r, s->g, s->b};
  for (int c = 0; c < 3; c++) {
    double size = 0.5; /* magnitude of the summed terms */
    for (int p = ROW_SH + c; p < planes; p += 3)
      size += fabs(row[p]);
    if (!(fabs((double)got[c] - fmin(fmax(want->rgb[c], 0.0), (double)PAGS_COLOUR_MAX)) <= 1e-6 * size))
      CHECK_FAIL("row %d, channel %d: %.9g, should be %.9g", index, c, (double)got[c], fmax(want->rgb[c], 0.0));
    if (fabs(want->rgb[c]) > 1e-6 * size)
      CHECK((s->clamped >> c & 1u) == (want->rgb[c] < 0.0));
  }
  CHECK(s->clamped < 8);
}

static void check_kind(const pags_kernels *k, row_kind kind) {
  int checked = 0;
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int degree = 0; degree <= 3; degree++) {
      const pags_projection view = view_random(degree, false);
      const rows r = rows_random(&view, counts[n], kind);
      const uint32_t *const keys = make_keys(r.count);
      const pags_splat *const got = shade(k, &view, &r, keys), *const want =
                                                                   shade(&pags_kernels_scalar, &view, &r, keys);
      for (int i = 0; i < r.count; i++) {
        double row[ROW_FLOATS];
        row_read(&r, i, row);
        const bool drawn = keys[i] != UINT32_MAX;
        check_untouched(got + i, drawn);
        if (CHECK_EXACT && memcmp(got + i, want + i, sizeof *got) != 0)
          CHECK_FAIL("row %d: not the scalar kernel's colour", i);
        if (drawn && row_usable(row, r.planes)) {
          const plain_row plain = row_plainly(&view, row);
          double position = 0.0;
          for (int j = 0; j < 3; j++)
            position = fmax(position, fabs(row[ROW_MEAN + j]));
          if (plain.drawn && position < 1e15) /* beyond 1e15 the squared distance overflows */
            check_colour(got + i, row, &plain, r.planes, i), checked++;
        }
        if (drawn) /* colours are finite and in range for any coefficients */
          CHECK(got[i].r >= 0.0f && got[i].r <= PAGS_COLOUR_MAX && got[i].g >= 0.0f && got[i].g <= PAGS_COLOUR_MAX &&
                got[i].b >= 0.0f && got[i].b <= PAGS_COLOUR_MAX);
      }
      check_release();
    }
  CHECK(checked > 500);
}

static void test_ordinary(const pags_kernels *k) {
  check_kind(k, ROWS_ORDINARY);
}
static void test_awkward(const pags_kernels *k) {
  check_kind(k, ROWS_AWKWARD);
}

static void test_bench(const pags_kernels *k) {
  for (int degree = 0; degree <= 3; degree += 3) {
    const pags_projection view = view_random(degree, false);
    const rows r = rows_random(&view, 256, ROWS_ORDINARY);
    uint32_t *const keys = CHECK_NEW(uint32_t, r.count);
    memset(keys, 0, (size_t)r.count * sizeof *keys);
    pags_splat *const splats = shade(k, &view, &r, keys);
    CHECK_BENCH(degree ? "shade, degree 3" : "shade, degree 0", r.count, "row")
    k->shade(&view, r.data, r.stride, NULL, r.count, keys, splats);
  }
}

int main(int argc, char **argv) {
  static const check_case cases[] = {{"shade ordinary", test_ordinary},
                                     {"shade awkward", test_awkward},
                                     {"shade other SH", test_other_sh},
                                     {"shade bench", test_bench}};
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
