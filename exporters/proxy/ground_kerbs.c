/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the place of kerbs more finely than the ground's lattice: points across a border between a road and something
 * higher are classed by the pictures, and the border is put where fewest are on the wrong side. */
#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "exporters/proxy/ground_plan.h"

enum { SAMPLES = 17, LEAST_SAMPLES = 3, WINDOW = 3 }; /* points across; of either class; cells around a corner */

/* In metres. */
static const double least_step = 0.05;  /* height of a kerb */
static const double sample_step = 0.04; /* between points */
static const double most_move = 0.12;   /* of a corner: cells stay in order */

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
 * class. */
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
  if (total[0] >= LEAST_SAMPLES && total[1] >= LEAST_SAMPLES && total[0] + total[1] > SAMPLES - LEAST_SAMPLES)
    f->offset = (0.5 * (first + last) - 0.5 * SAMPLES) * sample_step;
}

/* Lets a kerb claim the cells around its corner for its sides. */
static void claim(const pags_ground_plan *p, int64_t corner, const fit *f, int32_t *votes, uint8_t *kinds) {
  const int64_t wide = p->nx + 1, x = corner % wide, y = corner / wide;
  for (int64_t v = y - 2; v < y + 2; v++)
    for (int64_t u = x - 2; u < x + 2; u++) {
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
  PAGS_CHECK_MEMORY(classes && votes && kinds, "%lld cells", (long long)cells);
  PAGS_TRY(pags_classes_find(w, &b->depth_views, true, &points, classes));
  const uint8_t *own = classes;
  for (int64_t i = 0; i < corners; i++) {
    if (!find_sides(p, i, &f, heights))
      continue;
    find_offset(own, &f);
    own += SAMPLES;
    if (isnan(f.offset))
      continue;
    if (!move)
      claim(p, i, &f, votes, kinds);
    for (int k = 0; k < 2 && move; k++)
      p->corner[i][k] += (float)(f.normal[k] * fmin(fmax(f.offset, -most_move), most_move));
    p->fixed[i] = move;
  }
  for (int64_t i = 0; i < cells; i++)
    if (votes[i])
      p->kind[i] = votes[i] < 0 ? PAGS_GROUND_ROAD : p->kind[i] == PAGS_GROUND_ROAD ? kinds[i] : p->kind[i];
  return PAGS_OK;
}
