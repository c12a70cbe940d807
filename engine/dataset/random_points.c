/* SPDX-License-Identifier: Apache-2.0 */
/* Draws random initial points for a data set without a reconstruction.
 *
 * A uniform cube would put most points where no camera looks, or right in front of a camera. Here each point is drawn
 * on a ray of the cameras: a random training view, a random pixel of it and a random depth; a point that too few
 * views see is drawn again. The depth is log-uniform around the depth of the subject (the point nearest to all
 * optical axes), so that the density of the points falls with distance as the footprint of a pixel grows. */
#include "dataset/parsed.h"

#include "base/rng.h"

#include <assert.h>

enum { DRAW_VIEW, DRAW_PIXEL, DRAW_DEPTH, DRAW_COLOUR };

/* Random number stream of this file, so that other users of the same seed draw independent numbers. */
#define STREAM UINT64_C(0x706f696e74730000)

pags_result pags_random_points(const pags_camera *const *cameras, int64_t camera_count, const double origin[3],
                               uint64_t seed, int64_t count, float *xyz, uint8_t *rgb) {
  assert(camera_count > 0 && count > 0);
  double distance;
  PAGS_TRY(pags_focus_distance(cameras, camera_count, &distance));
  /* Each point must be seen by three views, or by all views of a set with fewer than three. After 16 * count rejected
   * points every point is accepted, so that views without overlap get initial points, too. */
  const int64_t enough = camera_count < 3 ? camera_count : 3;
  int64_t misses = 0;
  uint64_t draw = 0;
  for (int64_t i = 0; i < count;) {
    const pags_camera *camera = cameras[pags_rng_below(seed, STREAM + DRAW_VIEW, draw, (uint64_t)camera_count)];
    double pixel[2], p[3], point[3];
    pags_rng_uniform2(seed, STREAM + DRAW_PIXEL, draw, pixel);
    const double depth = pags_focus_depth(distance, pags_rng_uniform(seed, STREAM + DRAW_DEPTH, draw++));
    if (!pags_camera_point(camera, pixel[0] * camera->width, pixel[1] * camera->height, depth, p))
      p[0] = p[1] = 0, p[2] = depth; /* outside its circle a lens sees nothing: use its axis then */
    pags_rigid_point(camera->world_from_camera, p, point);
    int64_t seen = 0;
    for (int64_t k = 0; k < camera_count && seen < enough && misses < 16 * count; k++)
      seen += pags_camera_sees(cameras[k], point, 0.2 * distance);
    if (misses < 16 * count && seen < enough) {
      misses++;
      continue;
    }
    uint32_t colour[4];
    pags_rng_u32x4(seed, STREAM + DRAW_COLOUR, (uint64_t)i, colour);
    for (int c = 0; c < 3; c++) {
      xyz[3 * i + c] = (float)(point[c] - origin[c]);
      rgb[3 * i + c] = (uint8_t)(96 + colour[c] % 64);
    }
    i++;
  }
  return PAGS_OK;
}
