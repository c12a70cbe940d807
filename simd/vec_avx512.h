/* SPDX-License-Identifier: Apache-2.0 */
/* vec.h on AVX-512 F, DQ, BW, VL. */
#include <immintrin.h>

typedef __m512 vf;
typedef __m512i vi;
typedef __mmask16 vm;

/* Define the functions of vec.h that are one instruction. */
#define V_UNARY(result, name, operand, instruction) \
  static inline result name(operand a) {            \
    return instruction(a);                          \
  }
#define V_BINARY(result, name, operand, instruction) \
  static inline result name(operand a, operand b) {  \
    return instruction(a, b);                        \
  }
#define V_COMPARE(name, how)              \
  static inline vm name(vf a, vf b) {     \
    return _mm512_cmp_ps_mask(a, b, how); \
  }

V_UNARY(vf, v_set, float, _mm512_set1_ps)
static inline vf v_load(const float *p) {
  return _mm512_loadu_ps(p);
}
static inline void v_store(float *p, vf a) {
  _mm512_storeu_ps(p, a);
}
V_BINARY(vf, v_add, vf, _mm512_add_ps)
V_BINARY(vf, v_sub, vf, _mm512_sub_ps)
V_BINARY(vf, v_mul, vf, _mm512_mul_ps)
V_BINARY(vf, v_div, vf, _mm512_div_ps)
V_UNARY(vf, v_sqrt, vf, _mm512_sqrt_ps)
V_BINARY(vf, v_min, vf, _mm512_min_ps)
V_BINARY(vf, v_max, vf, _mm512_max_ps)
#if defined(PAGS_FUSED)
static inline vf v_fma(vf a, vf b, vf c) {
  return _mm512_fmadd_ps(a, b, c);
}
static inline vf v_fnma(vf a, vf b, vf c) {
  return _mm512_fnmadd_ps(a, b, c);
}
#endif
V_UNARY(vf, v_abs, vf, _mm512_abs_ps)
static inline vf v_minus_abs(vf a) {
  return _mm512_or_ps(a, _mm512_set1_ps(-0.0f));
}

V_COMPARE(v_lt, _CMP_LT_OQ)
V_COMPARE(v_le, _CMP_LE_OQ)
V_COMPARE(v_gt, _CMP_GT_OQ)
V_COMPARE(v_ge, _CMP_GE_OQ)
static inline vm v_ge_and(vm m, vf a, vf b) {
  return _mm512_mask_cmp_ps_mask(m, a, b, _CMP_GE_OQ);
}
static inline vm m_and(vm a, vm b) {
  return (vm)(a & b);
}
static inline vm m_or(vm a, vm b) {
  return (vm)(a | b);
}
static inline vm m_andnot(vm a, vm b) {
  return (vm)(a & ~b);
}
static inline unsigned m_bits(vm a) {
  return a;
}
static inline vm m_from_bits(unsigned bits) {
  return (vm)bits;
}
static inline vf v_select(vm m, vf yes, vf no) {
  return _mm512_mask_blend_ps(m, no, yes);
}
static inline vf v_maskz(vm m, vf a) {
  return _mm512_maskz_mov_ps(m, a);
}

V_UNARY(vi, i_set, int32_t, _mm512_set1_epi32)
static inline vi i_load(const int32_t *p) {
  return _mm512_loadu_si512(p);
}
static inline void i_store(int32_t *p, vi a) {
  _mm512_storeu_si512(p, a);
}
V_BINARY(vi, i_add, vi, _mm512_add_epi32)
V_BINARY(vi, i_mul, vi, _mm512_mullo_epi32)
V_BINARY(vi, i_and, vi, _mm512_and_si512)
V_BINARY(vi, i_or, vi, _mm512_or_si512)
static inline vi i_select(vm m, vi yes, vi no) {
  return _mm512_mask_blend_epi32(m, no, yes);
}
#define i_shl(a, n) _mm512_slli_epi32(a, n)
#define i_shr(a, n) _mm512_srli_epi32(a, n)
V_UNARY(vi, v_bits, vf, _mm512_castps_si512)
V_UNARY(vf, v_from_bits, vi, _mm512_castsi512_ps)
V_UNARY(vi, v_to_i, vf, _mm512_cvtps_epi32)
V_UNARY(vf, i_to_v, vi, _mm512_cvtepi32_ps)

static inline vf v_load_u8(const uint8_t *p) {
  return _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i *)(const void *)p)));
}
static inline vf v_load_fours(const float *a, const float *b, const float *c, const float *d) {
  const __m256 lo = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(a)), _mm_loadu_ps(b), 1);
  const __m256 hi = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(c)), _mm_loadu_ps(d), 1);
  return _mm512_insertf32x8(_mm512_castps256_ps512(lo), hi, 1);
}
static inline void v_store_4x4(float *p, int64_t stride, vf a) {
  _mm_storeu_ps(p, _mm512_castps512_ps128(a));
  _mm_storeu_ps(p + stride, _mm512_extractf32x4_ps(a, 1));
  _mm_storeu_ps(p + 2 * stride, _mm512_extractf32x4_ps(a, 2));
  _mm_storeu_ps(p + 3 * stride, _mm512_extractf32x4_ps(a, 3));
}
static inline int i_compress(int32_t *out, vm m, vi index) {
  _mm512_storeu_si512(out, _mm512_maskz_compress_epi32(m, index));
  return __builtin_popcount((unsigned)m);
}

static inline int i_compress8(int32_t *out, unsigned bits, vi index) {
  _mm256_storeu_si256((__m256i *)(void *)out,
                      _mm256_maskz_compress_epi32((__mmask8)bits, _mm512_castsi512_si256(index)));
  return __builtin_popcount(bits);
}

typedef struct v_packing {
  __mmask16 lanes;
  int count;
} v_packing;
static inline v_packing v_packing_of(vm m) {
  return (v_packing){m, __builtin_popcount((unsigned)m)};
}
static inline void v_pack(float *out, v_packing p, vf a) {
  _mm512_storeu_ps(out, _mm512_maskz_compress_ps(p.lanes, a));
}
static inline void v_transpose4(vf rows[4]) {
  const __m512d a = _mm512_castps_pd(_mm512_unpacklo_ps(rows[0], rows[1])),
                b = _mm512_castps_pd(_mm512_unpackhi_ps(rows[0], rows[1])),
                c = _mm512_castps_pd(_mm512_unpacklo_ps(rows[2], rows[3])),
                d = _mm512_castps_pd(_mm512_unpackhi_ps(rows[2], rows[3]));
  rows[0] = _mm512_castpd_ps(_mm512_unpacklo_pd(a, c));
  rows[1] = _mm512_castpd_ps(_mm512_unpackhi_pd(a, c));
  rows[2] = _mm512_castpd_ps(_mm512_unpacklo_pd(b, d));
  rows[3] = _mm512_castpd_ps(_mm512_unpackhi_pd(b, d));
}
static inline void v_transpose(vf rows[V_LANES]) {
  for (int k = 0; k < V_LANES; k += 4)
    v_transpose4(rows + k);
  /* Quarter q of rows[4 i + j] now has lanes 4 i, ..., 4 i + 3 of row 4 q + j: the quarters are transposed. */
  for (int j = 0; j < 4; j++) {
    const vf even01 = _mm512_shuffle_f32x4(rows[j], rows[4 + j], 0x88),
             odd01 = _mm512_shuffle_f32x4(rows[j], rows[4 + j], 0xDD),
             even23 = _mm512_shuffle_f32x4(rows[8 + j], rows[12 + j], 0x88),
             odd23 = _mm512_shuffle_f32x4(rows[8 + j], rows[12 + j], 0xDD);
    rows[j] = _mm512_shuffle_f32x4(even01, even23, 0x88);
    rows[4 + j] = _mm512_shuffle_f32x4(odd01, odd23, 0x88);
    rows[8 + j] = _mm512_shuffle_f32x4(even01, even23, 0xDD);
    rows[12 + j] = _mm512_shuffle_f32x4(odd01, odd23, 0xDD);
  }
}

static inline vf v_spread(vf a, int k) {
  const __m512i quarters = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
  return _mm512_permutexvar_ps(_mm512_add_epi32(quarters, _mm512_set1_epi32(4 * k)), a);
}
static inline void v_columns3(const vf rows[4], vf *x, vf *y, vf *z) {
  const __m512i first = _mm512_setr_epi32(0, 4, 8, 12, 16, 20, 24, 28, 0, 4, 8, 12, 16, 20, 24, 28);
  vf *const out[3] = {x, y, z};
  for (int k = 0; k < 3; k++) {
    const __m512i at = _mm512_add_epi32(first, _mm512_set1_epi32(k));
    *out[k] = _mm512_shuffle_f32x4(_mm512_permutex2var_ps(rows[0], at, rows[1]),
                                   _mm512_permutex2var_ps(rows[2], at, rows[3]), 0x44);
  }
}

/* v_foldN: one step of summing the lanes of two vectors at once. Each vector consists of parts of N lanes; the two
 * halves of each part are added, so that the result holds the partial sums of both vectors. */
static inline vf v_fold16(vf a, vf b) {
  return _mm512_add_ps(_mm512_shuffle_f32x4(a, b, 0x44), _mm512_shuffle_f32x4(a, b, 0xEE));
}
static inline vf v_fold8(vf a, vf b) {
  return _mm512_add_ps(_mm512_shuffle_f32x4(a, b, 0x88), _mm512_shuffle_f32x4(a, b, 0xDD));
}
static inline vf v_fold4(vf a, vf b) {
  return _mm512_add_ps(_mm512_shuffle_ps(a, b, 0x44), _mm512_shuffle_ps(a, b, 0xEE));
}
static inline vf v_fold2(vf a, vf b) {
  return _mm512_add_ps(_mm512_shuffle_ps(a, b, 0x88), _mm512_shuffle_ps(a, b, 0xDD));
}
/* Lane i of the result is the sum of the lanes of a[i], 12 vectors; lanes 12..15 are 0. */
static inline vf v_sum12(const vf a[12]) {
  /* After v_fold8 each 128-bit block holds four partial sums of one input: x those of 0 to 3, y 4 to 7, z 8 to 11. */
  const vf x = v_fold8(v_fold16(a[0], a[1]), v_fold16(a[2], a[3]));
  const vf y = v_fold8(v_fold16(a[4], a[5]), v_fold16(a[6], a[7]));
  const vf z = v_fold8(v_fold16(a[8], a[9]), v_fold16(a[10], a[11]));
  /* v_fold4 leaves lane pairs (x_j, y_j) and (z_j, 0) in block j; v_fold2 sums them to lanes x_j y_j z_j 0 of block
   * j, which are the sums of inputs j, 4 + j and 8 + j; `order` then sorts them. */
  const vf s = v_fold2(v_fold4(x, y), v_fold4(z, _mm512_setzero_ps()));
  const __m512i order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
  return _mm512_permutexvar_ps(order, s);
}
static inline float v_sum(vf a) {
  const __m256 h = _mm256_add_ps(_mm512_castps512_ps256(a), _mm512_extractf32x8_ps(a, 1));
  const __m128 q = _mm_add_ps(_mm256_castps256_ps128(h), _mm256_extractf128_ps(h, 1));
  const __m128 d = _mm_add_ps(q, _mm_movehl_ps(q, q));
  return _mm_cvtss_f32(_mm_add_ss(d, _mm_shuffle_ps(d, d, 1)));
}
/* Stores the first 12 lanes. */
static inline void v_store12(float *p, vf a) {
  _mm512_mask_storeu_ps(p, 0x0FFF, a);
}
static inline vf v_load12(const float *p) {
  return _mm512_maskz_loadu_ps(0x0FFF, p);
}
