/* SPDX-License-Identifier: Apache-2.0 */
/* Fits planes to LiDAR points, pulls Gaussians onto them and lays Gaussians into them; see lidar_planes.h.
 *
 * Points are sorted into cubic cells of four sizes. In each cell a plane is fitted by least squares: its normal is
 * the eigenvector of the smallest eigenvalue of the points' covariance. If the points lie within the LiDAR's noise of
 * it, the cell has a plane; else the cell is remembered as rough, so that Gaussians in it are not pulled to the plane
 * of a larger cell either. Pulling goes by the smallest cells that have a plane, which follow relief; laying by the
 * largest, whose normals are the mean of the most points: a Gaussian that is flat must not be askew. */
#include "init/lidar_planes.h"

#include <math.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "maths/maths.h"

enum { LEVELS = 4, PULL_LEVELS = 3, MOST_POINTS = 2000000, LEAST_POINTS = 10, GRAIN = 4096, CELL_BITS = 20 };

static const double finest = 0.4; /* side of the smallest cells, metres; the others are 2, 4 and 8 times it */
static const double thickest =
    0.04; /* largest standard deviation across a plane, metres: noise of LiDAR and poses, a little relief */
static const double narrowest =
    0.1; /* smallest standard deviation along its second axis, in cell sides: points on a line have no plane */
static const double widest = 0.75;    /* reach of a plane from its centre, along the plane, in cell sides */
static const double farthest = 0.3;   /* reach of a plane across it, metres */
static const double nearest = 0.03;   /* Gaussians nearer than this stay: the planes are not known better, metres */
static const double close = 0.1;      /* reach of a plane that Gaussians are laid into, across it, metres */
static const double level_at = 0.9;   /* cosine of the steepest slope of such a plane; z is up */
static const double thinnest = 0.005; /* sigma across a plane to which laying makes Gaussians flat, metres */

/* ---- Cells and their hash table ---- */

static uint64_t key_of(const int64_t cell[3], int level) {
  uint64_t key = (uint64_t)level;
  for (int k = 0; k < 3; k++)
    key = key << CELL_BITS | ((uint64_t)(cell[k] + (1 << (CELL_BITS - 1))) & ((1u << CELL_BITS) - 1));
  return key;
}

static void cell_of(const float p[3], double side, int64_t cell[3]) {
  const double most = (1 << (CELL_BITS - 1)) - 2;
  for (int k = 0; k < 3; k++)
    cell[k] = (int64_t)fmax(-most, fmin(most, floor((double)p[k] / side)));
}

static uint64_t hash_of(uint64_t key) {
  key ^= key >> 31;
  key *= 0x9e3779b97f4a7c15u;
  key ^= key >> 29;
  key *= 0xd6e8feb86659fd93u;
  return key ^ key >> 32;
}

/* The slot of the table that holds the plane with this key, or the free one where it belongs. Keys are unique. */
static int32_t *slot_of(const pags_lidar_planes *planes, uint64_t key) {
  uint64_t at = hash_of(key) & planes->mask;
  while (planes->table[at] >= 0 && planes->list[planes->table[at]].key != key)
    at = (at + 1) & planes->mask;
  return &planes->table[at];
}

/* ---- Fitting planes ---- */

typedef struct keyed {
  uint64_t key;
  int64_t row;
} keyed;

static int by_key(const void *a, const void *b) {
  const keyed *x = a, *y = b;
  if (x->key != y->key)
    return x->key < y->key ? -1 : 1;
  return x->row < y->row ? -1 : x->row > y->row;
}

static pags_lidar_plane fit(const pags_lidar_points *points, const keyed *run, int64_t count, double side) {
  double mean[3], a[3][3], v[3][3];
  pags_lidar_plane plane = {.key = run->key};

  /* Mean and covariance of the cell's points. */
  memset(a, 0, sizeof a);
  for (int k = 0; k < 3; k++) {
    mean[k] = 0;
    for (int64_t i = 0; i < count; i++)
      mean[k] += (double)points->rows[run[i].row].p[k] / (double)count;
  }
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 9; k++)
      a[k / 3][k % 3] += ((double)points->rows[run[i].row].p[k / 3] - mean[k / 3]) *
                         ((double)points->rows[run[i].row].p[k % 3] - mean[k % 3]) / (double)count;

  /* Jacobi's eigenvalue iteration: rotations make `a` diagonal, and the columns of `v` become the eigenvectors (Golub
   * and Van Loan, Matrix Computations, 8.5). */
  for (int i = 0; i < 9; i++)
    v[i / 3][i % 3] = i / 3 == i % 3;
  for (int sweep = 0; sweep < 12; sweep++)
    for (int p = 0; p < 2; p++)
      for (int q = p + 1; q < 3; q++) {
        if (fabs(a[p][q]) < 1e-300)
          continue;
        double tau = (a[q][q] - a[p][p]) / (2 * a[p][q]);
        double t = (tau >= 0 ? 1 : -1) / (fabs(tau) + sqrt(1 + tau * tau)), c = 1 / sqrt(1 + t * t), s = t * c;
        for (int k = 0; k < 3; k++) {
          double x = a[k][p], y = a[k][q];
          a[k][p] = c * x - s * y;
          a[k][q] = s * x + c * y;
        }
        for (int k = 0; k < 3; k++) {
          double x = a[p][k], y = a[q][k];
          a[p][k] = c * x - s * y;
          a[q][k] = s * x + c * y;
          x = v[k][p];
          y = v[k][q];
          v[k][p] = c * x - s * y;
          v[k][q] = s * x + c * y;
        }
      }

  int least = 0, most = 0;
  for (int k = 1; k < 3; k++) {
    least = a[k][k] < a[least][least] ? k : least;
    most = a[k][k] >= a[most][most] ? k : most;
  }
  double second = a[0][0] + a[1][1] + a[2][2] - a[least][least] - a[most][most];
  const bool flat = a[least][least] <= thickest * thickest && second >= narrowest * narrowest * side * side;
  pags_narrow3(mean, plane.centre);
  for (int k = 0; k < 3; k++)
    plane.normal[k] = flat ? (float)v[k][least] : 0.0f;
  return plane;
}

pags_result pags_lidar_planes_fit(const pags_lidar_points *points, pags_lidar_planes *out) {
  PAGS_AUTO(pags_lidar_planes_destroy) pags_lidar_planes planes = {0};
  const size_t room = (size_t)(points->count > 0 ? points->count : 1);
  *out = (pags_lidar_planes){0};
  PAGS_AUTOFREE keyed *keys = malloc(room * sizeof *keys);
  planes.list = malloc((room / LEAST_POINTS + 1) * LEVELS * sizeof *planes.list);
  PAGS_CHECK_MEMORY(keys && planes.list, "%lld points", (long long)points->count);
  for (int level = 0; level < LEVELS; level++) {
    /* All cells of one size; `keys` has room for all points. */
    const double side = ldexp(finest, level);
    int64_t n = 0;
    for (int64_t i = 0; i < points->count; i++) {
      int64_t cell[3];
      if (points->rows[i].owner >= 0 || points->rows[i].parked >= 0)
        continue;
      cell_of(points->rows[i].p, side, cell);
      keys[n++] = (keyed){key_of(cell, level), i};
    }
    pags_sort(keys, n, sizeof *keys, by_key);
    for (int64_t i = 0, end; i < n; i = end) {
      for (end = i + 1; end < n && keys[end].key == keys[i].key;)
        end++;
      if (end - i >= LEAST_POINTS)
        planes.list[planes.count++] = fit(points, keys + i, end - i, side);
    }
  }

  uint64_t size = 16;
  while (size < 2 * (uint64_t)planes.count)
    size *= 2;
  planes.mask = size - 1;
  planes.table = malloc(size * sizeof *planes.table);
  PAGS_CHECK_MEMORY(planes.table, "%lld LiDAR planes", (long long)planes.count);
  memset(planes.table, 0xff, size * sizeof *planes.table);
  for (int64_t i = 0; i < planes.count; i++)
    *slot_of(&planes, planes.list[i].key) = (int32_t)i;
  *out = planes;
  planes = (pags_lidar_planes){0};
  return PAGS_OK;
}

pags_result pags_lidar_planes_create(const pags_dataset *dataset, pags_tasks *tasks, pags_lidar_planes *out) {
  PAGS_AUTO(pags_lidar_points_destroy) pags_lidar_points points = {0};
  *out = (pags_lidar_planes){0};
  PAGS_TRY(pags_lidar_points_gather(dataset, tasks, MOST_POINTS, &points));
  return points.count > 0 ? pags_lidar_planes_fit(&points, out) : PAGS_OK;
}

void pags_lidar_planes_destroy(pags_lidar_planes *planes) {
  free(planes->list);
  free(planes->table);
  *planes = (pags_lidar_planes){0};
}

/* ---- Pulling Gaussians onto planes ---- */

typedef struct drawing {
  const pags_lidar_planes *planes;
  pags_gaussians *g;
  float share;
} drawing;

/* Is p within reach of a plane of cells of side `side`? `across` receives its signed distance from the plane. */
static bool reaches(const pags_lidar_plane *plane, const float p[3], float side, float *across) {
  float d[3];
  pags_subtract3f(p, plane->centre, d);
  *across = pags_dot3f(d, plane->normal);
  const float along2 = pags_dot3f(d, d) - *across * *across;
  return fabsf(*across) <= (float)farthest && along2 <= (float)(widest * widest) * side * side;
}

typedef enum around {
  UNKNOWN, /* none of the cells has enough points, nor has a smaller one within them */
  KNOWN,
  ROUGH /* p's own cell */
} around;

/* Finds the plane nearest to p among those that reach it in its own cell of one size and the six neighbours; `best`
 * receives it, or NULL, and `across` the signed distance. */
static around plane_of_level(const pags_lidar_planes *planes, const float p[3], int level,
                             const pags_lidar_plane **best, float *across) {
  static const int8_t step[7][3] = {{0, 0, 0}, {1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  const double side = ldexp(finest, level);
  around found = UNKNOWN;
  int64_t cell[3];
  cell_of(p, side, cell);
  *best = NULL;
  for (int i = 0; i < 7; i++) {
    const int64_t beside[3] = {cell[0] + step[i][0], cell[1] + step[i][1], cell[2] + step[i][2]};
    const int32_t index = *slot_of(planes, key_of(beside, level));
    float d;
    if (index < 0)
      continue;
    const pags_lidar_plane *const plane = &planes->list[index];
    const bool rough = plane->normal[0] == 0.0f && plane->normal[1] == 0.0f && plane->normal[2] == 0.0f;
    if (rough && i == 0)
      return ROUGH;
    found = KNOWN;
    if (!rough && reaches(plane, p, (float)side, &d) && (!*best || fabsf(d) < fabsf(*across))) {
      *best = plane;
      *across = d;
    }
  }
  return found;
}

/* The plane to which p is pulled, of the smallest cells that have one; NULL if no cell has one or if p's own cell is
 * rough. */
static const pags_lidar_plane *finest_plane(const pags_lidar_planes *planes, const float p[3], float *across) {
  const pags_lidar_plane *best = NULL;
  for (int level = 0; level < PULL_LEVELS && !best; level++)
    if (plane_of_level(planes, p, level, &best, across) == ROUGH)
      return NULL;
  return best;
}

/* The plane into which p is laid: the nearest of the largest cells that have one, if it is near and level; else
 * NULL. */
static const pags_lidar_plane *ground_plane(const pags_lidar_planes *planes, const float p[3], float *across) {
  const pags_lidar_plane *best = NULL;
  for (int level = LEVELS - 1; level >= 0 && !best; level--)
    if (plane_of_level(planes, p, level, &best, across) == UNKNOWN)
      return NULL;
  const bool laid = best && fabsf(*across) <= (float)close && fabsf(best->normal[2]) >= (float)level_at;
  return laid ? best : NULL;
}

/* Reads the mean of a row; returns false of a parked object's, which stays. */
static bool reads_mean(const pags_gaussians *g, int64_t row, float p[3]) {
  for (int k = 0; k < 3; k++)
    p[k] = pags_plane(g, PAGS_MEAN + k)[row];
  return !g->object_id || g->object_id[row] < 0;
}

static void draw_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const drawing *d = context;
  for (int64_t row = begin; row < end; row++) {
    float p[3], across = 0;
    const pags_lidar_plane *plane = reads_mean(d->g, row, p) ? finest_plane(d->planes, p, &across) : NULL;
    float excess = fabsf(across) - (float)nearest;
    for (int k = 0; plane && excess > 0.0f && k < 3; k++)
      pags_plane(d->g, PAGS_MEAN + k)[row] = p[k] - copysignf(d->share * excess, across) * plane->normal[k];
  }
}

bool pags_lidar_planes_pull(const pags_lidar_planes *planes, pags_gaussians *g, double share, pags_tasks *tasks) {
  drawing d = {planes, g, (float)share};
  return planes->count == 0 || pags_parallel_for(tasks, g->count, GRAIN, draw_block, &d);
}

/* ---- Laying Gaussians into planes ---- */

/* The unit vector along axis `axis` of a row's rotation: a column of the matrix of its quaternion. */
static void axis_of(const float q[4], int axis, float out[3]) {
  const float w = q[0], x = q[1], y = q[2], z = q[3];
  const float columns[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)},
                               {2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)},
                               {2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)}};
  memcpy(out, columns[axis], sizeof columns[axis]);
}

/* Turns the axis that is nearest to the plane's normal towards it by the share, and returns that axis; -1 if the
 * quaternion is zero, or too short or long. The turn is the least one: the quaternion (1 + a.b, a x b), normalised,
 * takes a to b. */
static int turn(pags_gaussians *g, int64_t row, const float normal[3], float share) {
  float q[4], norm = 0, best = 0, along[3] = {0};
  int axis = -1;
  for (int k = 0; k < 4; k++) {
    q[k] = pags_plane(g, PAGS_ROTATION + k)[row];
    norm += q[k] * q[k];
  }
  if (!(norm > 1e-30f && norm < 1e38f)) /* the square of its length isn't a float of full precision */
    return -1;
  for (int k = 0; k < 4; k++)
    q[k] /= sqrtf(norm);
  for (int k = 0; k < 3; k++) {
    float a[3];
    axis_of(q, k, a);
    const float dot = pags_dot3f(a, normal);
    if (fabsf(dot) <= fabsf(best))
      continue;
    best = dot;
    axis = k;
    pags_copy3f(a, along);
  }
  float goal[3], t[4];
  for (int k = 0; k < 3; k++)
    goal[k] = (1 - share) * along[k] + copysignf(share, best) * normal[k];
  pags_divide3f(goal, pags_length3f(goal)); /* at least 1/sqrt 2: the angle between the two is less than 55 degrees */
  t[0] = 1 + pags_dot3f(goal, along);
  pags_cross3f(along, goal, t + 1);
  const float unit = sqrtf(t[0] * t[0] + t[1] * t[1] + t[2] * t[2] + t[3] * t[3]);
  const float turned[4] = {
      t[0] * q[0] - t[1] * q[1] - t[2] * q[2] - t[3] * q[3], t[0] * q[1] + t[1] * q[0] + t[2] * q[3] - t[3] * q[2],
      t[0] * q[2] - t[1] * q[3] + t[2] * q[0] + t[3] * q[1], t[0] * q[3] + t[1] * q[2] - t[2] * q[1] + t[3] * q[0]};
  for (int k = 0; k < 4; k++)
    pags_plane(g, PAGS_ROTATION + k)[row] = turned[k] * (sqrtf(norm) / unit);
  return axis;
}

static void lay_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const drawing *const d = context;
  const float share = d->share, thin = (float)pags_log(thinnest);
  for (int64_t row = begin; row < end; row++) {
    float p[3], across = 0;
    const pags_lidar_plane *const plane = reads_mean(d->g, row, p) ? ground_plane(d->planes, p, &across) : NULL;
    const int axis = plane ? turn(d->g, row, plane->normal, share) : -1;
    if (axis < 0)
      continue;
    for (int k = 0; k < 3; k++)
      pags_plane(d->g, PAGS_MEAN + k)[row] = p[k] - share * across * plane->normal[k];
    float *const scale = pags_plane(d->g, PAGS_SCALE + axis) + row;
    *scale -= share * fmaxf(*scale - thin, 0.0f);
  }
}

bool pags_lidar_planes_lay(const pags_lidar_planes *planes, pags_gaussians *g, double share, pags_tasks *tasks) {
  drawing d = {planes, g, (float)share};
  return planes->count == 0 || pags_parallel_for(tasks, g->count, GRAIN, lay_block, &d);
}
