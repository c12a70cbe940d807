/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of road, pavement and verge from the ground's height field and the semantic pictures.
 *
 * Each cell of the lattice gets a kind. Cells meet at corners, where each kind has a vertex of its own: so surfaces
 * end sharply, and where they differ in height a kerb face joins them. Heights next to another kind, which cells of
 * both have blurred, and those that were not measured are interpolated from those of their own kind. Borders are
 * smoothed as polylines. All kinds are decimated together, as one mesh whose seams stay together, and then split. */
#include "exporters/proxy/ground_plan.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "exporters/proxy/tsdf.h"

enum {
  ROAD = PAGS_GROUND_ROAD,
  PAVEMENT = PAGS_GROUND_PAVEMENT,
  VERGE = PAGS_GROUND_VERGE,
  KINDS = PAGS_GROUND_KINDS,
  NONE = PAGS_GROUND_NONE
};
enum {
  LEAST_CELLS = 100, /* of a surface: 4 square metres; smaller ones join their neighbour */
  BLUR = 2,          /* cells next to another kind whose heights are replaced */
  SWEEPS = 60,       /* of interpolation of heights */
  SMOOTHINGS = 30    /* of borders */
};
static const char *const names[KINDS] = {"ground_road", "ground_pavement", "ground_verge"};

/* In metres. */
static const double least_step = 0.025; /* smaller steps between kinds are levelled */
static const double slant = 0.005;      /* a kerb's upper edge lies this far behind its foot: nothing is upright */
static const double most_shift = 0.12;  /* of a border's corners */
static const double error = 0.01;       /* of decimation */

typedef pags_ground_plan plan;

static void forget_plan(plan *p) {
  void *const owned[] = {p->kind, p->z, p->corner, p->fixed, p->top, p->foot, p->scratch, p->pure};
  for (size_t i = 0; i < sizeof owned / sizeof *owned; i++)
    free(owned[i]);
}

/* ---- Kinds ---- */

/* Gives cells whose kind isn't known that of the nearest cell of known kind, which isn't `but`, breadth first. */
static void spread(plan *p, uint8_t but) {
  static const int dx[4] = {1, -1, 0, 0}, dy[4] = {0, 0, 1, -1};
  int64_t queued = 0, *queue = p->scratch;
  for (int64_t i = 0; i < p->nx * p->ny; i++)
    if (p->kind[i] < KINDS && p->kind[i] != but)
      queue[queued++] = i;
  for (int64_t head = 0; head < queued; head++)
    for (int d = 0; d < 4; d++) {
      const int64_t x = queue[head] % p->nx + dx[d], y = queue[head] / p->nx + dy[d];
      if (pags_ground_kind(p, x, y) != KINDS)
        continue;
      p->kind[y * p->nx + x] = p->kind[queue[head]];
      queue[queued++] = y * p->nx + x;
    }
}

/* Takes the kinds from the pictures. Hidden cells continue the ground before and behind them: a membrane that is stiff
 * along the path, as that of the heights (ground_fill.c), tells road from the rest, which is as its neighbour. */
static pags_result find_kinds(const pags_proxy_maker *w, const pags_background *b, plan *p) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  const int64_t cells = p->nx * p->ny, steps = b->depth_views.count;
  pags_ground road = *p->ground; /* its heights: 1: road, 0: not */
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh points = {0};
  for (int64_t i = 0; i < cells; i++) {
    const float at[3] = {(float)(road.x0 + (double)(i % p->nx) * road.step),
                         (float)(road.y0 + (double)(i / p->nx) * road.step), road.z[i]};
    if (road.known[i])
      pags_proxy_mesh_vertex(&points, at, grey, 1);
  }
  PAGS_TRY(pags_proxy_mesh_check(&points));
  PAGS_AUTOFREE uint8_t *classes = malloc((size_t)points.vertex_count + 1), *known = malloc((size_t)cells);
  PAGS_AUTOFREE float *share = calloc((size_t)cells, sizeof *share), *weights = calloc((size_t)cells, sizeof *weights);
  PAGS_AUTOFREE float *nearest = NULL;
  PAGS_AUTOFREE double *path = malloc((size_t)steps * 3 * sizeof *path);
  PAGS_CHECK_MEMORY(classes && known && share && weights && path, "%lld cells", (long long)cells);
  PAGS_TRY(pags_classes_find(w, &b->depth_views, true, &points, classes));
  int64_t next = 0;
  for (int64_t i = 0; i < cells; i++) {
    p->kind[i] = NONE;
    known[i] = road.known[i] ? 2 : 0;
    if (!known[i])
      continue;
    const uint8_t class = classes[next++];
    p->kind[i] = class == PAGS_CHUNK_ROAD         ? ROAD
                 : class == PAGS_CHUNK_SIDEWALK   ? PAVEMENT
                 : class == PAGS_CHUNK_VEGETATION ? VERGE
                                                  : KINDS; /* not known yet */
    known[i] = p->kind[i] == KINDS ? 2 : 1;
  }
  spread(p, NONE);
  for (int64_t i = 0; i < cells; i++) {
    share[i] = p->kind[i] == ROAD;
    weights[i] = 1;
  }
  for (int64_t i = 0; i < steps; i++)
    pags_pose_position(b->depth_views.list[i].camera.world_from_camera, path + 3 * i);
  road.z = share;
  road.known = known;
  const pags_result result = pags_ground_fill(&road, weights, path, steps, 0);
  nearest = road.nearest;
  PAGS_TRY(result);
  for (int64_t i = 0; i < cells; i++)
    if (known[i] == 2 && p->kind[i] != NONE)
      p->kind[i] = share[i] > 0.5f ? ROAD : KINDS;
  spread(p, ROAD);
  for (int64_t i = 0; i < cells; i++) /* where nothing is known */
    p->kind[i] = p->kind[i] == KINDS ? ROAD : p->kind[i];
  return PAGS_OK;
}

/* Gives each cell the kind that most cells around it have. */
static pags_result vote(plan *p) {
  PAGS_AUTOFREE uint8_t *before = malloc((size_t)(p->nx * p->ny));
  PAGS_CHECK_MEMORY(before, "%lld cells", (long long)(p->nx * p->ny));
  for (int round = 0; round < 2; round++) {
    memcpy(before, p->kind, (size_t)(p->nx * p->ny));
    for (int64_t y = 0; y < p->ny; y++)
      for (int64_t x = 0; x < p->nx; x++) {
        int votes[NONE + 1] = {0}, best = before[y * p->nx + x];
        for (int64_t k = 0; k < 25 && best != NONE; k++) {
          const int64_t u = x + k % 5 - 2, v = y + k / 5 - 2;
          if (u >= 0 && v >= 0 && u < p->nx && v < p->ny)
            votes[before[v * p->nx + u]]++;
        }
        for (int k = 0; k < KINDS && best != NONE; k++)
          best = votes[k] > votes[best] ? k : best;
        p->kind[y * p->nx + x] = (uint8_t)best;
      }
  }
  return PAGS_OK;
}

/* Gives surfaces of too few cells the kind that they touch most, and leaves out those that touch none. */
static pags_result join_small(plan *p) {
  const int64_t cells = p->nx * p->ny;
  int64_t *parent = p->scratch;
  PAGS_AUTOFREE int32_t(*touch)[KINDS + 1] = calloc((size_t)cells + 1, sizeof *touch); /* cells last */
  PAGS_CHECK_MEMORY(touch, "%lld cells", (long long)cells);
  for (int64_t i = 0; i < cells; i++)
    parent[i] = i;
  for (int64_t i = 0; i < cells; i++) {
    const int64_t x = i % p->nx, y = i / p->nx;
    if (x && p->kind[i - 1] == p->kind[i])
      pags_set_join(parent, i, i - 1);
    if (y && p->kind[i - p->nx] == p->kind[i])
      pags_set_join(parent, i, i - p->nx);
  }
  for (int64_t i = 0; i < cells; i++) {
    const int64_t root = pags_set_root(parent, i), x = i % p->nx, y = i / p->nx;
    const uint8_t around[4] = {pags_ground_kind(p, x - 1, y), pags_ground_kind(p, x + 1, y),
                               pags_ground_kind(p, x, y - 1), pags_ground_kind(p, x, y + 1)};
    touch[root][KINDS]++;
    for (int d = 0; d < 4; d++)
      if (around[d] != NONE && around[d] != p->kind[i])
        touch[root][around[d]]++;
  }
  for (int64_t i = 0; i < cells; i++) {
    const int32_t *own = touch[pags_set_root(parent, i)];
    int best = 0;
    for (int k = 1; k < KINDS; k++)
      best = own[k] > own[best] ? k : best;
    if (own[KINDS] < LEAST_CELLS && p->kind[i] != NONE)
      p->kind[i] = own[best] ? (uint8_t)best : NONE;
  }
  return PAGS_OK;
}

/* ---- Heights ---- */

static bool is_pure(const plan *p, int64_t x, int64_t y, uint8_t kind) {
  for (int64_t v = y - BLUR; v <= y + BLUR; v++)
    for (int64_t u = x - BLUR; u <= x + BLUR; u++) {
      const uint8_t other = pags_ground_kind(p, u, v);
      if (other != kind && other != NONE)
        return false;
    }
  return pags_ground_kind(p, x, y) == kind;
}

/* Gives cells near another kind, and those that were not measured, heights of their own kind: first that of the nearest
 * cell that was measured and has no other kind near it, then means of their neighbours. */
static void sharpen(plan *p) {
  static const int dx[4] = {1, -1, 0, 0}, dy[4] = {0, 0, 1, -1};
  const int64_t cells = p->nx * p->ny;
  int64_t first = 0, count = 0, *queue = p->scratch;
  for (int64_t i = 0; i < cells; i++) {
    p->z[i] = p->ground->z[i];
    p->pure[i] = p->ground->known[i] == 1 && is_pure(p, i % p->nx, i / p->nx, p->kind[i]);
    if (p->pure[i])
      queue[first++] = i;
  }
  count = first;
  for (int64_t head = 0; head < count; head++)
    for (int d = 0; d < 4; d++) {
      const int64_t x = queue[head] % p->nx + dx[d], y = queue[head] / p->nx + dy[d], at = y * p->nx + x;
      if (p->kind[queue[head]] == NONE || pags_ground_kind(p, x, y) != p->kind[queue[head]] || p->pure[at])
        continue;
      p->pure[at] = 1;
      p->z[at] = p->z[queue[head]];
      queue[count++] = at;
    }
  for (int sweep = 0; sweep < SWEEPS; sweep++)
    for (int64_t k = first; k < count; k++) {
      const int64_t x = queue[k] % p->nx, y = queue[k] / p->nx;
      float sum = 0, weight = 0;
      for (int d = 0; d < 4; d++)
        if (pags_ground_kind(p, x + dx[d], y + dy[d]) == p->kind[queue[k]]) {
          sum += p->z[(y + dy[d]) * p->nx + x + dx[d]];
          weight += 1;
        }
      p->z[queue[k]] += 1.6f * (sum / fmaxf(weight, 1) - p->z[queue[k]]);
    }
}

/* ---- Corners ---- */

/* The four cells about a corner. */
static void cells_of(const plan *p, int64_t corner, uint8_t kinds[4], int64_t cells[4]) {
  for (int k = 0; k < 4; k++) {
    const int64_t x = corner % (p->nx + 1) - 1 + k % 2, y = corner / (p->nx + 1) - 1 + k / 2;
    kinds[k] = pags_ground_kind(p, x, y);
    cells[k] = y * p->nx + x;
  }
}

/* Smooths the borders: each corner with two neighbours on a border moves to the middle between them. */
static pags_result smooth_borders(plan *p) {
  const int64_t wide = p->nx + 1, corners = wide * (p->ny + 1), beside[4] = {1, -1, wide, -wide};
  PAGS_AUTOFREE float(*moved)[2] = malloc((size_t)corners * sizeof *moved);
  PAGS_CHECK_MEMORY(moved, "%lld corners", (long long)corners);
  for (int round = 0; round < SMOOTHINGS; round++) {
    memcpy(moved, p->corner, (size_t)corners * sizeof *moved);
    for (int64_t i = 0; i < corners; i++) {
      uint8_t k[4];
      int64_t cells[4], next[4];
      int count = 0;
      cells_of(p, i, k, cells);
      const bool border[4] = {k[1] != k[3], k[0] != k[2], k[2] != k[3], k[0] != k[1]}; /* right, left, up, down */
      for (int d = 0; d < 4; d++)
        if (border[d])
          next[count++] = i + beside[d];
      if (count != 2 || p->fixed[i] || k[0] == NONE || k[1] == NONE || k[2] == NONE || k[3] == NONE)
        continue;
      for (int a = 0; a < 2; a++) {
        const float middle = 0.25f * (p->corner[next[0]][a] + p->corner[next[1]][a]) + 0.5f * p->corner[i][a];
        const int64_t place = a ? i / wide : i % wide;
        const double home = (a ? p->ground->y0 : p->ground->x0) + ((double)place - 0.5) * p->ground->step;
        moved[i][a] = (float)fmin(fmax((double)middle, home - most_shift), home + most_shift);
      }
    }
    memcpy(p->corner, moved, (size_t)corners * sizeof *moved);
  }
  return PAGS_OK;
}

/* The vertices of all kinds at a corner. Until they are painted, their red is their kind. */
static void add_corner(plan *p, int64_t corner, pags_proxy_mesh *mesh) {
  double z[KINDS] = {0}, lo = HUGE_VAL, hi = -HUGE_VAL, sum = 0;
  int count[KINDS] = {0}, kinds = 0, seen = 1;
  uint8_t k[4];
  int64_t cells[4];
  cells_of(p, corner, k, cells);
  for (int c = 0; c < 4; c++)
    if (k[c] != NONE) {
      z[k[c]] += (double)p->z[cells[c]];
      count[k[c]]++;
      seen = seen && p->ground->known[cells[c]] == 1;
    }
  for (int i = 0; i < KINDS; i++)
    if (count[i]) {
      z[i] /= count[i];
      sum += z[i];
      lo = fmin(lo, z[i]);
      hi = fmax(hi, z[i]);
      kinds++;
    }
  for (int i = 0; i < KINDS; i++) {
    const float kind[3] = {(float)i, 0, 0};
    float at[3] = {p->corner[corner][0], p->corner[corner][1], (float)(hi - lo < least_step ? sum / kinds : z[i])};
    if (!count[i])
      continue;
    if (z[i] >= lo + least_step) { /* up a kerb: away from the other cells */
      double middle[2] = {0};
      for (int c = 0; c < 4; c++) {
        const double away = k[c] == i ? 1 : -1;
        middle[0] += away * (c % 2 ? 1 : -1);
        middle[1] += away * (c / 2 ? 1 : -1);
      }
      const double length = fmax(1, sqrt(middle[0] * middle[0] + middle[1] * middle[1]));
      const float foot[3] = {at[0], at[1], (float)lo};
      for (int a = 0; a < 2; a++)
        at[a] += (float)(slant * middle[a] / length);
      p->foot[corner][i] = pags_proxy_mesh_vertex(mesh, foot, kind, seen);
    }
    p->top[corner][i] = pags_proxy_mesh_vertex(mesh, at, kind, seen);
  }
}

/* Adds the kerb's face between two corners, seen from the cell of kind `right` to the right of the way from a to b;
 * the cell to the left is the higher one. */
static void add_kerb(const plan *p, int64_t a, int64_t b, uint8_t left, uint8_t right, pags_proxy_mesh *mesh) {
  if (left == right || left == NONE || right == NONE)
    return;
  const uint32_t high[2] = {p->top[a][left], p->top[b][left]}, low[2] = {p->foot[a][left], p->foot[b][left]};
  const float *z = mesh->positions;
  if (z[3 * high[0] + 2] + z[3 * high[1] + 2] <= z[3 * p->top[a][right] + 2] + z[3 * p->top[b][right] + 2])
    return;
  if (low[0] != UINT32_MAX && low[1] != UINT32_MAX)
    pags_proxy_mesh_triangle(mesh, low[0], low[1], high[1]);
  else if (low[1] != UINT32_MAX)
    pags_proxy_mesh_triangle(mesh, high[0], low[1], high[1]);
  if (low[0] != UINT32_MAX)
    pags_proxy_mesh_triangle(mesh, low[0], high[1], high[0]);
}

/* Makes the mesh of all kinds. */
static pags_result make_mesh(plan *p, pags_proxy_mesh *mesh) {
  const int64_t wide = p->nx + 1, corners = wide * (p->ny + 1);
  memset(p->top, 0xff, (size_t)corners * sizeof *p->top);
  memset(p->foot, 0xff, (size_t)corners * sizeof *p->foot);
  for (int64_t i = 0; i < corners; i++)
    add_corner(p, i, mesh);
  PAGS_TRY(pags_proxy_mesh_check(mesh));
  for (int64_t i = 0; i < p->nx * p->ny; i++) {
    const uint8_t kind = p->kind[i];
    const int64_t x = i % p->nx, y = i / p->nx, at = y * wide + x;
    if (kind == NONE)
      continue;
    const uint32_t v[4] = {p->top[at][kind], p->top[at + 1][kind], p->top[at + wide + 1][kind],
                           p->top[at + wide][kind]};
    pags_proxy_mesh_triangle(mesh, v[0], v[1], v[2]);
    pags_proxy_mesh_triangle(mesh, v[0], v[2], v[3]);
    /* The faces to the four neighbours, with this cell as the upper one on the left. */
    add_kerb(p, at, at + 1, kind, pags_ground_kind(p, x, y - 1), mesh);
    add_kerb(p, at + 1, at + wide + 1, kind, pags_ground_kind(p, x + 1, y), mesh);
    add_kerb(p, at + wide + 1, at + wide, kind, pags_ground_kind(p, x, y + 1), mesh);
    add_kerb(p, at + wide, at, kind, pags_ground_kind(p, x - 1, y), mesh);
  }
  return pags_proxy_mesh_check(mesh);
}

/* ---- The pieces ---- */

/* Whether all triangles have the same orientation as seen from above. */
static bool single_valued(const pags_proxy_mesh *mesh) {
  double n[3];
  for (int64_t i = 0; i < mesh->triangle_count; i++) {
    pags_proxy_mesh_cross(mesh, i, n);
    if (!(n[2] > 0))
      return false;
  }
  return true;
}

/* Decimates by as much as `error` allows without folds, and to the budget. */
static pags_result decimate(const pags_proxy_mesh *full, int64_t budget, pags_proxy_mesh *out) {
  double most = error;
  for (int attempt = 0; attempt < 4; attempt++, most /= 2) {
    pags_proxy_mesh_destroy(out);
    PAGS_TRY(pags_proxy_mesh_simplify_within(full, most, out));
    if (single_valued(out))
      break;
  }
  if (out->triangle_count <= budget)
    return PAGS_OK;
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh large = *out;
  *out = (pags_proxy_mesh){0};
  return pags_proxy_mesh_simplify(&large, budget, out);
}

/* Adds each connected surface as a chunk. Those of few triangles come after those of the same kind before them. */
static pags_result add_surfaces(const pags_proxy_maker *w, pags_background *b, const pags_proxy_mesh *mesh) {
  PAGS_AUTOFREE int64_t *parent = malloc(((size_t)mesh->vertex_count + 1) * sizeof *parent);
  PAGS_AUTOFREE uint32_t *triangles = malloc(((size_t)mesh->triangle_count + 1) * 3 * sizeof *triangles);
  PAGS_CHECK_MEMORY(parent && triangles, "%lld triangles", (long long)mesh->triangle_count);
  pags_proxy_mesh_connect(mesh, parent);
  for (int64_t v = 0; v < mesh->vertex_count; v++) {
    PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh surface = {0};
    const int kind = (int)mesh->colors[3 * v];
    int64_t count = 0;
    if (parent[v] != v)
      continue;
    for (int64_t i = 0; i < mesh->triangle_count; i++)
      if (pags_set_root(parent, mesh->triangles[3 * i]) == v)
        memcpy(triangles + 3 * count++, mesh->triangles + 3 * i, 3 * sizeof *triangles);
    PAGS_TRY(pags_proxy_mesh_copy_part(mesh, triangles, count, &surface));
    PAGS_TRY(pags_proxy_mesh_paint(&surface, &b->depth_views, 0.3, w->tasks));
    PAGS_TRY(pags_background_add(b, names[kind], &surface));
  }
  return PAGS_OK;
}

pags_result pags_ground_parts_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground) {
  PAGS_AUTO(forget_plan) plan p = {.ground = ground, .nx = ground->nx, .ny = ground->ny};
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh full = {0}, few = {0};
  const size_t corners = (size_t)((p.nx + 1) * (p.ny + 1));
  if (!ground->nx)
    return PAGS_OK;
  p.kind = malloc(corners);
  p.z = malloc(corners * sizeof *p.z);
  p.corner = malloc(corners * sizeof *p.corner);
  p.fixed = calloc(corners, 1);
  p.top = malloc(corners * sizeof *p.top);
  p.foot = malloc(corners * sizeof *p.foot);
  p.scratch = malloc(corners * sizeof *p.scratch);
  p.pure = malloc(corners);
  PAGS_CHECK_MEMORY(p.kind && p.z && p.corner && p.fixed && p.top && p.foot && p.scratch && p.pure,
                    "the ground's %zu corners", corners);
  /* Corners are up to a millimetre off in x and y: see pags_ground_mesh. */
  uint32_t state = 1;
  for (size_t i = 0; i < 2 * corners; i++) {
    const int64_t place = i % 2 ? (int64_t)(i / 2) / (p.nx + 1) : (int64_t)(i / 2) % (p.nx + 1);
    state = state * 1664525u + 1013904223u; /* Numerical Recipes' generator */
    p.corner[i / 2][i % 2] = (float)((i % 2 ? ground->y0 : ground->x0) + ((double)place - 0.5) * ground->step +
                                     0.002 * ((double)(state >> 8) / 16777216.0 - 0.5));
  }
  PAGS_TRY(find_kinds(w, b, &p));
  PAGS_TRY(vote(&p));
  PAGS_TRY(join_small(&p));
  sharpen(&p);
  for (int pass = 0; pass < 3; pass++) {
    PAGS_TRY(pags_ground_kerbs_fit(w, b, pass == 2, &p));
    sharpen(&p);
  }
  PAGS_TRY(smooth_borders(&p));
  PAGS_TRY(make_mesh(&p, &full));
  PAGS_TRY(decimate(&full, w->options->ground_triangles, &few));
  return add_surfaces(w, b, &few);
}
