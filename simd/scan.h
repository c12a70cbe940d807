/* SPDX-License-Identifier: Apache-2.0 */
/* Rolling shutter: a Gaussian is projected with the poses that the camera and its object had when the line of the
 * picture that shows its mean was read.
 *
 * At time u a mean has the camera coordinates c(u) = c0 + u c1 + u^2 c2 and lies at the pixel m(u) = pi(c(u)); the line
 * through a pixel is read at tau(m) = x X + y Y + start. Its time is the root of
 *
 *     f(u) = u - tau(m(u)),   f' = 1 - (x X' + y Y') = q,   m' = (X', Y') the velocity on the picture in px a read-out
 *
 * by Newton's method from u = 0, which is exact after a step where m is linear. u is clamped to [-1, 1], half a
 * read-out beyond both edges of the picture, to include Gaussians that reach into it from outside. Differentiating f =
 * 0 by the mean p gives the derivative of the pixel m, which projects the covariance:
 *
 *     du = (x J_x + y J_y) W dp / q,   dm = J W dp + m' du = (I + m' (x, y) / q) J W dp
 *
 * with W = camera_from_model at u; for a clamped row it is J W. The linearisation fails for Gaussians that are smeared
 * over many lines: those that move with the read-out (q < 0.1), and those so close that they move by more than a pixel
 * per line on a curved path. Both are drawn as at u = 0, as are those for which the iteration doesn't converge. */
#ifndef PAGS_SIMD_SCAN_H
#define PAGS_SIMD_SCAN_H

#include "lens.h"

enum { SCAN_STEPS = 4 }; /* each step squares the error; at q = 1/2 the last step changes less than rounding */
#define SCAN_DONE 1e-4f  /* a mean whose last step was smaller takes no further step, independent of its neighbours */

/* Read-out times of sixteen projected Gaussians, with the terms that the backward pass uses. */
typedef struct scanned {
  vf c0[3], c1[3], c2[3];
  vf u;
  vm found;        /* false: drawn at mid-exposure */
  vm free;         /* found and not clamped: u depends on the mean */
  vf v[3];         /* c' at u */
  vf dx, dy;       /* X / Z, Y / Z */
  vf drift[2];     /* m' */
  vf gain;         /* 1 / q where free, else 0 */
  vf along[3];     /* (x, y) J W */
  vf turn[9];      /* W */
  lens_seen *seen; /* with a lens: c as it is seen; else NULL */
  vf middle;       /* with a lens: across, at mid-exposure, px */
} scanned;

/* Row k of an affine map. */
static inline vf scan_row(const float *r, const float *t, int k, vf x, vf y, vf z) {
  return v_fma(v_set(r[3 * k]), x, v_fma(v_set(r[3 * k + 1]), y, v_fma(v_set(r[3 * k + 2]), z, v_set(t[k]))));
}

/* Writes c and c' at u, and m' there; returns tau(m). *q: 1 - (x, y) m'. */
V_INLINE vf scan_at(scanned *s, const pags_projection *view, vf u, vf cam[3], vf *q) {
  const pags_scan *const scan = view->scan;
  const vf two_u = v_add(u, u);
  for (int k = 0; k < 3; k++) {
    cam[k] = v_fma(u, v_fma(u, s->c2[k], s->c1[k]), s->c0[k]);
    s->v[k] = v_fma(two_u, s->c2[k], s->c1[k]);
  }
  vf mx, my;
  if (s->seen) {
    lens_see(s->seen, view, cam);
    for (int i = 0; i < 2; i++)
      s->drift[i] = lens_rate(s->seen, i, s->v);
    if (view->lens->turn > 0.0f)
      s->seen->m[0] = v_add(s->seen->m[0], lens_turn(view, s->seen->m[0], s->middle));
    mx = s->seen->m[0], my = s->seen->m[1];
  } else {
    const vf z = v_select(v_gt(cam[2], v_set(view->near_plane)), cam[2], v_set(1.0f)), inv_z = v_div(v_set(1.0f), z);
    s->dx = v_mul(cam[0], inv_z), s->dy = v_mul(cam[1], inv_z);
    s->drift[0] = v_mul(v_mul(v_set(view->fx), inv_z), v_fnma(s->dx, s->v[2], s->v[0]));
    s->drift[1] = v_mul(v_mul(v_set(view->fy), inv_z), v_fnma(s->dy, s->v[2], s->v[1]));
    mx = v_fma(v_set(view->fx), s->dx, v_set(view->cx)), my = v_fma(v_set(view->fy), s->dy, v_set(view->cy));
  }
  *q = v_fnma(v_set(scan->x), s->drift[0], v_fnma(v_set(scan->y), s->drift[1], v_set(1.0f)));
  return v_fma(v_set(scan->x), mx, v_fma(v_set(scan->y), my, v_set(scan->start)));
}

/* Finds the time of sixteen means and replaces their camera coordinates at u = 0 by those at that time. `seen`: with a
 * lens, receives how they are seen then; else NULL. */
V_INLINE void scan_mean(scanned *s, lens_seen *seen, const pags_projection *view, vf px, vf py, vf pz, vf cam[3]) {
  const pags_scan *const scan = view->scan;
  const vf one = v_set(1.0f), minus_one = v_set(-1.0f), least = v_set(PAGS_SCAN_LEAST);
  for (int k = 0; k < 3; k++) {
    s->c0[k] = cam[k];
    s->c1[k] = scan_row(scan->r1, scan->t1, k, px, py, pz);
    s->c2[k] = scan_row(scan->r2, scan->t2, k, px, py, pz);
  }
  s->seen = seen;
  if (seen && view->lens->turn > 0.0f) {
    lens_see(seen, view, cam);
    s->middle = seen->m[0];
  }
  vf q, u = v_zero();
  vm moves_on = m_first(V_LANES);
  for (int i = 0; i < SCAN_STEPS && m_bits(moves_on) != 0; i++) {
    const vf late = v_sub(u, scan_at(s, view, u, cam, &q)), step = v_div(late, v_max(q, least));
    u = v_select(moves_on, v_clamp(v_sub(u, step), minus_one, one), u);
    moves_on = m_and(moves_on, v_ge(v_abs(step), v_set(SCAN_DONE)));
  }
  const vf read = v_clamp(scan_at(s, view, u, cam, &q), minus_one, one);
  const vf moves = v_mul(v_set(fabsf(scan->x + scan->y)), v_add(v_abs(s->drift[0]), v_abs(s->drift[1])));
  s->found = m_and(m_and(v_ge(q, least), v_le(moves, v_set(PAGS_SCAN_MOST))), /* false for NaN */
                   v_lt(v_abs(v_sub(read, u)), v_set(1e-3f)));
  s->free = m_and(s->found, v_lt(v_abs(u), one));
  s->u = v_maskz(s->found, u);
  if (m_bits(s->found) != m_bits(m_first(V_LANES)))
    scan_at(s, view, s->u, cam, &q);
  s->gain = v_maskz(s->free, v_div(one, v_select(s->free, q, one)));
  for (int k = 0; k < 9; k++)
    s->turn[k] = v_fma(s->u, v_fma(s->u, v_set(scan->r2[k]), v_set(scan->r1[k])), v_set(view->r[k]));
}

/* Entry k of W; `s` is NULL without a rolling shutter. */
V_INLINE vf scan_turn(const scanned *s, const pags_projection *view, int k) {
  return s ? s->turn[k] : v_set(view->r[k]);
}

/* Read-out times of the lines that contain the means of the `drawn` splats. */
static inline vf scan_time(const pags_scan *scan, const pags_splat *splats, unsigned drawn) {
  float u[V_LANES] = {0.0f};
  for (; drawn; drawn &= drawn - 1) {
    const int k = __builtin_ctz(drawn);
    u[k] = scan->x * splats[k].x + scan->y * splats[k].y + scan->start;
  }
  return v_clamp(v_load(u), v_set(-1.0f), v_set(1.0f));
}

#endif
