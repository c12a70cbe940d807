/* SPDX-License-Identifier: Apache-2.0 */
/* Computes the outline of a 3D box in a picture and fills the pixels inside of an outline.
 *
 * The part of the box nearer than 0.1 m is clipped in camera space before projection, because a corner behind the
 * camera has no valid projection. The corners in front of the clipping plane and the intersections of the edges with
 * that plane span the rest of the box; its outline is the convex hull of their projections. Through a lens, edges are
 * curves: points along them are projected, and the hull is thinned to the corners that there is room for. */
#include <pags/dataset.h>

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/sort.h"
#include "base/vec3.h"

/* Most points that span a clipped box: 8 corners, or at most 7 corners and 6 intersections, because a plane cuts at
 * most six of the twelve edges and then leaves at most seven corners. */
enum { MOST_POINTS = 16 };

/* Pieces of an edge that a lens bends, and the points of all edges. */
enum { PER_EDGE = 8, EDGE_POINTS = 12 * (PER_EDGE + 1) };

static const double nearest = 0.1; /* metres: distance of the clipping plane */

static void project(const pags_camera *camera, const double p[3], double out[2]) {
  out[0] = camera->fx * p[0] / p[2] + camera->cx;
  out[1] = camera->fy * p[1] / p[2] + camera->cy;
}

/* Clips the box, given by its corners in the camera frame, at `nearest` and projects the points that span the rest;
 * returns their number. */
static int clip(const pags_camera *camera, double corners[8][3], double out[MOST_POINTS][2]) {
  int count = 0;
  for (int i = 0; i < 8; i++) {
    if (corners[i][2] >= nearest)
      project(camera, corners[i], out[count++]);
    for (int axis = 0; axis < 3; axis++) {
      int j = i | 1 << axis; /* the edge from corner i to corner j, visited once */
      if (j == i || (corners[i][2] >= nearest) == (corners[j][2] >= nearest))
        continue;
      const double share = (nearest - corners[i][2]) / (corners[j][2] - corners[i][2]);
      double crossing[3];
      pags_subtract3(corners[j], corners[i], crossing);
      pags_along3(corners[i], share, crossing, crossing);
      crossing[2] = nearest;
      project(camera, crossing, out[count++]);
    }
  }
  return count;
}

static int by_position(const void *a, const void *b) {
  const double *left = a, *right = b;
  if (left[0] != right[0])
    return left[0] < right[0] ? -1 : 1;
  return left[1] < right[1] ? -1 : left[1] > right[1];
}

static double turn(const double *a, const double *b, const double *c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/* Computes the convex hull with Andrew's monotone chain algorithm: the lower chain from left to right, then the upper
 * chain back. Returns the number of corners, at most `room`. */
static int hull(double points[][2], int count, double *out, int room) {
  double chain[2 * EDGE_POINTS + 1][2];
  int length = 0;
  pags_sort(points, count, sizeof *points, by_position);
  for (int side = 0; side < 2; side++) {
    int begin = length;
    for (int i = 0; i < count; i++) {
      const double *p = points[side == 0 ? i : count - 1 - i];
      while (length >= begin + 2 && turn(chain[length - 2], chain[length - 1], p) <= 0)
        length--;
      chain[length][0] = p[0];
      chain[length++][1] = p[1];
    }
    length--; /* the next chain begins with this point, or the first one began with it */
  }
  length = length > room ? room : length;
  memcpy(out, chain, (size_t)length * sizeof *chain);
  return length;
}

/* The outline through a lens, of the points along the edges that it sees; none if the box lies on both sides of an
 * equirectangular picture's seam. */
static int outline_through_lens(const pags_camera *camera, double box[8][3], double corners[32]) {
  double points[EDGE_POINTS][2], outline[2 * (EDGE_POINTS + 1)];
  int count = 0, kept = 0;
  double least = INFINITY, most = -INFINITY;
  for (int i = 0; i < 8; i++)
    for (int axis = 0; axis < 3; axis++)
      for (int s = 0; s <= PER_EDGE && !(i >> axis & 1); s++) {
        double p[3];
        for (int k = 0; k < 3; k++)
          p[k] = box[i][k] + (box[i | 1 << axis][k] - box[i][k]) * s / PER_EDGE;
        if (pags_dot3(p, p) < nearest * nearest || !pags_camera_project(camera, p, points[count], NULL))
          continue;
        least = fmin(least, points[count][0]);
        most = fmax(most, points[count++][0]);
      }
  if (count < 3 || (camera->lens.kind == PAGS_LENS_EQUIRECTANGULAR && most - least > 3.14159265 * camera->fx))
    return 0;
  const int length = hull(points, count, outline, EDGE_POINTS);
  for (; kept < MOST_POINTS && kept < length; kept++) {
    const int from = length <= MOST_POINTS ? kept : kept * length / MOST_POINTS;
    corners[2 * kept] = outline[2 * from];
    corners[2 * kept + 1] = outline[2 * from + 1];
  }
  return kept >= 3 ? kept : 0;
}

int pags_box_outline(const pags_camera *camera, const double world_from_object[12], const double size[3],
                     double corners[32]) {
  double box[8][3], points[MOST_POINTS][2];
  for (int i = 0; i < 8; i++) {
    /* Corner i of the box in the camera frame: bit k of i chooses the side along axis k. */
    const double *c = camera->world_from_camera;
    double local[3], world[3];
    for (int k = 0; k < 3; k++)
      local[k] = (i >> k & 1 ? 0.5 : -0.5) * size[k];
    for (int k = 0; k < 3; k++)
      world[k] = world_from_object[4 * k] * local[0] + world_from_object[4 * k + 1] * local[1] +
                 world_from_object[4 * k + 2] * local[2] + world_from_object[4 * k + 3] - c[4 * k + 3];
    for (int k = 0; k < 3; k++)
      box[i][k] = c[k] * world[0] + c[4 + k] * world[1] + c[8 + k] * world[2];
  }
  if (pags_camera_bends(camera))
    return outline_through_lens(camera, box, corners);
  int count = clip(camera, box, points);
  if (count < 3)
    return 0;
  for (int i = 0; i < count; i++)
    if (!isfinite(points[i][0]) || !isfinite(points[i][1]))
      return 0;
  int length = hull(points, count, corners, MOST_POINTS);
  return length >= 3 ? length : 0;
}

/* Intersects the horizontal line at y with a convex outline: the line lies inside from *left to *right. Returns false
 * if they don't meet. */
static bool crossings(const double *corners, int count, double y, double *left, double *right) {
  *left = INFINITY;
  *right = -INFINITY;
  for (int i = 0; i < count; i++) {
    const double *a = corners + 2 * i, *b = corners + 2 * ((i + 1) % count);
    if ((a[1] <= y) == (b[1] <= y))
      continue;
    double x = a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
    *left = fmin(*left, x);
    *right = fmax(*right, x);
  }
  return *left <= *right;
}

/* Returns the first pixel whose centre lies at or beyond x, clamped to 0..size. */
static int first_centre(double x, int size) {
  return (int)fmin(fmax(ceil(x - 0.5), 0), size);
}

void pags_outline_fill(const double *corners, int count, int width, int height, int stride, uint8_t bits,
                       uint8_t *plane) {
  assert(width <= stride);
  double top = INFINITY, bottom = -INFINITY;
  for (int i = 0; i < count; i++) {
    top = fmin(top, corners[2 * i + 1]);
    bottom = fmax(bottom, corners[2 * i + 1]);
  }
  if (count < 3)
    return;
  for (int y = first_centre(top, height), end = first_centre(bottom, height); y < end; y++) {
    double left, right;
    if (!crossings(corners, count, y + 0.5, &left, &right))
      continue;
    uint8_t *row = plane + (size_t)y * (size_t)stride;
    for (int x = first_centre(left, width), last = first_centre(right, width); x < last; x++)
      row[x] |= bits;
  }
}
