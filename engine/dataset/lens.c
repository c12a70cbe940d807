/* SPDX-License-Identifier: Apache-2.0 */
/* Lens distortion: projection and its inverse on the plane z = 1, and the choice of the pinhole camera to which
 * photographs are resampled.
 *
 * The models are described at pags_lens_kind; the size of the output follows the rule of COLMAP's undistorter. */
#include "dataset/lens.h"

#include <math.h>
#include <string.h>

#include "maths/maths.h"
#include "scene/lens.h"

#define PI 3.14159265358979323846

/* ---- Distortion models ---- */

static inline double poly(const double k[4], double t) {
  return 1 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])));
}

/* Checks that the intrinsics can be those of a camera. */
static pags_result check(pags_lens *lens, const char *where) {
  double sum = fabs(lens->fx) + fabs(lens->fy) + fabs(lens->cx) + fabs(lens->cy);
  for (int i = 0; i < 6; i++)
    sum += fabs(lens->model.k[i]);
  for (int i = 0; i < 4; i++)
    sum += fabs(lens->model.s[i]) + (i < 3 ? fabs(lens->model.d[i]) : 0) + (i < 2 ? fabs(lens->model.p[i]) : 0);
  if (!isfinite(sum))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected finite intrinsics", where);
  if (lens->width < 1 || lens->width > 65535 || lens->height < 1 || lens->height > 65535)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: %d x %d pixels, expected 1..65535", where, lens->width, lens->height);
  if (!(lens->fx > 0) || !(lens->fy > 0))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: focal lengths %g and %g, expected them above 0", where, lens->fx,
                     lens->fy);
  return pags_lens_model_check(&lens->model, where);
}

pags_result pags_lens_prepare(pags_lens *lens, const char *where) {
  PAGS_TRY(check(lens, where));
  /* Largest angle from the optical axis, 85 degrees: a pinhole image becomes useless beyond it. */
  const double widest = 85 * PI / 180, end = pags_tan(widest) * pags_tan(widest);
  if (pags_lens_is_of_angle(lens->model.kind)) {
    const double grows = pags_lens_grows_until(&lens->model, widest * widest), t = pags_tan(sqrt(grows));
    lens->limit = t * t;
    lens->folds = grows < widest * widest;
  } else {
    lens->limit = pags_lens_grows_until(&lens->model, end);
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

/* Inverts the radial distortion without the tangential part: returns the radius on the plane z = 1 whose distorted
 * radius is `target`. Bisection over the range in which the function grows. */
static double invert_radial(const pags_lens *lens, double target) {
  bool fisheye = pags_lens_is_of_angle(lens->model.kind);
  double low = 0, high = fisheye ? pags_atan(sqrt(lens->limit)) : sqrt(lens->limit);
  for (int i = 0; i < 60; i++) {
    double middle = 0.5 * (low + high);
    if (pags_lens_radius(&lens->model, middle) < target)
      low = middle;
    else
      high = middle;
  }
  return fisheye ? pags_tan(low) : low;
}

/* Newton's method with a Jacobian by central differences. It starts from the solution of the radial part, which is
 * close because the tangential part is small. The result is accepted if it reprojects within 0.001 pixel. */
bool pags_lens_unproject(const pags_lens *lens, double u, double v, double *x, double *y) {
  double target[2] = {(u - lens->cx) / lens->fx, (v - lens->cy) / lens->fy};
  double radius = pags_hypot(target[0], target[1]);
  double start = radius > 0 ? invert_radial(lens, radius) / radius : 1;
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
               at = pags_lens_radius(&lens->model, pags_lens_is_of_angle(lens->model.kind) ? pags_atan(edge) : edge) *
                    lens->fx;
  int lost = 0;
  for (int j = 0; j <= STEPS; j++)
    for (int i = 0; i <= STEPS; i++) {
      double x, y;
      lost += !pags_lens_unproject(lens, (double)lens->width * i / STEPS, (double)lens->height * j / STEPS, &x, &y);
    }
  *share = (double)lost / ((STEPS + 1) * (STEPS + 1));
  if (*share < 0.1)
    return PAGS_OK;
  return pags_fail(
      PAGS_ERROR_FORMAT,
      "%s: the distortion can't be undone at %.0f %% of the picture: its radial function stops growing %.0f "
      "pixels from the centre of %d x %d pixels; expected parameters of a lens that shows each direction "
      "once",
      where, 100 * *share, at, lens->width, lens->height);
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
    return pags_fail(PAGS_ERROR_FORMAT, "%s: the distortion leaves no usable rectangle of the picture", where);
  return PAGS_OK;
}
