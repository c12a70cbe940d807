/* SPDX-License-Identifier: Apache-2.0 */
/* Which clusters a lens sees. The means of a cluster lie in a ball, of radius r about a point at the distance d > r,
 * and so within the angle a = asin(r / d) of the direction to its middle, of angle c from the axis. Means beyond the
 * angle `farthest` aren't drawn, so that nothing is where c - a is larger. Else let L be the largest derivative of a
 * pixel by a direction up to the angle c + a, beyond which the great circle from the middle to a mean nowhere goes:
 *
 *   |pixel of the mean - pixel of the middle| <= L a
 *   extent = sqrt(reach_max (s^2 |J|^2 + low_pass)),  |J| <= L / (d - r)
 *
 * For a lens that clamps, |J| <= L / (least z), since a clamped direction is nearer to the axis and as far along it.
 *
 * With a rolling shutter the box holds the means at every time that their line may be read (cull.c). The shear of
 * simd/scan.h lengthens by at most 1 + |m'| (x, y) / q per component of m', with |m'| <= |J| |velocity| and at most a
 * pixel a line. */
#include <math.h>

#include "base/vec3.h"
#include "frame/lens_view.h"
#include "maths/maths.h"

typedef struct ball {
  double middle[3], distance, radius;
} ball;

/* The angle whose sine is `ratio` < 1. */
static double angle_of_sine(double ratio) {
  return pags_atan2(ratio, sqrt((1 - ratio) * (1 + ratio)));
}

/* The factor by which the shear of a rolling shutter lengthens Gaussians at most; slope: the most of |J|. */
static double shear_bound(const pags_projection *v, const float speed[3], double slope) {
  if (!v->scan)
    return 1;
  const double lines = fabs((double)v->scan->x) + fabs((double)v->scan->y),
               most = 1.0001 * (double)PAGS_SCAN_MOST / lines;
  const double velocity[3] = {(double)speed[0], (double)speed[1], (double)speed[2]};
  const double drift = fmin(most, slope * pags_length3(velocity));
  return 1.0001 * (1 + drift * lines / fmax((double)PAGS_SCAN_LEAST, 1 - lines * drift));
}

/* Whether a Gaussian may reach over the seam, the half plane X = 0, Z < 0. A mean at the horizontal distance h has the
 * extent sqrt(reach_max (s^2 (fx / h)^2 + low_pass)) along the longitude. */
static bool meets_seam(const struct frame_lens *l, const pags_projection *v, ball b, const float speed[3], float sigma,
                       float reach_max) {
  const double flat = sqrt(b.middle[0] * b.middle[0] + b.middle[2] * b.middle[2]);
  if (!(flat > 1.001 * b.radius))
    return true;
  const double slope = fmax(l->camera.fx, l->camera.fy) / (flat - b.radius),
               size = (double)sigma * slope * shear_bound(v, speed, slope);
  const double extent = sqrt((double)reach_max * (size * size + (double)v->low_pass));
  const double longitude = fabs(pags_atan2(b.middle[0], b.middle[2])) + angle_of_sine(b.radius / flat);
  return 1.0001 * (l->camera.fx * longitude + extent) + 1 >= 0.5 * (double)l->table.turn;
}

/* As lens_blocks; returns whether all of it lies outside of the picture. */
static bool find_blocks(double middle, double aside, float size, uint16_t *first, uint16_t *end) {
  lens_blocks(middle, aside, (double)size, first, end);
  return middle + aside <= 0 || middle - aside >= (double)size;
}

bool pags_frame_lens_misses(const struct frame_lens *l, const pags_projection *v, const float lo[3], const float hi[3],
                            const float speed[3], float sigma, float reach_max, cluster_bound *bound) {
  ball b;
  double half[3];
  for (int k = 0; k < 3; k++) {
    half[k] = 0.5 * ((double)hi[k] - (double)lo[k]);
    b.middle[k] = 0.5 * ((double)lo[k] + (double)hi[k]);
  }
  b.distance = pags_length3(b.middle);
  b.radius = 1.000001 * pags_length3(half) + 1e-6 * b.distance;
  const double nearest = fmax(b.distance - b.radius, (double)v->near_plane);
  bound->near = (float)(0.999999 * nearest);
  bound->seam = l->sphere && meets_seam(l, v, b, speed, sigma, reach_max);
  find_blocks(0, INFINITY, v->width, &bound->reach.x0, &bound->reach.x1);
  find_blocks(0, INFINITY, v->height, &bound->reach.y0, &bound->reach.y1);
  if (b.distance + b.radius <= (double)v->near_plane)
    return true;
  if (l->sphere || !(b.distance > b.radius)) /* also where it isn't a number */
    return false;
  const double off = pags_lens_angle(b.middle), within = angle_of_sine(b.radius / b.distance);
  if (off - within > l->farthest + 1e-6)
    return true;
  const double step = ceil((off + within) / l->farthest * LENS_STEPS);
  if (!(step <= LENS_STEPS) || (l->table.clamps && !(lo[2] > 0.0f)))
    return false;
  double at[2];
  pags_frame_lens_see(l, b.middle, at, NULL);
  const double most = (double)l->reach[(int)step],
               slope = most / (l->table.clamps ? (double)lo[2] : b.distance - b.radius);
  const double size = (double)sigma * slope * shear_bound(v, speed, slope);
  const double extent = sqrt((double)reach_max * (size * size + (double)v->low_pass)),
               aside = 1.0001 * (most * within + extent) + 1e-3 + 1e-6 * fabs(at[0]) + 1e-6 * fabs(at[1]);
  const bool beside = find_blocks(at[0], aside, v->width, &bound->reach.x0, &bound->reach.x1);
  return find_blocks(at[1], aside, v->height, &bound->reach.y0, &bound->reach.y1) || beside;
}
