/* SPDX-License-Identifier: Apache-2.0 */
/* vec.h for no particular machine: four of the compiler's own vectors of four lanes, which become SSE2, NEON or plain
 * code. The reference that the other ISAs are tested against. */

typedef float v_f4 __attribute__((vector_size(16)));
typedef int32_t v_i4 __attribute__((vector_size(16)));
typedef uint32_t v_u4 __attribute__((vector_size(16))); /* for all arithmetic: overflow wraps as in a register */
typedef float v_f4_in_memory __attribute__((vector_size(16), aligned(4), may_alias));
typedef uint32_t v_u4_in_memory __attribute__((vector_size(16), aligned(4), may_alias));

typedef struct vf {
  v_f4 q[4];
} vf;
typedef struct vi {
  v_u4 q[4];
} vi;
typedef struct vm {
  v_u4 q[4];
} vm; /* all ones or all zeros */

/* Computes the quarters k = 0, ..., 3 of a vector. Written out, because gcc unrolls loops too late to keep the quarters
 * in registers. */
#define V_QUARTER(number, expression) \
  {                                   \
    enum { k = number };              \
    out.q[k] = (expression);          \
  }
#define V_DO(result, expression) \
  result out;                    \
  V_QUARTER(0, expression)       \
  V_QUARTER(1, expression)       \
  V_QUARTER(2, expression)       \
  V_QUARTER(3, expression)       \
  return out

static inline v_f4 v_f4_load(const float *p) {
  return *(const v_f4_in_memory *)p;
}
static inline void v_f4_store(float *p, v_f4 x) {
  *(v_f4_in_memory *)p = x;
}
static inline v_f4 v_f4_select(v_u4 m, v_f4 yes, v_f4 no) {
  return (v_f4)(((v_u4)yes & m) | ((v_u4)no & ~m));
}
/* Transposes four vectors of four lanes. */
static inline void v_f4_transpose(v_f4 *a, v_f4 *b, v_f4 *c, v_f4 *d) {
  const v_f4 ab = __builtin_shufflevector(*a, *b, 0, 4, 1, 5), cd = __builtin_shufflevector(*c, *d, 0, 4, 1, 5);
  const v_f4 ba = __builtin_shufflevector(*a, *b, 2, 6, 3, 7), dc = __builtin_shufflevector(*c, *d, 2, 6, 3, 7);
  *a = __builtin_shufflevector(ab, cd, 0, 1, 4, 5);
  *b = __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
  *c = __builtin_shufflevector(ba, dc, 0, 1, 4, 5);
  *d = __builtin_shufflevector(ba, dc, 2, 3, 6, 7);
}

static inline vf v_set(float x) {
  const v_f4 all = {x, x, x, x};
  V_DO(vf, all);
}
static inline vf v_load(const float *p) {
  V_DO(vf, v_f4_load(p + 4 * k));
}
static inline void v_store(float *p, vf x) {
  for (int k = 0; k < 4; k++)
    v_f4_store(p + 4 * k, x.q[k]);
}
V_BINARY(vf, v_add, vf, x.q[k] + y.q[k])
V_BINARY(vf, v_sub, vf, x.q[k] - y.q[k])
V_BINARY(vf, v_mul, vf, x.q[k] * y.q[k])
V_BINARY(vf, v_div, vf, x.q[k] / y.q[k])
V_UNARY(vf, v_sqrt, vf, ((v_f4){sqrtf(x.q[k][0]), sqrtf(x.q[k][1]), sqrtf(x.q[k][2]), sqrtf(x.q[k][3])}))
V_BINARY(vf, v_min, vf, v_f4_select((v_u4)(x.q[k] < y.q[k]), x.q[k], y.q[k]))
V_BINARY(vf, v_max, vf, v_f4_select((v_u4)(x.q[k] > y.q[k]), x.q[k], y.q[k]))
V_UNARY(vi, v_bits, vf, (v_u4)x.q[k])
V_UNARY(vf, v_from_bits, vi, (v_f4)x.q[k])
V_UNARY(vf, v_abs, vf, (v_f4)((v_u4)x.q[k] & 0x7FFFFFFFu))
V_UNARY(vf, v_minus_abs, vf, (v_f4)((v_u4)x.q[k] | 0x80000000u))

V_BINARY(vm, v_lt, vf, (v_u4)(x.q[k] < y.q[k]))
V_BINARY(vm, v_le, vf, (v_u4)(x.q[k] <= y.q[k]))
V_BINARY(vm, v_gt, vf, (v_u4)(x.q[k] > y.q[k]))
V_BINARY(vm, v_ge, vf, (v_u4)(x.q[k] >= y.q[k]))
V_BINARY(vm, m_and, vm, x.q[k] & y.q[k])
V_BINARY(vm, m_or, vm, x.q[k] | y.q[k])
V_BINARY(vm, m_andnot, vm, x.q[k] & ~y.q[k])
/* The bits of a mask that belong to the lanes of quarter k. */
static inline v_u4 v_bits_of_quarter(int k) {
  const v_u4 bits = {1u << 4 * k, 2u << 4 * k, 4u << 4 * k, 8u << 4 * k};
  return bits;
}
static inline unsigned m_bits(vm x) {
  const v_u4 bits = (x.q[0] & v_bits_of_quarter(0)) | (x.q[1] & v_bits_of_quarter(1)) |
                    (x.q[2] & v_bits_of_quarter(2)) | (x.q[3] & v_bits_of_quarter(3));
  return bits[0] | bits[1] | bits[2] | bits[3];
}
static inline vm m_from_bits(unsigned bits) {
  const v_u4 all = {bits, bits, bits, bits};
  V_DO(vm, (v_u4)((all & v_bits_of_quarter(k)) != 0));
}

static inline vi i_set(int32_t x) {
  const uint32_t u = (uint32_t)x;
  const v_u4 all = {u, u, u, u};
  V_DO(vi, all);
}
static inline vi i_load(const int32_t *p) {
  V_DO(vi, *(const v_u4_in_memory *)(p + 4 * k));
}
static inline void i_store(int32_t *p, vi x) {
  for (int k = 0; k < 4; k++)
    *(v_u4_in_memory *)(p + 4 * k) = x.q[k];
}
V_BINARY(vi, i_add, vi, x.q[k] + y.q[k])
V_BINARY(vi, i_mul, vi, x.q[k] * y.q[k])
V_BINARY(vi, i_and, vi, x.q[k] & y.q[k])
V_BINARY(vi, i_or, vi, x.q[k] | y.q[k])
static inline vi i_select(vm m, vi yes, vi no) {
  V_DO(vi, (yes.q[k] & m.q[k]) | (no.q[k] & ~m.q[k]));
}
static inline vi i_shl(vi x, int n) {
  V_DO(vi, x.q[k] << n);
}
static inline vi i_shr(vi x, int n) {
  V_DO(vi, x.q[k] >> n);
}
static inline vf v_select(vm m, vf yes, vf no) {
  V_DO(vf, v_f4_select(m.q[k], yes.q[k], no.q[k]));
}
static inline vf v_maskz(vm m, vf x) {
  V_DO(vf, (v_f4)((v_u4)x.q[k] & m.q[k]));
}
static inline v_u4 v_f4_to_i(v_f4 x) {
  const v_i4 i = {(int32_t)lrintf(x[0]), (int32_t)lrintf(x[1]), (int32_t)lrintf(x[2]), (int32_t)lrintf(x[3])};
  return (v_u4)i;
}
V_UNARY(vi, v_to_i, vf, v_f4_to_i(x.q[k]))
V_UNARY(vf, i_to_v, vi, __builtin_convertvector((v_i4)x.q[k], v_f4))

static inline v_f4 v_f4_of_u8(const uint8_t *p) {
  return (v_f4){(float)p[0], (float)p[1], (float)p[2], (float)p[3]};
}
static inline vf v_load_u8(const uint8_t *p) {
  V_DO(vf, v_f4_of_u8(p + 4 * k));
}
static inline vf v_load_fours(const float *a, const float *b, const float *c, const float *d) {
  return (vf){{v_f4_load(a), v_f4_load(b), v_f4_load(c), v_f4_load(d)}};
}
static inline void v_store_4x4(float *p, int64_t stride, vf x) {
  for (int k = 0; k < 4; k++)
    v_f4_store(p + k * stride, x.q[k]);
}
static inline int i_compress8(int32_t *out, unsigned bits, vi index) {
  int32_t lanes[V_LANES];
  int n = 0;
  i_store(lanes, index);
  for (; bits; bits &= bits - 1)
    out[n++] = lanes[__builtin_ctz(bits)];
  return n;
}
static inline int i_compress(int32_t *out, vm m, vi index) {
  return i_compress8(out, m_bits(m), index);
}

typedef struct v_packing {
  int from[V_LANES], count;
} v_packing;
static inline v_packing v_packing_of(vm m) {
  v_packing p = {.count = 0};
  for (unsigned bits = m_bits(m); bits; bits &= bits - 1)
    p.from[p.count++] = __builtin_ctz(bits);
  return p;
}
static inline void v_pack(float *out, v_packing p, vf x) {
  float lanes[V_LANES];
  v_store(lanes, x);
  for (int k = 0; k < p.count; k++)
    out[k] = lanes[p.from[k]];
}
static inline void v_transpose4(vf rows[4]) {
  for (int k = 0; k < 4; k++)
    v_f4_transpose(&rows[0].q[k], &rows[1].q[k], &rows[2].q[k], &rows[3].q[k]);
}
static inline void v_transpose(vf rows[V_LANES]) {
  vf out[V_LANES];
  for (int i = 0; i < 4; i++) {
    v_transpose4(rows + 4 * i);
    for (int j = 0; j < V_LANES; j++)
      out[j].q[i] = rows[4 * i + (j & 3)].q[j >> 2];
  }
  memcpy(rows, out, sizeof out);
}

static inline vf v_spread(vf x, int quarter) {
  const v_f4 from = x.q[quarter];
  V_DO(vf, ((v_f4){from[k], from[k], from[k], from[k]}));
}
static inline void v_columns3(const vf rows[4], vf *x, vf *y, vf *z) {
  for (int k = 0; k < 4; k++) {
    vf groups = rows[k];
    v_f4_transpose(&groups.q[0], &groups.q[1], &groups.q[2], &groups.q[3]);
    x->q[k] = groups.q[0], y->q[k] = groups.q[1], z->q[k] = groups.q[2];
  }
}
static inline float v_sum(vf x) {
  const v_f4 four = (x.q[0] + x.q[2]) + (x.q[1] + x.q[3]);
  return (four[0] + four[2]) + (four[1] + four[3]);
}
static inline vf v_sum12(const vf a[12]) {
  vf out = v_set(0.0f);
  for (int k = 0; k < 12; k++)
    out.q[k >> 2][k & 3] = v_sum(a[k]);
  return out;
}
static inline void v_store12(float *p, vf x) {
  for (int k = 0; k < 3; k++)
    v_f4_store(p + 4 * k, x.q[k]);
}
static inline vf v_load12(const float *p) {
  return (vf){{v_f4_load(p), v_f4_load(p + 4), v_f4_load(p + 8), {0.0f}}};
}
