/* SPDX-License-Identifier: Apache-2.0 */
/* Distances from points to the true surfaces of a synthetic street, which is built again from truth/street.json.
 *
 * The points are sorted into a grid of cells. Each triangle of the street, posed at the given time, visits the cells
 * that its bounding box, enlarged by the reach, touches, and lowers the distances of the points in them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "synth/faults.h"
#include "synth/street_labels.h"

struct pags_street_truth {
  pags_street_options options;
  pags_street street;
};

/* ---- The options of a street in truth/street.json ---- */

static const char *const truth_file = "truth/street.json";

pags_result pags_street_write_truth(const pags_street *street, const char *path) {
  const pags_street_options *o = street->options;
  pags_json_writer json;
  pags_json_writer_init(&json, 1);
  pags_json_begin_object(&json, NULL);
  pags_json_put_integer(&json, "frames", o->frames);
  pags_json_put_number(&json, "fps", o->fps);
  pags_json_put_integer(&json, "objects", o->objects);
  pags_json_put_unsigned(&json, "seed", o->seed);
  if (o->lively)
    pags_json_put_bool(&json, "lively", true);
  pags_faults_to_json(&json, &o->faults);
  pags_json_end_object(&json);
  const pags_result result = pags_json_writer_save(&json, path);
  pags_json_writer_destroy(&json);
  return result;
}

static pags_result read_options(const char *path, pags_street_options *out) {
  pags_json *json;
  double frames, fps, objects, seed;
  bool lively = false;
  PAGS_TRY(pags_json_parse_file(path, &json));
  const pags_json_value *root = pags_json_root(json);
  pags_result result = pags_json_number(json, root, "frames", &frames);
  if (result == PAGS_OK)
    result = pags_json_number(json, root, "fps", &fps);
  if (result == PAGS_OK)
    result = pags_json_number(json, root, "objects", &objects);
  if (result == PAGS_OK)
    result = pags_json_number(json, root, "seed", &seed);
  if (result == PAGS_OK)
    result = pags_json_bool_or(json, root, "lively", false, &lively);
  pags_json_destroy(json);
  PAGS_TRY(result);
  if (!(frames >= 2 && frames <= 10000 && fps >= 0.1 && fps <= 1000 && objects >= 0 && objects <= 64 && seed >= 0 &&
        seed < 0x1p53))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: a number lies outside of what a street can have", path);
  *out = pags_street_options_default();
  out->frames = (int)frames;
  out->fps = fps;
  out->objects = (int)objects;
  out->seed = (uint64_t)seed;
  out->lively = lively;
  return PAGS_OK;
}

pags_result pags_street_read_truth(const char *folder, pags_street_options *out, int *found) {
  *found = 0;
  *out = pags_street_options_default();
  char *path = pags_path_join(folder, truth_file);
  if (!path)
    return pags_out_of_memory(NULL);
  *found = pags_file_exists(path);
  const pags_result result = *found ? read_options(path, out) : PAGS_OK;
  free(path);
  return result;
}

pags_result pags_street_truth_open(const char *folder, pags_street_truth **out) {
  *out = NULL;
  pags_street_options options;
  int found;
  PAGS_TRY(pags_street_read_truth(folder, &options, &found));
  if (!found)
    return PAGS_OK;
  pags_street_truth *truth = calloc(1, sizeof *truth);
  if (!truth)
    return pags_out_of_memory("a street");
  truth->options = options;
  const pags_result result = pags_street_build(&truth->options, &truth->street);
  if (result == PAGS_OK)
    *out = truth;
  else
    pags_street_truth_close(truth);
  return result;
}

void pags_street_truth_close(pags_street_truth *truth) {
  if (!truth)
    return;
  pags_street_destroy(&truth->street);
  free(truth);
}

/* ---- The grid of points ---- */

typedef struct grid {
  const float *points;
  float lo[3], reach;
  int64_t size[3];
  int64_t *start; /* cell c holds order[start[c]] .. order[start[c + 1] - 1] */
  int32_t *order; /* point indices sorted by cell; points outside of the grid are left out */
} grid;

enum { LEAST_HEIGHT = -10, MOST_HEIGHT = 60, HALF_WIDTH = 120, MARGIN = 50 };
static const float cell_side = 1.0f; /* metres */

/* Returns the index of the cell that contains p, -1 if p lies outside of the grid. */
static int64_t cell_of(const grid *g, const float *p) {
  int64_t at[3];
  for (int k = 0; k < 3; k++) {
    const float x = (p[k] - g->lo[k]) / cell_side;
    if (!(x >= 0.0f && x < (float)g->size[k]))
      return -1;
    at[k] = (int64_t)x;
  }
  return (at[2] * g->size[1] + at[1]) * g->size[0] + at[0];
}

static pags_result make_grid(const pags_street *street, const float *points, int64_t count, float reach, grid *g) {
  *g = (grid){.points = points, .reach = reach};
  const float hi[3] = {street->end_x + MARGIN, HALF_WIDTH, MOST_HEIGHT};
  g->lo[0] = street->begin_x - MARGIN, g->lo[1] = -HALF_WIDTH, g->lo[2] = LEAST_HEIGHT;
  for (int k = 0; k < 3; k++)
    g->size[k] = (int64_t)ceilf((hi[k] - g->lo[k]) / cell_side);
  const int64_t cells = g->size[0] * g->size[1] * g->size[2];
  g->start = calloc((size_t)cells + 2, sizeof *g->start);
  g->order = malloc((size_t)(count > 0 ? count : 1) * sizeof *g->order);
  if (!g->start || !g->order)
    return pags_out_of_memory("%lld points", (long long)count);
  for (int64_t i = 0; i < count; i++) /* counted at cell + 2: start[cell] is right after filling */
    if (cell_of(g, points + 3 * i) >= 0)
      g->start[cell_of(g, points + 3 * i) + 2]++;
  for (int64_t c = 2; c <= cells; c++)
    g->start[c] += g->start[c - 1];
  for (int64_t i = 0; i < count; i++)
    if (cell_of(g, points + 3 * i) >= 0)
      g->order[g->start[cell_of(g, points + 3 * i) + 1]++] = (int32_t)i;
  return PAGS_OK;
}

/* ---- Distances ---- */

/* Squared distance from a point to a triangle: to its plane where the point projects into the triangle, else to the
 * nearest edge. */
static float to_triangle(const float p[3], const float corner[3][3]) {
  float edge[3][3], from[3][3], normal[3], nearest = INFINITY;
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) {
      edge[i][k] = corner[(i + 1) % 3][k] - corner[i][k];
      from[i][k] = p[k] - corner[i][k];
    }
  for (int k = 0; k < 3; k++)
    normal[k] = edge[0][(k + 1) % 3] * edge[1][(k + 2) % 3] - edge[0][(k + 2) % 3] * edge[1][(k + 1) % 3];
  int inside = 1;
  for (int i = 0; i < 3; i++) {
    /* Squared distance to edge i, the segment from corner i along edge[i]; from[i] = point - corner i. */
    const float length = pags_dot3f(edge[i], edge[i]);
    float t = length > 0.0f ? pags_dot3f(from[i], edge[i]) / length : 0.0f, sum = 0.0f;
    t = t > 0.0f ? t < 1.0f ? t : 1.0f : 0.0f;
    for (int k = 0; k < 3; k++) {
      const float d = from[i][k] - t * edge[i][k];
      sum += d * d;
    }
    const float along = sum;

    float side[3];
    for (int k = 0; k < 3; k++)
      side[k] = edge[i][(k + 1) % 3] * from[i][(k + 2) % 3] - edge[i][(k + 2) % 3] * from[i][(k + 1) % 3];
    nearest = along < nearest ? along : nearest;
    inside = inside && pags_dot3f(side, normal) >= 0.0f;
  }
  const float area = pags_dot3f(normal, normal), height = pags_dot3f(from[0], normal);
  return inside && area > 0.0f ? height * height / area : nearest;
}

static void visit(const grid *g, const float corner[3][3], float *nearest) {
  int64_t first[3], last[3];
  for (int k = 0; k < 3; k++) {
    const float lo = fminf(fminf(corner[0][k], corner[1][k]), corner[2][k]) - g->reach - g->lo[k];
    const float hi = fmaxf(fmaxf(corner[0][k], corner[1][k]), corner[2][k]) + g->reach - g->lo[k];
    first[k] = lo > 0.0f ? (int64_t)(lo / cell_side) : 0;
    last[k] = hi < 0.0f ? -1 : (int64_t)fminf(hi / cell_side, (float)(g->size[k] - 1));
  }
  for (int64_t z = first[2]; z <= last[2]; z++)
    for (int64_t y = first[1]; y <= last[1]; y++)
      for (int64_t x = first[0]; x <= last[0]; x++) {
        /* Lower the squared distances of the points in this cell. */
        int64_t cell = (z * g->size[1] + y) * g->size[0] + x;
        for (int64_t i = g->start[cell]; i < g->start[cell + 1]; i++) {
          const int32_t at = g->order[i];
          const float square = to_triangle(g->points + 3 * at, corner);
          nearest[at] = square < nearest[at] ? square : nearest[at];
        }
      }
}

static void place_vertex(const float m[12], const float p[3], float out[3]) {
  for (int k = 0; k < 3; k++)
    out[k] = m[4 * k] * p[0] + m[4 * k + 1] * p[1] + m[4 * k + 2] * p[2] + m[4 * k + 3];
}

static void visit_placement(const grid *g, const pags_mesh *mesh, const float pose[12], float *nearest) {
  for (int64_t f = 0; f < mesh->face_count; f++) {
    float quad[4][3], corner[3][3];
    for (int i = 0; i < 4; i++)
      place_vertex(pose, mesh->vertices[mesh->faces[4 * f + i]].position, quad[i]);
    for (int half = 0; half < 2; half++) {
      memcpy(corner[0], quad[0], sizeof quad[0]);
      memcpy(corner[1], quad[1 + half], sizeof quad[0]);
      memcpy(corner[2], quad[2 + half], sizeof quad[0]);
      visit(g, (const float(*)[3])corner, nearest);
    }
  }
}

pags_result pags_street_truth_distances(pags_street_truth *truth, double time, const float *points, int64_t count,
                                        double reach, float *critical, float *other) {
  pags_street *street = &truth->street;
  grid g;
  pags_result result = make_grid(street, points, count, (float)reach, &g);
  for (int64_t i = 0; i < count; i++)
    critical[i] = other[i] = INFINITY;
  pags_street_set_time(street, time);
  for (int i = 0; result == PAGS_OK && i < street->placement_count; i++) {
    const pags_stage_placement *p = &street->placements[i];
    visit_placement(&g, &street->meshes[p->mesh], p->pose, p->actor >= 0 ? critical : other);
  }
  for (int64_t i = 0; i < count; i++) {
    critical[i] = sqrtf(critical[i]);
    other[i] = sqrtf(other[i]);
  }
  free(g.start);
  free(g.order);
  return result;
}
