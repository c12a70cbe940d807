/* SPDX-License-Identifier: Apache-2.0 */
/* Directions of a lens's pixels, and boxes by rays: the slabs of Kay and Kajiya (1986). */
#include "dataset/driving/label_plane.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/vec3.h"

/* Goes along a row from the column nearest to the principal point outwards, each direction beginning at the last. */
static void find_row(const pags_camera *camera, int row, int from, int to, int step, float *out) {
  double direction[3] = {0, 0, 0};
  for (int x = from; x != to; x += step) {
    const double at[2] = {(x + 0.5 - camera->cx) / camera->fx, (row + 0.5 - camera->cy) / camera->fy};
    if (!pags_lens_look(&camera->lens, at, direction))
      return;
    pags_narrow3(direction, out + 3 * x);
  }
}

pags_result pags_pixel_rays_create(const pags_camera *camera, pags_pixel_rays *out) {
  *out = (pags_pixel_rays){.width = camera->width, .height = camera->height};
  if (!pags_camera_bends(camera))
    return PAGS_OK;
  out->direction = calloc((size_t)camera->width * (size_t)camera->height, 3 * sizeof *out->direction);
  PAGS_CHECK_MEMORY(out->direction, "the directions of %d x %d pixels", camera->width, camera->height);
  const int middle = (int)fmin(fmax(camera->cx, 0), camera->width);
  for (int row = 0; row < camera->height; row++) {
    float *const rays = out->direction + 3 * (size_t)row * (size_t)camera->width;
    find_row(camera, row, middle, camera->width, 1, rays);
    find_row(camera, row, middle - 1, -1, -1, rays);
  }
  return PAGS_OK;
}

void pags_pixel_rays_destroy(pags_pixel_rays *rays) {
  free(rays->direction);
  *rays = (pags_pixel_rays){0};
}

/* Whether the ray from `eye` along `way`, both in the box's frame, meets it in front of the eye. */
static bool meets(const double eye[3], const double way[3], const double half[3]) {
  double from = 0, to = INFINITY;
  for (int k = 0; k < 3; k++) {
    if (way[k] == 0 && fabs(eye[k]) > half[k])
      return false;
    if (way[k] == 0)
      continue;
    const double a = (-half[k] - eye[k]) / way[k], b = (half[k] - eye[k]) / way[k];
    from = fmax(from, fmin(a, b));
    to = fmin(to, fmax(a, b));
  }
  return from < to;
}

void pags_pixel_rays_fill_box(const pags_pixel_rays *rays, const pags_camera *camera,
                              const double world_from_object[12], const double size[3], int stride, uint8_t bits,
                              uint8_t *plane) {
  double object_from_world[12], m[12], eye[3], half[3];
  pags_rigid_inverse(world_from_object, object_from_world);
  pags_rigid_multiply(object_from_world, camera->world_from_camera, m);
  pags_pose_position(m, eye);
  pags_scale3(0.5, size, half);
  /* Most rays miss the sphere around the box: those farther from its middle than `least` says. */
  const double away2 = pags_dot3(eye, eye), radius2 = pags_dot3(half, half);
  const double least = away2 > radius2 ? sqrt(away2 - radius2) - 1e-4 * sqrt(away2) : -INFINITY;
  for (int y = 0; y < rays->height; y++)
    for (int x = 0; x < rays->width; x++) {
      const float *const d = rays->direction + 3 * ((size_t)y * (size_t)rays->width + (size_t)x);
      double direction[3], way[3];
      pags_widen3(d, direction);
      pags_rotate3(m, direction, way);
      const bool seen = d[0] != 0.0f || d[1] != 0.0f || d[2] != 0.0f;
      if (seen && -pags_dot3(way, eye) >= least && meets(eye, way, half))
        plane[(size_t)y * (size_t)stride + (size_t)x] |= bits;
    }
}
