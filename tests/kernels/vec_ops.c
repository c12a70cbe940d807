/* SPDX-License-Identifier: Apache-2.0 */
#include "vec_ops.h"
#include "simd/vec.h"

static void put_f(vf x, uint32_t *out) {
  v_store((float *)(void *)out, x);
}
static void put_i(vi x, uint32_t *out) {
  i_store((int32_t *)(void *)out, x);
}
static void put_m(vm x, uint32_t *out) {
  put_i(i_select(x, i_set(-1), i_set(0)), out);
}

static vm lowest_bits(const uint32_t *words) {
  unsigned bits = 0;
  for (int k = 0; k < V_LANES; k++)
    bits |= (words[k] & 1u) << k;
  return m_from_bits(bits);
}

#define DEFINE(name, kind, vectors, lane)                                                                        \
  static void lane_##name(const uint32_t in[3][VEC_LANES], uint32_t out[VEC_LANES]) {                            \
    const vf x = v_load((const float *)(const void *)in[0]), y = v_load((const float *)(const void *)in[1]);     \
    const vf z = v_load((const float *)(const void *)in[2]);                                                     \
    const vi i = i_load((const int32_t *)(const void *)in[0]), j = i_load((const int32_t *)(const void *)in[1]); \
    const vm m = lowest_bits(in[2]);                                                                             \
    (void)x, (void)y, (void)z, (void)i, (void)j, (void)m;                                                        \
    put_##kind(vectors, out);                                                                                    \
  }
VEC_LANE_OPS(DEFINE)

#define NAME(name, kind, vectors, lane) lane_##name,
static vec_lane_op *const lane_ops[] = {VEC_LANE_OPS(NAME)};

static void math_exp2_3(const float *in, float *out) {
  v_store(out, v_exp2(v_load(in), 3));
}
static void math_exp2_5(const float *in, float *out) {
  v_store(out, v_exp2(v_load(in), 5));
}
static void math_exp(const float *in, float *out) {
  v_store(out, v_exp(v_load(in)));
}
static void math_log2(const float *in, float *out) {
  v_store(out, v_log2(v_load(in)));
}

static void iota(float *out) {
  v_store(out, v_iota());
}
static unsigned first(int count) {
  return m_bits(m_first(count));
}
static unsigned from_and_to_bits(unsigned bits) {
  return m_bits(m_from_bits(bits));
}
static int compress(int32_t *out, unsigned chosen, const int32_t *in) {
  return i_compress(out, m_from_bits(chosen), i_load(in));
}
static int compress8(int32_t *out, unsigned chosen, const int32_t *in) {
  return i_compress8(out, chosen, i_load(in));
}
static int pack(float *out, unsigned chosen, const float *in) {
  const v_packing packing = v_packing_of(m_from_bits(chosen));
  v_pack(out, packing, v_load(in));
  return packing.count;
}
static void transpose(float *rows) {
  vf all[V_LANES];
  for (int k = 0; k < V_LANES; k++)
    all[k] = v_load(rows + V_LANES * k);
  v_transpose(all);
  for (int k = 0; k < V_LANES; k++)
    v_store(rows + V_LANES * k, all[k]);
}
static void transpose4(float *rows) {
  vf all[4];
  for (int k = 0; k < 4; k++)
    all[k] = v_load(rows + V_LANES * k);
  v_transpose4(all);
  for (int k = 0; k < 4; k++)
    v_store(rows + V_LANES * k, all[k]);
}
static void spread(const float *in, int quarter, float *out) {
  v_store(out, v_spread(v_load(in), quarter));
}
static void load_fours(const float *a, const float *b, const float *c, const float *d, float *out) {
  v_store(out, v_load_fours(a, b, c, d));
}
static void columns3(const float *in, float *out) {
  const vf rows[4] = {v_load(in), v_load(in + 16), v_load(in + 32), v_load(in + 48)};
  vf x, y, z;
  v_columns3(rows, &x, &y, &z);
  v_store(out, x);
  v_store(out + V_LANES, y);
  v_store(out + 2 * V_LANES, z);
}
static void load_u8(const uint8_t *in, float *out) {
  v_store(out, v_load_u8(in));
}
static void load_4x4(const float *in, int64_t stride, float *out) {
  v_store(out, v_load_4x4(in, stride));
}
static void store_4x4(float *out, int64_t stride, const float *in) {
  v_store_4x4(out, stride, v_load(in));
}
static void load12(const float *in, float *out) {
  v_store(out, v_load12(in));
}
static void store12(float *out, const float *in) {
  v_store12(out, v_load(in));
}
static float sum(const float *in) {
  return v_sum(v_load(in));
}
static void sum12(const float *in, float *out) {
  vf a[12];
  for (int k = 0; k < 12; k++)
    a[k] = v_load(in + k * V_LANES);
  v_store(out, v_sum12(a));
}

#if defined(PAGS_ISA_AVX512)
const vec_ops vec_ops_avx512 = {
#elif defined(PAGS_ISA_AVX2)
const vec_ops vec_ops_avx2 = {
#elif defined(PAGS_ISA_NEON)
const vec_ops vec_ops_neon = {
#else
const vec_ops vec_ops_scalar = {
#endif
#if defined(PAGS_FUSED) && !defined(PAGS_ISA_SCALAR)
    .fused = true,
#endif
    .lanes = lane_ops,
    .math = {math_exp2_3, math_exp2_5, math_exp, math_log2},
    .iota = iota,
    .first = first,
    .from_and_to_bits = from_and_to_bits,
    .compress = compress,
    .compress8 = compress8,
    .pack = pack,
    .transpose = transpose,
    .transpose4 = transpose4,
    .spread = spread,
    .load_fours = load_fours,
    .columns3 = columns3,
    .load_u8 = load_u8,
    .load_4x4 = load_4x4,
    .store_4x4 = store_4x4,
    .load12 = load12,
    .store12 = store12,
    .sum = sum,
    .sum12 = sum12,
};
