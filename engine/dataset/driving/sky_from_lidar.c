/* SPDX-License-Identifier: Apache-2.0 */
/* Labels sky pixels of a set without sky masks, from the directions in which the LiDAR had no return.
 *
 * Points are sorted by their azimuth from the camera into bins of one degree, and each bin keeps the highest
 * elevation of its returns. A pixel is sky if its direction is more than one degree above the horizon and more than
 * `margin` above the highest return within two bins on either side. Two cases are unknown and are not labelled sky, but
 * as unknown: bins without any return (the LiDAR didn't scan there), and a highest return near the top of the LiDAR's
 * field of view, because the object there may extend above it (the upper beams of common LiDARs have 3 to 4 degrees
 * between them). The top of the field of view is the highest elevation among far returns, for which the LiDAR's
 * position on the car doesn't matter. If a sweep has few points, sweeps of other time steps are added, since most
 * things that hide the sky are static. */
#include "dataset/driving/label_plane.h"
#include "dataset/driving/reader.h"

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

#include <math.h>
#include <stdlib.h>

/* Bins of azimuth; bins on either side that a direction is compared with. */
enum { BINS = 360, REACH = 2 };

#define DEGREE (3.14159265358979323846 / 180)

static const double closest = 3; /* metres: nearer returns are the car itself or rain and are ignored */
static const double far = 15;    /* metres: farther returns are far; an offset of 1 m is at most 4 degrees there */
/* Least elevation above the highest return, above the horizon, and width of the unknown zone at the top. */
static const double margin = 1.5 * DEGREE;
static const double horizon = 1 * DEGREE;
static const double ceiling_band = 5 * DEGREE;

/* Sweeps are added until they have this many points together, or until there are this many sweeps. */
enum { ENOUGH_POINTS = 100000, MOST_SWEEPS = 24 };

typedef struct bins {
  double top[BINS]; /* highest elevation, radians, of the LiDAR returns in the azimuth bin; -inf: no return */
  double ceiling;   /* highest elevation, radians, of a far return; -inf: none */
} bins;

static int bin_of(double x, double y) {
  int bin = (int)floor((pags_atan2(y, x) / DEGREE + 180) * BINS / 360);
  return bin < 0 ? 0 : bin >= BINS ? BINS - 1 : bin;
}

/* Finds the sweep nearest to `frame` that is `rank` or more frames away; among sweeps at distance `rank` only those
 * with an index above `after`. A sweep of a held-out time step is used for its own frame only, because held-out data
 * must not influence other frames. Returns the distance in frames, -1 if there is no such sweep. */
static int next_sweep(const pags_driving *driving, int frame, int rank, int64_t after, int64_t *index) {
  int best = -1;
  for (int64_t i = 0; i < driving->sweep_count; i++) {
    const pags_sweep *sweep = &driving->sweeps[i];
    int distance = abs(sweep->frame - frame);
    if ((sweep->test && distance > 0) || distance < rank || (distance == rank && i <= after))
      continue;
    if (best < 0 || distance < best) {
      best = distance;
      *index = i;
    }
  }
  return best;
}

/* Fills the bins from the sweeps nearest in time, as seen from the camera. */
static pags_result gather(const pags_driving *driving, int frame, const pags_camera *camera, bins *b) {
  int64_t total = 0, index = -1;
  int distance = 0;
  for (int taken = 0; taken < MOST_SWEEPS && total < ENOUGH_POINTS; taken++) {
    int64_t count;
    PAGS_AUTOFREE float *xyz = NULL;
    distance = next_sweep(driving, frame, distance, index, &index);
    if (distance < 0)
      break;
    PAGS_TRY(pags_sweep_read(driving, index, &count, &xyz, NULL));

    const double *m = driving->sweeps[index].world_from_sweep, *c = camera->world_from_camera;
    double eye[3], p[3], d[3];
    pags_pose_position(c, eye);
    for (int64_t i = 0; i < count; i++) {
      pags_widen3(xyz + 3 * i, p);
      pags_rigid_point(m, p, d);
      pags_subtract3(d, eye, d);
      double flat = pags_hypot(d[0], d[1]), elevation = pags_atan2(d[2], flat);
      int bin = bin_of(d[0], d[1]);
      if (flat > closest)
        b->top[bin] = fmax(b->top[bin], elevation);
      if (flat > far)
        b->ceiling = fmax(b->ceiling, elevation);
    }

    total += count;
  }
  return PAGS_OK;
}

pags_result pags_sky_from_lidar(const pags_driving *driving, int frame, const pags_camera *camera,
                                const pags_pixel_rays *rays, int stride, uint8_t *plane) {
  bins b = {.ceiling = -INFINITY};
  double limit[BINS];
  for (int i = 0; i < BINS; i++)
    b.top[i] = -INFINITY;
  PAGS_TRY(gather(driving, frame, camera, &b));

  /* limit[i]: the elevation above which a direction in bin i is sky; infinite where it is unknown. */
  for (int i = 0; i < BINS; i++) {
    double highest = -INFINITY;
    for (int j = -REACH; j <= REACH; j++)
      highest = fmax(highest, b.top[(i + j + BINS) % BINS]);
    bool unknown = highest == -INFINITY || (highest > horizon && highest > b.ceiling - ceiling_band);
    limit[i] = unknown ? INFINITY : fmax(highest + margin, horizon);
  }

  const double *c = camera->world_from_camera;
  for (int y = 0; y < camera->height; y++) {
    uint8_t *row = plane + (size_t)y * (size_t)stride;
    double v = (y + 0.5 - camera->cy) / camera->fy;
    for (int x = 0; x < camera->width; x++) {
      double u = (x + 0.5 - camera->cx) / camera->fx, d[3];
      const float *const ray =
          rays->direction ? rays->direction + 3 * ((size_t)y * (size_t)rays->width + (size_t)x) : NULL;
      for (int k = 0; k < 3; k++)
        d[k] = ray ? c[4 * k] * (double)ray[0] + c[4 * k + 1] * (double)ray[1] + c[4 * k + 2] * (double)ray[2]
                   : c[4 * k] * u + c[4 * k + 1] * v + c[4 * k + 2];
      if (d[2] <= 0)
        continue;
      const double elevation = pags_atan2(d[2], pags_hypot(d[0], d[1]));
      const int bin = bin_of(d[0], d[1]);
      if (elevation > limit[bin])
        row[x] |= PAGS_LABEL_SKY;
      else if (limit[bin] == INFINITY && elevation > fmax(b.top[bin], horizon))
        row[x] |= PAGS_LABEL_SKY_UNKNOWN;
    }
  }

  return PAGS_OK;
}
