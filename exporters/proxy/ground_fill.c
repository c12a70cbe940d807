/* SPDX-License-Identifier: Apache-2.0 */
/* Fills the holes of the ground near the path, and smooths it.
 *
 * An elastic membrane over the lattice follows the measured heights. It is stiff along the path and soft across it,
 * since kerbs and ruts run along roads: ground that parked cars hide continues the ground before and behind them. Gaps
 * between ground and holes that ground surrounds are filled, too, if they are small: in what the cameras saw farther
 * off. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "exporters/proxy/ground.h"

#include "base/memory.h"
#include "maths/maths.h"

/* Iterations over all cells; neighbours of a cell; most cells of a gap, 5 m, and of a hole, 100 square metres, that
 * are filled wherever they are: what a car and a lorry hide. */
enum { SWEEPS = 300, NEIGHBOURS = 8, GAP = 25, HOLE = 2500 };
static const int dx[NEIGHBOURS] = {1, -1, 0, 0, 1, -1, 1, -1}, dy[NEIGHBOURS] = {0, 0, 1, -1, 1, -1, -1, 1};
static const double bend = 8;      /* radius, in metres, in which the path's direction at a place is estimated */
static const double across = 0.01; /* stiffness across the path, as a share of the stiffness along it */

/* The membrane's stiffness from a cell towards each of its eight neighbours. */
typedef struct stiffness {
  double towards[NEIGHBOURS];
} stiffness;

/* The stiffness at position `i` of the path, by the principal axis of the positions around it; the same towards the
 * four nearest neighbours if these positions have no direction. */
static stiffness stiffness_at(const double *path, int64_t count, int64_t i) {
  double n = 0, sx = 0, sy = 0, xx = 0, xy = 0, yy = 0, sum = 0;
  stiffness out = {{1, 1, 1, 1}};
  for (int64_t j = 0; j < count; j++) {
    double x = path[3 * j] - path[3 * i], y = path[3 * j + 1] - path[3 * i + 1];
    if (x * x + y * y > bend * bend)
      continue;
    n++;
    sx += x;
    sy += y;
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  xx = xx / n - sx * sx / n / n;
  xy = xy / n - sx * sy / n / n;
  yy = yy / n - sy * sy / n / n;
  if (xx + yy < 1)
    return out;
  double angle = 0.5 * pags_atan2(2 * xy, xx - yy), c = pags_cos(angle), s = pags_sin(angle);
  for (int d = 0; d < NEIGHBOURS; d++) {
    double along = (dx[d] * c + dy[d] * s) / pags_hypot(dx[d], dy[d]);
    out.towards[d] = across + pags_pow(along, 16);
    sum += out.towards[d];
  }
  for (int d = 0; d < NEIGHBOURS; d++)
    out.towards[d] *= 4 / sum;
  return out;
}

int64_t pags_ground_cell(const pags_ground *g, double x, double y) {
  const double i = floor((x - g->x0) / g->step + 0.5), j = floor((y - g->y0) / g->step + 0.5);
  return i >= 0 && j >= 0 && i < g->nx && j < g->ny ? (int64_t)j * g->nx + (int64_t)i : -1;
}

static bool inside(const pags_ground *g, int64_t x, int64_t y) {
  return x >= 0 && y >= 0 && x < g->nx && y < g->ny;
}

/* The neighbour of a cell in one of the eight directions; -1 outside of the lattice. */
static int64_t neighbour(const pags_ground *g, int64_t cell, int direction) {
  const int64_t x = cell % g->nx + dx[direction], y = cell / g->nx + dy[direction];
  return inside(g, x, y) ? y * g->nx + x : -1;
}

/* Finds for each cell the nearest position of the path, by a breadth-first search over the lattice. */
static void find_owners(const pags_ground *g, const double *path, int64_t count, int32_t *owner, int64_t *queue) {
  int64_t last = 0, cells = (int64_t)g->nx * g->ny;
  for (int64_t i = 0; i < cells; i++)
    owner[i] = -1;
  for (int64_t i = 0; i < count; i++) {
    const int64_t at = pags_ground_cell(g, path[3 * i], path[3 * i + 1]);
    if (at < 0 || owner[at] >= 0)
      continue;
    owner[at] = (int32_t)i;
    queue[last++] = at;
  }
  for (int64_t head = 0; head < last; head++)
    for (int d = 0; d < 4; d++) {
      const int64_t at = neighbour(g, queue[head], d);
      if (at < 0 || owner[at] >= 0)
        continue;
      owner[at] = owner[queue[head]];
      queue[last++] = at;
    }
}

/* Marks the cells without ground between others, at most GAP cells along x or y, as to be filled. */
static void mark_gaps(pags_ground *g) {
  const int64_t n[2] = {g->nx, g->ny}, step[2] = {1, g->nx};
  for (int axis = 0; axis < 2; axis++)
    for (int64_t line = 0; line < n[!axis]; line++)
      for (int64_t i = 0, last = -1; i < n[axis]; i++) {
        uint8_t *at = g->known + line * step[!axis] + i * step[axis];
        if (!*at)
          continue;
        for (int64_t k = 1; last >= 0 && i - last - 1 <= GAP && k < i - last; k++)
          at[-k * step[axis]] = PAGS_GROUND_WANTED;
        last = i;
      }
}

/* Marks the cells without ground that ground surrounds, in holes of at most HOLE cells, as to be filled. `queue` has
 * room for all cells. */
static void mark_holes(pags_ground *g, int64_t *queue) {
  const int64_t cells = (int64_t)g->nx * g->ny;
  for (int64_t i = 0; i < cells; i++) {
    int64_t count = 0;
    bool open = false;
    if (g->known[i])
      continue;
    g->known[i] = PAGS_GROUND_HOLE;
    queue[count++] = i;
    for (int64_t head = 0; head < count; head++)
      for (int d = 0; d < 4; d++) {
        const int64_t at = neighbour(g, queue[head], d);
        open = open || at < 0;
        if (at < 0 || g->known[at])
          continue;
        g->known[at] = PAGS_GROUND_HOLE;
        queue[count++] = at;
      }
    for (int64_t k = 0; k < count && !open && count <= HOLE; k++)
      g->known[queue[k]] = PAGS_GROUND_WANTED;
  }
  for (int64_t i = 0; i < cells; i++)
    if (g->known[i] == PAGS_GROUND_HOLE)
      g->known[i] = 0;
}

/* Makes all cells within `reach` metres of the path, those wanted and small holes ground. New cells start at the height
 * of the nearest known cell. */
static void extend(pags_ground *g, const double *path, int64_t path_count, double reach, int64_t *queue) {
  int64_t count = 0, cells = (int64_t)g->nx * g->ny, radius = (int64_t)ceil(reach / g->step);
  for (int64_t i = 0; i < path_count; i++) {
    int64_t x = (int64_t)floor((path[3 * i] - g->x0) / g->step + 0.5),
            y = (int64_t)floor((path[3 * i + 1] - g->y0) / g->step + 0.5);
    for (int64_t j = -radius; j <= radius; j++)
      for (int64_t k = -radius; k <= radius; k++)
        if (k * k + j * j <= radius * radius && inside(g, x + k, y + j) && !g->known[(y + j) * g->nx + x + k])
          g->known[(y + j) * g->nx + x + k] = PAGS_GROUND_WANTED;
  }
  mark_gaps(g);
  mark_holes(g, queue);
  for (int64_t i = 0; i < cells; i++)
    if (g->known[i] == 1)
      queue[count++] = i;
  for (int64_t head = 0; head < count; head++)
    for (int d = 0; d < 4; d++) {
      const int64_t at = neighbour(g, queue[head], d);
      if (at < 0 || g->known[at] != PAGS_GROUND_WANTED)
        continue;
      g->known[at] = 2;
      g->z[at] = g->z[queue[head]];
      queue[count++] = at;
    }
  for (int64_t i = 0; i < cells; i++)
    if (g->known[i] == PAGS_GROUND_WANTED)
      g->known[i] = 0; /* not connected to any known ground */
}

/* Minimises, by successive over-relaxation, the membrane's energy
 *     sum over cells of w (z - measured)^2 + sum over neighbours of s (z - z')^2
 * with the weights w of measured cells and the stiffness s. */
static void relax(pags_ground *g, const float *weights, const float *measured, const int32_t *owner,
                  const stiffness *stiff) {
  for (int sweep = 0; sweep < SWEEPS; sweep++)
    for (int64_t y = 0, i = 0; y < g->ny; y++)
      for (int64_t x = 0; x < g->nx; x++, i++) {
        if (!g->known[i])
          continue;
        const stiffness *s = &stiff[owner[i] < 0 ? 0 : owner[i]];
        double w = g->known[i] == 1 ? (double)weights[i] : 0, sum = w * (double)measured[i];
        for (int d = 0; d < NEIGHBOURS; d++) {
          const int64_t at = i + (int64_t)dy[d] * g->nx + dx[d];
          if (s->towards[d] > 0 && inside(g, x + dx[d], y + dy[d]) && g->known[at]) {
            sum += s->towards[d] * (double)g->z[at];
            w += s->towards[d];
          }
        }
        if (w > 0)
          g->z[i] += (float)(1.6 * (sum / w - (double)g->z[i]));
      }
}

void pags_ground_spread(const pags_ground *g, float *nearest, int64_t *queue) {
  int64_t count = 0;
  for (int64_t i = 0; i < (int64_t)g->nx * g->ny; i++) {
    nearest[i] = g->known[i] ? g->z[i] : (float)NAN;
    if (g->known[i])
      queue[count++] = i;
  }
  for (int64_t head = 0; head < count; head++)
    for (int d = 0; d < 4; d++) {
      const int64_t at = neighbour(g, queue[head], d);
      if (at < 0 || !isnan(nearest[at]))
        continue;
      nearest[at] = nearest[queue[head]];
      queue[count++] = at;
    }
}

pags_result pags_ground_fill(pags_ground *ground, const float *weights, const double *path, int64_t path_count,
                             double reach) {
  const size_t cells = (size_t)((int64_t)ground->nx * ground->ny);
  PAGS_AUTOFREE int64_t *queue = malloc((cells + 1) * sizeof *queue);
  PAGS_AUTOFREE int32_t *owner = malloc((cells + 1) * sizeof *owner);
  PAGS_AUTOFREE float *measured = malloc((cells + 1) * sizeof *measured);
  PAGS_AUTOFREE stiffness *stiff = malloc(((size_t)path_count + 1) * sizeof *stiff);
  PAGS_CHECK_MEMORY(queue && owner && measured && stiff, "the ground's %zu cells", cells);
  extend(ground, path, path_count, reach, queue);
  find_owners(ground, path, path_count, owner, queue);
  for (int64_t i = 0; i < path_count; i++)
    stiff[i] = stiffness_at(path, path_count, i);
  memcpy(measured, ground->z, cells * sizeof *measured);
  relax(ground, weights, measured, owner, stiff);
  ground->nearest = malloc(cells * sizeof *ground->nearest);
  PAGS_CHECK_MEMORY(ground->nearest, "the ground's %zu cells", cells);
  pags_ground_spread(ground, ground->nearest, queue);
  return PAGS_OK;
}
