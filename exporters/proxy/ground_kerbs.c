/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the place of kerbs more finely than the ground's lattice: points across a border between a road and something
 * higher are classed by the pictures, and the border is put where fewest are on the wrong side. Kerbs are nearly
 * straight over a few metres: each place is moved onto the line of least squares through those around it, of which the
 * nearest weigh most (moving least squares, Lancaster and Salkauskas 1981). Where parked cars hide the kerb, these are
 * those before and behind. */
#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "exporters/proxy/ground_plan.h"

/* Points across; least number of either class; most points of neither between them; cells around a corner that tell its
 * sides, that it claims for them, and whose places make a line; least number of these. */
enum { SAMPLES = 33, LEAST_SAMPLES = 3, ROOM = 4, WINDOW = 3, CLAIMED = 3, ALONG = 50, LEAST_PLACES = 3 };

/* In metres. */
static const double least_step = 0.05;  /* height of a kerb */
static const double sample_step = 0.02; /* between points */
static const double local = 1;       /* places nearer than that count about alike; weights fall by the fourth power */
static const double parallel = 0.25; /* places spread over less hardly turn the line from the border's direction */
static const double strays[] = {0.7, 0.1}; /* farther from the corner, and from the first line, places don't count */
static const double alike = 0.8;           /* least cosine between normals of kerbs of one line */
static const double most_move = 0.12;      /* of a corner: cells stay in order */

/* What is found at a corner. */
typedef struct fit {
  double normal[2]; /* away from the road */
  double offset;    /* of the kerb along it; NaN: not found */
  uint8_t kind;     /* of the side that isn't road */
} fit;

/* The direction away from the road, and the mean heights of both sides; false if there is no kerb. */
static bool find_sides(const pags_ground_plan *p, int64_t corner, fit *f, double heights[2]) {
  const int64_t wide = p->nx + 1, x = corner % wide, y = corner / wide;
  int count[2] = {0}, beside[2] = {0};
  double sum[2] = {0}, length;
  *f = (fit){.offset = (double)NAN};
  for (int k = 0; k < 4; k++) { /* the four cells about the corner */
    const uint8_t kind = pags_ground_kind(p, x - k % 2, y - k / 2);
    if (kind != PAGS_GROUND_NONE)
      beside[kind != PAGS_GROUND_ROAD]++;
    if (kind != PAGS_GROUND_NONE && kind != PAGS_GROUND_ROAD)
      f->kind = kind;
  }
  if (!beside[0] || !beside[1])
    return false;
  for (int64_t v = y - WINDOW; v < y + WINDOW; v++)
    for (int64_t u = x - WINDOW; u < x + WINDOW; u++) {
      const uint8_t kind = pags_ground_kind(p, u, v);
      const int side = kind != PAGS_GROUND_ROAD;
      if (kind == PAGS_GROUND_NONE)
        continue;
      f->normal[0] += (side ? 1 : -1) * ((double)(u - x) + 0.5);
      f->normal[1] += (side ? 1 : -1) * ((double)(v - y) + 0.5);
      sum[side] += (double)p->z[v * p->nx + u];
      count[side]++;
    }
  length = sqrt(f->normal[0] * f->normal[0] + f->normal[1] * f->normal[1]);
  for (int k = 0; k < 2; k++) {
    f->normal[k] /= fmax(length, 1e-9);
    heights[k] = sum[k] / fmax(1, count[k]);
  }
  return heights[1] - heights[0] > least_step;
}

/* Finds the kerb by the classes of the points across it: the middle of the places with the fewest points of the wrong
 * class, if points of both classes leave little room for it. */
static void find_offset(const uint8_t classes[SAMPLES], fit *f) {
  int total[2] = {0}, least = SAMPLES + 1, first = 0, last = 0;
  for (int i = 0; i < SAMPLES; i++) {
    total[0] += classes[i] == PAGS_CHUNK_ROAD;
    total[1] += classes[i] == PAGS_CHUNK_SIDEWALK || classes[i] == PAGS_CHUNK_VEGETATION;
  }
  int wrong = total[0]; /* a kerb before the first point: all of the road is beyond it */
  for (int i = 0; i <= SAMPLES; i++) {
    if (wrong < least) {
      least = wrong;
      first = i;
    }
    last = wrong == least ? i : last;
    if (i < SAMPLES)
      wrong += classes[i] == PAGS_CHUNK_ROAD ? -1 : classes[i] != PAGS_CHUNK_OTHER;
  }
  if (total[0] >= LEAST_SAMPLES && total[1] >= LEAST_SAMPLES && last - first <= ROOM)
    f->offset = (0.5 * (first + last) - 0.5 * SAMPLES) * sample_step;
}

/* The offset of a corner's kerb on the line through the places of kerbs around it that run alike; NaN if there are too
 * few. */
static double smooth_offset(const pags_ground_plan *p, const fit *fits, int64_t corner) {
  const int64_t wide = p->nx + 1, x = corner % wide, y = corner / wide;
  const double *normal = fits[corner].normal;
  double at = 0, slope = 0;
  for (int round = 0; round < 2; round++) {
    double count = 0, n = 0, st = 0, so = 0, stt = 0, sto = 0;
    for (int64_t v = y > ALONG ? y - ALONG : 0; v <= y + ALONG && v <= p->ny; v++)
      for (int64_t u = x > ALONG ? x - ALONG : 0; u <= x + ALONG && u <= p->nx; u++) {
        const fit *f = &fits[v * wide + u];
        if (isnan(f->offset) || !(f->normal[0] * normal[0] + f->normal[1] * normal[1] > alike))
          continue;
        double d[2];
        for (int k = 0; k < 2; k++)
          d[k] = (double)p->corner[v * wide + u][k] + f->offset * f->normal[k] - (double)p->corner[corner][k];
        const double t = d[1] * normal[0] - d[0] * normal[1], o = d[0] * normal[0] + d[1] * normal[1];
        const double far = t / local, weight = 1 / (1 + far * far * far * far);
        if (fabs(o - at - slope * t) > strays[round])
          continue;
        count++;
        n += weight;
        st += weight * t;
        so += weight * o;
        stt += weight * t * t;
        sto += weight * t * o;
      }
    if (count < LEAST_PLACES)
      return (double)NAN;
    const double spread = n * stt - st * st + n * n * parallel * parallel;
    slope = (n * sto - st * so) / spread;
    at = (so - slope * st) / n;
  }
  return at;
}

/* Lets a kerb claim the cells around its corner for its sides. */
static void claim(const pags_ground_plan *p, int64_t corner, const fit *f, int32_t *votes, uint8_t *kinds) {
  const int64_t wide = p->nx + 1, x = corner % wide, y = corner / wide;
  for (int64_t v = y - CLAIMED; v < y + CLAIMED; v++)
    for (int64_t u = x - CLAIMED; u < x + CLAIMED; u++) {
      const double off = ((double)(u - x) + 0.5) * f->normal[0] + ((double)(v - y) + 0.5) * f->normal[1];
      if (pags_ground_kind(p, u, v) == PAGS_GROUND_NONE)
        continue;
      votes[v * p->nx + u] += off * p->ground->step > f->offset ? 1 : -1;
      kinds[v * p->nx + u] = f->kind;
    }
}

pags_result pags_ground_kerbs_fit(const pags_proxy_maker *w, const pags_background *b, bool move, pags_ground_plan *p) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  const int64_t cells = p->nx * p->ny, corners = (p->nx + 1) * (p->ny + 1);
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh points = {0};
  double heights[2];
  fit f;
  for (int64_t i = 0; i < corners; i++) /* points across the border, at the height of the kerb's foot */
    for (int s = 0; s < SAMPLES && find_sides(p, i, &f, heights); s++) {
      const double off = (s - 0.5 * (SAMPLES - 1)) * sample_step;
      const float at[3] = {p->corner[i][0] + (float)(off * f.normal[0]), p->corner[i][1] + (float)(off * f.normal[1]),
                           (float)heights[0]};
      pags_proxy_mesh_vertex(&points, at, grey, 1);
    }
  PAGS_TRY(pags_proxy_mesh_check(&points));
  PAGS_AUTOFREE uint8_t *classes = malloc((size_t)points.vertex_count + 1);
  PAGS_AUTOFREE int32_t *votes = calloc((size_t)cells, sizeof *votes);
  PAGS_AUTOFREE uint8_t *kinds = calloc((size_t)cells, 1);
  PAGS_AUTOFREE fit *fits = malloc((size_t)corners * sizeof *fits);
  PAGS_AUTOFREE double *smooth = malloc((size_t)corners * sizeof *smooth);
  PAGS_CHECK_MEMORY(classes && votes && kinds && fits && smooth, "%lld cells", (long long)cells);
  PAGS_TRY(pags_classes_find(w, &b->depth_views, true, &points, classes));
  const uint8_t *own = classes;
  for (int64_t i = 0; i < corners; i++) {
    smooth[i] = (double)NAN;
    if (find_sides(p, i, &fits[i], heights)) {
      find_offset(own, &fits[i]);
      own += SAMPLES;
      smooth[i] = 0;
    }
  }
  for (int64_t i = 0; i < corners; i++)
    if (!isnan(smooth[i]))
      smooth[i] = smooth_offset(p, fits, i);
  for (int64_t i = 0; i < corners; i++) {
    fits[i].offset = smooth[i];
    if (isnan(fits[i].offset))
      continue;
    if (!move)
      claim(p, i, &fits[i], votes, kinds);
    for (int k = 0; k < 2 && move; k++)
      p->corner[i][k] += (float)(fits[i].normal[k] * fmin(fmax(fits[i].offset, -most_move), most_move));
    p->fixed[i] = move;
  }
  for (int64_t i = 0; i < cells; i++)
    if (votes[i])
      p->kind[i] = votes[i] < 0 ? PAGS_GROUND_ROAD : p->kind[i] == PAGS_GROUND_ROAD ? kinds[i] : p->kind[i];
  return PAGS_OK;
}
