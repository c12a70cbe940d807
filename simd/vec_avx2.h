/* SPDX-License-Identifier: Apache-2.0 */
/* vec.h on AVX2 + FMA: two registers of eight lanes. */
#include <immintrin.h>

typedef struct vf {
  __m256 a, b;
} vf;
typedef struct vi {
  __m256i a, b;
} vi;
typedef struct vm {
  __m256 a, b;
} vm; /* all ones or all zeros per lane */

/* Define the functions of vec.h that are one instruction for either half of x, or of x and y. */
#define V_UNARY(result, name, operand, instruction)      \
  static inline result name(operand x) {                 \
    return (result){instruction(x.a), instruction(x.b)}; \
  }
#define V_BINARY(result, name, operand, instruction)               \
  static inline result name(operand x, operand y) {                \
    return (result){instruction(x.a, y.a), instruction(x.b, y.b)}; \
  }

static inline vf v_set(float x) {
  const __m256 s = _mm256_set1_ps(x);
  return (vf){s, s};
}
static inline vf v_load(const float *p) {
  return (vf){_mm256_loadu_ps(p), _mm256_loadu_ps(p + 8)};
}
static inline void v_store(float *p, vf x) {
  _mm256_storeu_ps(p, x.a);
  _mm256_storeu_ps(p + 8, x.b);
}
V_BINARY(vf, v_add, vf, _mm256_add_ps)
V_BINARY(vf, v_sub, vf, _mm256_sub_ps)
V_BINARY(vf, v_mul, vf, _mm256_mul_ps)
V_BINARY(vf, v_div, vf, _mm256_div_ps)
V_UNARY(vf, v_sqrt, vf, _mm256_sqrt_ps)
V_BINARY(vf, v_min, vf, _mm256_min_ps)
V_BINARY(vf, v_max, vf, _mm256_max_ps)
#if defined(PAGS_FUSED)
static inline vf v_fma(vf x, vf y, vf z) {
  return (vf){_mm256_fmadd_ps(x.a, y.a, z.a), _mm256_fmadd_ps(x.b, y.b, z.b)};
}
static inline vf v_fnma(vf x, vf y, vf z) {
  return (vf){_mm256_fnmadd_ps(x.a, y.a, z.a), _mm256_fnmadd_ps(x.b, y.b, z.b)};
}
#endif
static inline vf v_abs(vf x) {
  const __m256 s = _mm256_set1_ps(-0.0f);
  return (vf){_mm256_andnot_ps(s, x.a), _mm256_andnot_ps(s, x.b)};
}
static inline vf v_minus_abs(vf x) {
  const __m256 s = _mm256_set1_ps(-0.0f);
  return (vf){_mm256_or_ps(x.a, s), _mm256_or_ps(x.b, s)};
}

#define V_COMPARE(name, how)                                                 \
  static inline vm name(vf x, vf y) {                                        \
    return (vm){_mm256_cmp_ps(x.a, y.a, how), _mm256_cmp_ps(x.b, y.b, how)}; \
  }
V_COMPARE(v_lt, _CMP_LT_OQ)
V_COMPARE(v_le, _CMP_LE_OQ)
V_COMPARE(v_gt, _CMP_GT_OQ)
V_COMPARE(v_ge, _CMP_GE_OQ)
V_BINARY(vm, m_and, vm, _mm256_and_ps)
V_BINARY(vm, m_or, vm, _mm256_or_ps)
static inline vm m_andnot(vm x, vm y) {
  return (vm){_mm256_andnot_ps(y.a, x.a), _mm256_andnot_ps(y.b, x.b)};
}
static inline unsigned m_bits(vm x) {
  return (unsigned)_mm256_movemask_ps(x.a) | (unsigned)_mm256_movemask_ps(x.b) << 8;
}
static inline vm m_from_bits(unsigned bits) {
  const __m256i lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
  const __m256i lo = _mm256_and_si256(_mm256_set1_epi32((int)(bits & 255u)), lane);
  const __m256i hi = _mm256_and_si256(_mm256_set1_epi32((int)(bits >> 8 & 255u)), lane);
  return (vm){_mm256_castsi256_ps(_mm256_cmpeq_epi32(lo, lane)), _mm256_castsi256_ps(_mm256_cmpeq_epi32(hi, lane))};
}
static inline vf v_select(vm m, vf yes, vf no) {
  return (vf){_mm256_blendv_ps(no.a, yes.a, m.a), _mm256_blendv_ps(no.b, yes.b, m.b)};
}
static inline vf v_maskz(vm m, vf x) {
  return (vf){_mm256_and_ps(m.a, x.a), _mm256_and_ps(m.b, x.b)};
}

static inline vi i_set(int32_t x) {
  const __m256i s = _mm256_set1_epi32(x);
  return (vi){s, s};
}
static inline vi i_load(const int32_t *p) {
  return (vi){_mm256_loadu_si256((const __m256i *)(const void *)p),
              _mm256_loadu_si256((const __m256i *)(const void *)(p + 8))};
}
static inline void i_store(int32_t *p, vi x) {
  _mm256_storeu_si256((__m256i *)(void *)p, x.a);
  _mm256_storeu_si256((__m256i *)(void *)(p + 8), x.b);
}
V_BINARY(vi, i_add, vi, _mm256_add_epi32)
V_BINARY(vi, i_mul, vi, _mm256_mullo_epi32)
V_BINARY(vi, i_and, vi, _mm256_and_si256)
V_BINARY(vi, i_or, vi, _mm256_or_si256)
V_UNARY(vi, v_bits, vf, _mm256_castps_si256)
V_UNARY(vf, v_from_bits, vi, _mm256_castsi256_ps)
static inline vi i_select(vm m, vi yes, vi no) {
  return v_bits(v_select(m, v_from_bits(yes), v_from_bits(no)));
}
#define i_shl(x, n) ((vi){_mm256_slli_epi32((x).a, n), _mm256_slli_epi32((x).b, n)})
#define i_shr(x, n) ((vi){_mm256_srli_epi32((x).a, n), _mm256_srli_epi32((x).b, n)})
V_UNARY(vi, v_to_i, vf, _mm256_cvtps_epi32)
V_UNARY(vf, i_to_v, vi, _mm256_cvtepi32_ps)

static inline vf v_load_u8(const uint8_t *p) {
  const __m128i bytes = _mm_loadu_si128((const __m128i *)(const void *)p);
  return (vf){_mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes)),
              _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_srli_si128(bytes, 8)))};
}
static inline vf v_load_fours(const float *a, const float *b, const float *c, const float *d) {
  return (vf){_mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(a)), _mm_loadu_ps(b), 1),
              _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(c)), _mm_loadu_ps(d), 1)};
}
static inline void v_store_4x4(float *p, int64_t stride, vf x) {
  _mm_storeu_ps(p, _mm256_castps256_ps128(x.a));
  _mm_storeu_ps(p + stride, _mm256_extractf128_ps(x.a, 1));
  _mm_storeu_ps(p + 2 * stride, _mm256_castps256_ps128(x.b));
  _mm_storeu_ps(p + 3 * stride, _mm256_extractf128_ps(x.b, 1));
}
static inline int i_compress4(int32_t *out, unsigned bits, __m128i index) {
  const __m128i order = _mm_load_si128((const __m128i *)(const void *)v_compress4[bits & 15u]);
  _mm_storeu_si128((__m128i *)(void *)out, _mm_shuffle_epi8(index, order));
  return __builtin_popcount(bits & 15u);
}
static inline int i_compress(int32_t *out, vm m, vi index) {
  const unsigned bits = m_bits(m);
  int n = i_compress4(out, bits, _mm256_castsi256_si128(index.a));
  n += i_compress4(out + n, bits >> 4, _mm256_extracti128_si256(index.a, 1));
  n += i_compress4(out + n, bits >> 8, _mm256_castsi256_si128(index.b));
  return n + i_compress4(out + n, bits >> 12, _mm256_extracti128_si256(index.b, 1));
}

static inline int i_compress8(int32_t *out, unsigned bits, vi index) {
  const int n = i_compress4(out, bits, _mm256_castsi256_si128(index.a));
  return n + i_compress4(out + n, bits >> 4, _mm256_extracti128_si256(index.a, 1));
}

typedef struct v_packing {
  __m256i a, b; /* the lanes of either half that come first */
  int low, count;
} v_packing;
static inline __m256i v_packing8(unsigned bits) {
  const uint64_t bytes = _pdep_u64(bits, 0x0101010101010101u) * 255u;
  return _mm256_cvtepu8_epi32(_mm_cvtsi64_si128((long long)_pext_u64(0x0706050403020100u, bytes)));
}
static inline v_packing v_packing_of(vm m) {
  const unsigned bits = m_bits(m);
  return (v_packing){v_packing8(bits & 255u), v_packing8(bits >> 8), __builtin_popcount(bits & 255u),
                     __builtin_popcount(bits)};
}
static inline void v_pack(float *out, v_packing p, vf x) {
  _mm256_storeu_ps(out, _mm256_permutevar8x32_ps(x.a, p.a));
  _mm256_storeu_ps(out + p.low, _mm256_permutevar8x32_ps(x.b, p.b));
}
static inline void v_transpose4_8(__m256 *r0, __m256 *r1, __m256 *r2, __m256 *r3) {
  const __m256d a = _mm256_castps_pd(_mm256_unpacklo_ps(*r0, *r1)), b = _mm256_castps_pd(_mm256_unpackhi_ps(*r0, *r1)),
                c = _mm256_castps_pd(_mm256_unpacklo_ps(*r2, *r3)), d = _mm256_castps_pd(_mm256_unpackhi_ps(*r2, *r3));
  *r0 = _mm256_castpd_ps(_mm256_unpacklo_pd(a, c));
  *r1 = _mm256_castpd_ps(_mm256_unpackhi_pd(a, c));
  *r2 = _mm256_castpd_ps(_mm256_unpacklo_pd(b, d));
  *r3 = _mm256_castpd_ps(_mm256_unpackhi_pd(b, d));
}
static inline void v_transpose4(vf rows[4]) {
  v_transpose4_8(&rows[0].a, &rows[1].a, &rows[2].a, &rows[3].a);
  v_transpose4_8(&rows[0].b, &rows[1].b, &rows[2].b, &rows[3].b);
}
static inline void v_transpose(vf rows[V_LANES]) {
  for (int k = 0; k < V_LANES; k += 4)
    v_transpose4(rows + k);
  /* Quarter q of rows[4 i + j] now has lanes 4 i, ..., 4 i + 3 of row 4 q + j: the quarters are transposed. */
  for (int j = 0; j < 4; j++) {
    const vf r0 = rows[j], r1 = rows[4 + j], r2 = rows[8 + j], r3 = rows[12 + j];
    rows[j] = (vf){_mm256_permute2f128_ps(r0.a, r1.a, 0x20), _mm256_permute2f128_ps(r2.a, r3.a, 0x20)};
    rows[4 + j] = (vf){_mm256_permute2f128_ps(r0.a, r1.a, 0x31), _mm256_permute2f128_ps(r2.a, r3.a, 0x31)};
    rows[8 + j] = (vf){_mm256_permute2f128_ps(r0.b, r1.b, 0x20), _mm256_permute2f128_ps(r2.b, r3.b, 0x20)};
    rows[12 + j] = (vf){_mm256_permute2f128_ps(r0.b, r1.b, 0x31), _mm256_permute2f128_ps(r2.b, r3.b, 0x31)};
  }
}

static inline vf v_spread(vf x, int k) {
  const __m256 half = k < 2 ? x.a : x.b;
  const __m256i lo = _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1), shift = _mm256_set1_epi32(k % 2 * 4),
                two = _mm256_set1_epi32(2);
  const __m256i first = _mm256_add_epi32(lo, shift);
  return (vf){_mm256_permutevar8x32_ps(half, first), _mm256_permutevar8x32_ps(half, _mm256_add_epi32(first, two))};
}
/* v_columns3 of eight groups, four in each of rows[0] and rows[1]. Group k is paired with group k + 4 in the other
 * half of a register, so that two rounds of unpacking give the columns in order. */
static inline void v_columns3_8(const vf *rows, __m256 *x, __m256 *y, __m256 *z) {
  const __m256 r0 = _mm256_permute2f128_ps(rows[0].a, rows[1].a, 0x20),
               r1 = _mm256_permute2f128_ps(rows[0].a, rows[1].a, 0x31);
  const __m256 r2 = _mm256_permute2f128_ps(rows[0].b, rows[1].b, 0x20),
               r3 = _mm256_permute2f128_ps(rows[0].b, rows[1].b, 0x31);
  const __m256 xy02 = _mm256_unpacklo_ps(r0, r2), xy13 = _mm256_unpacklo_ps(r1, r3);
  *x = _mm256_unpacklo_ps(xy02, xy13);
  *y = _mm256_unpackhi_ps(xy02, xy13);
  *z = _mm256_unpacklo_ps(_mm256_unpackhi_ps(r0, r2), _mm256_unpackhi_ps(r1, r3));
}
static inline void v_columns3(const vf rows[4], vf *x, vf *y, vf *z) {
  v_columns3_8(rows, &x->a, &y->a, &z->a);
  v_columns3_8(rows + 2, &x->b, &y->b, &z->b);
}

static inline __m128 v_quarter(vf x) {
  const __m256 h = _mm256_add_ps(x.a, x.b);
  return _mm_add_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
}
static inline __m128 v_sum4(const vf *a) {
  const __m128 p = v_quarter(a[0]), q = v_quarter(a[1]), r = v_quarter(a[2]), s = v_quarter(a[3]);
  const __m128 pq = _mm_add_ps(_mm_movelh_ps(p, q), _mm_movehl_ps(q, p)); /* p0+p2 p1+p3 q0+q2 q1+q3 */
  const __m128 rs = _mm_add_ps(_mm_movelh_ps(r, s), _mm_movehl_ps(s, r));
  return _mm_add_ps(_mm_shuffle_ps(pq, rs, 0x88), _mm_shuffle_ps(pq, rs, 0xDD));
}
static inline vf v_sum12(const vf a[12]) {
  return (vf){_mm256_insertf128_ps(_mm256_castps128_ps256(v_sum4(a)), v_sum4(a + 4), 1),
              _mm256_insertf128_ps(_mm256_castps128_ps256(v_sum4(a + 8)), _mm_setzero_ps(), 1)};
}
static inline float v_sum(vf x) {
  const __m128 q = v_quarter(x), d = _mm_add_ps(q, _mm_movehl_ps(q, q));
  return _mm_cvtss_f32(_mm_add_ss(d, _mm_shuffle_ps(d, d, 1)));
}
static inline void v_store12(float *p, vf x) {
  _mm256_storeu_ps(p, x.a);
  _mm_storeu_ps(p + 8, _mm256_castps256_ps128(x.b));
}
static inline vf v_load12(const float *p) {
  return (vf){_mm256_loadu_ps(p), _mm256_insertf128_ps(_mm256_setzero_ps(), _mm_loadu_ps(p + 8), 0)};
}
