/* SPDX-License-Identifier: Apache-2.0 */
/* Computes surface normals from a picture's depth plane, for --channel normal: cross products of depth differences
 * between neighbouring pixels. */
#include "cli/draw/picture.h"

#include <math.h>
#include "base/vec3.h"

/* Unprojects pixel (x, y) by its depth into camera coordinates; returns false if the pixel lies outside or has no
 * depth. */
static bool point_at(const pags_picture *picture, const pags_camera *camera, int x, int y, double p[3]) {
  if (x < 0 || y < 0 || x >= picture->width || y >= picture->height)
    return false;
  const double depth = (double)picture->depth[(int64_t)y * picture->stride + x];
  return depth > 0 && pags_camera_point(camera, x + 0.5, y + 0.5, depth, p);
}

/* Computes the surface tangent for one pixel in direction (dx, dy): the difference to that of the two neighbours
 * which is nearer in depth, so that at a depth edge both sides keep the normal of their own surface. */
static bool step_along(const pags_picture *picture, const pags_camera *camera, int x, int y, int dx, int dy,
                       const double here[3], double step[3]) {
  double ahead[3], behind[3];
  bool has_ahead = point_at(picture, camera, x + dx, y + dy, ahead);
  const bool has_behind = point_at(picture, camera, x - dx, y - dy, behind);
  if (has_ahead && has_behind && fabs(behind[2] - here[2]) < fabs(ahead[2] - here[2]))
    has_ahead = false;
  if (has_ahead)
    pags_subtract3(ahead, here, step);
  else if (has_behind)
    pags_subtract3(here, behind, step);
  return has_ahead || has_behind;
}

/* Computes the unit normal at a pixel in camera axes, facing the camera; zeros if it can't be determined. */
static void normal_at(const pags_picture *picture, const pags_camera *camera, int x, int y, double n[3]) {
  double here[3], right[3], down[3], cross[3];
  n[0] = n[1] = n[2] = 0;
  if (!point_at(picture, camera, x, y, here) || !step_along(picture, camera, x, y, 1, 0, here, right) ||
      !step_along(picture, camera, x, y, 0, 1, here, down))
    return;
  pags_cross3(down, right, cross);
  const double length = pags_length3(cross), towards = -pags_dot3(cross, here);
  if (length > 0)
    for (int k = 0; k < 3; k++)
      n[k] = cross[k] / (towards < 0 ? -length : length);
}

void pags_normals_from_depth(const pags_picture *picture, const pags_camera *camera, float *const out[3]) {
  const double *m = camera->world_from_camera;
  for (int y = 0; y < picture->height; y++)
    for (int x = 0; x < picture->stride; x++) {
      double n[3] = {0, 0, 0};
      if (x < picture->width)
        normal_at(picture, camera, x, y, n);
      for (int k = 0; k < 3; k++)
        out[k][(int64_t)y * picture->stride + x] = (float)pags_dot3(m + 4 * k, n);
    }
}
