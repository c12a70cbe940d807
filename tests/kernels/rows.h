/* SPDX-License-Identifier: Apache-2.0 */
/* Rows of Gaussian parameters and cameras for the tests of projection and shading, and both worked out in double. */
#ifndef PAGS_TESTS_ROWS_H
#define PAGS_TESTS_ROWS_H

#include "check.h"

enum { ROW_MEAN = 0, ROW_SCALE = 3, ROW_QUATERNION = 6, ROW_LOGIT = 10, ROW_SH = 11, ROW_FLOATS = 59 };

static inline int row_planes(int sh_degree) {
  return ROW_SH + 3 * (sh_degree + 1) * (sh_degree + 1);
}
static inline int64_t round_up_16(int64_t n) {
  return (n + 15) / 16 * 16;
}

/* Planes of `count` rows as the kernels take them, ending with the last row that may be read. */
typedef struct rows {
  float *data;
  int64_t stride;
  int count, planes;
} rows;

typedef enum row_kind { ROWS_ORDINARY, ROWS_NEEDLES, ROWS_AWKWARD } row_kind;

pags_projection view_random(int sh_degree, bool antialiased);
/* z is camera z, x y the model's: for rows at exact depths. */
pags_projection view_straight(int sh_degree);

/* Ordinary rows lie in and around the picture, axes within 1:20. Awkward: one row in three is behind the camera, at
 * the near plane, of no or infinite size, at the cut-off of opacity, without a rotation or holds a NaN or infinity
 * anywhere. Rows beyond the count hold NaN. */
rows rows_random(const pags_projection *view, int count, row_kind kind);

typedef struct plain_row {
  double x, y, z;        /* px, px, m */
  double a, b, c, d0, d; /* covariance, determinants without and with the low-pass filter */
  double opacity, raw_opacity;
  double extent_x, extent_y;
  double rgb[3];       /* before the clamp at 0 */
  bool drawn, certain; /* certain: no threshold is near enough for rounding to decide */
} plain_row;

plain_row row_plainly(const pags_projection *view, const double row[ROW_FLOATS]);
void row_read(const rows *r, int index, double row[ROW_FLOATS]);
/* No NaN or infinity but where it means something: a scale of 0, an opacity of 0 or 1. */
bool row_usable(const double row[ROW_FLOATS], int planes);

#endif
