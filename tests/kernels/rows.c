/* SPDX-License-Identifier: Apache-2.0 */
#include "rows.h"

#include "splats.h"

#include <math.h>
#include <string.h>

/* ---- Cameras ---- */

static void rotation(const double q[4], double r[9]) {
  const double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const bool none = norm == 0.0;
  const double w = none ? 1.0 : q[0] / norm, x = none ? 0.0 : q[1] / norm, y = none ? 0.0 : q[2] / norm;
  const double z = none ? 0.0 : q[3] / norm;
  const double m[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                       2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                       2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  memcpy(r, m, sizeof m);
}

static pags_projection view_of(const double r[9], const double eye[3], int sh_degree) {
  pags_projection v = {.fx = 310.0f,
                       .fy = 290.0f,
                       .cx = 203.0f,
                       .cy = 148.0f,
                       .width = 400.0f,
                       .height = 300.0f,
                       .near_plane = 0.25f,
                       .low_pass = 0.3f,
                       .alpha = {PAGS_ALPHA_MIN, -PAGS_LOG2_255, 0.0f, 0.0f},
                       .sh_degree = sh_degree};
  v.lim_x0 = (-0.15f * v.width - v.cx) / v.fx, v.lim_x1 = (1.15f * v.width - v.cx) / v.fx;
  v.lim_y0 = (-0.15f * v.height - v.cy) / v.fy, v.lim_y1 = (1.15f * v.height - v.cy) / v.fy;
  for (int i = 0; i < 3; i++) {
    v.eye[i] = (float)eye[i];
    v.t[i] = (float)-(r[3 * i] * eye[0] + r[3 * i + 1] * eye[1] + r[3 * i + 2] * eye[2]);
    for (int j = 0; j < 3; j++)
      v.r[3 * i + j] = (float)r[3 * i + j];
  }
  return v;
}

pags_projection view_random(int sh_degree, bool antialiased) {
  double q[4], r[9], eye[3];
  for (int k = 0; k < 4; k++)
    q[k] = (double)check_normal();
  for (int k = 0; k < 3; k++)
    eye[k] = (double)check_uniform(-3.0f, 3.0f);
  rotation(q, r);
  pags_projection v = view_of(r, eye, sh_degree);
  v.antialiased = antialiased;
  if (check_below(2))
    v.alpha = alpha_cut_continuous((double)check_uniform(1.5f, 8.0f) / 255.0);
  return v;
}

pags_projection view_straight(int sh_degree) {
  return view_of((const double[9]){1, 0, 0, 0, 1, 0, 0, 0, 1}, (const double[3]){0, 0, 0}, sh_degree);
}

pags_scan scan_random(const pags_projection *view) {
  const bool across = check_below(2), back = check_below(2);
  pags_scan s = {.x = across ? 1.0f / view->width : 0.0f, .y = across ? 0.0f : 1.0f / view->height, .start = -0.5f};
  if (back)
    s.x *= -1.0f, s.y *= -1.0f, s.start = 0.5f;
  for (int k = 0; k < 9; k++)
    s.r1[k] = check_uniform(-0.1f, 0.1f), s.r2[k] = check_uniform(-0.01f, 0.01f);
  for (int k = 0; k < 3; k++) {
    s.t1[k] = check_uniform(-1.0f, 1.0f), s.t2[k] = check_uniform(-0.05f, 0.05f);
    s.eye1[k] = check_uniform(-1.0f, 1.0f), s.eye2[k] = check_uniform(-0.05f, 0.05f);
  }
  return s;
}

/* ---- Rows ---- */

static void place(const pags_projection *v, float row[ROW_FLOATS], float x, float y, float z) {
  const float cam[3] = {(x - v->cx) / v->fx * z - v->t[0], (y - v->cy) / v->fy * z - v->t[1], z - v->t[2]};
  for (int k = 0; k < 3; k++)
    row[ROW_MEAN + k] = v->r[k] * cam[0] + v->r[3 + k] * cam[1] + v->r[6 + k] * cam[2];
}

static void ordinary(const pags_projection *v, float row[ROW_FLOATS], row_kind kind) {
  const float z = check_uniform(0.5f, 12.0f), size = z / v->fx * expf(check_uniform(-1.0f, 4.0f));
  /* Spread of the sigmas' logarithms: ratios up to 1:1e4 or 1:20. */
  const float spread = kind == ROWS_NEEDLES ? 9.2f : 3.0f;
  place(v, row, check_uniform(-60.0f, v->width + 60.0f), check_uniform(-60.0f, v->height + 60.0f), z);
  for (int k = 0; k < 3; k++)
    row[ROW_SCALE + k] = logf(size) - check_uniform(0.0f, spread);
  if (kind == ROWS_NEEDLES)
    row[ROW_SCALE + check_below(3)] = logf(size);
  for (int k = 0; k < 4; k++)
    row[ROW_QUATERNION + k] = check_normal();
  row[ROW_LOGIT] = 2.0f * check_normal();
  for (int k = ROW_SH; k < ROW_FLOATS; k++)
    row[k] = k < ROW_SH + 3 ? check_normal() : 0.3f * check_normal();
}

static void make_awkward(const pags_projection *v, float row[ROW_FLOATS]) {
  static const float odd[] = {NAN, INFINITY, -INFINITY, 1e30f, -1e30f, 0.0f, -0.0f, 1e-40f, 3e38f};
  static const float lengths[] = {1e-37f, 1e-30f, 1e-22f, 1e-16f, 1e-15f, 1e17f, 1e19f, 1e20f, 1e30f, 5e37f};
  switch (check_below(13)) {
    case 0: place(v, row, 200.0f, 150.0f, check_uniform(-9.0f, 0.0f)); break;
    case 1: place(v, row, check_uniform(0.0f, v->width), check_uniform(0.0f, v->height), v->near_plane); break;
    case 2: memcpy(row + ROW_MEAN, v->eye, sizeof v->eye); break;
    case 3:
      for (int k = 0; k < 3; k++)
        row[ROW_SCALE + k] = -INFINITY;
      break;
    case 4: row[ROW_SCALE + check_below(3)] = check_uniform(5.0f, 90.0f); break;
    case 5: row[ROW_LOGIT] = -logf(254.0f) * (1.0f + 1e-7f * (float)(check_below(5) - 2)); break;
    case 6: memset(row + ROW_QUATERNION, 0, 4 * sizeof *row); break;
    case 7: place(v, row, check_uniform(-5e4f, 5e4f), check_uniform(-5e4f, 5e4f), check_uniform(0.26f, 3.0f)); break;
    case 8: /* rows of negative colours */
      for (int k = 0; k < 3; k++)
        row[ROW_SH + k] -= 4.0f;
      break;
    case 9: row[ROW_LOGIT] = check_below(2) ? INFINITY : 40.0f; break;
    case 10: {
      const float length = lengths[check_below((int)(sizeof lengths / sizeof *lengths))];
      for (int k = 0; k < 4; k++)
        row[ROW_QUATERNION + k] *= length;
      break;
    }
    default: row[check_below(ROW_SH + 6)] = odd[check_below((int)(sizeof odd / sizeof *odd))]; break;
  }
}

rows rows_random(const pags_projection *view, int count, row_kind kind) {
  rows r = {.count = count, .planes = row_planes(view->sh_degree)};
  r.stride = round_up_16(count) + 16 * check_below(2);
  const int64_t size = (r.planes - 1) * r.stride + round_up_16(count);
  r.data = CHECK_NEW(float, size);
  for (int64_t i = 0; i < size; i++)
    r.data[i] = NAN;
  for (int i = 0; i < count; i++) {
    float row[ROW_FLOATS];
    ordinary(view, row, kind);
    if (kind == ROWS_AWKWARD && check_below(3) == 0)
      make_awkward(view, row);
    for (int p = 0; p < r.planes; p++)
      r.data[p * r.stride + i] = row[p];
  }
  check_freeze(r.data);
  return r;
}

void row_read(const rows *r, int index, double row[ROW_FLOATS]) {
  for (int p = 0; p < ROW_FLOATS; p++)
    row[p] = p < r->planes ? (double)r->data[p * r->stride + index] : 0.0;
}

bool row_usable(const double row[ROW_FLOATS], int planes) {
  for (int p = 0; p < planes; p++) {
    const bool zero_scale = p >= ROW_SCALE && p < ROW_QUATERNION && row[p] == -INFINITY;
    if (!isfinite(row[p]) && !zero_scale && !(p == ROW_LOGIT && isinf(row[p])))
      return false;
  }
  return true;
}

/* ---- The same computations in double ---- */

static double clamped(double x, double lo, double hi) {
  return fmin(fmax(x, lo), hi);
}

static void covariance_plainly(const pags_projection *v, const double row[ROW_FLOATS], const double cam[3],
                               plain_row *out) {
  const double tx = clamped(cam[0] / cam[2], (double)v->lim_x0, (double)v->lim_x1);
  const double ty = clamped(cam[1] / cam[2], (double)v->lim_y0, (double)v->lim_y1);
  const double fx = (double)v->fx / cam[2], fy = (double)v->fy / cam[2], low = (double)v->low_pass;
  double r[9], m[6];
  rotation(row + ROW_QUATERNION, r);
  for (int k = 0; k < 3; k++) {
    const double sigma = exp(clamped(row[ROW_SCALE + k], -87.0, 88.0));
    double axis[3];
    for (int i = 0; i < 3; i++)
      axis[i] = (double)v->r[3 * i] * r[k] + (double)v->r[3 * i + 1] * r[3 + k] + (double)v->r[3 * i + 2] * r[6 + k];
    m[k] = sigma * fx * (axis[0] - tx * axis[2]);
    m[3 + k] = sigma * fy * (axis[1] - ty * axis[2]);
  }
  const double minor[3] = {m[0] * m[4] - m[1] * m[3], m[0] * m[5] - m[2] * m[3], m[1] * m[5] - m[2] * m[4]};
  out->a = m[0] * m[0] + m[1] * m[1] + m[2] * m[2] + low;
  out->b = m[0] * m[3] + m[1] * m[4] + m[2] * m[5];
  out->c = m[3] * m[3] + m[4] * m[4] + m[5] * m[5] + low;
  out->d0 = minor[0] * minor[0] + minor[1] * minor[1] + minor[2] * minor[2];
  out->d = out->d0 + low * (out->a + out->c - low);
}

static void colour_plainly(const pags_projection *v, const double row[ROW_FLOATS], double rgb[3]) {
  double d[3], norm = 0.0;
  for (int k = 0; k < 3; k++) {
    d[k] = row[ROW_MEAN + k] - (double)v->eye[k];
    norm += d[k] * d[k];
  }
  norm = sqrt(norm);
  const bool at_eye = norm * norm <= 1e-30;
  const double x = at_eye ? 0.0 : d[0] / norm, y = at_eye ? 0.0 : d[1] / norm, z = at_eye ? 1.0 : d[2] / norm;
  /* Real spherical harmonics with the Condon-Shortley phase, m = -l .. l. */
  const double basis[16] = {0.28209479177387814,
                            -0.4886025119029199 * y,
                            0.4886025119029199 * z,
                            -0.4886025119029199 * x,
                            1.0925484305920792 * x * y,
                            -1.0925484305920792 * y * z,
                            0.31539156525252005 * (3 * z * z - 1),
                            -1.0925484305920792 * x * z,
                            0.5462742152960396 * (x * x - y * y),
                            -0.5900435899266435 * y * (3 * x * x - y * y),
                            2.890611442640554 * x * y * z,
                            -0.4570457994644658 * y * (5 * z * z - 1),
                            0.3731763325901154 * z * (5 * z * z - 3),
                            -0.4570457994644658 * x * (5 * z * z - 1),
                            1.445305721320277 * z * (x * x - y * y),
                            -0.5900435899266435 * x * (x * x - 3 * y * y)};
  for (int c = 0; c < 3; c++) {
    rgb[c] = 0.5;
    for (int k = 0; k < (v->sh_degree + 1) * (v->sh_degree + 1); k++)
      rgb[c] += basis[k] * row[ROW_SH + 3 * k + c];
  }
}

/* Returns whether a > b; clears `certain` if rounding could change the answer, `size` being the magnitude of the
 * terms from which a and b were summed. */
static bool above(double a, double b, double size, bool *certain) {
  *certain = *certain && fabs(a - b) > 1e-4 * size;
  return a > b;
}

plain_row row_plainly(const pags_projection *v, const double row[ROW_FLOATS]) {
  plain_row out = {.certain = true};
  double cam[3], size = 0.0;
  for (int i = 0; i < 3; i++) {
    cam[i] = (double)v->t[i];
    for (int k = 0; k < 3; k++) {
      cam[i] += (double)v->r[3 * i + k] * row[ROW_MEAN + k];
      size = fmax(size, fabs(row[ROW_MEAN + k]) + fabs((double)v->t[i]));
    }
  }
  out.z = cam[2];
  out.drawn = above(out.z, (double)v->near_plane, fmax(size, 1e-3), &out.certain);
  for (int i = 0; i < v->clip_count; i++) {
    const double a = (double)v->clips[i][0] * cam[0], b = (double)v->clips[i][1] * cam[1],
                 c = (double)v->clips[i][2] * cam[2], d = (double)v->clips[i][3];
    out.drawn = above(a + b + c, -d, fabs(a) + fabs(b) + fabs(c) + fabs(d), &out.certain) && out.drawn;
  }
  if (!out.drawn)
    return out;
  out.x = (double)v->fx * cam[0] / cam[2] + (double)v->cx;
  out.y = (double)v->fy * cam[1] / cam[2] + (double)v->cy;
  covariance_plainly(v, row, cam, &out);
  colour_plainly(v, row, out.rgb);
  out.raw_opacity = 1.0 / (1.0 + exp(clamped(-row[ROW_LOGIT], -87.0, 88.0)));
  out.opacity = out.raw_opacity * (v->antialiased ? sqrt(fmax(2.5e-5, out.d0 / out.d)) : 1.0);
  const double least = (double)v->alpha.least, compensation = out.opacity / out.raw_opacity;
  const bool scaled = v->antialiased && v->alpha.floor > 0.0f;
  const double scale = scaled ? fmax(compensation, (double)PAGS_ALPHA_MIN / least) : 1.0;
  out.least = least * scale;
  out.cut = (double)v->alpha.cut + log2(scale);
  out.floor = (double)v->alpha.floor * scale;
  const double reach = 2.0 * log(2.0) * (log2(out.opacity) + (double)v->alpha.lift - out.cut);
  const double slack = 1.0 + 1e-3 * (fabs(out.x) + fabs(out.y));
  out.extent_x = sqrt(fmax(reach * out.a, 0.0));
  out.extent_y = sqrt(fmax(reach * out.c, 0.0));
  bool *const sure = &out.certain;
  const bool conditions[] = {above(out.opacity, out.least, v->antialiased ? 50.0 * out.opacity : out.opacity, sure),
                             above(1e18, out.a, 1e18, sure),
                             above(1e18, out.c, 1e18, sure),
                             above(1e36, out.d, 1e36, sure),
                             above(out.x + out.extent_x, 0.0, slack + out.extent_x, sure),
                             above(out.y + out.extent_y, 0.0, slack + out.extent_y, sure),
                             above((double)v->width, out.x - out.extent_x, slack + out.extent_x, sure),
                             above((double)v->height, out.y - out.extent_y, slack + out.extent_y, sure)};
  for (size_t i = 0; i < sizeof conditions / sizeof *conditions; i++)
    out.drawn = out.drawn && conditions[i];
  return out;
}
