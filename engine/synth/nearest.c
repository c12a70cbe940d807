/* SPDX-License-Identifier: Apache-2.0 */
/* Distances from points to the true surfaces of a synthetic street, which is built again from truth/street.json.
 *
 * The points are sorted into a grid of cells. Each triangle of the street, posed at the given time, visits the cells
 * that its bounding box, enlarged by the reach, touches, and lowers the distances of the points in them. */
#include <math.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "synth/faults.h"

struct pags_street_truth {
  pags_street_options options;
  pags_street street;
};

PAGS_DEFINE_AUTO(pags_street_truth, pags_street_truth_close)

/* ---- The options of a street in truth/street.json ---- */

pags_result pags_street_write_truth(const pags_street *street, const char *path) {
  const pags_street_options *o = street->options;
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer json;
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
  return pags_json_writer_save(&json, path);
}

pags_result pags_street_read_truth(const char *folder, pags_street_options *out, bool *found) {
  double frames, fps, objects, seed;
  bool lively = false;
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  *out = pags_street_options_default();
  *found = false;
  PAGS_TRY(pags_json_parse_in_folder(folder, "truth/street.json", &json));
  *found = json;
  if (!json)
    return PAGS_OK;
  const pags_json_value *root = pags_json_root(json);
  PAGS_TRY(pags_json_number(json, root, "frames", &frames));
  PAGS_TRY(pags_json_number(json, root, "fps", &fps));
  PAGS_TRY(pags_json_number(json, root, "objects", &objects));
  PAGS_TRY(pags_json_number(json, root, "seed", &seed));
  PAGS_TRY(pags_json_bool_or(json, root, "lively", false, &lively));
  if (!(frames >= 2 && frames <= 10000 && fps >= 0.1 && fps <= 1000 && objects >= 0 && objects <= 64 && seed >= 0 &&
        seed < 0x1p53))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: a number lies outside of what a street can have", pags_json_path(json));
  out->frames = (int)frames;
  out->fps = fps;
  out->objects = (int)objects;
  out->seed = (uint64_t)seed;
  out->lively = lively;
  return PAGS_OK;
}

pags_result pags_street_truth_open(const char *folder, pags_street_truth **out) {
  *out = NULL;
  pags_street_options options;
  bool found;
  PAGS_TRY(pags_street_read_truth(folder, &options, &found));
  if (!found)
    return PAGS_OK;
  PAGS_AUTO(pags_street_truth_close_auto) pags_street_truth *truth = calloc(1, sizeof *truth);
  PAGS_CHECK_MEMORY(truth, "a street");
  truth->options = options;
  PAGS_TRY(pags_street_build(&truth->options, &truth->street));
  *out = pags_take(&truth);
  return PAGS_OK;
}

void pags_street_truth_close(pags_street_truth *truth) {
  if (truth)
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

static void free_grid(grid *g) {
  free(g->start);
  free(g->order);
}

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
  PAGS_CHECK_MEMORY(g->start && g->order, "%lld points", (long long)count);
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
  for (int i = 0; i < 3; i++) {
    pags_subtract3f(corner[(i + 1) % 3], corner[i], edge[i]);
    pags_subtract3f(p, corner[i], from[i]);
  }
  pags_cross3f(edge[0], edge[1], normal);
  bool inside = true;
  for (int i = 0; i < 3; i++) {
    /* Squared distance to edge i, the segment from corner i along edge[i]; from[i] = point - corner i. */
    const float length = pags_dot3f(edge[i], edge[i]);
    float t = length > 0.0f ? pags_dot3f(from[i], edge[i]) / length : 0.0f, off[3], side[3];
    t = t > 0.0f ? t < 1.0f ? t : 1.0f : 0.0f;
    pags_along3f(from[i], -t, edge[i], off);
    const float square = pags_dot3f(off, off);
    nearest = square < nearest ? square : nearest;
    pags_cross3f(edge[i], from[i], side);
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

pags_result pags_street_truth_distances(pags_street_truth *truth, double time, const float *points, int64_t count,
                                        double reach, float *critical, float *other) {
  pags_street *street = &truth->street;
  PAGS_AUTO(free_grid) grid g = {0};
  for (int64_t i = 0; i < count; i++)
    critical[i] = other[i] = INFINITY;
  PAGS_TRY(make_grid(street, points, count, (float)reach, &g));
  pags_street_set_time(street, time);
  for (int i = 0; i < street->placement_count; i++) {
    const pags_stage_placement *p = &street->placements[i];
    const pags_mesh *mesh = &street->meshes[p->mesh];
    for (int64_t f = 0; f < mesh->face_count; f++) {
      float quad[4][3], corner[3][3];
      for (int c = 0; c < 4; c++)
        pags_transform3f(p->pose, mesh->vertices[mesh->faces[4 * f + c]].position, quad[c]);
      for (int half = 0; half < 2; half++) {
        pags_copy3f(quad[0], corner[0]);
        pags_copy3f(quad[1 + half], corner[1]);
        pags_copy3f(quad[2 + half], corner[2]);
        visit(&g, (const float(*)[3])corner, p->actor >= 0 ? critical : other);
      }
    }
  }
  for (int64_t i = 0; i < count; i++) {
    critical[i] = sqrtf(critical[i]);
    other[i] = sqrtf(other[i]);
  }
  return PAGS_OK;
}
