/* SPDX-License-Identifier: Apache-2.0 */
/* A z-buffer of coarse cells for sparse LiDAR points.
 *
 * The LiDAR sits elsewhere than the camera and measures surfaces that are hidden from the camera. Drawn as single
 * pixels, its points would hide nothing; so each covers a rectangle that is large enough to close the gaps to its
 * neighbours, depending on the number of points in the picture. */
#include "init/z_buffer.h"

#include <math.h>

#include "base/memory.h"

/* Bounds of half the side of the rectangle that a point covers: smallest and largest, metres; largest, px. */
static const double least_half = 0.08, most_half = 0.5;
static const double most_pixels = 16.0;

/* A point is hidden only if it is deeper than its cell by more than this (metres, plus a share of the cell's depth):
 * a smaller difference is taken for the same surface, seen at a slant. */
static const float same_metres = 0.3f, same_share = 0.08f;

pags_result pags_z_buffer_reset(pags_z_buffer *buffer, int width, int height, double focal) {
  buffer->width = width;
  buffer->height = height;
  buffer->focal = focal;
  buffer->columns = (width + PAGS_OCCLUSION_CELL - 1) / PAGS_OCCLUSION_CELL;
  buffer->rows = (height + PAGS_OCCLUSION_CELL - 1) / PAGS_OCCLUSION_CELL;
  int64_t cells = (int64_t)buffer->columns * buffer->rows;
  if (cells > buffer->room) {
    free(buffer->depth);
    buffer->depth = malloc((size_t)cells * sizeof *buffer->depth);
    buffer->room = buffer->depth ? cells : 0;
    PAGS_CHECK_MEMORY(buffer->depth, "a depth buffer of %dx%d", buffer->columns, buffer->rows);
  }
  for (int64_t i = 0; i < cells; i++)
    buffer->depth[i] = INFINITY;
  return PAGS_OK;
}

void pags_z_buffer_destroy(pags_z_buffer *buffer) {
  free(buffer->depth);
  *buffer = (pags_z_buffer){0};
}

static int clamp_cell(double pixel, int cells) {
  int cell = (int)(pixel / PAGS_OCCLUSION_CELL);
  return pixel < 0 ? 0 : cell < cells ? cell : cells - 1;
}

void pags_z_buffer_add(pags_z_buffer *buffer, const pags_seen_point *points, int64_t count) {
  int64_t seen = 0;
  for (int64_t i = 0; i < count; i++)
    seen += points[i].z > 0;
  if (seen == 0)
    return;
  double spacing = 0.5 * sqrt((double)buffer->width * buffer->height / (double)seen);
  for (int64_t i = 0; i < count; i++)
    if (points[i].z > 0) {
      /* Lower the depth of the cells in the rectangle that this point covers. */
      double u = (double)points[i].u, v = (double)points[i].v, scale = buffer->focal / (double)points[i].z;
      double half = fmin(fmax(spacing, least_half * scale), fmin(most_half * scale, most_pixels));
      int left = clamp_cell(u - half, buffer->columns), right = clamp_cell(u + half, buffer->columns);
      int top = clamp_cell(v - 0.25 * half, buffer->rows), bottom = clamp_cell(v + 2 * half, buffer->rows);
      for (int y = top; y <= bottom; y++) {
        float *row = buffer->depth + (int64_t)y * buffer->columns;
        for (int x = left; x <= right; x++)
          row[x] = points[i].z < row[x] ? points[i].z : row[x];
      }
    }
}

bool pags_z_buffer_visible(const pags_z_buffer *buffer, const pags_seen_point *point) {
  int x = clamp_cell((double)point->u, buffer->columns), y = clamp_cell((double)point->v, buffer->rows);
  float nearest = buffer->depth[(int64_t)y * buffer->columns + x];
  return point->z <= nearest * (1 + same_share) + same_metres;
}
