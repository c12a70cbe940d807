/* SPDX-License-Identifier: Apache-2.0 */
/* The backward pass of shade and project: gradients of the raw parameters from the partial sums of (splat, tile)
 * pairs, in the notation of project.c.
 *
 * Per row, with S.. the sums over its slots (times ln 2, since the falloff is a power of two):
 *   dL/dmx = 2 p Su               dL/dmy = 2 (w Sv - p h Su)
 *   dL/dB  = 2 Suv / sqrt(D)      dL/dC  = (Svv - Suu) / C - 2 h Suv / sqrt(D)      dL/dD = Suu / D
 *   dL/dopacity = S / (ln 2 opacity)
 * then through D = D0 + low (A0 + C0) + low^2 and the minors to M = J W R S. A0, B, C0 and D0 are all plain sums of
 * products of M's entries, so nothing cancels on the way. */
#include "projection.h"
#include "sh.h"

typedef struct slot_sums {
  vf field[PAGS_SLOT_FLOATS];
} slot_sums;

/* Adds up each row's slots in the order of its tiles, so that the bits don't depend on how tiles were scheduled.
 * Returns the mask of rows that were drawn. */
static inline unsigned gather_slots(slot_sums *sums, int lanes, const uint32_t *keys, const pags_splat *splats,
                                    const int64_t *slot_start, const float *slots) {
  float transposed[PAGS_SLOT_FLOATS][V_LANES];
  memset(transposed, 0, sizeof transposed);
  unsigned drawn = 0;
  for (int k = 0; k < lanes; k++) {
    if (keys[k] == UINT32_MAX || splats[k].tiles == 0)
      continue;
    drawn |= 1u << k;
    const float *slot = slots + slot_start[k] * PAGS_SLOT_FLOATS;
    vf sum = v_load12(slot);
    for (uint32_t i = 1; i < splats[k].tiles; i++)
      sum = v_add(sum, v_load12(slot += PAGS_SLOT_FLOATS));
    float row[V_LANES];
    v_store(row, sum);
    for (int f = 0; f < PAGS_SLOT_FLOATS; f++)
      transposed[f][k] = row[f];
  }
  const float ln2 = 0.69314718f;
  for (int f = 0; f < PAGS_SLOT_FLOATS; f++) {
    const bool colour = f >= PAGS_SLOT_R && f <= PAGS_SLOT_Z;
    sums->field[f] = v_mul(v_load(transposed[f]), v_set(colour ? 1.0f : ln2));
  }
  return drawn;
}

/* dL/dM from dL/d(A0, B, C0, D0). */
static inline void covariance_backward(const projected *s, vf ga, vf gb, vf gc, vf gd0, vf *gm) {
  const vf *const m = s->m, two = v_set(2.0f);
  vf e[3];
  for (int k = 0; k < 3; k++) {
    e[k] = v_mul(v_mul(two, gd0), s->minor[k]);
    gm[k] = v_fma(v_mul(two, ga), m[k], v_mul(gb, m[3 + k]));
    gm[3 + k] = v_fma(v_mul(two, gc), m[3 + k], v_mul(gb, m[k]));
  }
  gm[0] = v_fma(e[0], m[4], v_fma(e[1], m[5], gm[0]));
  gm[1] = v_fma(e[2], m[5], v_fnma(e[0], m[3], gm[1]));
  gm[2] = v_fnma(e[1], m[3], v_fnma(e[2], m[4], gm[2]));
  gm[3] = v_fnma(e[0], m[1], v_fnma(e[1], m[2], gm[3]));
  gm[4] = v_fma(e[0], m[0], v_fnma(e[2], m[2], gm[4]));
  gm[5] = v_fma(e[1], m[0], v_fma(e[2], m[1], gm[5]));
}

/* dL/dq of the quaternion as stored from dL/dR. */
static inline void quaternion_backward(const projected *s, const vf *gr, vf *gq) {
  const vf w = s->q[0], x = s->q[1], y = s->q[2], z = s->q[3], two = v_set(2.0f), four = v_set(4.0f);
  const vf a = v_sub(gr[7], gr[5]), b = v_sub(gr[2], gr[6]), c = v_sub(gr[3], gr[1]);
  const vf d = v_add(gr[1], gr[3]), e = v_add(gr[2], gr[6]), f = v_add(gr[5], gr[7]);
  vf g[4];
  g[0] = v_mul(two, v_dot3(x, y, z, a, b, c));
  g[1] = v_fnma(v_mul(four, x), v_add(gr[4], gr[8]), v_mul(two, v_dot3(y, z, w, d, e, a)));
  g[2] = v_fnma(v_mul(four, y), v_add(gr[0], gr[8]), v_mul(two, v_dot3(x, z, w, d, f, b)));
  g[3] = v_fnma(v_mul(four, z), v_add(gr[0], gr[4]), v_mul(two, v_dot3(x, y, w, e, f, c)));
  /* The derivative of the normalisation is (I - q q') / |q|. */
  const vf along = v_fma(w, g[0], v_dot3(x, y, z, g[1], g[2], g[3]));
  for (int k = 0; k < 4; k++)
    gq[k] = v_mul(v_fnma(along, s->q[k], g[k]), s->q_inv_norm);
}

/* dL/d(mean in camera space), from dL/d(J W), from dL/d(mean in pixels) and from dL/d(depth). */
V_INLINE void camera_backward(const projected *s, const scanned *scan, const pags_projection *view, const vf *gt,
                              vf gmx, vf gmy, vf gdepth, vf *gcam) {
  vf g00 = v_zero(), g02 = v_zero(), g11 = v_zero(), g12 = v_zero();
  for (int k = 0; k < 3; k++) {
    g00 = v_fma(gt[k], scan_turn(scan, view, k), g00);
    g02 = v_fma(gt[k], scan_turn(scan, view, 6 + k), g02);
    g11 = v_fma(gt[3 + k], scan_turn(scan, view, 3 + k), g11);
    g12 = v_fma(gt[3 + k], scan_turn(scan, view, 6 + k), g12);
  }
  /* j00 = fx / z; j02 = -fx tx / z with tx = x/z, or a constant where it was clamped. */
  const vm all = m_from_bits(0xFFFFu);
  const vf free_x = v_maskz(m_andnot(all, s->clamped_x), v_mul(g02, v_mul(s->j00, s->inv_z)));
  const vf free_y = v_maskz(m_andnot(all, s->clamped_y), v_mul(g12, v_mul(s->j11, s->inv_z)));
  gcam[0] = v_sub(v_mul(gmx, s->j00), free_x);
  gcam[1] = v_sub(v_mul(gmy, s->j11), free_y);
  const vf gj = v_fma(g00, s->j00, v_fma(g02, s->j02, v_fma(g11, s->j11, v_mul(g12, s->j12))));
  const vf dx = v_mul(s->x, s->inv_z), dy = v_mul(s->y, s->inv_z);
  const vf gshift = v_fma(v_mul(gmx, s->j00), dx, v_mul(v_mul(gmy, s->j11), dy)); /* d(fx x/z)/dz = -j00 x/z */
  gcam[2] = v_fma(free_x, s->tx, v_fma(free_y, s->ty, v_fnma(gj, s->inv_z, v_sub(gdepth, gshift))));
}

/* As camera_backward through a lens: dL/d(J W) acts on J where it was taken, on the mean or at the clamped direction,
 * t = clamp z there. */
V_INLINE void lens_backward(const projected *s, const scanned *scan, const pags_projection *view, const vf *gt, vf gmx,
                            vf gmy, vf gdepth, vf *gcam) {
  const vf gm[2] = {gmx, gmy};
  vf by_held[3] = {v_zero(), v_zero(), v_zero()}, slopes[3];
  for (int k = 0; k < 3; k++)
    gcam[k] = v_mul(gdepth, s->seen.n[k]);
  for (int i = 0; i < 2; i++) {
    vf gj[3]; /* dL/dJ_i */
    for (int k = 0; k < 3; k++)
      gj[k] = v_dot3(gt[3 * i], gt[3 * i + 1], gt[3 * i + 2], scan_turn(scan, view, 3 * k),
                     scan_turn(scan, view, 3 * k + 1), scan_turn(scan, view, 3 * k + 2));
    lens_bend(&s->held, i, gj, by_held);
    lens_slopes(&s->seen, i, slopes);
    for (int k = 0; k < 3; k++)
      gcam[k] = v_fma(gm[i], slopes[k], gcam[k]);
  }
  if (view->lens->clamps) {
    const vm all = m_from_bits(0xFFFFu);
    by_held[2] = v_add(by_held[2], v_add(v_maskz(s->clamped_x, v_mul(by_held[0], s->tx)),
                                         v_maskz(s->clamped_y, v_mul(by_held[1], s->ty))));
    by_held[0] = v_maskz(m_andnot(all, s->clamped_x), by_held[0]);
    by_held[1] = v_maskz(m_andnot(all, s->clamped_y), by_held[1]);
  }
  for (int k = 0; k < 3; k++)
    gcam[k] = v_add(gcam[k], by_held[k]);
}

/* Back through the shear of scan.h, t = (I + h (x, y)) J W with h = m' / q: turns dL/dt into dL/d(J W), and returns
 * dL/dm' in gdrift. */
static inline void shear_backward(const scanned *s, const pags_scan *scan, vf *gt, vf *gdrift) {
  vf gshear[2], galong[3];
  for (int i = 0; i < 2; i++)
    gshear[i] = v_dot3(gt[3 * i], gt[3 * i + 1], gt[3 * i + 2], s->along[0], s->along[1], s->along[2]);
  for (int k = 0; k < 3; k++) {
    galong[k] = v_mul(s->gain, v_fma(s->drift[0], gt[k], v_mul(s->drift[1], gt[3 + k])));
    gt[k] = v_fma(v_set(scan->x), galong[k], gt[k]);
    gt[3 + k] = v_fma(v_set(scan->y), galong[k], gt[3 + k]);
  }
  /* h = m' / q, q = 1 - (x, y) m' */
  const vf by_q = v_mul(v_mul(s->gain, s->gain), v_fma(gshear[0], s->drift[0], v_mul(gshear[1], s->drift[1])));
  gdrift[0] = v_fma(gshear[0], s->gain, v_mul(v_set(scan->x), by_q));
  gdrift[1] = v_fma(gshear[1], s->gain, v_mul(v_set(scan->y), by_q));
}

/* dL/d(mean) with a rolling shutter, added to gmean, which holds what the colours give. gt: dL/d(J W); gcam: dL/dc with
 * u and m' held. L depends on u by c, c', W and the eye, and u on the mean by du = (x J_x + y J_y) W dp / q. */
V_INLINE void scan_backward(const projected *p, const scanned *s, bool bends, const pags_projection *view, const vf *gt,
                            const vf *gdrift, vf *gcam, vf *gmean) {
  const pags_scan *const scan = view->scan;
  const vf two = v_set(2.0f), focal[2] = {v_set(view->fx), v_set(view->fy)}, slope[2] = {s->dx, s->dy};
  vf gv[3], rate[9], gu = v_zero(), j[2][3], taken[2][3]; /* J at the mean, and where it was taken */
  gv[0] = gv[1] = gv[2] = v_zero();
  for (int i = 0; i < 2 && bends; i++) { /* m'_i = J_i v */
    vf along[3];
    lens_slopes(&p->seen, i, j[i]);
    lens_slopes(&p->held, i, taken[i]);
    for (int k = 0; k < 3; k++) {
      gv[k] = v_fma(gdrift[i], j[i][k], gv[k]);
      along[k] = v_mul(gdrift[i], s->v[k]);
    }
    lens_bend(&p->seen, i, along, gcam);
  }
  for (int i = 0; i < 2 && !bends; i++) {                     /* m'_i = f_i / Z (v_i - slope_i v_Z) */
    const vf g = v_mul(gdrift[i], v_mul(focal[i], p->inv_z)); /* by v_i - slope_i v_Z */
    const vf gslope = v_sub(v_zero(), v_mul(g, s->v[2]));
    gv[i] = g;
    gv[2] = v_fnma(g, slope[i], gv[2]);
    gcam[i] = v_fma(gslope, p->inv_z, gcam[i]);
    gcam[2] = v_fnma(p->inv_z, v_fma(gslope, slope[i], v_mul(gdrift[i], s->drift[i])), gcam[2]);
  }
  for (int k = 0; k < 3; k++)
    gu = v_fma(gcam[k], s->v[k], v_fma(v_mul(two, gv[k]), s->c2[k], gu));
  for (int k = 0; k < 9; k++) { /* W' */
    rate[k] = v_fma(v_mul(two, s->u), v_set(scan->r2[k]), v_set(scan->r1[k]));
    const vf gturn = bends   ? v_fma(taken[0][k / 3], gt[k % 3], v_mul(taken[1][k / 3], gt[3 + k % 3]))
                     : k < 3 ? v_mul(p->j00, gt[k])
                     : k < 6 ? v_mul(p->j11, gt[k])
                             : v_fma(p->j02, gt[k - 6], v_mul(p->j12, gt[k - 3]));
    gu = v_fma(gturn, rate[k], gu);
  }
  for (int k = 0; k < 3; k++)
    gu = v_fnma(gmean[k], v_fma(v_mul(two, s->u), v_set(scan->eye2[k]), v_set(scan->eye1[k])), gu);

  const vf by_line = v_mul(gu, s->gain);
  if (bends) {
    for (int k = 0; k < 3; k++)
      gcam[k] = v_fma(by_line, v_fma(v_set(scan->x), j[0][k], v_mul(v_set(scan->y), j[1][k])), gcam[k]);
  } else {
    const vf gx = v_mul(by_line, v_mul(v_set(scan->x), p->j00)), gy = v_mul(by_line, v_mul(v_set(scan->y), p->j11));
    gcam[0] = v_add(gcam[0], gx);
    gcam[1] = v_add(gcam[1], gy);
    gcam[2] = v_fnma(gx, s->dx, v_fnma(gy, s->dy, gcam[2]));
  }
  for (int k = 0; k < 3; k++) {
    gmean[k] = v_add(gmean[k], v_dot3(gcam[0], gcam[1], gcam[2], s->turn[k], s->turn[3 + k], s->turn[6 + k]));
    gmean[k] = v_add(gmean[k], v_dot3(gv[0], gv[1], gv[2], rate[k], rate[3 + k], rate[6 + k]));
  }
}

/* dL/d(direction), the three coordinates taken as independent, from k, the sums over channels of dL/dcolour times
 * coefficient of each basis function. */
static inline void sh_direction_gradient(int degree, const vf *d, const vf *k, vf *g) {
  const vf x = d[0], y = d[1], z = d[2];
  g[0] = g[1] = g[2] = v_zero();
  if (degree < 1)
    return;
  const vf c1 = v_set(SH_C1);
  g[0] = v_fnma(c1, k[3], g[0]);
  g[1] = v_fnma(c1, k[1], g[1]);
  g[2] = v_fma(c1, k[2], g[2]);
  if (degree < 2)
    return;
  const vf two = v_set(2.0f), four = v_set(4.0f);
  vf s[7];
  for (int i = 0; i < 5; i++)
    s[i] = v_mul(v_set(sh_c2[i]), k[4 + i]);
  g[0] = v_fma(s[0], y, v_fma(s[3], z, v_fma(v_mul(two, x), v_sub(s[4], s[2]), g[0])));
  g[1] = v_fma(s[0], x, v_fma(s[1], z, v_fnma(v_mul(two, y), v_add(s[4], s[2]), g[1])));
  g[2] = v_fma(s[1], y, v_fma(s[3], x, v_fma(v_mul(four, z), s[2], g[2])));
  if (degree < 3)
    return;
  for (int i = 0; i < 7; i++)
    s[i] = v_mul(v_set(sh_c3[i]), k[9 + i]);
  const vf xx = v_mul(x, x), yy = v_mul(y, y), zz = v_mul(z, z), xy = v_mul(x, y), yz = v_mul(y, z), xz = v_mul(x, z);
  const vf three = v_set(3.0f), six = v_set(6.0f), eight = v_set(8.0f);
  const vf minus = v_sub(xx, yy), four_zz = v_mul(four, zz);
  g[0] = v_fma(s[0], v_mul(six, xy), v_fma(s[1], yz, v_fnma(s[2], v_mul(two, xy), v_fnma(s[3], v_mul(six, xz), g[0]))));
  g[0] = v_fma(s[4], v_sub(v_sub(four_zz, yy), v_mul(three, xx)),
               v_fma(s[5], v_mul(two, xz), v_fma(s[6], v_mul(three, minus), g[0])));
  g[1] =
      v_fma(s[0], v_mul(three, minus), v_fma(s[1], xz, v_fma(s[2], v_sub(v_sub(four_zz, xx), v_mul(three, yy)), g[1])));
  g[1] = v_fnma(s[3], v_mul(six, yz),
                v_fnma(s[4], v_mul(two, xy), v_fnma(s[5], v_mul(two, yz), v_fnma(s[6], v_mul(six, xy), g[1]))));
  g[2] = v_fma(s[1], xy,
               v_fma(s[2], v_mul(eight, yz), v_fma(v_mul(s[3], three), v_sub(v_add(zz, zz), v_add(xx, yy)), g[2])));
  g[2] = v_fma(s[4], v_mul(eight, xz), v_fma(s[5], minus, g[2]));
}

V_INLINE void shade_backward(const pags_projection *view, const vf *u, const float *data, int64_t stride,
                             const float *sh, const vf *gcolour, float *out, int64_t out_stride, vf *gmean) {
  vf direction[3], inverse_distance, basis[16], weighted[16], gdirection[3];
  sh_direction(view, u, data, stride, direction, &inverse_distance);
  sh_basis(view->sh_degree, direction[0], direction[1], direction[2], basis);
  const int coefficients = (view->sh_degree + 1) * (view->sh_degree + 1);
  for (int k = 0; k < coefficients; k++) {
    weighted[k] = v_zero();
    for (int c = 0; c < 3; c++) {
      weighted[k] = v_fma(gcolour[c], v_load(sh + (3 * k + c) * stride), weighted[k]);
      v_store(out + (11 + 3 * k + c) * out_stride, v_mul(basis[k], gcolour[c]));
    }
  }
  sh_direction_gradient(view->sh_degree, direction, weighted, gdirection);
  const vf along = v_dot3(direction[0], direction[1], direction[2], gdirection[0], gdirection[1], gdirection[2]);
  for (int k = 0; k < 3; k++)
    gmean[k] = v_fma(v_fnma(along, direction[k], gdirection[k]), inverse_distance, gmean[k]);
}

V_INLINE int rows_backward(bool rolls, bool bends, const pags_projection *view, const float *data, int64_t stride,
                           const float *sh, const slot_sums *sums, unsigned drawn, const pags_splat *splats, float *out,
                           int64_t out_stride, float *mean2d, float *radius, uint8_t *name) {
  projected s;
  scanned scan;
  project_all(&s, rolls ? &scan : NULL, bends, view, data, stride);
  const vf *const f = sums->field, two = v_set(2.0f);
  const vf inv_c = v_div(v_set(1.0f), s.c), inv_d = v_div(v_set(1.0f), s.d), inv_root_d = v_sqrt(inv_d);
  const vf p = v_sqrt(v_mul(v_mul(v_set(PAGS_HALF_LOG2E), s.c), inv_d)), h = v_mul(s.b, inv_c);
  const vf w = v_sqrt(v_mul(v_set(PAGS_HALF_LOG2E), inv_c));
  const vf gmx = v_mul(two, v_mul(p, f[PAGS_SLOT_SU]));
  const vf gmy = v_mul(two, v_fnma(v_mul(p, h), f[PAGS_SLOT_SU], v_mul(w, f[PAGS_SLOT_SV])));
  const vf gb = v_mul(two, v_mul(f[PAGS_SLOT_SUV], inv_root_d));
  vf gc = v_fnma(h, gb, v_mul(v_sub(f[PAGS_SLOT_SVV], f[PAGS_SLOT_SUU]), inv_c));
  vf gd = v_mul(f[PAGS_SLOT_SUU], inv_d);

  /* S carries ln 2; dL/d(ln opacity) does not: the exponent in base two is log2(opacity). */
  const vf glog = v_mul(f[PAGS_SLOT_S], v_set(1.44269504f));
  vf gd0 = v_zero();
  if (view->antialiased) { /* d ln compensation = (dD0/D0 - dD/D) / 2 above its floor */
    const vm free = v_gt(v_mul(s.d0, inv_d), v_set(2.5e-5f));
    const vf half = v_maskz(free, v_mul(v_set(0.5f), glog));
    gd0 = v_maskz(free, v_div(half, v_select(free, s.d0, v_set(1.0f))));
    gd = v_fnma(half, inv_d, gd);
  }
  gd0 = v_add(gd0, gd);
  const vf low = v_set(view->low_pass);
  const vf ga = v_mul(low, gd);
  gc = v_fma(low, gd, gc);
  v_store(out + 10 * out_stride, v_mul(glog, s.rest));

  vf gm[6], gt[6], gr[9], gq[4], gcam[3], gmean[3], gcolour[3], gdrift[2];
  covariance_backward(&s, ga, gb, gc, gd0, gm);
  for (int k = 0; k < 3; k++)
    v_store(out + (3 + k) * out_stride, v_fma(gm[k], s.m[k], v_mul(gm[3 + k], s.m[3 + k])));
  for (int k = 0; k < 6; k++)
    gm[k] = v_mul(gm[k], s.sigma[k % 3]);
  for (int j = 0; j < 3; j++) {
    gt[j] = v_dot3(gm[0], gm[1], gm[2], s.rotation[3 * j], s.rotation[3 * j + 1], s.rotation[3 * j + 2]);
    gt[3 + j] = v_dot3(gm[3], gm[4], gm[5], s.rotation[3 * j], s.rotation[3 * j + 1], s.rotation[3 * j + 2]);
    for (int k = 0; k < 3; k++)
      gr[3 * j + k] = v_fma(s.t[j], gm[k], v_mul(s.t[3 + j], gm[3 + k]));
  }
  quaternion_backward(&s, gr, gq);
  for (int k = 0; k < 4; k++)
    v_store(out + (6 + k) * out_stride, gq[k]);
  if (rolls)
    shear_backward(&scan, view->scan, gt, gdrift);
  if (bends)
    lens_backward(&s, rolls ? &scan : NULL, view, gt, gmx, gmy, f[PAGS_SLOT_Z], gcam);
  else
    camera_backward(&s, rolls ? &scan : NULL, view, gt, gmx, gmy, f[PAGS_SLOT_Z], gcam);
  for (int k = 0; k < 3; k++)
    gmean[k] = rolls
                   ? v_zero()
                   : v_dot3(gcam[0], gcam[1], gcam[2], v_set(view->r[k]), v_set(view->r[3 + k]), v_set(view->r[6 + k]));
  unsigned negative[3] = {0, 0, 0};
  for (unsigned rest = drawn; rest; rest &= rest - 1)
    for (int c = 0; c < 3; c++)
      negative[c] |= (splats[__builtin_ctz(rest)].clamped >> c & 1u) << __builtin_ctz(rest);
  for (int c = 0; c < 3; c++)
    gcolour[c] = v_maskz(m_from_bits(~negative[c] & 0xFFFFu), f[PAGS_SLOT_R + c]);
  if (rolls) {
    const vf u = scan_time(view->scan, splats, drawn);
    shade_backward(view, &u, data, stride, sh, gcolour, out, out_stride, gmean);
    scan_backward(&s, &scan, bends, view, gt, gdrift, gcam, gmean);
  } else {
    shade_backward(view, NULL, data, stride, sh, gcolour, out, out_stride, gmean);
  }
  for (int k = 0; k < 3; k++)
    v_store(out + k * out_stride, gmean[k]);

  const int planes = 11 + 3 * (view->sh_degree + 1) * (view->sh_degree + 1);
  vm finite = m_from_bits(0xFFFFu);
  for (int k = 0; k < planes; k++)
    finite = m_and(finite, v_lt(v_abs(v_load(out + k * out_stride)), v_set(3e38f)));
  const unsigned bad = drawn & ~m_bits(finite);
  for (unsigned rest = name ? bad : 0; rest; rest &= rest - 1) { /* the first plane whose value isn't finite */
    const int row = __builtin_ctz(rest);
    int plane = 0;
    while (fabsf(out[plane * out_stride + row]) < 3e38f)
      plane++;
    name[row] = (uint8_t)(plane + 1);
  }
  const vm good = m_from_bits(drawn & ~bad);
  for (int k = 0; k < planes; k++)
    v_store(out + k * out_stride, v_maskz(good, v_load(out + k * out_stride)));
  const vf half_w = v_set(0.5f * view->width), half_h = v_set(0.5f * view->height);
  const vf nx = v_mul(gmx, half_w), ny = v_mul(gmy, half_h);
  v_store(mean2d, v_maskz(good, v_sqrt(v_fma(nx, nx, v_mul(ny, ny)))));
  const vf middle = v_mul(v_set(0.5f), v_add(s.a, s.c));
  const vf largest = v_add(middle, v_sqrt(v_max(v_set(0.1f), v_fma(middle, middle, v_sub(v_zero(), s.d)))));
  v_store(radius, v_maskz(m_from_bits(drawn), v_mul(v_set(3.0f), v_sqrt(largest))));
  return __builtin_popcount(bad);
}

V_INLINE int all_rows_backward(bool rolls, bool bends, const pags_projection *view, const float *data, int64_t stride,
                               const float *sh, int count, const uint32_t *keys, const pags_splat *splats,
                               const int64_t *slot_start, const float *slots, const pags_row_gradient *out) {
  const int planes = 11 + 3 * (view->sh_degree + 1) * (view->sh_degree + 1);
  int bad = 0;
  if (!sh)
    sh = data + 11 * stride;
  for (int first = 0; first < count; first += V_LANES) {
    slot_sums sums;
    const int lanes = count - first < V_LANES ? count - first : V_LANES;
    const unsigned drawn = gather_slots(&sums, lanes, keys + first, splats + first, slot_start + first, slots);
    if (drawn) {
      bad += rows_backward(rolls, bends, view, data + first, stride, sh + first, &sums, drawn, splats + first,
                           out->data + first, out->stride, out->mean2d + first, out->radius + first,
                           out->bad ? out->bad + first : NULL);
      continue;
    }
    for (int p = 0; p < planes; p++)
      v_store(out->data + p * out->stride + first, v_zero());
    v_store(out->mean2d + first, v_zero());
    v_store(out->radius + first, v_zero());
  }
  return bad;
}

int KERNEL(project_backward)(const pags_projection *view, const float *data, int64_t stride, const float *sh, int count,
                             const uint32_t *keys, const pags_splat *splats, const int64_t *slot_start,
                             const float *slots, const pags_row_gradient *out) {
  if (view->lens && view->scan)
    return all_rows_backward(true, true, view, data, stride, sh, count, keys, splats, slot_start, slots, out);
  if (view->lens)
    return all_rows_backward(false, true, view, data, stride, sh, count, keys, splats, slot_start, slots, out);
  if (view->scan)
    return all_rows_backward(true, false, view, data, stride, sh, count, keys, splats, slot_start, slots, out);
  return all_rows_backward(false, false, view, data, stride, sh, count, keys, splats, slot_start, slots, out);
}
