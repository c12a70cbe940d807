/* SPDX-License-Identifier: Apache-2.0 */
/* Lenses: projection of directions with its derivatives, and its inverse (the models are described at pags_lens_kind);
 * and the lenses of photographs, with the pinhole camera to which these are resampled, whose size follows the rule of
 * COLMAP's undistorter.
 *
 * With rho = |(X, Y)|, the unit vector e = (X, Y) / rho and s the angle or the distance of the direction from the axis,
 * the radial part is R(s) e and has the derivatives
 *   d/d(X, Y) = R/rho (I - e e') + R' ds/drho e e',   d/dZ = R' ds/dZ e
 * Tangential and prism terms act on w = s e or on w = R e, which has derivatives of the same form. */
#include "scene/lens.h"

#include <math.h>
#include <string.h>

#include "base/file.h"
#include "base/vec3.h"
#include "maths/maths.h"

#define PI 3.14159265358979323846

static const double most_of_radius = 85 * PI / 180; /* a picture on a plane becomes useless beyond it */
static const double most_of_angle = 3.1; /* all directions in the circle at pi are the same one: it has no derivative */

static const char *const names[PAGS_LENS_KINDS] = {"perspective", "fisheye",  "rational", "fov",    "thin_prism",
                                                   "aria",        "division", "eucm",     "ftheta", "equirectangular"};

const char *pags_lens_kind_name(pags_lens_kind kind) {
  return (unsigned)kind < PAGS_LENS_KINDS ? names[kind] : NULL;
}

/* ---- Radial functions ---- */

static inline double poly(const double k[4], double t) {
  return 1 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])));
}

static inline double poly6(const double k[6], double t) {
  return 1 + t * (k[0] + t * (k[1] + t * (k[2] + t * (k[3] + t * (k[4] + t * k[5])))));
}

static inline double denominator(const double d[3], double t) {
  return 1 + t * (d[0] + t * (d[1] + t * d[2]));
}

bool pags_lens_is_of_angle(pags_lens_kind kind) {
  return kind == PAGS_LENS_FISHEYE || kind == PAGS_LENS_THIN_PRISM || kind == PAGS_LENS_ARIA ||
         kind == PAGS_LENS_FTHETA;
}

/* The distance from the principal point at which the lens shows this angle or distance, in focal lengths, without
 * tangential and prism terms. */
static double radial(const pags_lens_model *lens, double s) {
  const double *k = lens->k;
  switch (lens->kind) {
    case PAGS_LENS_RATIONAL: return s * poly6(k, s * s) / denominator(lens->d, s * s);
    case PAGS_LENS_FOV: return pags_lens_model_is_plain(lens) ? s : pags_atan(2 * s * pags_tan(0.5 * k[0])) / k[0];
    case PAGS_LENS_ARIA: return s * poly6(k, s * s);
    case PAGS_LENS_DIVISION: return 2 * s / (1 + sqrt(fmax(1 - 4 * k[0] * s * s, 0)));
    case PAGS_LENS_EUCM: return s / (k[0] * sqrt(k[1] * s * s + 1) + 1 - k[0]);
    case PAGS_LENS_FTHETA: return s * (1 + s * (k[0] + s * (k[1] + s * (k[2] + s * (k[3] + s * k[4])))));
    default: return s * poly(k, s * s);
  }
}

/* The derivative of the radial function times the square of the denominator, which is positive where it has one;
 * negative where the denominator isn't. */
static double growth(const pags_lens_model *lens, double s) {
  const double *k = lens->k, *d = lens->d, t = s * s, t2 = t * t;
  if (lens->kind == PAGS_LENS_FTHETA)
    return 1 + s * (2 * k[0] + s * (3 * k[1] + s * (4 * k[2] + s * (5 * k[3] + s * 6 * k[4]))));
  const double up =
      1 + t * (3 * k[0] + t * (5 * k[1] + t * (7 * k[2] + t * 9 * k[3]))) + t2 * t2 * t * (11 * k[4] + t * 13 * k[5]);
  if (lens->kind != PAGS_LENS_RATIONAL)
    return up;
  const double below = denominator(d, t);
  return below > 0 ? up * below - poly6(k, t) * 2 * t * (d[0] + t * (2 * d[1] + t * 3 * d[2])) : -1;
}

/* The derivative of the radial function. */
static double slope(const pags_lens_model *lens, double s) {
  const double *k = lens->k;
  switch (lens->kind) {
    case PAGS_LENS_RATIONAL: {
      const double below = denominator(lens->d, s * s);
      return growth(lens, s) / (below * below);
    }
    case PAGS_LENS_FOV: {
      const double spread = 2 * pags_tan(0.5 * k[0]);
      return pags_lens_model_is_plain(lens) ? 1 : spread / (k[0] * (1 + spread * spread * s * s));
    }
    case PAGS_LENS_DIVISION: {
      const double root = sqrt(fmax(1 - 4 * k[0] * s * s, 1e-12));
      return 2 / (1 + root) + 8 * k[0] * s * s / (root * (1 + root) * (1 + root));
    }
    case PAGS_LENS_EUCM: {
      const double root = sqrt(k[1] * s * s + 1), below = k[0] * root + 1 - k[0];
      return (below - k[0] * k[1] * s * s / root) / (below * below);
    }
    default: return growth(lens, s);
  }
}

/* The smallest t = s^2 in (0, end) at which the radial function stops growing, or `end` if it grows throughout. A scan
 * over s in 4096 steps finds the sign change of the derivative, bisection refines it. */
static double grows_until(const pags_lens_model *lens, double end) {
  const int steps = 4096;
  double low = 0;
  if (lens->kind == PAGS_LENS_DIVISION)
    return lens->k[0] > 0 ? fmin(end, 0.25 / lens->k[0]) : end;
  if (lens->kind == PAGS_LENS_FOV || lens->kind == PAGS_LENS_EUCM)
    return end;
  for (int i = 1; i <= steps; i++) {
    double s = sqrt(end) * i / steps, high = s * s;
    if (growth(lens, s) <= 0) {
      for (int j = 0; j < 60; j++) {
        double middle = 0.5 * (low + high);
        if (growth(lens, sqrt(middle)) > 0)
          low = middle;
        else
          high = middle;
      }
      return low;
    }
    low = high;
  }
  return end;
}

/* ---- Checks ---- */

int pags_lens_model_is_plain(const pags_lens_model *lens) {
  /* FOV is a pinhole at omega 0, to 1e-13 at 1e-6; EUCM at alpha 0, whatever beta is. */
  if (pags_lens_is_of_angle(lens->kind) || lens->kind == PAGS_LENS_EQUIRECTANGULAR)
    return false;
  if (lens->kind == PAGS_LENS_FOV)
    return fabs(lens->k[0]) < 1e-6;
  if (lens->kind == PAGS_LENS_EUCM)
    return lens->k[0] == 0;
  bool zero = lens->p[0] == 0 && lens->p[1] == 0;
  for (int i = 0; i < 6; i++)
    zero = zero && lens->k[i] == 0;
  for (int i = 0; i < 3; i++)
    zero = zero && lens->d[i] == 0;
  return zero;
}

enum { NUMBERS = 15 };

/* The coefficients of the model in one list: k, d, p, s. */
static void list_numbers(const pags_lens_model *lens, double out[NUMBERS]) {
  memcpy(out, lens->k, sizeof lens->k);
  memcpy(out + 6, lens->d, sizeof lens->d);
  memcpy(out + 9, lens->p, sizeof lens->p);
  memcpy(out + 11, lens->s, sizeof lens->s);
}

static bool is_finite(const pags_lens_model *lens) {
  double numbers[NUMBERS], sum = 0;
  list_numbers(lens, numbers);
  for (int i = 0; i < NUMBERS; i++)
    sum += fabs(numbers[i]);
  return isfinite(sum);
}

int pags_lens_model_same(const pags_lens_model *a, const pags_lens_model *b) {
  double of_a[NUMBERS], of_b[NUMBERS], off = fabs(a->field - b->field);
  list_numbers(a, of_a);
  list_numbers(b, of_b);
  for (int i = 0; i < NUMBERS; i++)
    off = fmax(off, fabs(of_a[i] - of_b[i]));
  return a->kind == b->kind && off <= 1e-9;
}

pags_result pags_lens_model_check(pags_lens_model *lens, const char *what) {
  if (!pags_lens_kind_name(lens->kind) || !is_finite(lens))
    return pags_fail_at(what, "expected a lens of finite numbers and a kind that is known");
  if (!(lens->field >= 0 && lens->field <= 360))
    return pags_fail_at(what, "expected a lens's field of 0 to 360 degrees, found %g", lens->field);
  if (lens->kind == PAGS_LENS_FOV && !(fabs(lens->k[0]) < PI))
    return pags_fail_at(what, "FOV's omega is %g, expected an angle in radians between -pi and pi", lens->k[0]);
  if (lens->kind == PAGS_LENS_EUCM && !(lens->k[0] >= 0 && lens->k[0] <= 1 && lens->k[1] > 0))
    return pags_fail_at(what, "EUCM's alpha is %g and beta %g, expected 0..1 and above 0", lens->k[0], lens->k[1]);
  if (lens->kind == PAGS_LENS_FTHETA && !(1 + lens->s[0] > lens->s[1] * lens->s[2]))
    return pags_fail_at(what, "F-theta's matrix [%g %g; %g 1] mirrors the picture", 1 + lens->s[0], lens->s[1],
                        lens->s[2]);
  if (lens->kind == PAGS_LENS_EQUIRECTANGULAR) {
    lens->limit = PI;
  } else if (pags_lens_is_of_angle(lens->kind)) {
    lens->limit = sqrt(grows_until(lens, most_of_angle * most_of_angle));
  } else {
    const double end = pags_tan(most_of_radius);
    lens->limit = pags_atan(sqrt(grows_until(lens, end * end)));
  }
  return PAGS_OK;
}

double pags_lens_model_widest(const pags_lens_model *lens) {
  return lens->field > 0 ? fmin(lens->field * (PI / 360), lens->limit) : lens->limit;
}

/* ---- Projection ---- */

/* The angle of (rho, Z), of which atan(rho) is the one at Z = 1. */
static double angle_of(double rho, double z) {
  return z > 0 ? pags_atan(rho / z) : z < 0 ? PI - pags_atan(rho / -z) : 0.5 * PI;
}

double pags_lens_angle(const double v[3]) {
  return angle_of(sqrt(v[0] * v[0] + v[1] * v[1]), v[2]);
}

/* A direction relative to the axis: the arguments of radial functions and of their derivatives. */
typedef struct aside {
  double e[2], rho, s, s_rho, s_z; /* s_rho, s_z: derivatives of s */
} aside;

/* at = value e and its derivatives; `value` is a function of s with the derivative `rate`. */
static void along_e(const aside *a, double value, double rate, double at[2], double jacobian[6]) {
  const double out = rate * a->s_rho, round = a->rho > 1e-12 * fabs(a->s) && a->rho > 0 ? value / a->rho : out;
  for (int i = 0; i < 2; i++) {
    at[i] = value * a->e[i];
    for (int j = 0; j < 2; j++)
      jacobian[3 * i + j] = (i == j ? round : 0) + (out - round) * a->e[i] * a->e[j];
    jacobian[3 * i + 2] = rate * a->s_z * a->e[i];
  }
}

void pags_lens_prism(const pags_lens_model *lens, double out[4]) {
  const double *const s = lens->s;
  const double thin[4] = {s[0], 0, s[1], 0}, none[4] = {0, 0, 0, 0};
  memcpy(out, lens->kind == PAGS_LENS_ARIA ? s : lens->kind == PAGS_LENS_THIN_PRISM ? thin : none, sizeof thin);
}

/* Adds the terms of p and of the prism at w, with the derivatives wj of w. `prism`: coefficients of |w|^2 and |w|^4 of
 * x, then of y. */
static void add_terms(const double p[2], const double prism[4], const double w[2], const double wj[6], double at[2],
                      double jacobian[6]) {
  const double x = w[0], y = w[1], r2 = x * x + y * y;
  const double bend[2] = {prism[0] + 2 * prism[1] * r2, prism[2] + 2 * prism[3] * r2}; /* by |w|^2 */
  const double by[4] = {2 * p[0] * y + 6 * p[1] * x + 2 * bend[0] * x, 2 * p[0] * x + 2 * p[1] * y + 2 * bend[0] * y,
                        2 * p[0] * x + 2 * p[1] * y + 2 * bend[1] * x, 6 * p[0] * y + 2 * p[1] * x + 2 * bend[1] * y};
  at[0] += 2 * p[0] * x * y + p[1] * (r2 + 2 * x * x) + r2 * (prism[0] + r2 * prism[1]);
  at[1] += p[0] * (r2 + 2 * y * y) + 2 * p[1] * x * y + r2 * (prism[2] + r2 * prism[3]);
  for (int i = 0; i < 2; i++)
    for (int k = 0; k < 3; k++)
      jacobian[3 * i + k] += by[2 * i] * wj[k] + by[2 * i + 1] * wj[3 + k];
}

static void see_sphere(const double v[3], double at[2], double jacobian[6]) {
  const double x = v[0], y = v[1], z = v[2], flat2 = fmax(x * x + z * z, 1e-30), flat = sqrt(flat2);
  const double all2 = flat2 + y * y;
  const double derivatives[6] = {z / flat2, 0, -x / flat2, -x * y / (all2 * flat), flat / all2, -z * y / (all2 * flat)};
  at[0] = pags_atan2(x, z);
  at[1] = pags_atan2(y, flat);
  memcpy(jacobian, derivatives, sizeof derivatives);
}

void pags_lens_see(const pags_lens_model *lens, const double v[3], double at[2], double jacobian[6]) {
  double own[6], *const j = jacobian ? jacobian : own, w[2], wj[6];
  if (lens->kind == PAGS_LENS_EQUIRECTANGULAR) {
    see_sphere(v, at, j);
    return;
  }
  const double rho = sqrt(v[0] * v[0] + v[1] * v[1]), square = rho * rho + v[2] * v[2];
  aside a = {.e = {1, 0}, .rho = rho};
  if (rho > 0)
    a.e[0] = v[0] / rho, a.e[1] = v[1] / rho;
  if (pags_lens_is_of_angle(lens->kind))
    a.s = angle_of(rho, v[2]), a.s_rho = v[2] / square, a.s_z = -rho / square;
  else
    a.s = rho / v[2], a.s_rho = 1 / v[2], a.s_z = -a.s / v[2];
  const double radius = radial(lens, a.s), rate = slope(lens, a.s);
  along_e(&a, radius, rate, at, j);
  double prism[4];
  pags_lens_prism(lens, prism);
  if (lens->kind == PAGS_LENS_PERSPECTIVE || lens->kind == PAGS_LENS_RATIONAL || lens->kind == PAGS_LENS_THIN_PRISM) {
    along_e(&a, a.s, 1, w, wj);
    add_terms(lens->p, prism, w, wj, at, j);
  } else if (lens->kind == PAGS_LENS_ARIA) {
    along_e(&a, radius, rate, w, wj);
    add_terms(lens->p, prism, w, wj, at, j);
  } else if (lens->kind == PAGS_LENS_FTHETA) {
    const double c = 1 + lens->s[0], d = lens->s[1], e = lens->s[2], x = at[0], y = at[1];
    at[0] = c * x + d * y;
    at[1] = e * x + y;
    for (int k = 0; k < 3; k++) {
      const double across = j[k], down = j[3 + k];
      j[k] = c * across + d * down;
      j[3 + k] = e * across + down;
    }
  }
}

/* ---- Inverse projection ---- */

/* Inverts the radial function by bisection: where in 0..high, a range in which it grows, it is `target`. */
static double invert_radial(const pags_lens_model *lens, double target, double high, int steps) {
  double low = 0;
  for (int i = 0; i < steps; i++) {
    const double middle = 0.5 * (low + high);
    if (radial(lens, middle) < target)
      low = middle;
    else
      high = middle;
  }
  return low;
}

/* Inverts the radial part. */
static void look_radially(const pags_lens_model *lens, const double at[2], double v[3]) {
  double x = at[0], y = at[1];
  if (lens->kind == PAGS_LENS_FTHETA) {
    const double c = 1 + lens->s[0], d = lens->s[1], e = lens->s[2], all = c - d * e;
    x = (at[0] - d * at[1]) / all;
    y = (c * at[1] - e * at[0]) / all;
  }
  const bool of_angle = pags_lens_is_of_angle(lens->kind);
  const double target = sqrt(x * x + y * y);
  const double s = invert_radial(lens, target, of_angle ? lens->limit : pags_tan(lens->limit), 40);
  const double across = of_angle ? pags_sin(s) : s, scale = target > 0 ? across / target : 0;
  v[0] = x * scale;
  v[1] = y * scale;
  v[2] = of_angle ? pags_cos(s) : 1;
}

/* The last step that changes the point by less than 1e-8 leaves 1e-12 where the lens is far from its limit, since the
 * errors are squared. */
int pags_lens_look(const pags_lens_model *lens, const double at[2], double v[3]) {
  if (lens->kind == PAGS_LENS_EQUIRECTANGULAR) {
    const double flat = pags_cos(at[1]);
    v[0] = pags_sin(at[0]) * flat;
    v[1] = pags_sin(at[1]);
    v[2] = pags_cos(at[0]) * flat;
    return fabs(at[0]) <= PI && fabs(at[1]) <= 0.5 * PI && pags_lens_angle(v) <= pags_lens_model_widest(lens);
  }
  if (v[0] == 0 && v[1] == 0 && v[2] == 0)
    look_radially(lens, at, v);
  pags_divide3(v, pags_length3(v));
  const double farthest = lens->limit + 1e-9;
  for (int i = 0; i < 20; i++) {
    double seen[2], j[6];
    pags_lens_see(lens, v, seen, j);
    const double off[2] = {at[0] - seen[0], at[1] - seen[1]};
    /* The shortest step d with J d = off: J' (J J')^-1 off. J v = 0, so that it lies across v. */
    const double a = j[0] * j[0] + j[1] * j[1] + j[2] * j[2], b = j[0] * j[3] + j[1] * j[4] + j[2] * j[5],
                 c = j[3] * j[3] + j[4] * j[4] + j[5] * j[5], all = a * c - b * b;
    if (!(all > 1e-12 * a * c))
      return 0;
    const double left = (c * off[0] - b * off[1]) / all, right = (a * off[1] - b * off[0]) / all;
    for (int k = 0; k < 3; k++)
      v[k] += left * j[k] + right * j[3 + k];
    pags_divide3(v, pags_length3(v));
    if (!(pags_lens_angle(v) <= farthest))
      return 0;
    if (fabs(off[0]) + fabs(off[1]) < 1e-8 * (1 + fabs(at[0]) + fabs(at[1])))
      return pags_lens_angle(v) <= pags_lens_model_widest(lens);
  }
  return 0;
}

/* ---- The lens of a photograph ---- */

pags_result pags_lens_prepare(pags_lens *lens, const char *where) {
  if (!is_finite(&lens->model) || !isfinite(lens->fx) || !isfinite(lens->fy) || !isfinite(lens->cx) ||
      !isfinite(lens->cy))
    return pags_fail_at(where, "expected finite intrinsics");
  if (lens->width < 1 || lens->width > 65535 || lens->height < 1 || lens->height > 65535)
    return pags_fail_at(where, "%d x %d pixels, expected 1..65535", lens->width, lens->height);
  if (!(lens->fx > 0) || !(lens->fy > 0))
    return pags_fail_at(where, "focal lengths %g and %g, expected them above 0", lens->fx, lens->fy);
  PAGS_TRY(pags_lens_model_check(&lens->model, where));
  /* Largest angle from the optical axis, 85 degrees: a pinhole image becomes useless beyond it. */
  const double widest = 85 * PI / 180, end = pags_tan(widest) * pags_tan(widest);
  if (pags_lens_is_of_angle(lens->model.kind)) {
    const double grows = grows_until(&lens->model, widest * widest), t = pags_tan(sqrt(grows));
    lens->limit = t * t;
    lens->folds = grows < widest * widest;
  } else {
    lens->limit = grows_until(&lens->model, end);
    lens->folds = lens->limit < end;
  }
  const double half = 0.5 * lens->model.field * PI / 180, t = half > 0 && half < widest ? pags_tan(half) : 0;
  if (t > 0)
    lens->limit = fmin(lens->limit, t * t);
  return PAGS_OK;
}

void pags_lens_set_panorama(double width, double height, pags_lens *lens) {
  lens->fx = width / (2 * PI);
  lens->fy = height / PI;
  lens->cx = 0.5 * width;
  lens->cy = 0.5 * height;
}

bool pags_lens_is_pinhole(const pags_lens *lens) {
  return pags_lens_model_is_plain(&lens->model);
}

/* Maps the undistorted point (x, y) on the plane z = 1 to its distorted position on the same plane: pags_lens_see, of
 * which the two usual kinds are written out without derivatives, since every pixel of a photograph takes it. */
static inline void distort(const pags_lens *lens, double x, double y, double out[2]) {
  double r2 = x * x + y * y;
  if (lens->model.kind == PAGS_LENS_PERSPECTIVE) {
    double scale = poly(lens->model.k, r2), p1 = lens->model.p[0], p2 = lens->model.p[1];
    out[0] = x * scale + 2 * p1 * x * y + p2 * (r2 + 2 * x * x);
    out[1] = y * scale + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
  } else if (lens->model.kind == PAGS_LENS_FISHEYE) {
    double r = sqrt(r2), theta = pags_atan(r);
    double scale = r > 1e-12 ? theta * poly(lens->model.k, theta * theta) / r : 1;
    out[0] = x * scale;
    out[1] = y * scale;
  } else {
    pags_lens_see(&lens->model, (double[3]){x, y, 1}, out, NULL);
  }
}

bool pags_lens_project(const pags_lens *lens, double x, double y, double *u, double *v) {
  double d[2];
  distort(lens, x, y, d);
  *u = lens->fx * d[0] + lens->cx;
  *v = lens->fy * d[1] + lens->cy;
  return x * x + y * y < lens->limit;
}

void pags_lens_project_row(const pags_lens *lens, int count, double x, double step, double y, double *source) {
  const pags_lens local = *lens; /* stays in registers, whereas `source` could alias *lens */
  for (int i = 0; i < count; i++) {
    double d[2], here = x + i * step;
    distort(&local, here, y, d);
    bool valid = here * here + y * y < local.limit;
    source[2 * i] = valid ? local.fx * d[0] + local.cx : NAN;
    source[2 * i + 1] = valid ? local.fy * d[1] + local.cy : NAN;
  }
}

/* ---- Inverse projection ---- */

/* Newton's method with a Jacobian by central differences. It starts from the solution of the radial part, which is
 * close because the tangential part is small. The result is accepted if it reprojects within 0.001 pixel. */
bool pags_lens_unproject(const pags_lens *lens, double u, double v, double *x, double *y) {
  const double target[2] = {(u - lens->cx) / lens->fx, (v - lens->cy) / lens->fy};
  const double radius = pags_hypot(target[0], target[1]), edge = sqrt(lens->limit);
  const bool of_angle = pags_lens_is_of_angle(lens->model.kind);
  const double s = invert_radial(&lens->model, radius, of_angle ? pags_atan(edge) : edge, 60);
  const double start = radius > 0 ? (of_angle ? pags_tan(s) : s) / radius : 1;
  double at[2] = {target[0] * start, target[1] * start};
  for (int i = 0; i < 20; i++) {
    double here[2], left[2], right[2], up[2], down[2];
    double h = 1e-6 * (1 + pags_hypot(at[0], at[1]));
    distort(lens, at[0], at[1], here);
    distort(lens, at[0] - h, at[1], left);
    distort(lens, at[0] + h, at[1], right);
    distort(lens, at[0], at[1] - h, up);
    distort(lens, at[0], at[1] + h, down);
    double a = (right[0] - left[0]) / (2 * h), b = (down[0] - up[0]) / (2 * h);
    double c = (right[1] - left[1]) / (2 * h), d = (down[1] - up[1]) / (2 * h);
    double e = target[0] - here[0], f = target[1] - here[1], det = a * d - b * c;
    if (!(fabs(det) > 1e-12))
      return false;
    at[0] += (e * d - b * f) / det;
    at[1] += (a * f - e * c) / det;
    if (fabs(e) + fabs(f) < 1e-12)
      break;
  }
  double check[2];
  distort(lens, at[0], at[1], check);
  *x = at[0];
  *y = at[1];
  return at[0] * at[0] + at[1] * at[1] < lens->limit && fabs(check[0] - target[0]) * lens->fx < 1e-3 &&
         fabs(check[1] - target[1]) * lens->fy < 1e-3;
}

pags_result pags_lens_check_inverse(const pags_lens *lens, const char *where, double *share) {
  enum { STEPS = 32 };
  *share = 0;
  if (pags_lens_is_pinhole(lens) || !lens->folds)
    return PAGS_OK;
  /* The radius of the fold in the picture, for the message. */
  const double edge = sqrt(lens->limit),
               at = radial(&lens->model, pags_lens_is_of_angle(lens->model.kind) ? pags_atan(edge) : edge) * lens->fx;
  int lost = 0;
  for (int j = 0; j <= STEPS; j++)
    for (int i = 0; i <= STEPS; i++) {
      double x, y;
      lost += !pags_lens_unproject(lens, (double)lens->width * i / STEPS, (double)lens->height * j / STEPS, &x, &y);
    }
  *share = (double)lost / ((STEPS + 1) * (STEPS + 1));
  if (*share < 0.1)
    return PAGS_OK;
  return pags_fail_at(
      where,
      "the distortion can't be undone at %.0f %% of the picture: its radial function stops growing %.0f pixels from "
      "the centre of %d x %d pixels; expected parameters of a lens that shows each direction once",
      100 * *share, at, lens->width, lens->height);
}

/* ---- The pinhole camera of a lens ---- */

/* Narrows bounds = {left, top, right, bottom} of the undistorted rectangle by the border point (u, v) of the
 * distorted picture. The bounds are pixels of a pinhole camera with the lens's fx, fy, cx, cy; `side` is the index of
 * the bound to move. A border point that can't be unprojected leaves the bounds unchanged. */
static void narrow(const pags_lens *lens, double u, double v, int side, double bounds[4]) {
  double x, y;
  if (!pags_lens_unproject(lens, u, v, &x, &y))
    return;
  double at = side % 2 == 0 ? lens->fx * x + lens->cx : lens->fy * y + lens->cy;
  if (side < 2 ? at > bounds[side] : at < bounds[side])
    bounds[side] = at;
}

/* Returns the largest whole number of pixels that fits into [low, high], centred in the interval, or 0 if that is not
 * 1..65535. Shifts the principal point *centre from the lens's pixel coordinates to those of the new rectangle. */
static int whole_pixels(double low, double high, double *centre) {
  double size = floor(high - low + 1e-9);
  *centre -= low + 0.5 * (high - low - size);
  return size >= 1 && size <= 65535 ? (int)size : 0;
}

pags_result pags_lens_pinhole(const pags_lens *lens, const char *where, pags_camera *out) {
  out->width = lens->width;
  out->height = lens->height;
  out->fx = lens->fx;
  out->fy = lens->fy;
  out->cx = lens->cx;
  out->cy = lens->cy;
  if (pags_lens_is_pinhole(lens))
    return PAGS_OK;
  double w = lens->width, h = lens->height;
  double bounds[4] = {lens->cx - 2 * fmax(lens->cx, 0), lens->cy - 2 * fmax(lens->cy, 0),
                      lens->cx + 2 * fmax(w - lens->cx, 0), lens->cy + 2 * fmax(h - lens->cy, 0)};
  for (int i = 0; i <= lens->height; i++) {
    narrow(lens, 0, i, 0, bounds);
    narrow(lens, w, i, 2, bounds);
  }
  for (int i = 0; i <= lens->width; i++) {
    narrow(lens, i, 0, 1, bounds);
    narrow(lens, i, h, 3, bounds);
  }
  out->width = whole_pixels(bounds[0], bounds[2], &out->cx);
  out->height = whole_pixels(bounds[1], bounds[3], &out->cy);
  if (out->width == 0 || out->height == 0)
    return pags_fail_at(where, "the distortion leaves no usable rectangle of the picture");
  return PAGS_OK;
}
