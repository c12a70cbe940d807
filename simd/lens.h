/* SPDX-License-Identifier: Apache-2.0 */
/* Lenses (pags/lens.h): where sixteen points are seen, and the first and second derivatives by their coordinates.
 *
 * Let n be the direction of a point p at the distance d, and t and f the unit vectors across n in which the angle from
 * the lens's axis and the turn about the axis grow; e is the unit vector along (X, Y). A lens shows the point at
 *
 *     m = A (R(angle) e + T(W(angle) e)) + (cx, cy)
 *
 * with the focal lengths in A, the radial function R, and the tangential and prism terms T, which act on W e. Since m
 * does not depend on d, its derivatives are those of a sphere, over d:
 *
 *     dm_i = J_i dp,  J_i = (along_i t + round_i f) / d
 *     dJ_i = H_i dp,  in the frame (n, t, f), with dp / d = (x, y, z):
 *     d H_i dp = (-along_i y - round_i z,  -along_i x + tt_i y + tf_i z,  -round_i x + tf_i y + ff_i z)
 *
 * For R alone, with Q = R / sin and Q' = (R' - Q cos) / sin:
 *
 *     along = R' e,  round = Q (-e_y, e_x),  tt = R'' e,  tf = Q' (-e_y, e_x),  ff = (Q' cos - Q sin) e
 *
 * R is read from a table of cubics, which the engine fills in double precision for any lens. Longitude and latitude
 * have the same form about the axis Y, with along = (0, fy), round = (fx / cos, 0), tf = (fx tan / cos, 0) and ff =
 * (0, -fy tan) of the latitude. */
#ifndef PAGS_SIMD_LENS_H
#define PAGS_SIMD_LENS_H

#include "kernel.h"

typedef struct lens_seen {
  vf m[2];     /* px */
  vf d, inv_d; /* distance */
  vf angle;    /* from the axis, radians; 0 for longitude and latitude, which see everything */
  vf n[3], t[3], f[3];
  vf along[2], round[2];
  vf tt[2], tf[2], ff[2];
} lens_seen;

/* The angle 0..pi of the vector (z, rho) from the axis z, rho >= 0, by the polynomial of Cephes' atanf. */
static inline vf lens_angle(vf rho, vf z) {
  const vf ahead = v_abs(z), small = v_min(rho, ahead), large = v_max(v_max(rho, ahead), v_set(1e-30f));
  const vm middle = v_gt(small, v_mul(large, v_set(0.41421356f)));
  const vf a = v_div(v_select(middle, v_sub(small, large), small), v_select(middle, v_add(small, large), large));
  const vf aa = v_mul(a, a);
  vf p = v_fma(v_set(8.05374449538e-2f), aa, v_set(-1.38776856032e-1f));
  p = v_fma(p, aa, v_set(1.99777106478e-1f));
  p = v_fma(p, aa, v_set(-3.33329491539e-1f));
  p = v_fma(v_mul(p, aa), a, a);
  p = v_add(p, v_maskz(middle, v_set(0.78539816f)));
  p = v_select(v_gt(rho, ahead), v_sub(v_set(1.57079633f), p), p);
  return v_select(v_lt(z, v_zero()), v_sub(v_set(3.14159265f), p), p);
}

/* R, R' and R''; beyond `farthest`, those there. */
static inline void lens_radius(const pags_lens_table *lens, vf angle, vf r[3]) {
  const vf at = v_min(v_mul(angle, v_set(lens->per_radian)), v_set((float)PAGS_LENS_STEPS)); /* not NaN */
  const vf first = v_min(v_max(v_sub(at, v_set(0.5f)), v_zero()), v_set((float)(PAGS_LENS_STEPS - 1)));
  const vi step = v_to_i(first);
  const vf x = v_sub(at, i_to_v(step)), per = v_set(lens->per_radian);
  int32_t steps[V_LANES];
  vf c[4];
  i_store(steps, step);
  for (int j = 0; j < 4; j++)
    c[j] = v_load_fours(lens->radius[steps[j]], lens->radius[steps[4 + j]], lens->radius[steps[8 + j]],
                        lens->radius[steps[12 + j]]);
  v_transpose4(c);
  r[0] = v_fma(v_fma(v_fma(c[3], x, c[2]), x, c[1]), x, c[0]);
  r[1] = v_mul(per, v_fma(v_fma(v_mul(v_set(3.0f), c[3]), x, v_add(c[2], c[2])), x, c[1]));
  r[2] = v_mul(v_mul(per, per), v_fma(v_mul(v_set(6.0f), c[3]), x, v_add(c[2], c[2])));
}

/* The derivatives of r(angle) e, r the value and its two derivatives. */
static inline void lens_ring(const vf e[2], vf sine, vf cosine, const vf r[3], lens_seen *out) {
  const vm aside = v_gt(sine, v_set(1e-3f)); /* nearer to the axis the difference below cancels */
  const vf inv = v_div(v_set(1.0f), v_max(sine, v_set(1e-18f)));
  const vf q = v_select(v_gt(sine, v_set(1e-18f)), v_mul(r[0], inv), r[1]);
  const vf q1 = v_select(aside, v_mul(v_fnma(q, cosine, r[1]), inv), v_mul(v_set(0.5f), r[2]));
  const vf q2 = v_fnma(q, sine, v_mul(q1, cosine)), turned[2] = {v_sub(v_zero(), e[1]), e[0]};
  for (int i = 0; i < 2; i++) {
    out->m[i] = v_mul(r[0], e[i]);
    out->along[i] = v_mul(r[1], e[i]);
    out->round[i] = v_mul(q, turned[i]);
    out->tt[i] = v_mul(r[2], e[i]);
    out->tf[i] = v_mul(q1, turned[i]);
    out->ff[i] = v_mul(q2, e[i]);
  }
}

/* Adds T(w) and its derivatives. */
static inline void lens_terms(const pags_lens_table *lens, const lens_seen *w, lens_seen *out) {
  const vf x = w->m[0], y = w->m[1], two = v_set(2.0f), r2 = v_fma(x, x, v_mul(y, y));
  const vf p[2] = {v_set(lens->p[0]), v_set(lens->p[1])}, point[2] = {x, y};
  for (int i = 0; i < 2; i++) {
    const vf first = v_set(lens->prism[2 * i]), second = v_set(lens->prism[2 * i + 1]);
    const vf bend = v_fma(v_mul(two, second), r2, first), more = v_mul(v_set(8.0f), second), own = p[1 - i],
             other = p[i];
    vf by[2], bent[3]; /* by x, y; xx, xy, yy */
    for (int k = 0; k < 2; k++) {
      const vf twice = v_mul(two, v_add(bend, k == i ? v_mul(v_set(3.0f), own) : own));
      by[k] = v_fma(twice, point[k], v_mul(v_mul(two, other), point[1 - k]));
      bent[2 * k] = v_fma(v_mul(more, point[k]), point[k], twice);
    }
    bent[1] = v_fma(v_mul(more, x), y, v_mul(two, other));
    const vf square = v_fma(v_mul(two, point[i]), point[i], r2);
    out->m[i] = v_add(out->m[i],
                      v_fma(v_mul(v_mul(two, other), x), y, v_fma(own, square, v_mul(r2, v_fma(second, r2, first)))));
    const vf *const a = w->along, *const b = w->round;
    const vf bent_a[2] = {v_fma(bent[0], a[0], v_mul(bent[1], a[1])), v_fma(bent[1], a[0], v_mul(bent[2], a[1]))};
    const vf bent_b[2] = {v_fma(bent[0], b[0], v_mul(bent[1], b[1])), v_fma(bent[1], b[0], v_mul(bent[2], b[1]))};
    for (int k = 0; k < 2; k++) {
      out->along[i] = v_fma(by[k], a[k], out->along[i]);
      out->round[i] = v_fma(by[k], b[k], out->round[i]);
      out->tt[i] = v_fma(by[k], w->tt[k], v_fma(bent_a[k], a[k], out->tt[i]));
      out->tf[i] = v_fma(by[k], w->tf[k], v_fma(bent_a[k], b[k], out->tf[i]));
      out->ff[i] = v_fma(by[k], w->ff[k], v_fma(bent_b[k], b[k], out->ff[i]));
    }
  }
}

/* Applies A to a pair. */
static inline void lens_stretch(const pags_lens_table *lens, vf pair[2]) {
  const vf x = pair[0], y = pair[1];
  for (int i = 0; i < 2; i++)
    pair[i] = v_fma(v_set(lens->a[2 * i]), x, v_mul(v_set(lens->a[2 * i + 1]), y));
}

static inline void lens_see_around(lens_seen *l, const pags_projection *view, const vf p[3]) {
  const pags_lens_table *const lens = view->lens;
  const vf rho = v_sqrt(v_fma(p[0], p[0], v_mul(p[1], p[1]))), one = v_set(1.0f);
  const vm aside = v_gt(rho, v_set(1e-18f));
  const vf inv = v_div(one, v_select(aside, rho, one));
  const vf e[2] = {v_select(aside, v_mul(p[0], inv), one), v_maskz(aside, v_mul(p[1], inv))};
  const vf sine = v_mul(rho, l->inv_d), cosine = v_mul(p[2], l->inv_d);
  vf r[3];
  l->angle = lens_angle(rho, p[2]);
  for (int k = 0; k < 2; k++)
    l->t[k] = v_mul(cosine, e[k]);
  l->t[2] = v_sub(v_zero(), sine);
  l->f[0] = v_sub(v_zero(), e[1]), l->f[1] = e[0], l->f[2] = v_zero();
  lens_radius(lens, l->angle, r);
  lens_ring(e, sine, cosine, r, l);
  if (lens->terms_of != PAGS_LENS_NO_TERMS) {
    lens_seen w;
    const vf inv_cosine = v_div(one, cosine), squared = v_mul(inv_cosine, inv_cosine);
    const vf slope[3] = {v_mul(sine, inv_cosine), squared, v_mul(v_mul(v_set(2.0f), squared), v_mul(sine, inv_cosine))};
    const vf angle[3] = {l->angle, one, v_zero()};
    const bool of_slope = lens->terms_of == PAGS_LENS_TERMS_OF_SLOPE,
               of_angle = lens->terms_of == PAGS_LENS_TERMS_OF_ANGLE;
    lens_ring(e, sine, cosine, of_slope ? slope : of_angle ? angle : r, &w);
    lens_terms(lens, &w, l);
  }
  lens_stretch(lens, l->m);
  lens_stretch(lens, l->along);
  lens_stretch(lens, l->round);
  lens_stretch(lens, l->tt);
  lens_stretch(lens, l->tf);
  lens_stretch(lens, l->ff);
}

static inline void lens_see_sphere(lens_seen *l, const pags_projection *view, const vf p[3]) {
  const pags_lens_table *const lens = view->lens;
  const vf flat = v_sqrt(v_fma(p[0], p[0], v_mul(p[2], p[2]))), one = v_set(1.0f), none = v_zero();
  const vm aside = v_gt(flat, v_set(1e-15f));
  const vf inv = v_div(one, v_select(aside, flat, one));
  const vf x = v_maskz(aside, v_mul(p[0], inv)), z = v_select(aside, v_mul(p[2], inv), one);
  const vf sine = v_mul(p[1], l->inv_d), cosine = v_max(v_mul(flat, l->inv_d), v_set(1e-15f));
  const vf inv_cosine = v_div(one, cosine), slope = v_mul(sine, inv_cosine);
  const vf fx = v_set(lens->a[0]), fy = v_set(lens->a[3]);
  const vf longitude = lens_angle(v_abs(p[0]), p[2]), latitude = v_sub(v_set(1.57079633f), lens_angle(flat, p[1]));
  l->angle = none;
  l->m[0] = v_mul(fx, v_select(v_lt(p[0], none), v_sub(none, longitude), longitude));
  l->m[1] = v_mul(fy, latitude);
  l->t[0] = v_sub(none, v_mul(sine, x)), l->t[1] = cosine, l->t[2] = v_sub(none, v_mul(sine, z));
  l->f[0] = z, l->f[1] = none, l->f[2] = v_sub(none, x);
  l->along[0] = none, l->along[1] = fy;
  l->round[0] = v_mul(fx, inv_cosine), l->round[1] = none;
  l->tt[0] = l->tt[1] = none;
  l->tf[0] = v_mul(l->round[0], slope), l->tf[1] = none;
  l->ff[0] = none, l->ff[1] = v_sub(none, v_mul(fy, slope));
}

/* Sees sixteen points of camera space. */
static inline void lens_see(lens_seen *l, const pags_projection *view, const vf p[3]) {
  l->d = v_sqrt(v_dot3(p[0], p[1], p[2], p[0], p[1], p[2]));
  l->inv_d = v_div(v_set(1.0f), v_max(l->d, v_set(1e-18f)));
  for (int k = 0; k < 3; k++)
    l->n[k] = v_mul(p[k], l->inv_d);
  if (view->lens->turn > 0.0f)
    lens_see_sphere(l, view, p);
  else
    lens_see_around(l, view, p);
  l->m[0] = v_add(l->m[0], v_set(view->cx));
  l->m[1] = v_add(l->m[1], v_set(view->cy));
}

/* The pixels that a panorama has to be moved by: its second place over the seam, where that is drawn, and whole turns,
 * such that the mean isn't farther than half a turn from where it was at mid-exposure, `middle`. */
static inline vf lens_turn(const pags_projection *view, vf m, vf middle) {
  const vf turn = v_set(view->lens->turn), half = v_set(0.5f * view->lens->turn), moved = v_sub(m, middle);
  vf by = v_sub(v_maskz(v_lt(moved, v_sub(v_zero(), half)), turn), v_maskz(v_gt(moved, half), turn));
  if (view->turned)
    by = v_add(by, v_select(v_gt(middle, v_set(view->cx)), v_sub(v_zero(), turn), turn));
  return by;
}

/* J_i. */
static inline void lens_slopes(const lens_seen *l, int i, vf out[3]) {
  const vf along = v_mul(l->along[i], l->inv_d), round = v_mul(l->round[i], l->inv_d);
  for (int k = 0; k < 3; k++)
    out[k] = v_fma(along, l->t[k], v_mul(round, l->f[k]));
}

/* J_i v */
static inline vf lens_rate(const lens_seen *l, int i, const vf v[3]) {
  vf slopes[3];
  lens_slopes(l, i, slopes);
  return v_dot3(slopes[0], slopes[1], slopes[2], v[0], v[1], v[2]);
}

/* Adds H_i v. */
static inline void lens_bend(const lens_seen *l, int i, const vf v[3], vf out[3]) {
  const vf by = v_mul(l->inv_d, l->inv_d);
  const vf x = v_mul(by, v_dot3(l->n[0], l->n[1], l->n[2], v[0], v[1], v[2])),
           y = v_mul(by, v_dot3(l->t[0], l->t[1], l->t[2], v[0], v[1], v[2])),
           z = v_mul(by, v_dot3(l->f[0], l->f[1], l->f[2], v[0], v[1], v[2]));
  const vf by_n = v_sub(v_zero(), v_fma(l->along[i], y, v_mul(l->round[i], z)));
  const vf by_t = v_fnma(l->along[i], x, v_fma(l->tt[i], y, v_mul(l->tf[i], z)));
  const vf by_f = v_fnma(l->round[i], x, v_fma(l->tf[i], y, v_mul(l->ff[i], z)));
  for (int k = 0; k < 3; k++)
    out[k] = v_fma(by_n, l->n[k], v_fma(by_t, l->t[k], v_fma(by_f, l->f[k], out[k])));
}

#endif
