/* SPDX-License-Identifier: Apache-2.0 */
/* Each operation of simd/vec.h as a function over plain arrays: vec_ops.c compiled once per ISA, for test_vec.c. */
#ifndef PAGS_TESTS_VEC_OPS_H
#define PAGS_TESTS_VEC_OPS_H

#include <stdbool.h>
#include <stdint.h>

/* Lane by lane: name, kind of result (f, i or m), the expression over vectors and the same over a lane. Floats x,
 * y, z, ints i, j (the bits of x and y), m a truth value (the lowest bit of z). */
#define VEC_LANE_OPS(X)                                                                             \
  X(v_set, f, v_set(1.5f), 1.5f)                                                                    \
  X(v_zero, f, v_zero(), 0.0f)                                                                      \
  X(v_load, f, x, x)                                                                                \
  X(v_add, f, v_add(x, y), x + y)                                                                   \
  X(v_sub, f, v_sub(x, y), x - y)                                                                   \
  X(v_mul, f, v_mul(x, y), x *y)                                                                    \
  X(v_div, f, v_div(x, y), x / y)                                                                   \
  X(v_sqrt, f, v_sqrt(x), sqrtf(x))                                                                 \
  X(v_min, f, v_min(x, y), x < y ? x : y)                                                           \
  X(v_max, f, v_max(x, y), x > y ? x : y)                                                           \
  X(v_fma, f, v_fma(x, y, z), plain_fma(x, y, z, fused))                                            \
  X(v_fnma, f, v_fnma(x, y, z), plain_fnma(x, y, z, fused))                                         \
  X(v_abs, f, v_abs(x), fabsf(x))                                                                   \
  X(v_clamp, f, v_clamp(x, v_set(-2.0f), v_set(3.0f)), isnan(x) ? x : fminf(fmaxf(x, -2.0f), 3.0f)) \
  X(v_dot3, f, v_dot3(x, y, z, y, z, x), plain_fma(x, y, plain_fma(y, z, z *x, fused), fused))      \
  X(v_select, f, v_select(m, x, y), m ? x : y)                                                      \
  X(v_maskz, f, v_maskz(m, x), m ? x : 0.0f)                                                        \
  X(v_minus_abs, f, v_minus_abs(x), -fabsf(x))                                                      \
  X(v_from_bits, f, v_from_bits(i_add(i, j)), plain_float((int32_t)((uint32_t)i + (uint32_t)j)))    \
  X(i_to_v, f, i_to_v(i), (float)i)                                                                 \
  X(v_lt, m, v_lt(x, y), x < y)                                                                     \
  X(v_le, m, v_le(x, y), x <= y)                                                                    \
  X(v_gt, m, v_gt(x, y), x > y)                                                                     \
  X(v_ge, m, v_ge(x, y), x >= y)                                                                    \
  X(v_ge_and, m, v_ge_and(m, x, y), m &&x >= y)                                                     \
  X(m_and, m, m_and(m, v_lt(x, y)), m &&x < y)                                                      \
  X(m_or, m, m_or(m, v_lt(x, y)), m || x < y)                                                       \
  X(m_andnot, m, m_andnot(m, v_lt(x, y)), m && !(x < y))                                            \
  X(i_set, i, i_set(-7), -7)                                                                        \
  X(i_load, i, i, i)                                                                                \
  X(v_bits, i, v_bits(x), i)                                                                        \
  X(i_add, i, i_add(i, j), (int32_t)((uint32_t)i + (uint32_t)j))                                    \
  X(i_mul, i, i_mul(i, j), (int32_t)((uint32_t)i * (uint32_t)j))                                    \
  X(i_and, i, i_and(i, j), i &j)                                                                    \
  X(i_or, i, i_or(i, j), i | j)                                                                     \
  X(i_select, i, i_select(m, i, j), m ? i : j)                                                      \
  X(i_shl_1, i, i_shl(i, 1), (int32_t)((uint32_t)i << 1))                                           \
  X(i_shl_23, i, i_shl(i, 23), (int32_t)((uint32_t)i << 23))                                        \
  X(i_shr_1, i, i_shr(i, 1), (int32_t)((uint32_t)i >> 1))                                           \
  X(i_shr_31, i, i_shr(i, 31), (int32_t)((uint32_t)i >> 31))                                        \
  X(v_to_i, i, v_to_i(v_maskz(v_lt(v_abs(x), v_set(0x1p31f)), x)), fabsf(x) < 0x1p31f ? (int32_t)lrintf(x) : 0)

enum { VEC_LANES = 16 };

typedef void vec_lane_op(const uint32_t in[3][VEC_LANES], uint32_t out[VEC_LANES]);

typedef enum vec_math { VEC_EXP2_3, VEC_EXP2_5, VEC_EXP, VEC_LOG2, VEC_MATHS } vec_math;

typedef struct vec_ops {
  bool fused;                /* whether v_fma should be a fused multiply-add */
  vec_lane_op *const *lanes; /* in the order of VEC_LANE_OPS */
  void (*math[VEC_MATHS])(const float *in, float *out);
  void (*iota)(float *out);
  unsigned (*first)(int count);
  unsigned (*from_and_to_bits)(unsigned bits);
  int (*compress)(int32_t *out, unsigned chosen, const int32_t *in);
  int (*compress8)(int32_t *out, unsigned chosen, const int32_t *in);
  int (*pack)(float *out, unsigned chosen, const float *in);
  void (*transpose)(float *rows);  /* 16 vectors, in place */
  void (*transpose4)(float *rows); /* 4 vectors, in place */
  void (*spread)(const float *in, int quarter, float *out);
  void (*load_fours)(const float *a, const float *b, const float *c, const float *d, float *out);
  void (*columns3)(const float *in, float *out); /* transposes 64 floats to 48 */
  void (*load_u8)(const uint8_t *in, float *out);
  void (*load_4x4)(const float *in, int64_t stride, float *out);
  void (*store_4x4)(float *out, int64_t stride, const float *in);
  void (*load12)(const float *in, float *out);
  void (*store12)(float *out, const float *in);
  float (*sum)(const float *in);
  void (*sum12)(const float *in, float *out); /* `in` holds 12 vectors */
} vec_ops;

extern const vec_ops vec_ops_scalar, vec_ops_avx2, vec_ops_avx512, vec_ops_neon;

#endif
