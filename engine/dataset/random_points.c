/* SPDX-License-Identifier: Apache-2.0 */
/* Random points to start from where a data set has none.
 *
 * A uniform cube would put most of them where no camera looks, or right in front of one. Ours are drawn along the
 * cameras' own rays: a random training view, a random pixel of it, a random depth; those that too few other views see
 * are drawn again. Depth is spread evenly in its logarithm, so that the density falls with distance as the size of a
 * pixel in space grows, around the depth of the subject: the point nearest to all optical axes. */
#include "dataset/parsed.h"

#include "base/rng.h"
#include "dataset/focus.h"

#include <assert.h>

enum { DRAW_VIEW, DRAW_PIXEL, DRAW_DEPTH, DRAW_COLOUR };

/* What the draws of a seed are for; other users of the same seed take other streams. */
#define STREAM UINT64_C(0x706f696e74730000)

static bool seen_by(const pags_camera *const *cameras, int64_t count, const double point[3], double nearest,
                    int64_t enough) {
  for (int64_t i = 0; i < count && enough > 0; i++)
    enough -= pags_camera_sees(cameras[i], point, nearest);
  return enough <= 0;
}

static void draw_point(const pags_camera *const *cameras, int64_t count, double distance, uint64_t seed, uint64_t draw,
                       double point[3]) {
  const pags_camera *camera = cameras[pags_rng_below(seed, STREAM + DRAW_VIEW, draw, (uint64_t)count)];
  const double *m = camera->world_from_camera;
  double pixel[2];
  pags_rng_uniform2(seed, STREAM + DRAW_PIXEL, draw, pixel);
  double z = pags_focus_depth(distance, pags_rng_uniform(seed, STREAM + DRAW_DEPTH, draw));
  double x = (pixel[0] * camera->width - camera->cx) / camera->fx * z;
  double y = (pixel[1] * camera->height - camera->cy) / camera->fy * z;
  for (int i = 0; i < 3; i++)
    point[i] = m[4 * i] * x + m[4 * i + 1] * y + m[4 * i + 2] * z + m[4 * i + 3];
}

pags_result pags_random_points(const pags_camera *const *cameras, int64_t camera_count, const double origin[3],
                               uint64_t seed, int64_t count, float *xyz, uint8_t *rgb) {
  assert(camera_count > 0 && count > 0);
  double distance;
  PAGS_TRY(pags_focus_distance(cameras, camera_count, &distance));
  /* Three views place a point; sets of fewer can't ask for more than they have. After enough misses any point will do:
   * views that overlap with nothing still need something to start from. */
  int64_t enough = camera_count < 3 ? camera_count : 3, misses = 0;
  uint64_t draw = 0;
  for (int64_t i = 0; i < count;) {
    double point[3];
    draw_point(cameras, camera_count, distance, seed, draw++, point);
    if (misses < 16 * count && !seen_by(cameras, camera_count, point, 0.2 * distance, enough)) {
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
