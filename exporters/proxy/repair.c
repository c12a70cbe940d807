/* SPDX-License-Identifier: Apache-2.0 */
/* Makes a decimated mesh closed again.
 *
 * Edge collapses leave two kinds of faults in a mesh that was closed: pairs of faces that cover each other, and edges
 * where four or more faces meet. Such pairs are removed. Such edges are split: around the edge, each face is
 * joined to the face that bounds the same wedge of solid, and vertices are doubled so that only joined faces share
 * them. If the joined faces are still connected around both ends of the edge, doubling doesn't separate them: then
 * each pair of faces gets its own new vertex in the middle of the edge. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "exporters/proxy/mesh.h"
#include "maths/maths.h"

/* A half-edge: one edge of one face. */
typedef struct half {
  uint32_t low, high; /* the vertices of the edge, the smaller index first */
  int64_t id;         /* 3 * triangle + the corner that the half-edge leaves from; -1: joined already */
  double angle;       /* the face's angle about the axis low -> high, radians */
  int backward;       /* the face runs from high to low */
} half;

static int compare_halves(const void *left, const void *right) {
  const half *a = left, *b = right;
  if (a->low != b->low)
    return a->low < b->low ? -1 : 1;
  if (a->high != b->high)
    return a->high < b->high ? -1 : 1;
  if (a->angle != b->angle)
    return a->angle < b->angle ? -1 : 1;
  return a->id < b->id ? -1 : a->id > b->id;
}

static int64_t next_corner(int64_t id) {
  return id % 3 == 2 ? id - 2 : id + 1;
}

/* A face with its vertices sorted, to find faces of the same three vertices. */
typedef struct face_key {
  uint32_t v[3]; /* ascending */
  int odd;       /* sorting took an odd permutation: the face has the opposite orientation */
  int64_t triangle;
} face_key;

static int compare_faces(const void *left, const void *right) {
  const face_key *a = left, *b = right;
  for (int k = 0; k < 3; k++)
    if (a->v[k] != b->v[k])
      return a->v[k] < b->v[k] ? -1 : 1;
  return a->odd != b->odd ? a->odd - b->odd : a->triangle < b->triangle ? -1 : a->triangle > b->triangle;
}

static void swap_if(face_key *key, int a, int b) {
  if (key->v[a] <= key->v[b])
    return;
  uint32_t v = key->v[a];
  key->v[a] = key->v[b];
  key->v[b] = v;
  key->odd ^= 1;
}

static void subtract(const float *a, const float *b, double out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = (double)a[k] - (double)b[k];
}

/* ---- Cutting edges by doubling vertices ---- */

/* The angle, about the axis low -> high, of the face's third corner against a reference direction that depends only
 * on the axis. Sorting by it puts the faces of an edge in order around the edge. */
static double angle_of(const pags_proxy_mesh *s, const half *h) {
  uint32_t third = s->triangles[next_corner(next_corner(h->id))];
  const float *low = s->positions + 3 * (int64_t)h->low;
  double axis[3], arm[3], first[3] = {0}, second[3];
  subtract(s->positions + 3 * (int64_t)h->high, low, axis);
  subtract(s->positions + 3 * (int64_t)third, low, arm);
  int smallest = 0;
  for (int k = 1; k < 3; k++)
    smallest = fabs(axis[k]) < fabs(axis[smallest]) ? k : smallest;
  double unit[3] = {0};
  unit[smallest] = 1;
  pags_cross3(axis, unit, first);
  pags_cross3(axis, first, second);
  double length = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
  double x = arm[0] * first[0] + arm[1] * first[1] + arm[2] * first[2];
  double y = arm[0] * second[0] + arm[1] * second[1] + arm[2] * second[2];
  return pags_atan2(y, x * length);
}

/* Union-find over the corners of all triangles: corners of one set become one vertex. */
static int64_t root_of(int64_t *parent, int64_t i) {
  while (parent[i] != i) {
    parent[i] = parent[parent[i]];
    i = parent[i];
  }
  return i;
}

static void join(int64_t *parent, int64_t a, int64_t b) {
  a = root_of(parent, a);
  b = root_of(parent, b);
  parent[a < b ? b : a] = a < b ? a : b;
}

/* Joins the faces around one edge, sorted by angle, in pairs. A face that runs from low to high has its solid side
 * towards smaller angles, so it is joined to the next face at a smaller angle that runs from high to low. */
static void join_edge(half *halves, int64_t count, int64_t *parent) {
  for (int64_t i = 0; i < count; i++) {
    if (halves[i].backward || halves[i].id < 0)
      continue;
    for (int64_t step = 1; step < count; step++) {
      half *other = &halves[(i + count - step) % count];
      if (!other->backward || other->id < 0)
        continue;
      join(parent, halves[i].id, next_corner(other->id));
      join(parent, next_corner(halves[i].id), other->id);
      other->id = -1;
      break;
    }
    halves[i].id = -1;
  }
}

/* Rebuilds the mesh with one vertex for each set of joined corners. */
static pags_result renumber(pags_proxy_mesh *s, int64_t *parent) {
  pags_proxy_mesh out = {0};
  int64_t corners = 3 * s->triangle_count;
  uint32_t *place = malloc(((size_t)corners + 1) * sizeof *place);
  PAGS_CHECK_MEMORY(place, "%lld corners", (long long)corners);
  for (int64_t i = 0; i < corners; i++) { /* the root of a set of corners is its smallest
                                               number, so the loop meets it first */
    int64_t root = root_of(parent, i), v = s->triangles[i];
    place[i] =
        root == i ? pags_proxy_mesh_vertex(&out, s->positions + 3 * v, s->colors + 3 * v, s->observed[v]) : place[root];
  }
  for (int64_t i = 0; i < s->triangle_count; i++)
    pags_proxy_mesh_triangle(&out, place[3 * i], place[3 * i + 1], place[3 * i + 2]);
  free(place);
  pags_proxy_mesh_destroy(s);
  *s = out;
  return pags_proxy_mesh_check(s);
}

/* ---- Cutting edges in their middle ---- */

/* Splits triangle id / 3 at the vertex `middle` on the edge that leaves its corner id % 3: one half keeps the
 * triangle's number, the other half becomes a new triangle. */
static void split_face(pags_proxy_mesh *s, int64_t id, uint32_t middle) {
  const uint32_t corners[3] = {s->triangles[id], s->triangles[next_corner(id)],
                               s->triangles[next_corner(next_corner(id))]};
  s->triangles[next_corner(id)] = middle;
  pags_proxy_mesh_triangle(s, middle, corners[1], corners[2]);
}

/* Separates the faces around one edge in the pairs that join_edge makes: each pair gets a new vertex in the middle of
 * the edge. A face that was already split in this pass is left for the next pass. */
static void part_edge(pags_proxy_mesh *s, half *halves, int64_t count, uint8_t *split) {
  for (int64_t i = 0; i < count; i++) {
    if (halves[i].backward || split[halves[i].id / 3])
      continue;
    for (int64_t step = 1; step < count; step++) {
      half *other = &halves[(i + count - step) % count];
      if (!other->backward || split[other->id / 3])
        continue;
      float position[3], color[3];
      for (int k = 0; k < 3; k++) {
        position[k] =
            0.5f * (s->positions[3 * (int64_t)halves[i].low + k] + s->positions[3 * (int64_t)halves[i].high + k]);
        color[k] = s->colors[3 * (int64_t)halves[i].low + k];
      }
      uint32_t middle = pags_proxy_mesh_vertex(s, position, color, s->observed[halves[i].low]);
      split[halves[i].id / 3] = split[other->id / 3] = 1;
      split_face(s, halves[i].id, middle);
      split_face(s, other->id, middle);
      break;
    }
  }
}

/* Finds the edges that still have more than two faces and separates their faces in the middle of the edge. `found`
 * receives the number of such edges. */
static pags_result part_edges(pags_proxy_mesh *s, int64_t *found) {
  int64_t count = 3 * s->triangle_count;
  half *halves = malloc(((size_t)count + 1) * sizeof *halves);
  uint8_t *split = calloc((size_t)s->triangle_count + 1, 1);
  *found = 0;
  if (!halves || !split) {
    free(halves);
    free(split);
    return pags_out_of_memory("%lld edges", (long long)count);
  }
  for (int64_t i = 0; i < count; i++) {
    uint32_t a = s->triangles[i], b = s->triangles[next_corner(i)];
    halves[i] = (half){.low = a < b ? a : b, .high = a < b ? b : a, .id = i, .backward = a > b};
    halves[i].angle = angle_of(s, &halves[i]);
  }
  pags_sort(halves, count, sizeof *halves, compare_halves);
  for (int64_t i = 0, end; i < count; i = end) {
    for (end = i; end < count && halves[end].low == halves[i].low && halves[end].high == halves[i].high; end++)
      continue;
    if (end - i > 2) {
      ++*found;
      part_edge(s, halves + i, end - i, split);
    }
  }
  free(halves);
  free(split);
  return pags_proxy_mesh_check(s);
}

/* ---- The repair ---- */

pags_result pags_proxy_mesh_repair(pags_proxy_mesh *surface) {
  enum { PASSES = 4 };
  int64_t left = 1;

  /* Remove pairs of faces of the same three vertices and opposite orientation. */
  face_key *keys = malloc(((size_t)surface->triangle_count + 1) * sizeof *keys);
  PAGS_CHECK_MEMORY(keys, "%lld triangles", (long long)surface->triangle_count);
  for (int64_t i = 0; i < surface->triangle_count; i++) {
    keys[i] = (face_key){.triangle = i};
    memcpy(keys[i].v, surface->triangles + 3 * i, sizeof keys[i].v);
    swap_if(&keys[i], 0, 1);
    swap_if(&keys[i], 1, 2);
    swap_if(&keys[i], 0, 1);
  }
  pags_sort(keys, surface->triangle_count, sizeof *keys, compare_faces);
  for (int64_t i = 0, end; i < surface->triangle_count; i = end) {
    int64_t even = 0;
    for (end = i; end < surface->triangle_count && !memcmp(keys[end].v, keys[i].v, sizeof keys[i].v); end++)
      even += !keys[end].odd;
    int64_t odd = end - i - even, pairs = even < odd ? even : odd;
    for (int64_t p = 0; p < pairs; p++) /* faces of even orientation come first, odd ones last */
      surface->triangles[3 * keys[i + p].triangle] = surface->triangles[3 * keys[end - 1 - p].triangle] = UINT32_MAX;
  }
  free(keys);
  int64_t kept = 0;
  for (int64_t i = 0; i < surface->triangle_count; i++)
    if (surface->triangles[3 * i] != UINT32_MAX)
      memmove(surface->triangles + 3 * kept++, surface->triangles + 3 * i, 3 * sizeof(uint32_t));
  surface->triangle_count = kept;

  /* Join the faces around each edge in pairs, and double the vertices of faces that aren't joined. */
  int64_t count = 3 * surface->triangle_count;
  half *halves = malloc(((size_t)count + 1) * sizeof *halves);
  int64_t *parent = malloc(((size_t)count + 1) * sizeof *parent);
  pags_result result = halves && parent ? PAGS_OK : pags_out_of_memory("%lld edges", (long long)count);
  for (int64_t i = 0; i < count && result == PAGS_OK; i++) {
    uint32_t a = surface->triangles[i], b = surface->triangles[next_corner(i)];
    parent[i] = i;
    halves[i] = (half){.low = a < b ? a : b, .high = a < b ? b : a, .id = i, .backward = a > b};
    halves[i].angle = angle_of(surface, &halves[i]);
  }
  if (result == PAGS_OK) {
    pags_sort(halves, count, sizeof *halves, compare_halves);
    for (int64_t i = 0, end; i < count; i = end) {
      for (end = i; end < count && halves[end].low == halves[i].low && halves[end].high == halves[i].high; end++)
        continue;
      join_edge(halves + i, end - i, parent);
    }
    result = renumber(surface, parent);
  }
  free(halves);
  free(parent);
  PAGS_TRY(result);

  for (int pass = 0; pass < PASSES && left; pass++)
    PAGS_TRY(part_edges(surface, &left));
  return PAGS_OK;
}
