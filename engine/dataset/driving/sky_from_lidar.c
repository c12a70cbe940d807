/* SPDX-License-Identifier: Apache-2.0 */
/* Sky without masks: where the LiDAR would have met something.
 *
 * Directions from the camera are sorted by azimuth into bins of one degree, and each bin keeps the elevation of its
 * highest return. A pixel is sky when its direction is more than a degree above the horizon and MARGIN above the
 * highest return within two bins on either side. Two cases say nothing and are not called sky: no return at all in
 * those bins (the LiDAR didn't look there), and a highest return near the top of the LiDAR's field of view (whatever
 * stands there may go on above it; the upper beams of common LiDARs lie 3 to 4 degrees apart). That top is the highest
 * elevation among far returns, for which it doesn't matter where on the car the LiDAR sits. Thinned sweeps are made up
 * for by sweeps of other time steps, most things in the way of the sky being at rest. */
#include "dataset/driving/label_plane.h"
#include "dataset/driving/reader.h"

#include <math.h>
#include <stdlib.h>

enum { BINS = 360, REACH = 2 };

#define DEGREE (3.14159265358979323846 / 180)

static const double closest = 3; /* metres: nearer returns are the car's own or rain */
static const double far = 15;    /* metres: 1 m aside is 4 degrees */
static const double margin = 1.5 * DEGREE;
static const double horizon = 1 * DEGREE;
static const double ceiling_band = 5 * DEGREE;

/* Sweeps are taken until there are so many points, or so many sweeps. */
enum { ENOUGH_POINTS = 100000, MOST_SWEEPS = 24 };

typedef struct bins {
  double top[BINS]; /* highest elevation; -inf: no return */
  double ceiling;   /* highest elevation of a far return; -inf: none */
} bins;

static int bin_of(double x, double y) {
  int bin = (int)floor((atan2(y, x) / DEGREE + 180) * BINS / 360);
  return bin < 0 ? 0 : bin >= BINS ? BINS - 1 : bin;
}

/* The nearest sweep that is `rank` or more frames away; of training, unless it is the frame's own: what is held out
 * must not speak for other frames. Returns its distance in frames, -1: there is none. */
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

static pags_result gather(const pags_driving *driving, int frame, const pags_camera *camera, bins *b) {
  int64_t total = 0, index = -1;
  int distance = 0;
  for (int taken = 0; taken < MOST_SWEEPS && total < ENOUGH_POINTS; taken++) {
    int64_t count;
    float *xyz;
    distance = next_sweep(driving, frame, distance, index, &index);
    if (distance < 0)
      break;
    PAGS_TRY(pags_sweep_read(driving, index, &count, &xyz));

    /* Raise bins. */
    const double *m = driving->sweeps[index].world_from_sweep, *c = camera->world_from_camera;
    for (int64_t i = 0; i < count; i++) {
      double d[3];
      for (int k = 0; k < 3; k++) {
        const double *row = m + 4 * k;
        d[k] = row[0] * (double)xyz[3 * i] + row[1] * (double)xyz[3 * i + 1] + row[2] * (double)xyz[3 * i + 2] +
               row[3] - c[4 * k + 3];
      }
      double flat = hypot(d[0], d[1]), elevation = atan2(d[2], flat);
      int bin = bin_of(d[0], d[1]);
      if (flat > closest)
        b->top[bin] = fmax(b->top[bin], elevation);
      if (flat > far)
        b->ceiling = fmax(b->ceiling, elevation);
    }

    total += count;
    free(xyz);
  }
  return PAGS_OK;
}

pags_result pags_sky_from_lidar(const pags_driving *driving, int frame, const pags_camera *camera, int stride,
                                uint8_t *plane) {
  bins b = {.ceiling = -INFINITY};
  double limit[BINS];
  for (int i = 0; i < BINS; i++)
    b.top[i] = -INFINITY;
  PAGS_TRY(gather(driving, frame, camera, &b));

  /* The elevation above which a direction in this bin is sky; infinite where nothing can be said. */
  for (int i = 0; i < BINS; i++) {
    double highest = -INFINITY;
    for (int j = -REACH; j <= REACH; j++)
      highest = fmax(highest, b.top[(i + j + BINS) % BINS]);
    bool unknown = highest == -INFINITY || (highest > horizon && highest > b.ceiling - ceiling_band);
    limit[i] = unknown ? INFINITY : fmax(highest + margin, horizon);
  }

  /* Mark. */
  const double *c = camera->world_from_camera;
  for (int y = 0; y < camera->height; y++) {
    uint8_t *row = plane + (size_t)y * (size_t)stride;
    double v = (y + 0.5 - camera->cy) / camera->fy;
    for (int x = 0; x < camera->width; x++) {
      double u = (x + 0.5 - camera->cx) / camera->fx, d[3];
      for (int k = 0; k < 3; k++)
        d[k] = c[4 * k] * u + c[4 * k + 1] * v + c[4 * k + 2];
      if (d[2] > 0 && atan2(d[2], hypot(d[0], d[1])) > limit[bin_of(d[0], d[1])])
        row[x] |= PAGS_LABEL_SKY;
    }
  }

  return PAGS_OK;
}
