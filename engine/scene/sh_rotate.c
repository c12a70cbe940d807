/* SPDX-License-Identifier: Apache-2.0 */
/* Rotation of spherical harmonics, for Gaussians that are moved with their object or come in other axes. A rotation
 * maps the functions of each degree l = 1..3 to themselves by a matrix of (2 l + 1) x (2 l + 1). The matrix is found by
 * least squares: rotated basis functions are sampled in 40 directions and expressed in the basis. The result is exact
 * up to rounding, since rotated functions of a degree lie in the space of that degree. */
#include "scene/axes.h"

#include <math.h>
#include <string.h>

#include "maths/maths.h"

enum { DIRECTIONS = 40 };

/* Values of the real spherical harmonics in direction `d`, terms 1..15 (degrees 1 to 3) with the signs, the order and
 * the constants of Kerbl et al. 2023. The constants matter: entry (a, b) of a rotation matrix scales with the ratio
 * of the constants of terms b and a. */
static void basis(const double d[3], double out[15]) {
  double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
  const double values[15] = {-0.4886025119029199 * y,
                             0.4886025119029199 * z,
                             -0.4886025119029199 * x,
                             1.0925484305920792 * x * y,
                             -1.0925484305920792 * y * z,
                             0.31539156525252005 * (2 * zz - xx - yy),
                             -1.0925484305920792 * x * z,
                             0.5462742152960396 * (xx - yy),
                             -0.5900435899266435 * y * (3 * xx - yy),
                             2.890611442640554 * x * y * z,
                             -0.4570457994644658 * y * (4 * zz - xx - yy),
                             0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
                             -0.4570457994644658 * x * (4 * zz - xx - yy),
                             1.445305721320277 * z * (xx - yy),
                             -0.5900435899266435 * x * (xx - 3 * yy)};
  memcpy(out, values, sizeof values);
}

/* The matrix that rotates the coefficients of one degree, in the upper left (2 l + 1) x (2 l + 1) of `out`. With B
 * the basis at the sample directions and B' the basis at the same directions turned back, it solves
 *     (B^T B) out = B^T B'. */
static void turn_degree(const double rotation[9], int degree, double out[7][7]) {
  int n = 2 * degree + 1, first = degree * degree - 1;
  double normal[7][7] = {{0}};
  memset(out, 0, 49 * sizeof(double));
  for (int i = 0; i < DIRECTIONS; i++) {
    double z = 1 - (2 * i + 1.0) / DIRECTIONS, r = sqrt(1 - z * z), angle = 2.39996322972865332 * i;
    const double d[3] = {r * pags_cos(angle), r * pags_sin(angle), z};
    double back[3], here[15], there[15];
    for (int k = 0; k < 3; k++)
      back[k] = rotation[k] * d[0] + rotation[3 + k] * d[1] + rotation[6 + k] * d[2];
    basis(d, here);
    basis(back, there);
    for (int a = 0; a < n; a++)
      for (int b = 0; b < n; b++) {
        normal[a][b] += here[first + a] * here[first + b];
        out[a][b] += here[first + a] * there[first + b];
      }
  }

  /* Gauss-Jordan elimination with n right sides; `normal` is positive definite, so no pivoting is needed. The right
   * sides in `out` become the solution. */
  for (int p = 0; p < n; p++)
    for (int i = 0; i < n; i++) {
      if (i == p)
        continue;
      double f = normal[i][p] / normal[p][p];
      for (int k = 0; k < n; k++) {
        normal[i][k] -= f * normal[p][k];
        out[i][k] -= f * out[p][k];
      }
    }
  for (int i = 0; i < n; i++)
    for (int k = 0; k < n; k++)
      out[i][k] /= normal[i][i];
}

void pags_sh_rotation_make(const double rotation[9], pags_sh_rotation *out) {
  for (int l = 1; l <= 3; l++)
    turn_degree(rotation, l, out->m[l - 1]);
}

void pags_sh_rotation_apply(const pags_sh_rotation *turn, int degree, double *rest) {
  for (int l = 1; l <= degree; l++) {
    const int n = 2 * l + 1;
    double *const band = rest + l * l - 1, turned[7] = {0};
    for (int a = 0; a < n; a++)
      for (int b = 0; b < n; b++)
        turned[a] += turn->m[l - 1][a][b] * band[b];
    memcpy(band, turned, (size_t)n * sizeof *turned);
  }
}

void pags_sh_rotation_apply_row(const pags_sh_rotation *turn, int degree, pags_gaussians *g, int64_t row) {
  const int terms = pags_sh_coefficients(degree) - 1;
  for (int c = 0; c < 3; c++) {
    double rest[15];
    for (int k = 0; k < terms; k++)
      rest[k] = (double)pags_plane(g, PAGS_SH + 3 * (k + 1) + c)[row];
    pags_sh_rotation_apply(turn, degree, rest);
    for (int k = 0; k < terms; k++)
      pags_plane(g, PAGS_SH + 3 * (k + 1) + c)[row] = (float)rest[k];
  }
}
