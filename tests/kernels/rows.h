/* SPDX-License-Identifier: Apache-2.0 */
/* Random rows of Gaussian parameters and cameras for the tests of projection and shading, and the double-precision
 * results for both. */
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

/* Parameter planes of `count` rows in the kernels' layout. The buffer ends with the last row that a kernel may read. */
typedef struct rows {
  float *data;
  int64_t stride;
  int count, planes;
} rows;

typedef enum row_kind { ROWS_ORDINARY, ROWS_NEEDLES, ROWS_AWKWARD } row_kind;

pags_projection view_random(int sh_degree, bool antialiased);
/* Makes a view whose z is camera z and whose x and y are the model's, for rows at exact depths. */
pags_projection view_straight(int sh_degree);
/* Returns a random motion of the view during a rolling shutter's read-out: up to 1 m and 0.1 radians. */
pags_scan scan_random(const pags_projection *view);

/* Ordinary rows lie in and around the picture with ratios of axes up to 1:20. One in three of the awkward rows is
 * behind the camera, at the near plane, of zero or infinite size, at the opacity cut-off, without a rotation, or holds
 * a NaN or infinity in any parameter. Rows beyond the count hold NaN. */
rows rows_random(const pags_projection *view, int count, row_kind kind);

typedef struct plain_row {
  double x, y, z;        /* position: x and y in px, z in m */
  double a, b, c, d0, d; /* covariance; its determinants without and with the low-pass filter */
  double opacity, raw_opacity;
  double least, cut, floor; /* the row's pags_alpha_cut */
  double extent_x, extent_y;
  double rgb[3];       /* colour before the clamp at 0 */
  bool drawn, certain; /* certain: no threshold is so near that rounding decides it */
} plain_row;

plain_row row_plainly(const pags_projection *view, const double row[ROW_FLOATS]);
void row_read(const rows *r, int index, double row[ROW_FLOATS]);
/* Returns whether the row is finite, except where infinity has a meaning: a scale of 0, an opacity of 0 or 1. */
bool row_usable(const double row[ROW_FLOATS], int planes);

#endif
