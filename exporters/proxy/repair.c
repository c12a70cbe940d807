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

#include "exporters/proxy/mesh.h"
#include "maths/maths.h"

/* A half-edge: one edge of one face. */
typedef struct half {
  uint32_t low, high; /* the vertices of the edge, the smaller index first */
  int64_t id;         /* 3 * triangle + the corner that the half-edge leaves from; -1: joined already */
  double angle;       /* the face's angle about the axis low -> high, radians */
  bool backward;      /* the face runs from high to low */
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
  bool odd;      /* sorting took an odd permutation: the face has the opposite orientation */
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
  key->odd = !key->odd;
}

/* ---- Cutting edges by doubling vertices ---- */

/* The angle, about the axis low -> high, of the face's third corner against a reference direction that depends only
 * on the axis. Sorting by it puts the faces of an edge in order around the edge. */
static double angle_of(const pags_proxy_mesh *s, const half *h) {
  double low[3], axis[3], arm[3], unit[3] = {0}, first[3], second[3];
  pags_proxy_mesh_point(s, h->low, low);
  pags_proxy_mesh_point(s, h->high, axis);
  pags_proxy_mesh_point(s, s->triangles[next_corner(next_corner(h->id))], arm);
  pags_subtract3(axis, low, axis);
  pags_subtract3(arm, low, arm);
  int smallest = 0;
  for (int k = 1; k < 3; k++)
    smallest = fabs(axis[k]) < fabs(axis[smallest]) ? k : smallest;
  unit[smallest] = 1;
  pags_cross3(axis, unit, first);
  pags_cross3(axis, first, second);
  return pags_atan2(pags_dot3(arm, second), pags_dot3(arm, first) * pags_length3(axis));
}

/* The half-edges of all faces, sorted by edge and then by angle; freed by the caller. NULL if out of memory. */
static half *sorted_halves(const pags_proxy_mesh *s) {
  const int64_t count = 3 * s->triangle_count;
  half *halves = malloc(((size_t)count + 1) * sizeof *halves);
  for (int64_t i = 0; halves && i < count; i++) {
    const uint32_t a = s->triangles[i], b = s->triangles[next_corner(i)];
    halves[i] = (half){.low = a < b ? a : b, .high = a < b ? b : a, .id = i, .backward = a > b};
    halves[i].angle = angle_of(s, &halves[i]);
  }
  if (halves)
    pags_sort(halves, count, sizeof *halves, compare_halves);
  return halves;
}

/* The end of the run of half-edges of one edge that begins at `begin`. */
static int64_t end_of_edge(const half *halves, int64_t begin, int64_t count) {
  int64_t end = begin;
  while (end < count && halves[end].low == halves[begin].low && halves[end].high == halves[begin].high)
    end++;
  return end;
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
      pags_set_join(parent, halves[i].id, next_corner(other->id));
      pags_set_join(parent, next_corner(halves[i].id), other->id);
      other->id = -1;
      break;
    }
    halves[i].id = -1;
  }
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
      const int64_t low = halves[i].low;
      float position[3], color[3];
      pags_add3f(s->positions + 3 * low, s->positions + 3 * (int64_t)halves[i].high, position);
      pags_scale3f(0.5f, position, position);
      pags_copy3f(s->colors + 3 * low, color); /* adding a vertex may move the array */
      uint32_t middle = pags_proxy_mesh_vertex(s, position, color, s->observed[low]);
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
  const int64_t count = 3 * s->triangle_count;
  PAGS_AUTOFREE half *halves = sorted_halves(s);
  PAGS_AUTOFREE uint8_t *split = calloc((size_t)s->triangle_count + 1, 1);
  *found = 0;
  PAGS_CHECK_MEMORY(halves && split, "%lld edges", (long long)count);
  for (int64_t i = 0, end; i < count; i = end) {
    end = end_of_edge(halves, i, count);
    if (end - i > 2) {
      ++*found;
      part_edge(s, halves + i, end - i, split);
    }
  }
  return pags_proxy_mesh_check(s);
}

/* ---- The repair ---- */

/* Removes pairs of faces of the same three vertices and opposite orientation. */
static pags_result drop_pairs(pags_proxy_mesh *s) {
  PAGS_AUTOFREE face_key *keys = malloc(((size_t)s->triangle_count + 1) * sizeof *keys);
  PAGS_CHECK_MEMORY(keys, "%lld triangles", (long long)s->triangle_count);
  for (int64_t i = 0; i < s->triangle_count; i++) {
    keys[i] = (face_key){.triangle = i};
    memcpy(keys[i].v, s->triangles + 3 * i, sizeof keys[i].v);
    swap_if(&keys[i], 0, 1);
    swap_if(&keys[i], 1, 2);
    swap_if(&keys[i], 0, 1);
  }
  pags_sort(keys, s->triangle_count, sizeof *keys, compare_faces);
  for (int64_t i = 0, end; i < s->triangle_count; i = end) {
    int64_t even = 0;
    for (end = i; end < s->triangle_count && !memcmp(keys[end].v, keys[i].v, sizeof keys[i].v); end++)
      even += !keys[end].odd;
    int64_t odd = end - i - even, pairs = even < odd ? even : odd;
    for (int64_t p = 0; p < pairs; p++) /* faces of even orientation come first, odd ones last */
      s->triangles[3 * keys[i + p].triangle] = s->triangles[3 * keys[end - 1 - p].triangle] = UINT32_MAX;
  }
  pags_proxy_mesh_drop_marked(s);
  return PAGS_OK;
}

/* Joins the faces around each edge in pairs, and rebuilds the mesh with one vertex for each set of joined corners,
 * which is found by its corner of the least number: vertices of faces that aren't joined are doubled. */
static pags_result double_vertices(pags_proxy_mesh *s) {
  const int64_t count = 3 * s->triangle_count;
  PAGS_AUTOFREE half *halves = sorted_halves(s);
  PAGS_AUTOFREE int64_t *parent = malloc(((size_t)count + 1) * sizeof *parent);
  PAGS_AUTOFREE uint32_t *place = malloc(((size_t)count + 1) * sizeof *place);
  pags_proxy_mesh out = {0};
  PAGS_CHECK_MEMORY(halves && parent && place, "%lld edges", (long long)count);
  for (int64_t i = 0; i < count; i++)
    parent[i] = i;
  for (int64_t i = 0, end; i < count; i = end) {
    end = end_of_edge(halves, i, count);
    join_edge(halves + i, end - i, parent);
  }
  for (int64_t i = 0; i < count; i++) {
    const int64_t root = pags_set_root(parent, i), v = s->triangles[i];
    place[i] =
        root == i ? pags_proxy_mesh_vertex(&out, s->positions + 3 * v, s->colors + 3 * v, s->observed[v]) : place[root];
  }
  for (int64_t i = 0; i < s->triangle_count; i++)
    pags_proxy_mesh_triangle(&out, place[3 * i], place[3 * i + 1], place[3 * i + 2]);
  pags_proxy_mesh_destroy(s);
  *s = out;
  return pags_proxy_mesh_check(s);
}

pags_result pags_proxy_mesh_repair(pags_proxy_mesh *surface) {
  enum { PASSES = 4 };
  int64_t left = 1;
  PAGS_TRY(drop_pairs(surface));
  PAGS_TRY(double_vertices(surface));
  for (int pass = 0; pass < PASSES && left; pass++)
    PAGS_TRY(part_edges(surface, &left));
  return PAGS_OK;
}
