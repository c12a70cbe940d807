/* SPDX-License-Identifier: Apache-2.0 */
/* vec.h in plain C: arrays of sixteen. The reference that the other ISAs are tested against. */

typedef struct vf {
  float l[16];
} vf;
typedef struct vi {
  int32_t l[16];
} vi;
typedef struct vm {
  uint32_t l[16];
} vm; /* all ones or all zeros */

#define V_DO(result, expression)    \
  result out;                       \
  for (int k = 0; k < V_LANES; k++) \
    out.l[k] = (expression);        \
  return out

static inline vf v_set(float x) {
  V_DO(vf, x);
}
static inline vf v_zero(void) {
  V_DO(vf, 0.0f);
}
static inline vf v_load(const float *p) {
  V_DO(vf, p[k]);
}
static inline void v_store(float *p, vf x) {
  memcpy(p, x.l, sizeof x.l);
}
static inline vf v_add(vf x, vf y) {
  V_DO(vf, x.l[k] + y.l[k]);
}
static inline vf v_sub(vf x, vf y) {
  V_DO(vf, x.l[k] - y.l[k]);
}
static inline vf v_mul(vf x, vf y) {
  V_DO(vf, x.l[k] * y.l[k]);
}
static inline vf v_div(vf x, vf y) {
  V_DO(vf, x.l[k] / y.l[k]);
}
static inline vf v_sqrt(vf x) {
  V_DO(vf, sqrtf(x.l[k]));
}
static inline vf v_min(vf x, vf y) {
  V_DO(vf, x.l[k] < y.l[k] ? x.l[k] : y.l[k]);
}
static inline vf v_max(vf x, vf y) {
  V_DO(vf, x.l[k] > y.l[k] ? x.l[k] : y.l[k]);
}
static inline vf v_abs(vf x) {
  V_DO(vf, fabsf(x.l[k]));
}
static inline vi v_bits(vf x) {
  vi out;
  memcpy(out.l, x.l, sizeof out.l);
  return out;
}
static inline vf v_from_bits(vi x) {
  vf out;
  memcpy(out.l, x.l, sizeof out.l);
  return out;
}

static inline vm v_lt(vf x, vf y) {
  V_DO(vm, 0u - (uint32_t)(x.l[k] < y.l[k]));
}
static inline vm v_le(vf x, vf y) {
  V_DO(vm, 0u - (uint32_t)(x.l[k] <= y.l[k]));
}
static inline vm v_gt(vf x, vf y) {
  V_DO(vm, 0u - (uint32_t)(x.l[k] > y.l[k]));
}
static inline vm v_ge(vf x, vf y) {
  V_DO(vm, 0u - (uint32_t)(x.l[k] >= y.l[k]));
}
static inline vm m_and(vm x, vm y) {
  V_DO(vm, x.l[k] & y.l[k]);
}
static inline vm m_or(vm x, vm y) {
  V_DO(vm, x.l[k] | y.l[k]);
}
static inline vm m_andnot(vm x, vm y) {
  V_DO(vm, x.l[k] & ~y.l[k]);
}
static inline vm v_ge_and(vm m, vf x, vf y) {
  return m_and(m, v_ge(x, y));
}
static inline unsigned m_bits(vm x) {
  unsigned bits = 0;
  for (int k = 0; k < V_LANES; k++)
    bits |= (x.l[k] & 1u) << k;
  return bits;
}
static inline vm m_from_bits(unsigned bits) {
  V_DO(vm, 0u - (bits >> k & 1u));
}
static inline vi i_set(int32_t x) {
  V_DO(vi, x);
}
static inline vi i_load(const int32_t *p) {
  V_DO(vi, p[k]);
}
static inline void i_store(int32_t *p, vi x) {
  memcpy(p, x.l, sizeof x.l);
}
/* Adds as unsigned, so that overflow wraps as it does in a vector register and isn't undefined. */
static inline vi i_add(vi x, vi y) {
  V_DO(vi, (int32_t)((uint32_t)x.l[k] + (uint32_t)y.l[k]));
}
static inline vi i_mul(vi x, vi y) {
  V_DO(vi, (int32_t)((uint32_t)x.l[k] * (uint32_t)y.l[k]));
}
static inline vi i_and(vi x, vi y) {
  V_DO(vi, x.l[k] & y.l[k]);
}
static inline vi i_or(vi x, vi y) {
  V_DO(vi, x.l[k] | y.l[k]);
}
static inline vi i_select(vm m, vi yes, vi no) {
  V_DO(vi, (int32_t)(((uint32_t)yes.l[k] & m.l[k]) | ((uint32_t)no.l[k] & ~m.l[k])));
}
static inline vi i_shl(vi x, int n) {
  V_DO(vi, (int32_t)((uint32_t)x.l[k] << n));
}
static inline vi i_shr(vi x, int n) {
  V_DO(vi, (int32_t)((uint32_t)x.l[k] >> n));
}
static inline vf v_select(vm m, vf yes, vf no) {
  return v_from_bits(i_select(m, v_bits(yes), v_bits(no)));
}
static inline vf v_maskz(vm m, vf x) {
  return v_select(m, x, v_zero());
}
static inline vf v_minus_abs(vf x) {
  V_DO(vf, -fabsf(x.l[k]));
}
static inline vi v_to_i(vf x) {
  V_DO(vi, (int32_t)lrintf(x.l[k]));
}
static inline vf i_to_v(vi x) {
  V_DO(vf, (float)x.l[k]);
}

static inline vf v_load_u8(const uint8_t *p) {
  V_DO(vf, (float)p[k]);
}
static inline vf v_load_fours(const float *a, const float *b, const float *c, const float *d) {
  const float *const from[4] = {a, b, c, d};
  V_DO(vf, from[k >> 2][k & 3]);
}
static inline void v_store_4x4(float *p, int64_t stride, vf x) {
  for (int k = 0; k < V_LANES; k++)
    p[(k >> 2) * stride + (k & 3)] = x.l[k];
}
static inline int i_compress(int32_t *out, vm m, vi index) {
  int n = 0;
  for (int k = 0; k < V_LANES; k++)
    if (m.l[k])
      out[n++] = index.l[k];
  return n;
}

static inline int i_compress8(int32_t *out, unsigned bits, vi index) {
  int n = 0;
  for (; bits; bits &= bits - 1)
    out[n++] = index.l[__builtin_ctz(bits)];
  return n;
}

typedef struct v_packing {
  int from[V_LANES], count;
} v_packing;
static inline v_packing v_packing_of(vm m) {
  v_packing p = {.count = 0};
  for (int k = 0; k < V_LANES; k++)
    if (m.l[k])
      p.from[p.count++] = k;
  return p;
}
static inline void v_pack(float *out, v_packing p, vf x) {
  for (int k = 0; k < p.count; k++)
    out[k] = x.l[p.from[k]];
}
static inline void v_transpose4(vf rows[4]) {
  vf out[4];
  for (int j = 0; j < 4; j++)
    for (int k = 0; k < V_LANES; k++)
      out[j].l[k] = rows[k & 3].l[(k & ~3) + j];
  memcpy(rows, out, sizeof out);
}
static inline void v_transpose(vf rows[V_LANES]) {
  for (int k = 0; k < V_LANES; k++)
    for (int j = 0; j < k; j++) {
      const float swap = rows[k].l[j];
      rows[k].l[j] = rows[j].l[k];
      rows[j].l[k] = swap;
    }
}

static inline vf v_spread(vf x, int quarter) {
  V_DO(vf, x.l[4 * quarter + (k >> 2)]);
}
static inline void v_columns3(const vf rows[4], vf *x, vf *y, vf *z) {
  for (int k = 0; k < V_LANES; k++) {
    const float *const group = rows[k >> 2].l + 4 * (k & 3);
    x->l[k] = group[0], y->l[k] = group[1], z->l[k] = group[2];
  }
}

static inline float v_sum(vf x) {
  float l[8];
  for (int k = 0; k < 8; k++)
    l[k] = x.l[k] + x.l[k + 8];
  for (int step = 4; step >= 1; step /= 2)
    for (int k = 0; k < step; k++)
      l[k] += l[k + step];
  return l[0];
}
static inline vf v_sum12(const vf a[12]) {
  V_DO(vf, k < 12 ? v_sum(a[k < 12 ? k : 0]) : 0.0f);
}
static inline void v_store12(float *p, vf x) {
  memcpy(p, x.l, 12 * sizeof(float));
}
static inline vf v_load12(const float *p) {
  V_DO(vf, k < 12 ? p[k] : 0.0f);
}
