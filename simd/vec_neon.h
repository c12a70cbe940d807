/* SPDX-License-Identifier: Apache-2.0 */
/* vec.h on AArch64 NEON: four registers of four lanes. */
#include <arm_neon.h>

typedef struct vf {
  float32x4_t r[4];
} vf;
typedef struct vi {
  int32x4_t r[4];
} vi;
typedef struct vm {
  uint32x4_t r[4];
} vm;

#define V_DO(result, expression) \
  result out;                    \
  for (int k = 0; k < 4; k++)    \
    out.r[k] = (expression);     \
  return out

static inline vf v_set(float x) {
  V_DO(vf, vdupq_n_f32(x));
}
static inline vf v_load(const float *p) {
  V_DO(vf, vld1q_f32(p + 4 * k));
}
static inline void v_store(float *p, vf x) {
  for (int k = 0; k < 4; k++)
    vst1q_f32(p + 4 * k, x.r[k]);
}
V_BINARY(vf, v_add, vf, vaddq_f32(x.r[k], y.r[k]))
V_BINARY(vf, v_sub, vf, vsubq_f32(x.r[k], y.r[k]))
V_BINARY(vf, v_mul, vf, vmulq_f32(x.r[k], y.r[k]))
V_BINARY(vf, v_div, vf, vdivq_f32(x.r[k], y.r[k]))
V_UNARY(vf, v_sqrt, vf, vsqrtq_f32(x.r[k]))
/* By comparison and selection, since vminq and vminnmq treat NaN in other ways than vec.h defines. */
V_BINARY(vf, v_min, vf, vbslq_f32(vcltq_f32(x.r[k], y.r[k]), x.r[k], y.r[k]))
V_BINARY(vf, v_max, vf, vbslq_f32(vcgtq_f32(x.r[k], y.r[k]), x.r[k], y.r[k]))
#if defined(PAGS_FUSED)
static inline vf v_fma(vf x, vf y, vf z) {
  V_DO(vf, vfmaq_f32(z.r[k], x.r[k], y.r[k]));
}
static inline vf v_fnma(vf x, vf y, vf z) {
  V_DO(vf, vfmsq_f32(z.r[k], x.r[k], y.r[k]));
}
#endif
V_UNARY(vf, v_abs, vf, vabsq_f32(x.r[k]))
V_UNARY(vf, v_minus_abs, vf, vreinterpretq_f32_u32(vorrq_u32(vreinterpretq_u32_f32(x.r[k]), vdupq_n_u32(0x80000000u))))

V_BINARY(vm, v_lt, vf, vcltq_f32(x.r[k], y.r[k]))
V_BINARY(vm, v_le, vf, vcleq_f32(x.r[k], y.r[k]))
V_BINARY(vm, v_gt, vf, vcgtq_f32(x.r[k], y.r[k]))
V_BINARY(vm, v_ge, vf, vcgeq_f32(x.r[k], y.r[k]))
V_BINARY(vm, m_and, vm, vandq_u32(x.r[k], y.r[k]))
V_BINARY(vm, m_or, vm, vorrq_u32(x.r[k], y.r[k]))
V_BINARY(vm, m_andnot, vm, vbicq_u32(x.r[k], y.r[k]))
static inline unsigned m_bits(vm x) {
  static const uint32_t weights[4] = {1, 2, 4, 8};
  const uint32x4_t w = vld1q_u32(weights);
  unsigned bits = 0;
  for (int k = 0; k < 4; k++)
    bits |= vaddvq_u32(vandq_u32(x.r[k], w)) << 4 * k;
  return bits;
}
static inline vm m_from_bits(unsigned bits) {
  static const uint32_t weights[4] = {1, 2, 4, 8};
  const uint32x4_t w = vld1q_u32(weights);
  V_DO(vm, vceqq_u32(vandq_u32(vdupq_n_u32(bits >> 4 * k), w), w));
}
static inline vf v_select(vm m, vf yes, vf no) {
  V_DO(vf, vbslq_f32(m.r[k], yes.r[k], no.r[k]));
}
static inline vf v_maskz(vm m, vf x) {
  V_DO(vf, vreinterpretq_f32_u32(vandq_u32(m.r[k], vreinterpretq_u32_f32(x.r[k]))));
}

static inline vi i_set(int32_t x) {
  V_DO(vi, vdupq_n_s32(x));
}
static inline vi i_load(const int32_t *p) {
  V_DO(vi, vld1q_s32(p + 4 * k));
}
static inline void i_store(int32_t *p, vi x) {
  for (int k = 0; k < 4; k++)
    vst1q_s32(p + 4 * k, x.r[k]);
}
V_BINARY(vi, i_add, vi, vaddq_s32(x.r[k], y.r[k]))
V_BINARY(vi, i_mul, vi, vmulq_s32(x.r[k], y.r[k]))
V_BINARY(vi, i_and, vi, vandq_s32(x.r[k], y.r[k]))
V_BINARY(vi, i_or, vi, vorrq_s32(x.r[k], y.r[k]))
static inline vi i_select(vm m, vi yes, vi no) {
  V_DO(vi, vbslq_s32(m.r[k], yes.r[k], no.r[k]));
}
static inline vi i_shl(vi x, int n) {
  V_DO(vi, vshlq_s32(x.r[k], vdupq_n_s32(n)));
}
static inline vi i_shr(vi x, int n) {
  V_DO(vi, vreinterpretq_s32_u32(vshlq_u32(vreinterpretq_u32_s32(x.r[k]), vdupq_n_s32(-n))));
}
V_UNARY(vi, v_bits, vf, vreinterpretq_s32_f32(x.r[k]))
V_UNARY(vf, v_from_bits, vi, vreinterpretq_f32_s32(x.r[k]))
V_UNARY(vi, v_to_i, vf, vcvtnq_s32_f32(x.r[k]))
V_UNARY(vf, i_to_v, vi, vcvtq_f32_s32(x.r[k]))

static inline vf v_load_u8(const uint8_t *p) {
  const uint8x16_t bytes = vld1q_u8(p);
  const uint16x8_t lo = vmovl_u8(vget_low_u8(bytes)), hi = vmovl_u8(vget_high_u8(bytes));
  return (vf){{vcvtq_f32_u32(vmovl_u16(vget_low_u16(lo))), vcvtq_f32_u32(vmovl_u16(vget_high_u16(lo))),
               vcvtq_f32_u32(vmovl_u16(vget_low_u16(hi))), vcvtq_f32_u32(vmovl_u16(vget_high_u16(hi)))}};
}
static inline vf v_load_fours(const float *a, const float *b, const float *c, const float *d) {
  return (vf){{vld1q_f32(a), vld1q_f32(b), vld1q_f32(c), vld1q_f32(d)}};
}
static inline void v_store_4x4(float *p, int64_t stride, vf x) {
  for (int k = 0; k < 4; k++)
    vst1q_f32(p + k * stride, x.r[k]);
}
V_INLINE int i_compress_quarters(int32_t *out, unsigned bits, vi index, int quarters) {
  int n = 0;
  for (int k = 0; k < quarters; k++) {
    const unsigned four = bits >> 4 * k & 15u;
    const uint8x16_t lanes = vqtbl1q_u8(vreinterpretq_u8_s32(index.r[k]), vld1q_u8(v_compress4[four]));
    vst1q_s32(out + n, vreinterpretq_s32_u8(lanes));
    n += __builtin_popcount(four);
  }
  return n;
}
static inline int i_compress(int32_t *out, vm m, vi index) {
  return i_compress_quarters(out, m_bits(m), index, 4);
}
static inline int i_compress8(int32_t *out, unsigned bits, vi index) {
  return i_compress_quarters(out, bits, index, 2);
}

typedef struct v_packing {
  uint8x16_t order[4]; /* of each quarter, the lanes that come first */
  int counts[4], count;
} v_packing;
static inline v_packing v_packing_of(vm m) {
  const unsigned bits = m_bits(m);
  v_packing p = {.count = __builtin_popcount(bits)};
  for (int k = 0; k < 4; k++) {
    p.order[k] = vld1q_u8(v_compress4[bits >> 4 * k & 15u]);
    p.counts[k] = __builtin_popcount(bits >> 4 * k & 15u);
  }
  return p;
}
static inline void v_pack(float *out, v_packing p, vf x) {
  for (int k = 0; k < 4; out += p.counts[k++])
    vst1q_f32(out, vreinterpretq_f32_u8(vqtbl1q_u8(vreinterpretq_u8_f32(x.r[k]), p.order[k])));
}
static inline void v_transpose4(vf rows[4]) {
  for (int q = 0; q < 4; q++) {
    const float32x4_t a = vzip1q_f32(rows[0].r[q], rows[2].r[q]), b = vzip2q_f32(rows[0].r[q], rows[2].r[q]),
                      c = vzip1q_f32(rows[1].r[q], rows[3].r[q]), d = vzip2q_f32(rows[1].r[q], rows[3].r[q]);
    rows[0].r[q] = vzip1q_f32(a, c);
    rows[1].r[q] = vzip2q_f32(a, c);
    rows[2].r[q] = vzip1q_f32(b, d);
    rows[3].r[q] = vzip2q_f32(b, d);
  }
}
static inline void v_transpose(vf rows[V_LANES]) {
  for (int k = 0; k < V_LANES; k += 4)
    v_transpose4(rows + k);
  for (int j = 0; j < 4; j++) { /* quarter q of rows[4 i + j] and quarter i of rows[4 q + j] change places */
    for (int i = 0; i < 4; i++)
      for (int q = 0; q < i; q++) {
        const float32x4_t swap = rows[4 * i + j].r[q];
        rows[4 * i + j].r[q] = rows[4 * q + j].r[i];
        rows[4 * q + j].r[i] = swap;
      }
  }
}

static inline vf v_spread(vf x, int quarter) {
  float lanes[4];
  vst1q_f32(lanes, x.r[quarter]);
  V_DO(vf, vdupq_n_f32(lanes[k]));
}
static inline void v_columns3(const vf rows[4], vf *x, vf *y, vf *z) {
  for (int k = 0; k < 4; k++) {
    const float32x4_t *const r = rows[k].r;
    const float32x4_t xy02 = vzip1q_f32(r[0], r[2]), xy13 = vzip1q_f32(r[1], r[3]);
    x->r[k] = vzip1q_f32(xy02, xy13);
    y->r[k] = vzip2q_f32(xy02, xy13);
    z->r[k] = vzip1q_f32(vzip2q_f32(r[0], r[2]), vzip2q_f32(r[1], r[3]));
  }
}

static inline float32x4_t v_quarter(vf x) {
  return vaddq_f32(vaddq_f32(x.r[0], x.r[2]), vaddq_f32(x.r[1], x.r[3]));
}
static inline float32x4_t v_sum4(const vf *a) {
  const float32x4_t p = v_quarter(a[0]), q = v_quarter(a[1]), r = v_quarter(a[2]), s = v_quarter(a[3]);
  const float32x4_t pq =
      vaddq_f32(vcombine_f32(vget_low_f32(p), vget_low_f32(q)), vcombine_f32(vget_high_f32(p), vget_high_f32(q)));
  const float32x4_t rs =
      vaddq_f32(vcombine_f32(vget_low_f32(r), vget_low_f32(s)), vcombine_f32(vget_high_f32(r), vget_high_f32(s)));
  return vaddq_f32(vuzp1q_f32(pq, rs), vuzp2q_f32(pq, rs));
}
static inline vf v_sum12(const vf a[12]) {
  return (vf){{v_sum4(a), v_sum4(a + 4), v_sum4(a + 8), vdupq_n_f32(0.0f)}};
}
static inline float v_sum(vf x) {
  const float32x4_t q = v_quarter(x);
  const float32x2_t d = vadd_f32(vget_low_f32(q), vget_high_f32(q));
  return vget_lane_f32(d, 0) + vget_lane_f32(d, 1);
}
static inline void v_store12(float *p, vf x) {
  for (int k = 0; k < 3; k++)
    vst1q_f32(p + 4 * k, x.r[k]);
}
static inline vf v_load12(const float *p) {
  return (vf){{vld1q_f32(p), vld1q_f32(p + 4), vld1q_f32(p + 8), vdupq_n_f32(0.0f)}};
}
