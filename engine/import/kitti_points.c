/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the sweeps of KITTI's Velodyne and of programs that write them in other forms (kitti_files.h).
 *
 * The bytes of a sweep don't state what they are. A form is taken if the numbers that it gives are what a LiDAR can
 * measure: places within its reach, and a reflectance that isn't negative. Read with the wrong width or the wrong
 * number of columns, they aren't. */
#include <math.h>
#include <stdlib.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/memory.h"
#include "base/sort.h"
#include "import/kitti_files.h"

/* KITTI's own form first. */
static const pags_kitti_form forms[] = {{4, 4, 1}, {4, 8, 1}, {5, 4, 1}, {3, 4, 1}, {5, 8, 1}, {3, 8, 1}};
enum { FORMS = sizeof forms / sizeof forms[0], SAMPLES = 1000, LEAST = 100 };

static const double reach = 300; /* m */

/* The sum of bytes is at most 8 x 5, so that no product overflows. */
static size_t row_bytes(const pags_kitti_form *form) {
  return (size_t)form->columns * (size_t)form->width;
}

static double load(const pags_kitti_form *form, const uint8_t *row, int column) {
  return form->width == 8 ? pags_load_f64(row + 8 * column) : (double)pags_load_f32(row + 4 * column);
}

/* Returns the share of rows, out of at most SAMPLES, that a LiDAR can have measured. `range` receives the distance that
 * 95 of 100 of them don't exceed, `near` the share within 15 m. Places up to `most` metres count. */
static double plausible_share(const pags_kitti_form *form, const uint8_t *bytes, size_t rows, double most,
                              double *range, double *near) {
  double ranges[SAMPLES];
  int count = 0, good = 0, close = 0;
  const size_t step = rows / SAMPLES + 1;
  for (size_t i = 0; i < rows; i += step, count++) {
    const uint8_t *row = bytes + i * row_bytes(form);
    double square = 0;
    bool ok = true;
    for (int c = 0; c < form->columns; c++) {
      const double v = load(form, row, c);
      ok = ok && isfinite(v) && (v == 0 || fabs(v) > 1e-12) && fabs(v) < 1e9;
      square += c < 3 ? v * v : 0;
      if (c >= 3) /* reflectance, and a ring or the like */
        ok = ok && v >= 0 && v <= 65535;
    }
    if (!ok || !(sqrt(square) < most))
      continue;
    close += sqrt(square) < 15;
    ranges[good++] = sqrt(square);
  }
  pags_sort_doubles(ranges, good);
  *range = good ? ranges[(good * 95) / 100] : 0;
  *near = good ? (double)close / good : 0;
  return count ? (double)good / count : 0;
}

pags_result pags_kitti_form_find(const char *path, pags_kitti_form *out) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size = 0;
  double range, near;
  *out = forms[0];
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  for (int i = 0; i < 2 * FORMS; i++) {
    const pags_kitti_form *form = &forms[i % FORMS];
    const bool far = i >= FORMS; /* places out of reach: millimetres, or the world's axes */
    const size_t rows = size / row_bytes(form);
    if (size % row_bytes(form) || plausible_share(form, bytes, rows, far ? 1e8 : reach, &range, &near) < 0.95)
      continue;
    *out = *form;
    if (!far && rows >= LEAST && near == 0)
      return pags_fail_at(path,
                          "no point lies within 15 m of the LiDAR; expected its own axes (x forward, y left, z up), "
                          "not those of the world");
    if (!far)
      return PAGS_OK;
    out->scale = 0.001;
    if (plausible_share(form, bytes, rows, 1000 * reach, &range, &near) >= 0.95 && range > 15e3)
      return PAGS_OK;
    return pags_fail_at(path,
                        "95 of 100 points lie up to %g away; expected metres (up to %g) in the LiDAR's own axes, not "
                        "those of the world",
                        range, reach);
  }
  return pags_fail_at(path,
                      "expected rows of x y z reflectance, 4 floats (16 bytes), found %zu bytes that are neither this "
                      "nor 3 or 5 columns nor doubles within a LiDAR's reach",
                      size);
}

bool pags_kitti_form_is_usual(const pags_kitti_form *form) {
  return form->columns == 4 && form->width == 4 && form->scale == 1;
}

pags_result pags_kitti_points_read(const char *path, const pags_kitti_form *form, int64_t *count, float **xyzr) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size = 0;
  *count = 0;
  *xyzr = NULL;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  if (size % row_bytes(form))
    return pags_fail_at(path, "expected rows of %d %s (%zu bytes), found %zu bytes", form->columns,
                        form->width == 8 ? "doubles" : "floats", row_bytes(form), size);
  const size_t rows = size / row_bytes(form);
  float *values = *xyzr = malloc(rows ? rows * 4 * sizeof *values : 1);
  PAGS_CHECK_MEMORY(values, "%s: its points", path);
  for (size_t i = 0; i < rows; i++)
    for (int c = 0; c < 4; c++) {
      const double v = c < form->columns ? load(form, bytes + i * row_bytes(form), c) : 0;
      values[4 * i + (size_t)c] = (float)(c < 3 ? form->scale * v : v);
    }
  *count = (int64_t)rows;
  return PAGS_OK;
}
