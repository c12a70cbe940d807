/* SPDX-License-Identifier: Apache-2.0 */
/* Sixteen float lanes on every machine: one AVX-512 register, two AVX2, four NEON, or four of the compiler's own
 * vectors in the scalar build. vf: sixteen floats; vi: sixteen int32; vm: sixteen truth values.
 *
 * A kernel source is written once over these functions and compiled once per ISA (simd/CMakeLists.txt). Because the
 * lane count and the order of every horizontal sum are the same everywhere, builds without fused multiply-add
 * (PAGS_REPRODUCIBLE) agree to the bit on all ISAs.
 *
 * Rules that hold for every implementation:
 *
 *     v_fma, v_fnma   fused if the ISA has it and the build allows it (PAGS_FUSED), else a product and a sum
 *     v_min(a, b)     a < b ? a : b; v_max(a, b): a > b ? a : b. If a or b is NaN, the result is b
 *     comparisons     false if either side is NaN
 *     v_to_i          rounds to the nearest integer, ties to even; the caller must ensure |x| < 2^31
 *     sums            always in the same order: lane i + lane i + 8, of these i + (i + 4), then i + (i + 2), then 0 + 1
 *     loads, stores   need no alignment
 *     v_load_fours    loads four floats from each of four addresses
 *     v_spread        repeats each of the lanes 4 k, ..., 4 k + 3 four times
 *     i_compress      stores the lanes selected by m, without gaps, and returns their number; writes up to 16 numbers
 *     i_compress8     the same for the first eight lanes, by the bits of a mask; bits from 8 on must be 0
 *     v_packing_of    permutation that moves the lanes selected by m to the front, and their number `count`
 *     v_pack          stores a vector's lanes permuted so; writes up to 16 floats
 *     v_transpose4    of four vectors: lanes 4 q, ..., 4 q + 3 of rows[j] become lane 4 q + j of the four
 *     v_transpose     of sixteen vectors: lane j of rows[k] becomes lane k of rows[j]
 *     v_columns3      of 16 groups of four lanes (four vectors): the first, second and third lane of each
 */
#ifndef PAGS_SIMD_VEC_H
#define PAGS_SIMD_VEC_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

enum { V_LANES = 16 };

/* Forces inlining, for functions whose constant arguments select a variant: otherwise gcc leaves the selection in the
 * inner loop. */
#define V_INLINE static inline __attribute__((always_inline))

/* Byte shuffles that move the lanes, of four, whose bits are set in the mask (the first index) to the front; 128
 * clears a byte. */
#if defined(PAGS_ISA_AVX2) || defined(PAGS_ISA_NEON)
static const uint8_t v_compress4[16][16] __attribute__((aligned(16))) = {
    {128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128},
    {0, 1, 2, 3, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128},
    {4, 5, 6, 7, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128},
    {0, 1, 2, 3, 4, 5, 6, 7, 128, 128, 128, 128, 128, 128, 128, 128},
    {8, 9, 10, 11, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128},
    {0, 1, 2, 3, 8, 9, 10, 11, 128, 128, 128, 128, 128, 128, 128, 128},
    {4, 5, 6, 7, 8, 9, 10, 11, 128, 128, 128, 128, 128, 128, 128, 128},
    {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 128, 128, 128, 128},
    {12, 13, 14, 15, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128, 128},
    {0, 1, 2, 3, 12, 13, 14, 15, 128, 128, 128, 128, 128, 128, 128, 128},
    {4, 5, 6, 7, 12, 13, 14, 15, 128, 128, 128, 128, 128, 128, 128, 128},
    {0, 1, 2, 3, 4, 5, 6, 7, 12, 13, 14, 15, 128, 128, 128, 128},
    {8, 9, 10, 11, 12, 13, 14, 15, 128, 128, 128, 128, 128, 128, 128, 128},
    {0, 1, 2, 3, 8, 9, 10, 11, 12, 13, 14, 15, 128, 128, 128, 128},
    {4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 128, 128, 128, 128},
    {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15},
};
#endif

/* NEON and scalar: define functions that compute each quarter of their result, with the ISA's V_DO, from that of x, or
 * of x and y. */
#if defined(PAGS_ISA_NEON) || defined(PAGS_ISA_SCALAR)
#define V_UNARY(result, name, operand, expression) \
  static inline result name(operand x) {           \
    V_DO(result, expression);                      \
  }
#define V_BINARY(result, name, operand, expression) \
  static inline result name(operand x, operand y) { \
    V_DO(result, expression);                       \
  }
#endif

#if defined(PAGS_ISA_AVX512)
#include "vec_avx512.h"
#elif defined(PAGS_ISA_AVX2)
#include "vec_avx2.h"
#elif defined(PAGS_ISA_NEON)
#include "vec_neon.h"
#elif defined(PAGS_ISA_SCALAR)
#include "vec_scalar.h"
#else
#error "compile kernels through simd/CMakeLists.txt, which names the ISA"
#endif

#if !defined(PAGS_FUSED) || defined(PAGS_ISA_SCALAR)
static inline vf v_fma(vf x, vf y, vf z) {
  return v_add(v_mul(x, y), z);
}
static inline vf v_fnma(vf x, vf y, vf z) {
  return v_sub(z, v_mul(x, y));
}
#endif

#if !defined(PAGS_ISA_AVX512)
static inline vm v_ge_and(vm m, vf x, vf y) {
  return m_and(m, v_ge(x, y));
}
#endif
static inline vf v_zero(void) {
  return v_set(0.0f);
}

/* Loads four rows of four floats, `stride` floats apart. */
static inline vf v_load_4x4(const float *p, int64_t stride) {
  return v_load_fours(p, p + stride, p + 2 * stride, p + 3 * stride);
}

/* 0, 1, ..., 15 */
static inline vf v_iota(void) {
  static const float lanes[V_LANES] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  return v_load(lanes);
}

static inline vm m_first(int count) {
  return m_from_bits(count >= V_LANES ? 0xFFFFu : (1u << count) - 1u);
}
/* NaN stays NaN. */
static inline vf v_clamp(vf x, vf lo, vf hi) {
  return v_min(hi, v_max(lo, x));
}
static inline vf v_dot3(vf a, vf b, vf c, vf x, vf y, vf z) {
  return v_fma(a, x, v_fma(b, y, v_mul(c, z)));
}

/* First step of v_exp2 and v_exp: returns x + 1.5 * 2^23, whose low mantissa bits hold round(x); *fraction is
 * x - round(x). */
static inline vf v_exp2_scale(vf x, vf *fraction) {
  const vf magic = v_set(12582912.0f); /* 1.5 * 2^23: adding it rounds to an integer kept in the low mantissa bits */
  const vf shifted = v_add(x, magic);
  *fraction = v_sub(x, v_sub(shifted, magic));
  return shifted;
}
/* 2^x for |x| < 126: 2^round(x), by adding to the exponent bits, times a polynomial in x - round(x) on [-0.5, 0.5].
 * The polynomials are minimax in relative error (found by Lawson's reweighted least squares): 7.5e-5 at degree 3,
 * 7.5e-8 (plus float rounding) at degree 5. */
V_INLINE vf v_exp2(vf x, int degree) {
  vf f, p;
  const vf shifted = v_exp2_scale(x, &f);
  if (degree >= 5) {
    /* Estrin's scheme: 12 cycles of latency where Horner's takes 20. The blending loop is limited by how much latency
     * out-of-order execution can hide. */
    const vf f2 = v_mul(f, f);
    const vf c45 = v_fma(v_set(1.32764721e-3f), f, v_set(9.67554141e-3f));
    const vf c23 = v_fma(v_set(5.55071327e-2f), f, v_set(2.40221197e-1f));
    const vf c01 = v_fma(v_set(6.93146967e-1f), f, v_set(1.00000007f));
    p = v_fma(v_fma(c45, f2, c23), f2, c01);
  } else {
    p = v_fma(v_set(5.51716697e-2f), f, v_set(2.42611127e-1f));
    p = v_fma(p, f, v_set(6.93260986e-1f));
    p = v_fma(p, f, v_set(0.999928073f));
  }
  return v_from_bits(i_add(v_bits(p), i_shl(v_bits(shifted), 23)));
}

/* e^x, x clamped to [-87, 88]; NaN stays NaN. */
static inline vf v_exp(vf x) {
  const vf clamped = v_clamp(x, v_set(-87.0f), v_set(88.0f));
  /* log2 e in two pieces keeps the product's low bits, without which e^20 would be off by 1e-6 relative. */
  const vf hi = v_mul(clamped, v_set(1.4426950f));
  vf f;
  const vf shifted = v_exp2_scale(hi, &f);
  const vf n = v_sub(shifted, v_set(12582912.0f));
  f = v_fnma(n, v_set(0.693359375f), clamped); /* x - n ln 2, ln 2 split so that the first product is exact */
  f = v_fnma(n, v_set(-2.12194440e-4f), f);
  vf p = v_fma(v_set(1.9875691500e-4f), f, v_set(1.3981999507e-3f)); /* Cephes expf */
  p = v_fma(p, f, v_set(8.3334519073e-3f));
  p = v_fma(p, f, v_set(4.1665795894e-2f));
  p = v_fma(p, f, v_set(1.6666665459e-1f));
  p = v_fma(p, f, v_set(5.0000001201e-1f));
  p = v_fma(v_mul(p, f), f, v_add(f, v_set(1.0f)));
  const vf scaled = v_from_bits(i_add(v_bits(p), i_shl(v_bits(shifted), 23)));
  return v_select(v_ge(x, x), scaled, x); /* adding to the bits of a NaN may give a number */
}

/* log2 x for finite normal x > 0, with an error of about 1.5 ulp, by the polynomial of Cephes' logf. */
static inline vf v_log2(vf x) {
  const vi bits = v_bits(x);
  const vi e = i_add(i_shr(bits, 23), i_set(-126));
  vf m = v_from_bits(i_or(i_and(bits, i_set(0x007FFFFF)), i_set(0x3F000000))); /* [0.5, 1) */
  const vm small = v_lt(m, v_set(0.70710678f));
  m = v_select(small, v_add(m, m), m);
  const vf exponent = v_sub(i_to_v(e), v_maskz(small, v_set(1.0f)));
  const vf f = v_sub(m, v_set(1.0f)), f2 = v_mul(f, f);
  vf p = v_fma(v_set(7.0376836292e-2f), f, v_set(-1.1514610310e-1f));
  p = v_fma(p, f, v_set(1.1676998740e-1f));
  p = v_fma(p, f, v_set(-1.2420140846e-1f));
  p = v_fma(p, f, v_set(1.4249322787e-1f));
  p = v_fma(p, f, v_set(-1.6668057665e-1f));
  p = v_fma(p, f, v_set(2.0000714765e-1f));
  p = v_fma(p, f, v_set(-2.4999993993e-1f));
  p = v_fma(p, f, v_set(3.3333331174e-1f));
  const vf ln = v_add(f, v_fma(v_mul(f2, f), p, v_mul(f2, v_set(-0.5f))));
  return v_fma(ln, v_set(1.44269504f), exponent);
}

#endif
