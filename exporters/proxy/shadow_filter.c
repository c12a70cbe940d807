/* SPDX-License-Identifier: Apache-2.0 */
/* Tells the pixels of a vehicle's depth view that show its shadow, the road or a kerb next to it from those that show
 * the vehicle, by darkness, height above the box's lower face, place in the box and surface slope. */
#include "exporters/proxy/depth_view.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/vec3.h"

/* Gaussians that move with a vehicle also show its shadow: seen from behind as a dark wall between the wheels, seen
 * from the side as a level dark surface on the ground. A pixel is shadow if its display-referred luminance is below
 * `dark`, it is lower than `wall_height` over the box's lower face and more than `wheels` inwards of the box's sides;
 * or if it is level and lower than `shadow` (dark pixels: `dark_shadow`). All but `dark` (0..1) in metres. */
static const double dark = 0.25, wall_height = 0.3, wheels = 0.35, shadow = 0.12, dark_shadow = 0.16;

/* Away from the wheels a car's body begins higher than `sill` (metres), so dark pixels below it are shadow, too. The
 * wheels lie between the shares `wheels_from` and `wheels_to` of the length from the middle; boxes longer than
 * `longest_car` are not cars. Within `margin` of the box's sides, a level surface lower than `footway` is a footway:
 * a box is as wide as the mirrors, so the kerb that a car is parked at lies in it. */
static const double sill = 0.25, wheels_from = 0.2, wheels_to = 0.4, longest_car = 6, footway = 0.3, margin = 0.2;

/* Whether the surface at a pixel, with the point `p`, is level (its normal within 45 degrees of z), by the points of
 * a neighbour to the side and one above or below. Returns -1 if one of them has no depth. */
static int is_level(const pags_depth_view *s, int x, int y, const double p[3]) {
  double n[3];
  const int side = x + 1 < s->camera.width ? x + 1 : x - 1, next = y + 1 < s->camera.height ? y + 1 : y - 1;
  return pags_depth_view_normal(s, x, y, side, next, p, n) ? fabs(n[2]) > 0.7 * pags_length3(n) : -1;
}

/* Whether a pixel shows shadow or ground instead of the vehicle, by the rules above. If its slope is unknown, it must
 * be lower than half of the limit for level surfaces. */
static bool is_shadow(const pags_depth_view *s, int x, int y, const double size[3]) {
  int64_t at = (int64_t)y * s->camera.width + x;
  double p[3], limit = shadow;
  pags_depth_view_point(s, x, y, (double)s->depth[at], p);
  double height = p[2] + 0.5 * size[2], along = fabs(p[0]) / size[0], inwards = 0.5 * size[1] - fabs(p[1]);
  const uint8_t *rgb = s->rgb + 3 * at;
  if (0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2] < 255 * dark) {
    if (height < wall_height && inwards > wheels)
      return true;
    if (height < sill && size[0] < longest_car && (along < wheels_from || along > wheels_to))
      return true;
    limit = dark_shadow;
  }
  if (inwards < margin)
    limit = footway;
  if (height > limit)
    return false;
  int level = is_level(s, x, y, p);
  return level < 0 ? height < 0.5 * limit : level;
}

pags_result pags_depth_view_filter_shadow(pags_depth_view *s, const double size[3]) {
  int64_t count = (int64_t)s->camera.width * s->camera.height;
  PAGS_AUTOFREE uint8_t *marked = calloc((size_t)count, 1);
  PAGS_CHECK_MEMORY(marked, "a view of %dx%d", s->camera.width, s->camera.height);
  for (int64_t i = 0; i < count; i++)
    marked[i] = s->depth[i] > 0 && is_shadow(s, (int)(i % s->camera.width), (int)(i / s->camera.width), size);
  for (int64_t i = 0; i < count; i++)
    if (marked[i]) {
      s->depth[i] = -s->depth[i];
      s->cover[i] = 0;
    }
  pags_depth_view_bound(s);
  return PAGS_OK;
}
