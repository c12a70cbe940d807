/* SPDX-License-Identifier: Apache-2.0 */
/* Compares every operation of vec.h on every ISA with plain C, to the bit (any two NaNs are equal), and checks the
 * error bounds that vec.h states for exp2, exp and log2. */
#include "check.h"
#include "vec_ops.h"

#include <math.h>
#include <string.h>

static float plain_float(int32_t bits) {
  float x;
  memcpy(&x, &bits, sizeof x);
  return x;
}
static uint32_t plain_bits(float x) {
  uint32_t bits;
  memcpy(&bits, &x, sizeof bits);
  return bits;
}
static float plain_fma(float x, float y, float z, bool fused) {
  return fused ? fmaf(x, y, z) : x * y + z;
}
static float plain_fnma(float x, float y, float z, bool fused) {
  return fused ? fmaf(-x, y, z) : z - x * y;
}

static uint32_t word_f(float x) {
  return plain_bits(x);
}
static uint32_t word_i(int32_t x) {
  return (uint32_t)x;
}
static uint32_t word_m(bool x) {
  return x ? UINT32_MAX : 0;
}

#define DEFINE(name, kind, vectors, lane)                                             \
  static uint32_t lane_##name(uint32_t xb, uint32_t yb, uint32_t zb, bool fused) {    \
    const int32_t i = (int32_t)xb, j = (int32_t)yb;                                   \
    const float x = plain_float(i), y = plain_float(j), z = plain_float((int32_t)zb); \
    const bool m = zb & 1u;                                                           \
    (void)x, (void)y, (void)z, (void)i, (void)j, (void)m, (void)fused;                \
    return word_##kind(lane);                                                         \
  }
VEC_LANE_OPS(DEFINE)

static const struct {
  const char *name;
  char kind;
  uint32_t (*lane)(uint32_t x, uint32_t y, uint32_t z, bool fused);
} lane_ops[] = {
#define ROW(name, kind, vectors, lane) {#name, #kind[0], lane_##name},
    VEC_LANE_OPS(ROW)};

static const vec_ops *ops_of(const pags_kernels *k) {
#if defined(VEC_OPS_avx2)
  if (strcmp(k->name, "avx2") == 0)
    return &vec_ops_avx2;
  if (strcmp(k->name, "avx512") == 0)
    return &vec_ops_avx512;
#elif defined(VEC_OPS_neon)
  if (strcmp(k->name, "neon") == 0)
    return &vec_ops_neon;
#endif
  (void)k;
  return &vec_ops_scalar;
}

/* A random word: an ordinary number, random bits, or one of the values where implementations differ. */
static uint32_t awkward_word(void) {
  static const float special[] = {0.0f,      -0.0f,           1.0f,       -1.0f,  0.5f,          -1.5f,
                                  2.5f,      INFINITY,        -INFINITY,  NAN,    0x1p-149f,     -0x1.8p-130f,
                                  0x1p-126f, 0x1.fffffep127f, 8388607.5f, 1e-30f, -2147483520.0f};
  switch (check_below(4)) {
    case 0: return plain_bits(special[check_below((int)(sizeof special / sizeof *special))]);
    case 1: return check_u32();
    case 2: return plain_bits((float)check_below(9) - 4.0f);
    default: return plain_bits(check_normal() * ldexpf(1.0f, check_below(40) - 20));
  }
}

static void test_lanes(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  uint32_t(*const in)[VEC_LANES] = check_buffer(3 * VEC_LANES * sizeof(uint32_t));
  uint32_t *const out = CHECK_NEW(uint32_t, VEC_LANES);
  for (int round = 0; round < 2000; round++) {
    for (int l = 0; l < 3 * VEC_LANES; l++)
      in[l / VEC_LANES][l % VEC_LANES] = awkward_word();
    for (size_t o = 0; o < sizeof lane_ops / sizeof *lane_ops; o++) {
      ops->lanes[o]((const uint32_t(*)[VEC_LANES])in, out);
      for (int l = 0; l < VEC_LANES; l++) {
        const uint32_t want = lane_ops[o].lane(in[0][l], in[1][l], in[2][l], ops->fused);
        const bool both_nan =
            lane_ops[o].kind == 'f' && isnan(plain_float((int32_t)want)) && isnan(plain_float((int32_t)out[l]));
        if (out[l] != want && !both_nan)
          CHECK_FAIL("%s(%08x, %08x, %08x): %08x, should be %08x", lane_ops[o].name, in[0][l], in[1][l], in[2][l],
                     out[l], want);
      }
    }
  }
}

static void test_masks(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  float *const x = CHECK_NEW(float, VEC_LANES);
  for (int count = 1; count <= 100; count++)
    CHECK(ops->first(count) == (count >= 16 ? 0xFFFFu : (1u << count) - 1u));
  ops->iota(x);
  for (int l = 0; l < VEC_LANES; l++)
    CHECK(x[l] == (float)l);
  for (unsigned bits = 0; bits <= 0xFFFFu; bits++)
    CHECK(ops->from_and_to_bits(bits) == bits);
}

/* compress and pack write at most sixteen lanes, for every choice of lanes. */
static void test_compress(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  int32_t *const in = CHECK_NEW(int32_t, VEC_LANES), *const out = CHECK_NEW(int32_t, VEC_LANES);
  int32_t *const half = CHECK_NEW(int32_t, VEC_LANES / 2);
  float *const floats = CHECK_NEW(float, VEC_LANES);
  for (int l = 0; l < VEC_LANES; l++)
    in[l] = (int32_t)(check_u32() & 0xBFFFFFFF); /* as floats: no NaN, whose bits a copy may change */
  for (unsigned chosen = 0; chosen <= 0xFFFFu; chosen++) {
    const int n = ops->compress(out, chosen, in);
    int want = 0;
    for (int l = 0; l < VEC_LANES; l++)
      if (chosen >> l & 1u)
        CHECK(out[want++] == in[l]);
    CHECK(n == want);
    CHECK(chosen > 0xFFu ||
          (ops->compress8(half, chosen, in) == want && memcmp(half, out, (size_t)want * sizeof *out) == 0));
    CHECK(ops->pack(floats, chosen, (const float *)(const void *)in) == want);
    CHECK(memcmp(floats, out, (size_t)want * sizeof *out) == 0);
  }
}

static void test_memory(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  const int64_t stride = 7;
  uint8_t *const bytes = CHECK_NEW(uint8_t, VEC_LANES);
  float *const out = CHECK_NEW(float, VEC_LANES), *const twelve = CHECK_NEW(float, 12);
  float *const picture = CHECK_NEW(float, 3 * stride + 4), *const copy = CHECK_NEW(float, 3 * stride + 4);
  for (int l = 0; l < VEC_LANES; l++)
    bytes[l] = (uint8_t)check_u32();
  ops->load_u8(bytes, out);
  for (int l = 0; l < VEC_LANES; l++)
    CHECK(out[l] == (float)bytes[l]);
  for (int i = 0; i < 3 * stride + 4; i++)
    picture[i] = (float)i, copy[i] = -1.0f;
  ops->load_4x4(picture, stride, out);
  for (int l = 0; l < VEC_LANES; l++)
    CHECK(out[l] == (float)(l / 4 * stride + l % 4));
  ops->store_4x4(copy, stride, out);
  for (int i = 0; i < 3 * stride + 4; i++)
    CHECK(copy[i] == (i % stride < 4 ? (float)i : -1.0f));
  ops->store12(twelve, out);
  CHECK_SAME("store12", twelve, out, 12);
  memset(out, 0xFF, VEC_LANES * sizeof *out);
  ops->load12(twelve, out);
  for (int l = 0; l < VEC_LANES; l++)
    CHECK(l < 12 ? out[l] == twelve[l] : plain_bits(out[l]) == 0);
}

static void test_rows_of_four(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  float *const rows = CHECK_NEW(float, 64), *const columns = CHECK_NEW(float, 48),
               *const out = CHECK_NEW(float, VEC_LANES);
  for (int i = 0; i < 64; i++)
    rows[i] = (float)i;
  ops->columns3(rows, columns);
  for (int i = 0; i < 48; i++)
    CHECK(columns[i] == rows[4 * (i % 16) + i / 16]);
  const int from[4] = {60, 1, 30, 17};
  ops->load_fours(rows + from[0], rows + from[1], rows + from[2], rows + from[3], out);
  for (int l = 0; l < VEC_LANES; l++)
    CHECK(out[l] == (float)(from[l / 4] + l % 4));
  for (int quarter = 0; quarter < 4; quarter++) {
    ops->spread(rows, quarter, out);
    for (int l = 0; l < VEC_LANES; l++)
      CHECK(out[l] == (float)(4 * quarter + l / 4));
  }
}

static void test_transposed(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  float *const rows = CHECK_NEW(float, 16 * VEC_LANES);
  for (int i = 0; i < 16 * VEC_LANES; i++)
    rows[i] = (float)i;
  ops->transpose(rows);
  for (int i = 0; i < 16 * VEC_LANES; i++)
    CHECK(rows[i] == (float)(i % 16 * 16 + i / 16));
  for (int i = 0; i < 4 * VEC_LANES; i++)
    rows[i] = (float)i;
  ops->transpose4(rows);
  for (int i = 0; i < 4 * VEC_LANES; i++) {
    const int row = i / VEC_LANES, quarter = i % VEC_LANES / 4;
    CHECK(rows[i] == (float)(i % 4 * VEC_LANES + 4 * quarter + row));
  }
}

static float plain_sum(const float *x) {
  float s[VEC_LANES];
  memcpy(s, x, sizeof s);
  for (int half = 8; half >= 1; half /= 2)
    for (int l = 0; l < half; l++)
      s[l] += s[l + half];
  return s[0];
}

static void test_sums(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  float *const in = CHECK_NEW(float, 12 * VEC_LANES), *const out = CHECK_NEW(float, VEC_LANES);
  for (int round = 0; round < 1000; round++) {
    float want[VEC_LANES] = {0.0f};
    for (int i = 0; i < 12 * VEC_LANES; i++)
      in[i] = check_normal() * ldexpf(1.0f, check_below(24));
    for (int a = 0; a < 12; a++) {
      want[a] = plain_sum(in + a * VEC_LANES);
      const float sum = ops->sum(in + a * VEC_LANES);
      CHECK_SAME("v_sum", &sum, want + a, 1);
    }
    ops->sum12(in, out);
    CHECK_SAME("v_sum12", out, want, VEC_LANES);
  }
}

/* Returns the largest relative error (absolute for log2, whose result passes through 0) over a fine grid with random
 * offsets, so that no regular lattice is hit. */
static double worst_error(const vec_ops *ops, vec_math math, double (*exact)(double), double lo, double hi) {
  enum { POINTS = 1 << 17 };
  float in[VEC_LANES], out[VEC_LANES];
  double worst = 0.0;
  for (int first = 0; first < POINTS; first += VEC_LANES) {
    for (int l = 0; l < VEC_LANES; l++)
      in[l] = (float)(lo + (hi - lo) * (first + l + (double)check_uniform(0.0f, 1.0f)) / POINTS);
    ops->math[math](in, out);
    for (int l = 0; l < VEC_LANES; l++) {
      const double want = exact((double)in[l]), scale = math == VEC_LOG2 ? fmax(1.0, fabs(want)) : want;
      worst = fmax(worst, fabs((double)out[l] - want) / scale);
    }
  }
  return worst;
}

static void test_exp2(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  const double at3 = worst_error(ops, VEC_EXP2_3, exp2, -125.9, 125.9),
               at5 = worst_error(ops, VEC_EXP2_5, exp2, -125.9, 125.9);
  check_note("relative error %.3g at degree 3, %.3g at 5", at3, at5);
  const double rounding = 4 * 0x1p-24; /* rounding of the last few operations */
  CHECK(at3 <= 7.5e-5 + rounding);
  CHECK(at5 <= 7.5e-8 + rounding);
  for (int x = -125; x <= 125; x++) { /* the polynomial of a whole number is its constant term */
    float in[VEC_LANES], out[VEC_LANES];
    for (int l = 0; l < VEC_LANES; l++)
      in[l] = (float)x;
    ops->math[VEC_EXP2_5](in, out);
    CHECK(check_ulps(out[0], ldexpf(1.0f, x)) <= 1);
  }
}

static void test_exp(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  const double worst = worst_error(ops, VEC_EXP, exp, -87.0, 88.0), near = worst_error(ops, VEC_EXP, exp, -5.0, 5.0);
  check_note("relative error %.3g, %.3g within [-5, 5]", worst, near);
  CHECK(worst <= 2 * 0x1p-23);
  float in[VEC_LANES] = {0.0f, -0.0f, 88.0f, 89.0f, INFINITY, -87.0f, -88.0f, -INFINITY, -1e30f, 1e30f, NAN},
        out[VEC_LANES];
  in[11] = plain_float(0x7FC00001), in[12] = plain_float((int32_t)0xFFFFFFFFu), in[13] = plain_float(0x7FC0FF80);
  ops->math[VEC_EXP](in, out);
  CHECK(out[0] == 1.0f && out[1] == 1.0f);
  CHECK(out[3] == out[2] && out[4] == out[2] && out[9] == out[2] && isfinite(out[2]));
  CHECK(out[6] == out[5] && out[7] == out[5] && out[8] == out[5] && out[5] > 0.0f);
  for (int l = 10; l < 14; l++) /* any NaN payload that a file may hold */
    if (!isnan(out[l]))
      CHECK_FAIL("exp(NaN %08x) is %g", plain_bits(in[l]), (double)out[l]);
}

static void test_log2(const pags_kernels *k) {
  const vec_ops *const ops = ops_of(k);
  const double small = worst_error(ops, VEC_LOG2, log2, 1e-3, 4.0), large = worst_error(ops, VEC_LOG2, log2, 4.0, 3e38);
  const double tiny = worst_error(ops, VEC_LOG2, log2, 0x1p-126, 1e-30);
  check_note("error %.3g below 4, %.3g above, %.3g near 2^-126 (relative beyond 1)", small, large, tiny);
  CHECK(small <= 1.5 * 0x1p-23 && large <= 1.5 * 0x1p-23 && tiny <= 1.5 * 0x1p-23);
  float in[VEC_LANES] = {1.0f, 2.0f, 0.5f, 0x1p-126f, 0x1p127f, 1e-30f, 0x1.fffffep0f}, out[VEC_LANES];
  for (int l = 7; l < VEC_LANES; l++)
    in[l] = 1.0f;
  ops->math[VEC_LOG2](in, out);
  CHECK(out[0] == 0.0f && out[1] == 1.0f && out[2] == -1.0f && out[3] == -126.0f && out[4] == 127.0f);
}

int main(int argc, char **argv) {
  static const check_case cases[] = {
      {"lanes", test_lanes},       {"masks", test_masks},
      {"compress", test_compress}, {"transposed", test_transposed},
      {"memory", test_memory},     {"rows of four", test_rows_of_four},
      {"sums", test_sums},         {"exp2", test_exp2},
      {"exp", test_exp},           {"log2", test_log2},
  };
  return check_main(argc, argv, cases, (int)(sizeof cases / sizeof *cases));
}
