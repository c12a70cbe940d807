/* SPDX-License-Identifier: Apache-2.0 */
/* Axes of splat files. There are the 16 coordinate systems that SPZ's record can name (nianticlabs/spz,
 * extensions/README.md): eight with y up or down and z forward or back, and eight with these two exchanged. */
#include "scene/axes.h"

#include <assert.h>
#include <string.h>
#include <strings.h>

/* ---- Names ---- */

static const char *const up_codes[] = {
    [PAGS_UP_UNKNOWN] = "unknown", [PAGS_UP_Z] = "z", [PAGS_UP_MINUS_Y] = "-y", [PAGS_UP_Y] = "y"};

const char *pags_up_code(pags_up up) {
  return up_codes[up];
}

bool pags_up_from_code(const char *name, pags_up *up) {
  name += *name == '+';
  for (int i = 0; i < (int)(sizeof up_codes / sizeof *up_codes); i++)
    if (strcasecmp(name, up_codes[i]) == 0) {
      *up = (pags_up)i;
      return true;
    }
  return false;
}

const char *pags_axes_name(int axes) {
  static const char *const names[PAGS_AXES_COUNT] = {"unknown", "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF",
                                                     "LFD",     "RFD", "LFU", "RFU", "LBD", "RBD", "LBU", "RBU"};
  return axes > 0 && axes < PAGS_AXES_COUNT ? names[axes] : names[0];
}

/* ---- Turning ---- */

/* In which of x, y and z (bits 0, 1, 2) the SH functions 1 to 15 are odd, in the order m = -l .. l. */
static const int odd[15] = {2, 4, 1, 3, 6, 0, 5, 0, 2, 7, 2, 4, 1, 4, 1};

void pags_axes_signs(int axes, int vector[3], int harmonics[15]) {
  assert(axes >= 1 && axes <= 8);
  /* The number less one has a bit for each letter: 1 right, 2 up, 4 forward. */
  const int bits = axes - 1;
  vector[0] = bits & 1 ? 1 : -1;
  vector[1] = bits & 2 ? -1 : 1;
  vector[2] = bits & 4 ? 1 : -1;
  for (int i = 0; i < 15; i++)
    harmonics[i] = (odd[i] & 1 ? vector[0] : 1) * (odd[i] & 2 ? vector[1] : 1) * (odd[i] & 4 ? vector[2] : 1);
}

static void negate(float *values, int64_t count) {
  for (int64_t i = 0; i < count; i++)
    values[i] = 0.0f - values[i]; /* no negative zeros */
}

/* With S the diagonal matrix of the signs, a rotation R becomes S R S, whose quaternion has the vector part
 * det(S) S v. */
static void flip(pags_gaussians *g, int axes) {
  int vector[3], harmonics[15];
  pags_axes_signs(axes, vector, harmonics);
  const int determinant = vector[0] * vector[1] * vector[2];
  for (int k = 0; k < 3; k++) {
    if (vector[k] < 0)
      negate(pags_plane(g, PAGS_MEAN + k), g->count);
    if (vector[k] * determinant < 0)
      negate(pags_plane(g, PAGS_ROTATION + 1 + k), g->count);
  }
  for (int i = 0; i < pags_sh_coefficients(g->sh_degree) - 1; i++)
    for (int c = 0; c < 3 && harmonics[i] < 0; c++)
      negate(pags_plane(g, PAGS_SH + 3 * (1 + i) + c), g->count);
}

/* Turns by -90 degrees about x: (x, y, z) becomes (x, z, -y). */
static void exchange(pags_gaussians *g) {
  static const double rotation[9] = {1, 0, 0, 0, 0, 1, 0, -1, 0};
  const double root = 0.70710678118654752;
  pags_sh_rotation turn;
  pags_sh_rotation_make(rotation, &turn);
  for (int64_t i = 0; i < g->count; i++) {
    float *const y = pags_plane(g, PAGS_MEAN + 1) + i, *const z = pags_plane(g, PAGS_MEAN + 2) + i;
    const float before = *y;
    *y = *z;
    *z = 0.0f - before;

    /* The quaternion (1, -1, 0, 0) / sqrt 2 times that of the Gaussian. */
    double q[4];
    for (int k = 0; k < 4; k++)
      q[k] = root * (double)pags_plane(g, PAGS_ROTATION + k)[i];
    const double product[4] = {q[0] + q[1], q[1] - q[0], q[2] + q[3], q[3] - q[2]};
    for (int k = 0; k < 4; k++)
      pags_plane(g, PAGS_ROTATION + k)[i] = (float)product[k];
    pags_sh_rotation_apply_row(&turn, g->sh_degree, g, i);
  }
}

void pags_axes_turn_point(int axes, double point[3]) {
  int vector[3], harmonics[15];
  const double y = point[1];
  if (axes > 8) { /* as exchange */
    point[1] = point[2];
    point[2] = 0.0 - y;
  }
  pags_axes_signs(axes > 8 ? axes - 8 : axes, vector, harmonics);
  for (int k = 0; k < 3; k++)
    point[k] = 0.0 + vector[k] * point[k]; /* no negative zeros */
}

void pags_gaussians_turn(pags_gaussians *g, int axes) {
  assert(axes > 0 && axes < PAGS_AXES_COUNT);
  if (g->count == 0) /* has no planes */
    return;
  if (axes > 8)
    exchange(g); /* right, forward, down becomes right, down, back: eight numbers below */
  flip(g, axes > 8 ? axes - 8 : axes);
}
