/* SPDX-License-Identifier: Apache-2.0 */
/* Projection of 3D Gaussians to the picture plane (EWA: Zwicker et al. 2001; constants of Kerbl et al. 2023).
 *
 *   M = J W R S, 2x3: S = diag(sigma), R the Gaussian's rotation, W = camera_from_model, J the Jacobian of the pinhole
 *   covariance [A B; B C] = M M' + low_pass I
 *   D0 = det(M M') = sum of the squared 2x2 minors of M (Cauchy-Binet), D = D0 + low_pass (A0 + C0) + low_pass^2
 *
 * Through a lens (lens.h) J is that of the lens.
 *
 * Every term of D is non-negative, so a needle's determinant keeps its digits where A C - B^2 loses all of them. */
#ifndef PAGS_SIMD_PROJECTION_H
#define PAGS_SIMD_PROJECTION_H

#include "scan.h"

/* Intermediate values of the projection of sixteen Gaussians, which the backward pass computes again and uses. */
typedef struct projected {
  vf x, y, z;       /* camera space */
  vf mx, my;        /* px */
  vf inv_z, tx, ty; /* clamped x/z, y/z */
  vm clamped_x, clamped_y;
  vf sigma[3];
  vf q[4], q_inv_norm;   /* unit quaternion, and 1/|q|, at most 1e15; 0 for a zero quaternion, which is the identity */
  vf rotation[9];        /* R */
  vf j00, j02, j11, j12; /* J; with a lens in place of it and of inv_z: */
  lens_seen seen, held;  /* the mean, and the nearest direction of a lens that clamps, where J is taken */
  vf depth;              /* z, or the distance */
  vf t[6];               /* J W, 2x3 */
  vf m[6];               /* M */
  vf minor[3];           /* 12, 13, 23 */
  vf a, b, c, d0, d;
  vf compensation;      /* sqrt(max(2.5e-5, D0 / D)), 1 without antialiasing */
  vf opacity;           /* compensated */
  vf raw_opacity, rest; /* sigmoid(logit), and 1 - sigmoid(logit) computed without cancellation */
} projected;

static inline vf quaternion_square(const vf q[4]) {
  return v_fma(q[0], q[0], v_dot3(q[1], q[2], q[3], q[1], q[2], q[3]));
}

static inline void rotation_from_quaternion(projected *s, const float *data, int64_t stride) {
  vf q[4];
  for (int k = 0; k < 4; k++)
    q[k] = v_load(data + (6 + k) * stride);
  vf norm2 = quaternion_square(q), scale = v_set(1.0f);
  const vm ordinary = m_and(v_gt(norm2, v_set(1e-30f)), v_lt(norm2, v_set(1e38f)));
  const bool scaled = m_bits(ordinary) != 0xFFFFu;
  if (scaled) { /* a power of two brings the squares of every length but 0 into the range of floats */
    const vf other = v_select(v_lt(norm2, scale), v_set(0x1p100f), v_set(0x1p-100f));
    scale = v_select(ordinary, scale, other);
    for (int k = 0; k < 4; k++)
      q[k] = v_mul(q[k], scale);
    norm2 = quaternion_square(q);
  }
  const vm none = v_le(norm2, v_zero()); /* false for NaN, which stays NaN: such a row is not drawn */
  s->q_inv_norm = v_select(none, v_zero(), v_div(v_set(1.0f), v_sqrt(v_select(none, v_set(1.0f), norm2))));
  s->q[0] = v_select(none, v_set(1.0f), v_mul(q[0], s->q_inv_norm));
  for (int k = 1; k < 4; k++)
    s->q[k] = v_mul(q[k], s->q_inv_norm);
  if (scaled)
    s->q_inv_norm = v_min(v_mul(s->q_inv_norm, scale), v_set(1e15f));
  const vf w = s->q[0], x = s->q[1], y = s->q[2], z = s->q[3], two = v_set(2.0f), one = v_set(1.0f);
  const vf xx = v_mul(x, x), yy = v_mul(y, y), zz = v_mul(z, z);
  s->rotation[0] = v_fnma(two, v_add(yy, zz), one);
  s->rotation[1] = v_mul(two, v_fnma(w, z, v_mul(x, y)));
  s->rotation[2] = v_mul(two, v_fma(w, y, v_mul(x, z)));
  s->rotation[3] = v_mul(two, v_fma(w, z, v_mul(x, y)));
  s->rotation[4] = v_fnma(two, v_add(xx, zz), one);
  s->rotation[5] = v_mul(two, v_fnma(w, x, v_mul(y, z)));
  s->rotation[6] = v_mul(two, v_fnma(w, y, v_mul(x, z)));
  s->rotation[7] = v_mul(two, v_fma(w, x, v_mul(y, z)));
  s->rotation[8] = v_fnma(two, v_add(xx, yy), one);
}

/* As project_mean, from camera space on. */
static inline void project_through_lens(projected *s, bool rolls, const pags_projection *view, const vf cam[3]) {
  const pags_lens_table *const lens = view->lens;
  if (!rolls) {
    lens_see(&s->seen, view, cam);
    if (view->turned)
      s->seen.m[0] = v_add(s->seen.m[0], lens_turn(view, s->seen.m[0], s->seen.m[0]));
  }
  s->mx = s->seen.m[0], s->my = s->seen.m[1];
  s->depth = s->seen.d;
  s->clamped_x = s->clamped_y = m_from_bits(0);
  if (lens->clamps) {
    const vf dx = v_div(cam[0], cam[2]), dy = v_div(cam[1], cam[2]);
    s->clamped_x = m_or(v_lt(dx, v_set(lens->least[0])), v_gt(dx, v_set(lens->most[0])));
    s->clamped_y = m_or(v_lt(dy, v_set(lens->least[1])), v_gt(dy, v_set(lens->most[1])));
    s->tx = v_clamp(dx, v_set(lens->least[0]), v_set(lens->most[0]));
    s->ty = v_clamp(dy, v_set(lens->least[1]), v_set(lens->most[1]));
  }
  if (m_bits(m_or(s->clamped_x, s->clamped_y)) == 0) {
    s->held = s->seen;
    return;
  }
  const vf at[3] = {v_select(s->clamped_x, v_mul(s->tx, cam[2]), cam[0]),
                    v_select(s->clamped_y, v_mul(s->ty, cam[2]), cam[1]), cam[2]};
  lens_see(&s->held, view, at);
}

/* Computes the mean in camera space and in pixels, and the Jacobian J at the clamped direction. The clamp (INRIA's
 * 1.3 tan, around the principal point as in gsplat) bounds how far a Gaussian outside of the picture is stretched
 * into it; the mean itself is not clamped. */
V_INLINE void project_mean(projected *s, scanned *scan, bool bends, const pags_projection *view, const float *data,
                           int64_t stride) {
  const vf px = v_load(data), py = v_load(data + stride), pz = v_load(data + 2 * stride);
  vf cam[3];
  for (int k = 0; k < 3; k++)
    cam[k] = v_fma(v_set(view->r[3 * k]), px,
                   v_fma(v_set(view->r[3 * k + 1]), py, v_fma(v_set(view->r[3 * k + 2]), pz, v_set(view->t[k]))));
  if (scan)
    scan_mean(scan, bends ? &s->seen : NULL, view, px, py, pz, cam);
  s->x = cam[0], s->y = cam[1], s->z = s->depth = cam[2];
  if (bends) {
    project_through_lens(s, scan != NULL, view, cam);
    return;
  }
  /* A Gaussian behind the near plane is masked later; z = 1 keeps the division finite until then. */
  const vf z = v_select(v_gt(s->z, v_set(view->near_plane)), s->z, v_set(1.0f));
  s->inv_z = v_div(v_set(1.0f), z);
  const vf dx = v_mul(s->x, s->inv_z), dy = v_mul(s->y, s->inv_z);
  s->mx = v_fma(v_set(view->fx), dx, v_set(view->cx));
  s->my = v_fma(v_set(view->fy), dy, v_set(view->cy));
  s->tx = v_clamp(dx, v_set(view->lim_x0), v_set(view->lim_x1));
  s->ty = v_clamp(dy, v_set(view->lim_y0), v_set(view->lim_y1));
  s->clamped_x = m_or(v_lt(dx, v_set(view->lim_x0)), v_gt(dx, v_set(view->lim_x1)));
  s->clamped_y = m_or(v_lt(dy, v_set(view->lim_y0)), v_gt(dy, v_set(view->lim_y1)));
  s->j00 = v_mul(v_set(view->fx), s->inv_z);
  s->j11 = v_mul(v_set(view->fy), s->inv_z);
  s->j02 = v_mul(v_set(-1.0f), v_mul(s->j00, s->tx));
  s->j12 = v_mul(v_set(-1.0f), v_mul(s->j11, s->ty));
}

V_INLINE void project_covariance(projected *s, scanned *scan, bool bends, const pags_projection *view,
                                 const float *data, int64_t stride) {
  vf j[2][3];
  for (int i = 0; i < 2 && bends; i++)
    lens_slopes(&s->held, i, j[i]);
  for (int k = 0; k < 3; k++) {
    s->sigma[k] = v_exp(v_load(data + (3 + k) * stride));
    for (int i = 0; i < 2 && bends; i++)
      s->t[3 * i + k] = v_dot3(j[i][0], j[i][1], j[i][2], scan_turn(scan, view, k), scan_turn(scan, view, 3 + k),
                               scan_turn(scan, view, 6 + k));
    if (bends)
      continue;
    s->t[k] = v_fma(s->j00, scan_turn(scan, view, k), v_mul(s->j02, scan_turn(scan, view, 6 + k)));
    s->t[3 + k] = v_fma(s->j11, scan_turn(scan, view, 3 + k), v_mul(s->j12, scan_turn(scan, view, 6 + k)));
  }
  for (int k = 0; k < 3 && scan; k++) { /* J W becomes (I + m' (x, y) / q) J W */
    scan->along[k] = v_fma(v_set(view->scan->x), s->t[k], v_mul(v_set(view->scan->y), s->t[3 + k]));
    for (int i = 0; i < 2; i++)
      s->t[3 * i + k] = v_fma(v_mul(scan->drift[i], scan->gain), scan->along[k], s->t[3 * i + k]);
  }
  for (int i = 0; i < 2; i++)
    for (int k = 0; k < 3; k++)
      s->m[3 * i + k] = v_mul(
          v_dot3(s->t[3 * i], s->t[3 * i + 1], s->t[3 * i + 2], s->rotation[k], s->rotation[3 + k], s->rotation[6 + k]),
          s->sigma[k]);
  const vf *const m = s->m;
  s->minor[0] = v_fnma(m[1], m[3], v_mul(m[0], m[4]));
  s->minor[1] = v_fnma(m[2], m[3], v_mul(m[0], m[5]));
  s->minor[2] = v_fnma(m[2], m[4], v_mul(m[1], m[5]));
  const vf a0 = v_dot3(m[0], m[1], m[2], m[0], m[1], m[2]), c0 = v_dot3(m[3], m[4], m[5], m[3], m[4], m[5]);
  const vf low = v_set(view->low_pass);
  s->b = v_dot3(m[0], m[1], m[2], m[3], m[4], m[5]);
  s->a = v_add(a0, low);
  s->c = v_add(c0, low);
  s->d0 = v_dot3(s->minor[0], s->minor[1], s->minor[2], s->minor[0], s->minor[1], s->minor[2]);
  s->d = v_add(s->d0, v_fma(low, v_add(a0, c0), v_mul(low, low)));
}

/* `scan`: NULL without a rolling shutter. Whether it is, and whether a lens bends rays, are constants, so that each
 * has code of its own. */
V_INLINE void project_all(projected *s, scanned *scan, bool bends, const pags_projection *view, const float *data,
                          int64_t stride) {
  rotation_from_quaternion(s, data, stride);
  project_mean(s, scan, bends, view, data, stride);
  project_covariance(s, scan, bends, view, data, stride);

  const vf logit = v_load(data + 10 * stride);
  const vf fade = v_exp(v_sub(v_zero(), logit));
  s->raw_opacity = v_div(v_set(1.0f), v_add(v_set(1.0f), fade));
  s->rest = v_mul(fade, s->raw_opacity);
  s->compensation = v_set(1.0f);
  if (view->antialiased)
    s->compensation = v_sqrt(v_max(v_set(2.5e-5f), v_div(s->d0, s->d)));
  s->opacity = v_mul(s->raw_opacity, s->compensation);
}

#define PAGS_HALF_LOG2E 0.72134752f

#endif
