/* SPDX-License-Identifier: Apache-2.0 */
/* Draws dots, lines, numbers and projected boxes (overlay_draw.h). Lines are clipped to the picture, boxes to a near
 * plane. */
#include "cli/measure/overlay_draw.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/vec3.h"
#include "maths/maths.h"

static const double near_plane = 0.1;

pags_result pags_photo_image(const pags_photo *photo, pags_image *out) {
  PAGS_TRY(pags_image_create(out, photo->width, photo->height, 3, PAGS_U8));
  const size_t plane = (size_t)photo->height * (size_t)photo->stride;
  uint8_t *to = out->data;
  for (int y = 0; y < photo->height; y++)
    for (int x = 0; x < photo->width; x++)
      for (size_t c = 0; c < 3; c++)
        *to++ = photo->rgb[c * plane + (size_t)y * (size_t)photo->stride + (size_t)x];
  return PAGS_OK;
}

void pags_draw_dot(pags_image *image, double x, double y, int half, const uint8_t rgb[3]) {
  uint8_t *data = image->data;
  int left = (int)floor(x) - half, top = (int)floor(y) - half;
  for (int j = top; j <= top + 2 * half; j++)
    for (int i = left; i <= left + 2 * half; i++)
      if (i >= 0 && j >= 0 && i < image->width && j < image->height)
        memcpy(data + 3 * ((size_t)j * (size_t)image->width + (size_t)i), rgb, 3);
}

/* Clips the parameter range [*lo, *hi] of a segment to the values of s where p + s d lies in [0, most] (one axis of a
 * clip to the picture); returns false if nothing is left. */
static bool cut(double p, double d, double most, double *lo, double *hi) {
  if (fabs(d) < 1e-12)
    return p >= 0 && p <= most;
  double s0 = -p / d, s1 = (most - p) / d;
  *lo = fmax(*lo, fmin(s0, s1));
  *hi = fmin(*hi, fmax(s0, s1));
  return *lo < *hi;
}

void pags_draw_line(pags_image *image, const double a[2], const double b[2], const uint8_t rgb[3]) {
  double lo = 0, hi = 1, dx = b[0] - a[0], dy = b[1] - a[1];
  if (!cut(a[0], dx, image->width, &lo, &hi) || !cut(a[1], dy, image->height, &lo, &hi))
    return;
  int steps = 1 + (int)(fmax(fabs(dx), fabs(dy)) * (hi - lo));
  for (int i = 0; i <= steps; i++) {
    double s = lo + (hi - lo) * i / steps, x = a[0] + s * dx, y = a[1] + s * dy;
    pags_draw_dot(image, x, y, 0, rgb);
    pags_draw_dot(image, x + 1, y, 0, rgb);
    pags_draw_dot(image, x, y + 1, 0, rgb);
  }
}

void pags_draw_number(pags_image *image, int x, int y, int64_t number) {
  enum { COLUMNS = 3, ROWS = 5, SCALE = 2, EDGE = 2, STEP = (COLUMNS + 1) * SCALE };
  /* Rows of a digit from above, three bits each, the leftmost the highest. */
  static const unsigned digits[10] = {075557, 026227, 071747, 071717, 055711, 074717, 074757, 071111, 075757, 075717};
  static const uint8_t black[3] = {0, 0, 0}, white[3] = {255, 255, 255};
  char text[24];
  const int length = snprintf(text, sizeof text, "%" PRId64, number < 0 ? 0 : number);
  for (int j = 0; j < ROWS * SCALE + 2 * EDGE; j++)
    for (int i = 0; i < length * STEP - SCALE + 2 * EDGE; i++) {
      const int column = (i - EDGE) / SCALE % (COLUMNS + 1), row = (j - EDGE) / SCALE;
      const bool inside = i >= EDGE && j >= EDGE && column < COLUMNS && row < ROWS;
      const int at = inside ? (i - EDGE) / STEP : length;
      const bool ink = at < length && digits[text[at] - '0'] >> (3 * (ROWS - 1 - row) + (COLUMNS - 1 - column)) & 1;
      pags_draw_dot(image, x + i, y + j, 0, ink ? black : white);
    }
}

/* Projects and draws the edge from a to b, both in camera coordinates, clipped at the near plane. */
static void draw_edge(pags_image *image, const pags_camera *camera, const double a[3], const double b[3],
                      const uint8_t rgb[3]) {
  enum { PIECES = 16 };
  double ends[2][3], way[3], before[2] = {0, 0}, at[2];
  pags_subtract3(b, a, way);
  if (pags_camera_bends(camera)) {
    /* The edge through a lens in short pieces; those on both sides of a panorama's seam are left out. */
    bool drawn = false;
    for (int i = 0; i <= PIECES; i++) {
      double p[3];
      for (int k = 0; k < 3; k++)
        p[k] = a[k] + way[k] * i / PIECES;
      const bool seen = pags_dot3(p, p) > near_plane * near_plane && pags_camera_project(camera, p, at, NULL);
      if (seen && drawn && fabs(at[0] - before[0]) < 0.5 * image->width)
        pags_draw_line(image, before, at, rgb);
      drawn = seen;
      memcpy(before, at, sizeof before);
    }
    return;
  }
  if (a[2] < near_plane && b[2] < near_plane)
    return;
  double on_plane[3], pixels[2][2];
  pags_along3(a, (near_plane - a[2]) / way[2], way, on_plane);
  pags_copy3(a[2] < near_plane ? on_plane : a, ends[0]);
  pags_copy3(b[2] < near_plane ? on_plane : b, ends[1]);
  for (int e = 0; e < 2; e++) {
    pixels[e][0] = camera->fx * ends[e][0] / ends[e][2] + camera->cx;
    pixels[e][1] = camera->fy * ends[e][1] / ends[e][2] + camera->cy;
  }
  pags_draw_line(image, pixels[0], pixels[1], rgb);
}

void pags_draw_box(pags_image *image, const pags_camera *camera, const double world_from_object[12],
                   const double size[3], const uint8_t rgb[3]) {
  double inverse[12], m[12], corners[8][3];
  pags_rigid_inverse(camera->world_from_camera, inverse);
  pags_rigid_multiply(inverse, world_from_object, m);
  for (int i = 0; i < 8; i++) { /* bit k of i: the corner lies on the positive side of axis k */
    double p[3];
    for (int k = 0; k < 3; k++)
      p[k] = (i >> k & 1 ? 0.5 : -0.5) * size[k];
    pags_rigid_point(m, p, corners[i]);
  }
  for (int i = 0; i < 8; i++)
    for (int k = 0; k < 3; k++)
      if (!(i >> k & 1))
        draw_edge(image, camera, corners[i], corners[i | 1 << k], rgb);
  draw_edge(image, camera, corners[1], corners[7], rgb);
  draw_edge(image, camera, corners[3], corners[5], rgb);
}

bool pags_view_begins_step(const pags_dataset *dataset, int64_t view) {
  return view == 0 || pags_dataset_view(dataset, view)->frame != pags_dataset_view(dataset, view - 1)->frame;
}

void pags_depth_colour(double metres, uint8_t rgb[3]) {
  double h = pags_log(fmax(metres, 2) / 2) / pags_log(50.0), s = fmin(h, 1);
  rgb[0] = (uint8_t)(255 * fmax(0, 1 - 2 * s));
  rgb[1] = (uint8_t)(255 * (1 - fabs(2 * s - 1)));
  rgb[2] = (uint8_t)(255 * fmax(0, 2 * s - 1));
}
