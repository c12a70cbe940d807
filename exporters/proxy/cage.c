/* SPDX-License-Identifier: Apache-2.0 */
/* Fits a cage: a box of quads about the mesh, whose control points are moved until its limit surface lies on the
 * mesh.
 *
 * In each round, every sample of the limit surface is pulled to the nearest point of the mesh, and for every vertex
 * of the mesh the nearest sample is pulled to that vertex (so that protruding parts such as wheels are not lost). The
 * control points are found by linear least squares over the limit stencils, with a penalty on the cage's bending (the
 * difference of a control point from the mean of its neighbours) whose weight falls from round to round. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "exporters/proxy/mesh_query.h"
#include "exporters/proxy/subdiv.h"
#include "maths/maths.h"

/* SIDE x SIDE samples of the limit surface on each quad; at most MOST_PULLS of the mesh's vertices pull. */
enum { ROUNDS = 14, SIDE = 5, MOST_PULLS = 3000 };

/* Total weight of the pulls from the mesh's vertices, relative to that of the pulls from samples of the limit
 * surface. It is large for the sake of protruding parts such as wheels: few vertices lie there, and the nearest
 * points that samples find lie elsewhere. */
static const double vertex_weight = 8;

typedef struct cage {
  int n[3]; /* quads along x, y, z */
  pags_quads mesh;
  int *lattice; /* vertex at each point of the (n + 1)^3 lattice; -1 inside */
} cage;

static void forget_cage(cage *c) {
  pags_quads_destroy(&c->mesh);
  free(c->lattice);
}

/* ---- The box of quads ---- */

static int lattice_at(const cage *c, int x, int y, int z) {
  return (z * (c->n[1] + 1) + y) * (c->n[0] + 1) + x;
}

/* Chooses the numbers of quads a, b, c along the axes of a box, such that quads are about square and their number
 *     2 (a b + b c + c a)
 * is at most `most_quads`; the longest axis gets at most 16. */
static void choose_counts(const double size[3], int64_t most_quads, int n[3]) {
  for (int longest = 16;; longest--) {
    double side = fmax(size[0], fmax(size[1], size[2])) / longest;
    for (int k = 0; k < 3; k++)
      n[k] = side > 0 ? (int)fmax(1, floor(size[k] / side + 0.5)) : 1;
    if (longest == 1 || 2 * ((int64_t)n[0] * n[1] + (int64_t)n[1] * n[2] + (int64_t)n[2] * n[0]) <= most_quads)
      return;
  }
}

/* Adds the quads of one face of the box, at the low or the high end of axis `a`, counter-clockwise seen from
 * outside. */
static void add_face(cage *c, int a, bool high) {
  int u = (a + 1) % 3, v = (a + 2) % 3;
  for (int j = 0; j < c->n[v]; j++)
    for (int i = 0; i < c->n[u]; i++) {
      int *quad = c->mesh.quads + 4 * (size_t)c->mesh.quad_count++;
      for (int corner = 0; corner < 4; corner++) {
        static const int du[4] = {0, 1, 1, 0}, dv[4] = {0, 0, 1, 1};
        int at = high ? corner : 3 - corner, p[3];
        p[a] = high ? c->n[a] : 0;
        p[u] = i + du[at];
        p[v] = j + dv[at];
        quad[corner] = c->lattice[lattice_at(c, p[0], p[1], p[2])];
      }
    }
}

/* Makes the first cage: the box `lo`..`hi` with a lattice of control points on its faces. */
static pags_result build_box(cage *c, const double lo[3], const double hi[3], int64_t most_quads) {
  double size[3];
  pags_subtract3(hi, lo, size);
  choose_counts(size, most_quads, c->n);
  const size_t n[3] = {(size_t)c->n[0], (size_t)c->n[1], (size_t)c->n[2]};
  const size_t points = (n[0] + 1) * (n[1] + 1) * (n[2] + 1), quads = 2 * (n[0] * n[1] + n[1] * n[2] + n[2] * n[0]);
  c->lattice = malloc(points * sizeof *c->lattice);
  c->mesh.positions = malloc(points * 3 * sizeof *c->mesh.positions);
  c->mesh.quads = malloc(quads * 4 * sizeof *c->mesh.quads);
  PAGS_CHECK_MEMORY(c->lattice && c->mesh.positions && c->mesh.quads, "a cage");
  for (int z = 0; z <= c->n[2]; z++)
    for (int y = 0; y <= c->n[1]; y++)
      for (int x = 0; x <= c->n[0]; x++) {
        const int p[3] = {x, y, z};
        bool outside = false;
        for (int k = 0; k < 3; k++)
          outside = outside || p[k] == 0 || p[k] == c->n[k];
        c->lattice[lattice_at(c, x, y, z)] = outside ? c->mesh.vertex_count : -1;
        for (int k = 0; k < 3 && outside; k++)
          c->mesh.positions[3 * c->mesh.vertex_count + k] = (float)(lo[k] + size[k] * p[k] / c->n[k]);
        c->mesh.vertex_count += outside;
      }
  for (int a = 0; a < 3; a++) {
    add_face(c, a, false);
    add_face(c, a, true);
  }
  return PAGS_OK;
}

/* ---- Least squares ---- */

/* The normal equations of the least squares: one symmetric matrix, three right sides (x, y, z). */
typedef struct equations {
  int n;
  double *matrix; /* n * n */
  double *right;  /* 3 * n */
} equations;

/* Adds the equation "the weighted sum of these control points is `target`" with the weight `price`. */
static void add_equation(equations *e, const int32_t *indices, const float *weights, int64_t count,
                         const double target[3], double price) {
  for (int64_t i = 0; i < count; i++) {
    double w = price * (double)weights[i];
    for (int64_t j = 0; j < count; j++)
      e->matrix[(size_t)indices[i] * (size_t)e->n + (size_t)indices[j]] += w * (double)weights[j];
    for (int k = 0; k < 3; k++)
      e->right[k * e->n + indices[i]] += w * target[k];
  }
}

static double dot(const double *a, const double *b, int n) {
  double sum[4] = {0};
  int i = 0;
  for (; i + 4 <= n; i += 4)
    for (int k = 0; k < 4; k++)
      sum[k] += a[i + k] * b[i + k];
  for (; i < n; i++)
    sum[0] += a[i] * b[i];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/* Solves the normal equations by a row-wise Cholesky factorisation in place. The matrix is positive definite, since
 * each control point has a small positive weight on the diagonal. */
static void solve(equations *e) {
  size_t n = (size_t)e->n;
  for (size_t i = 0; i < n; i++) {
    double *row = e->matrix + i * n;
    for (size_t j = 0; j < i; j++)
      row[j] = (row[j] - dot(row, e->matrix + j * n, (int)j)) / e->matrix[j * n + j];
    row[i] = sqrt(fmax(row[i] - dot(row, row, (int)i), 1e-12));
  }
  for (int c = 0; c < 3; c++) {
    double *x = e->right + (size_t)c * n;
    for (size_t i = 0; i < n; i++)
      x[i] = (x[i] - dot(e->matrix + i * n, x, (int)i)) / e->matrix[i * n + i];
    for (size_t i = n; i-- > 0;) {
      x[i] /= e->matrix[i * n + i];
      for (size_t k = 0; k < i; k++)
        x[k] -= e->matrix[i * n + k] * x[i];
    }
  }
}

/* ---- Fitting ---- */

typedef struct fit {
  const pags_proxy_mesh *mesh;
  const pags_mesh_query *query;
  pags_quads *cage;
  pags_stencils stencils;
  float *limit; /* samples of the limit surface */
  equations equations;
} fit;

static void forget_fit(fit *f) {
  free(f->limit);
  free(f->equations.matrix);
  free(f->equations.right);
  pags_stencils_destroy(&f->stencils);
}

/* Pulls a sample of the limit surface to `target` with the weight `price`. */
static void pull(fit *f, int64_t sample, const double target[3], double price) {
  int64_t first = f->stencils.first[sample];
  add_equation(&f->equations, f->stencils.indices + first, f->stencils.weights + first,
               f->stencils.first[sample + 1] - first, target, price);
}

/* Adds the penalty on bending: each control point should be the mean of the control points at the other ends of its
 * edges. */
static void add_smoothness(fit *f, double price) {
  const pags_quads *c = f->cage;
  static const double nothing[3] = {0};
  int32_t indices[33];
  float weights[33];
  for (int v = 0; v < c->vertex_count; v++) {
    int count = 0;
    indices[0] = v;
    for (int q = 0; q < c->quad_count; q++)
      for (int k = 0; k < 4; k++)
        if (c->quads[4 * q + k] == v &&
            count < 32) /* the edge that leaves v only: as all quads run the same way, each neighbour comes once */
          indices[++count] = c->quads[4 * q + (k + 1) % 4];
    weights[0] = 1;
    for (int i = 1; i <= count; i++)
      weights[i] = -1.0f / (float)count;
    add_equation(&f->equations, indices, weights, count + 1, nothing, price);
  }
}

/* One round of the fit: sets up and solves the normal equations for new control points. */
static pags_result round_of(fit *f, int round) {
  const int n = f->equations.n;
  PAGS_AUTO(pags_mesh_query_destroy_auto) pags_mesh_query *cloud = NULL;

  /* Evaluate the samples of the limit surface by their stencils. */
  for (int64_t i = 0; i < f->stencils.count; i++) {
    double p[3] = {0};
    for (int64_t s = f->stencils.first[i]; s < f->stencils.first[i + 1]; s++)
      for (int k = 0; k < 3; k++)
        p[k] += (double)f->stencils.weights[s] * (double)f->cage->positions[3 * f->stencils.indices[s] + k];
    pags_narrow3(p, f->limit + 3 * i);
  }

  PAGS_TRY(pags_mesh_query_of_points(f->limit, f->stencils.count, &cloud));
  memset(f->equations.matrix, 0, (size_t)n * (size_t)n * sizeof(double));
  memset(f->equations.right, 0, 3 * (size_t)n * sizeof(double));
  for (int64_t i = 0; i < f->stencils.count; i++) {
    double p[3], target[3];
    pags_widen3(f->limit + 3 * i, p);
    pags_mesh_query_nearest(f->query, p, target);
    pull(f, i, target, 1);
  }
  int64_t step = f->mesh->vertex_count / MOST_PULLS + 1;
  double share = (double)f->stencils.count / (double)(f->mesh->vertex_count / step + 1);
  for (int64_t i = 0; i < f->mesh->vertex_count; i += step) {
    double target[3];
    uint32_t sample;
    pags_proxy_mesh_point(f->mesh, i, target);
    pags_mesh_query_distance(cloud, target, &sample);
    pull(f, sample, target, vertex_weight * share);
  }
  double samples_each = (double)f->stencils.count / (double)n;
  add_smoothness(f, samples_each * 2 * pags_pow(0.003, (double)round / (ROUNDS - 1)));
  for (int i = 0; i < n; i++) { /* a weak pull to where it is, for control points that nothing else determines */
    f->equations.matrix[(size_t)i * (size_t)n + (size_t)i] += 1e-4 * samples_each;
    for (int k = 0; k < 3; k++)
      f->equations.right[k * n + i] += 1e-4 * samples_each * (double)f->cage->positions[3 * i + k];
  }
  solve(&f->equations);
  for (int i = 0; i < n; i++)
    for (int k = 0; k < 3; k++)
      f->cage->positions[3 * i + k] = (float)f->equations.right[k * n + i];
  return PAGS_OK;
}

/* ---- The cage ---- */

pags_result pags_proxy_mesh_cage(const pags_proxy_mesh *mesh, int level, int64_t budget, pags_proxy_mesh *out) {
  PAGS_AUTO(forget_cage) cage c = {0};
  PAGS_AUTO(pags_mesh_query_destroy_auto) pags_mesh_query *query = NULL;
  PAGS_AUTO(pags_quads_destroy) pags_quads fine = {0};
  PAGS_AUTO(forget_fit) fit f = {.mesh = mesh, .cage = &c.mesh};
  double lo[3], hi[3];
  *out = (pags_proxy_mesh){0};
  PAGS_TRY(pags_mesh_query_of_mesh(mesh, &query));
  pags_proxy_mesh_bounds(mesh, lo, hi);
  PAGS_TRY(build_box(&c, lo, hi, budget / 2 >> 2 * level));

  const size_t n = (size_t)c.mesh.vertex_count;
  PAGS_TRY(pags_subdiv_stencils(&c.mesh, SIDE, &f.stencils));
  f.query = query;
  f.limit = malloc((size_t)f.stencils.count * 3 * sizeof *f.limit);
  f.equations = (equations){c.mesh.vertex_count, malloc(n * n * sizeof(double)), malloc(3 * n * sizeof(double))};
  PAGS_CHECK_MEMORY(f.limit && f.equations.matrix && f.equations.right, "a cage");
  for (int round = 0; round < ROUNDS; round++)
    PAGS_TRY(round_of(&f, round));
  if (level > 0)
    PAGS_TRY(pags_subdiv_refine(&c.mesh, level, &fine));

  /* Write quads as triangles. Each vertex takes colour and `observed` from a corner of the mesh's nearest triangle. */
  const pags_quads *from = level > 0 ? &fine : &c.mesh;
  for (int i = 0; i < from->vertex_count; i++) {
    double p[3];
    uint32_t triangle;
    pags_widen3(from->positions + 3 * i, p);
    pags_mesh_query_distance(query, p, &triangle);
    const int64_t nearest = mesh->triangles[3 * (size_t)triangle];
    pags_proxy_mesh_vertex(out, from->positions + 3 * i, mesh->colors + 3 * nearest, mesh->observed[nearest]);
  }
  for (int i = 0; i < from->quad_count; i++) {
    const int *q = from->quads + 4 * i;
    pags_proxy_mesh_triangle(out, (uint32_t)q[0], (uint32_t)q[1], (uint32_t)q[2]);
    pags_proxy_mesh_triangle(out, (uint32_t)q[0], (uint32_t)q[2], (uint32_t)q[3]);
  }
  return pags_proxy_mesh_check(out);
}
