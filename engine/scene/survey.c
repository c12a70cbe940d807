/* SPDX-License-Identifier: Apache-2.0 */
/* Surveys Gaussians on a grid of cells. A cell is solid if the Gaussians in it cover most of its side. A free cell is
 * surrounded if, of the 26 directions to its neighbours, rays meet something solid in nearly all that don't lead out
 * of one open side: rooms have such cells, streets too, whose open side is the sky. Objects hardly have any, since
 * training fills them. */
#include "scene/survey.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "maths/maths.h"

enum {
  LONGEST = 64,         /* cells along the longest side of the box */
  MOST_SAMPLES = 400000 /* Gaussians looked at: an even choice of more */
};

static const double least_opacity = 0.3; /* less opaque Gaussians are ignored */
static const double solid_cover = 0.3;   /* share of a cell's side that is covered if the cell is solid */
static const double least_room = 0.18;  /* cells of a room for each solid cell: objects have up to 0.14, streets 0.22 */
static const double least_height = 1.5; /* a hollow shell that is smaller in any direction is an object; metres */
static const double round_enough = 0.085; /* relative spread of distances from the middle: less is a ball, not a room */
static const double large_reach = 0.12; /* two usual sigmas by the longest side: captures have up to 0.055, toys 0.18 */

/* The extent of one Gaussian: its mean, and its two longer axes with their sigmas as lengths. */
typedef struct sample {
  double mean[3], axis[2][3], sigma[2];
  double weight; /* its opacity */
} sample;

void pags_survey_destroy(pags_survey *survey) {
  free(survey->cells);
  memset(survey, 0, sizeof *survey);
}

/* ---- Samples ---- */

static bool take_sample(const pags_gaussians *g, int64_t i, const double pose[12], double least, sample *out) {
  double q[4], r[9], sigma[3], mean[3];
  out->weight = 1 / (1 + pags_exp(-(double)pags_plane(g, PAGS_OPACITY)[i]));
  if (!(out->weight > least))
    return false;
  for (int k = 0; k < 4; k++)
    q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[i];
  pags_rotation_from_quaternion(q, r);
  int thin = 0;
  for (int k = 0; k < 3; k++) {
    sigma[k] = pags_exp(fmin((double)pags_plane(g, PAGS_SCALE + k)[i], 30));
    thin = sigma[k] < sigma[thin] ? k : thin;
  }
  pags_gaussian_mean(g, i, mean);
  pags_rigid_point(pose, mean, out->mean);
  for (int a = 0; a < 2; a++) {
    const int column = (thin + 1 + a) % 3;
    const double axis[3] = {r[column], r[3 + column], r[6 + column]};
    out->sigma[a] = sigma[column];
    pags_rotate3(pose, axis, out->axis[a]);
  }
  return isfinite(out->mean[0]) && isfinite(out->mean[1]) && isfinite(out->mean[2]);
}

/* Takes samples of the Gaussians of the background and of all objects that are there at the scene's begin. `weight` of
 * an even choice represents the others. */
static pags_result take_samples(const pags_scene *scene, double least, sample **out, int64_t *count) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  const int64_t every = pags_scene_gaussian_count(scene) / MOST_SAMPLES + 1;
  *out = malloc(((size_t)(pags_scene_gaussian_count(scene) / every) + (size_t)scene->model_count + 1) * sizeof **out);
  *count = 0;
  PAGS_CHECK_MEMORY(*out, "a survey");
  for (int64_t m = 0; m < scene->model_count; m++) {
    double pose[12];
    bool there = m == 0;
    memcpy(pose, identity, sizeof pose);
    for (int64_t o = 0; o < scene->object_count && !there; o++)
      there = scene->objects[o].model == m && pags_object_pose(&scene->objects[o].record, scene->time_begin, pose);
    if (m > 0)
      pags_pose_subtract(pose, scene->origin);
    for (int64_t i = 0; there && i < scene->models[m].gaussians.count; i += every)
      if (take_sample(&scene->models[m].gaussians, i, pose, least, &(*out)[*count]))
        (*out)[(*count)++].weight *= (double)every;
  }
  return PAGS_OK;
}

/* ---- The box ---- */

/* Bounds the means: the middle 90 % of them, widened by as much on both sides, but no farther than 99.8 % reach.
 * Gaussians farther away are floaters, or the far background of an object. A flat scene or a single point has an extent
 * of at least `reach`. */
static pags_result bound_samples(const sample *samples, int64_t count, double reach, double lo[3], double hi[3]) {
  PAGS_AUTOFREE double *values = malloc(((size_t)count + 1) * sizeof *values);
  PAGS_CHECK_MEMORY(values, "a survey");
  for (int k = 0; k < 3; k++) {
    for (int64_t i = 0; i < count; i++)
      values[i] = samples[i].mean[k];
    pags_sort_doubles(values, count);
    const double last = (double)(count - 1);
    const double low = values[(int64_t)(0.05 * last)], high = values[(int64_t)(0.95 * last)];
    lo[k] = fmax(values[(int64_t)(0.001 * last)], low - (high - low));
    hi[k] = fmin(values[(int64_t)ceil(0.999 * last)], high + (high - low));
    const double middle = 0.5 * (lo[k] + hi[k]);
    lo[k] = fmin(lo[k], middle - reach);
    hi[k] = fmax(hi[k], middle + reach);
  }
  return PAGS_OK;
}

static int64_t cell_count(const pags_survey *s) {
  return (int64_t)s->n[0] * s->n[1] * s->n[2];
}

/* Lays cells over a box, with a margin of two cells. */
static pags_result lay_cells(const double lo[3], const double hi[3], pags_survey *out) {
  const double longest = fmax(fmax(hi[0] - lo[0], hi[1] - lo[1]), fmax(hi[2] - lo[2], 1e-6));
  out->step = longest / LONGEST;
  for (int k = 0; k < 3; k++) {
    out->n[k] = (int)ceil((hi[k] - lo[k]) / out->step) + 5;
    out->origin[k] = 0.5 * (lo[k] + hi[k] - out->n[k] * out->step);
  }
  free(out->cells);
  out->cells = calloc((size_t)cell_count(out), 1);
  PAGS_CHECK_MEMORY(out->cells, "a survey");
  return PAGS_OK;
}

static int64_t cell_at(const pags_survey *s, const double point[3]) {
  int at[3];
  for (int k = 0; k < 3; k++) {
    const double c = floor((point[k] - s->origin[k]) / s->step);
    if (!(c >= 0 && c < s->n[k]))
      return -1;
    at[k] = (int)c;
  }
  return ((int64_t)at[2] * s->n[1] + at[1]) * s->n[0] + at[0];
}

int pags_survey_cell(const pags_survey *survey, const double point[3]) {
  const int64_t at = survey->cells ? cell_at(survey, point) : -1;
  return at < 0 ? PAGS_CELL_FREE : survey->cells[at];
}

/* Marks the cells that Gaussians cover: a Gaussian's disc of one sigma is divided into patches, each of which covers
 * its share of the cell that it is in. */
static pags_result mark_solid(const sample *samples, int64_t count, pags_survey *s) {
  PAGS_AUTOFREE float *cover = calloc((size_t)cell_count(s), sizeof *cover);
  PAGS_CHECK_MEMORY(cover, "a survey");
  for (int64_t i = 0; i < count; i++) {
    const sample *g = &samples[i];
    int half[2];
    for (int a = 0; a < 2; a++)
      half[a] = (int)fmin(floor(g->sigma[a] / s->step) + 1, 8);
    const double patches = (2 * half[0] + 1) * (2 * half[1] + 1);
    const double share = g->weight * fmin(1, 6 * g->sigma[0] * g->sigma[1] / (patches * s->step * s->step));
    for (int u = -half[0]; u <= half[0]; u++)
      for (int v = -half[1]; v <= half[1]; v++) {
        double p[3];
        for (int k = 0; k < 3; k++)
          p[k] = g->mean[k] + fmin(g->sigma[0], 8 * s->step) * u / half[0] * g->axis[0][k] +
                 fmin(g->sigma[1], 8 * s->step) * v / half[1] * g->axis[1][k];
        const int64_t at = cell_at(s, p);
        if (at >= 0)
          cover[at] += (float)share;
      }
  }
  for (int64_t i = 0; i < cell_count(s); i++)
    s->cells[i] = (double)cover[i] > solid_cover ? PAGS_CELL_SOLID : PAGS_CELL_FREE;
  return PAGS_OK;
}

/* The box of the solid cells, a two-hundredth at either end of each axis left out. */
static void bound_solid(pags_survey *s) {
  for (int k = 0; k < 3; k++) {
    int64_t counts[LONGEST + 6] = {0}, all = 0, below = 0, above = 0; /* of each layer of cells */
    for (int64_t i = 0; i < cell_count(s); i++)
      if (s->cells[i] == PAGS_CELL_SOLID) {
        const int64_t at[3] = {i % s->n[0], i / s->n[0] % s->n[1], i / s->n[0] / s->n[1]};
        counts[at[k]]++;
        all++;
      }
    int first = 0, last = s->n[k] - 1;
    while (first < last && (below += counts[first]) * 200 <= all)
      first++;
    while (last > first && (above += counts[last]) * 200 <= all)
      last--;
    if (all) {
      s->lo[k] = s->origin[k] + first * s->step;
      s->hi[k] = s->origin[k] + (last + 1) * s->step;
    }
  }
}

/* ---- Rooms ---- */

/* Sets bit d of met[cell] if the ray from the cell in direction d, one of the 27 steps to a neighbour, meets a solid
 * cell. Cells are visited against the direction, so that the neighbour is known. */
static void look_along(const pags_survey *s, int direction, uint32_t *met) {
  const int d[3] = {direction % 3 - 1, direction / 3 % 3 - 1, direction / 9 - 1};
  const uint32_t bit = (uint32_t)1 << direction;
  for (int iz = 0; iz < s->n[2]; iz++)
    for (int iy = 0; iy < s->n[1]; iy++)
      for (int ix = 0; ix < s->n[0]; ix++) {
        const int at[3] = {d[0] > 0 ? s->n[0] - 1 - ix : ix, d[1] > 0 ? s->n[1] - 1 - iy : iy,
                           d[2] > 0 ? s->n[2] - 1 - iz : iz};
        bool outside = false;
        for (int k = 0; k < 3; k++)
          outside = outside || at[k] + d[k] < 0 || at[k] + d[k] >= s->n[k];
        if (outside)
          continue;
        const int64_t own = ((int64_t)at[2] * s->n[1] + at[1]) * s->n[0] + at[0];
        const int64_t next = own + ((int64_t)d[2] * s->n[1] + d[1]) * s->n[0] + d[0];
        if (s->cells[next] == PAGS_CELL_SOLID || (met[next] & bit))
          met[own] |= bit;
      }
}

/* Whether rays meet something in at least 12 of the 17 directions that don't lead through the most open of the six
 * sides. */
static bool is_surrounded(uint32_t met) {
  for (int side = 0; side < 6; side++) {
    uint32_t through = 0;
    for (int d = 0; d < 27; d++) {
      const int step[3] = {d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1};
      through |= step[side / 2] == (side % 2 ? 1 : -1) ? (uint32_t)1 << d : 0;
    }
    if (__builtin_popcount(met & ~through) >= 12)
      return true;
  }
  return false;
}

/* Whether nothing within two cells of this one is solid. */
static bool is_clear(const pags_survey *s, int x, int y, int z) {
  if (x < 2 || y < 2 || z < 2 || x + 2 >= s->n[0] || y + 2 >= s->n[1] || z + 2 >= s->n[2])
    return false;
  for (int i = 0; i < 125; i++) {
    const int64_t at = ((int64_t)(z + i / 25 - 2) * s->n[1] + (y + i / 5 % 5 - 2)) * s->n[0] + (x + i % 5 - 2);
    if (s->cells[at] == PAGS_CELL_SOLID)
      return false;
  }
  return true;
}

/* Keeps the largest connected set of room cells; the others become free. `queue` has room for all cells. */
static void keep_largest(pags_survey *s, int64_t *queue, uint32_t *label) {
  const int64_t steps[3] = {1, s->n[0], (int64_t)s->n[0] * s->n[1]}, cells = cell_count(s);
  int64_t largest = 0;
  uint32_t labels = 0, kept = 0;
  memset(label, 0, (size_t)cells * sizeof *label);
  for (int64_t i = 0; i < cells; i++) {
    if (s->cells[i] != PAGS_CELL_ROOM || label[i])
      continue;
    int64_t read = 0, written = 0;
    label[i] = ++labels;
    queue[written++] = i;
    while (read < written) { /* room cells are never at the border of the grid: all six neighbours exist */
      const int64_t at = queue[read++];
      for (int d = 0; d < 6; d++) {
        const int64_t next = at + (d % 2 ? steps[d / 2] : -steps[d / 2]);
        if (s->cells[next] == PAGS_CELL_ROOM && !label[next]) {
          label[next] = labels;
          queue[written++] = next;
        }
      }
    }
    if (written > largest) {
      largest = written;
      kept = labels;
    }
  }
  for (int64_t i = 0; i < cells; i++)
    if (s->cells[i] == PAGS_CELL_ROOM && label[i] != kept)
      s->cells[i] = PAGS_CELL_FREE;
}

static void middle_of(const pags_survey *s, int64_t cell, double out[3]) {
  const int64_t at[3] = {cell % s->n[0], cell / s->n[0] % s->n[1], cell / s->n[0] / s->n[1]};
  for (int k = 0; k < 3; k++)
    out[k] = s->origin[k] + ((double)at[k] + 0.5) * s->step;
}

/* Marks the cells of the room, and finds their middle. */
static pags_result mark_room(pags_survey *s) {
  const int64_t cells = cell_count(s);
  PAGS_AUTOFREE uint32_t *met = calloc((size_t)cells, sizeof *met);
  PAGS_AUTOFREE int64_t *queue = malloc((size_t)cells * sizeof *queue);
  int64_t count = 0, solid = 0;
  PAGS_CHECK_MEMORY(met && queue, "a survey");
  for (int d = 0; d < 27; d++)
    if (d != 13)
      look_along(s, d, met);
  for (int64_t i = 0; i < cells; i++)
    if (s->cells[i] != PAGS_CELL_SOLID && is_surrounded(met[i]) &&
        is_clear(s, (int)(i % s->n[0]), (int)(i / s->n[0] % s->n[1]), (int)(i / s->n[0] / s->n[1])))
      s->cells[i] = PAGS_CELL_ROOM;
  keep_largest(s, queue, met);
  double sum[3] = {0}, p[3];
  for (int64_t i = 0; i < cells; i++)
    if (s->cells[i] == PAGS_CELL_SOLID) {
      solid++;
    } else if (s->cells[i] == PAGS_CELL_ROOM) {
      middle_of(s, i, p);
      count++;
      pags_add3(sum, p, sum);
    }
  s->surrounded = solid ? (double)count / (double)solid : 0;
  for (int k = 0; k < 3; k++)
    s->middle[k] = count ? sum[k] / (double)count : 0.5 * (s->lo[k] + s->hi[k]);
  return PAGS_OK;
}

/* Whether the solid cells lie on a ball about the middle of the box. */
static bool is_round(const pags_survey *s) {
  const double middle[3] = {0.5 * (s->lo[0] + s->hi[0]), 0.5 * (s->lo[1] + s->hi[1]), 0.5 * (s->lo[2] + s->hi[2])};
  double sum = 0, squares = 0, count = 0;
  for (int64_t i = 0; i < cell_count(s); i++) {
    double p[3];
    if (s->cells[i] != PAGS_CELL_SOLID)
      continue;
    middle_of(s, i, p);
    const double distance = pags_distance3(p, middle);
    sum += distance;
    squares += distance * distance;
    count++;
  }
  return count > 0 &&
         squares / count - sum / count * (sum / count) < round_enough * sum / count * (round_enough * sum / count);
}

/* ---- The survey ---- */

static pags_result survey(const sample *samples, int64_t count, pags_survey *s) {
  double reach = 0; /* two usual sigmas */
  for (int64_t i = 0; i < count; i++)
    reach += 2 * fmax(samples[i].sigma[0], samples[i].sigma[1]) / (double)count;
  PAGS_TRY(bound_samples(samples, count, reach, s->lo, s->hi));
  for (int pass = 0; pass < 2; pass++) { /* the second time with cells of the box that is really filled */
    PAGS_TRY(lay_cells(s->lo, s->hi, s));
    PAGS_TRY(mark_solid(samples, count, s));
    if (pass == 0)
      bound_solid(s);
  }
  PAGS_TRY(mark_room(s));
  const double least = fmin(fmin(s->hi[0] - s->lo[0], s->hi[1] - s->lo[1]), s->hi[2] - s->lo[2]);
  s->inside = s->surrounded >= least_room && least >= least_height && !is_round(s);

  /* Where the Gaussians are large compared with the scene, as in models of a few, the box holds them whole. */
  const double longest = fmax(fmax(s->hi[0] - s->lo[0], s->hi[1] - s->lo[1]), s->hi[2] - s->lo[2]);
  for (int k = 0; k < 3 && reach > large_reach * longest; k++) {
    s->lo[k] -= reach;
    s->hi[k] += reach;
  }
  return PAGS_OK;
}

pags_result pags_survey_make(const pags_scene *scene, pags_survey *out) {
  PAGS_AUTOFREE sample *samples = NULL, *fainter = NULL;
  int64_t count;
  *out = (pags_survey){.lo = {-0.5, -0.5, -0.5}, .hi = {0.5, 0.5, 0.5}};
  PAGS_TRY(take_samples(scene, least_opacity, &samples, &count));
  const bool faint = !count;
  if (faint)
    PAGS_TRY(take_samples(scene, 0, &fainter, &count));
  const pags_result result = count ? survey(faint ? fainter : samples, count, out) : PAGS_OK;
  if (result != PAGS_OK)
    pags_survey_destroy(out);
  return result;
}

int pags_survey_places(const pags_survey *survey, int most, double (*places)[3]) {
  int count = 0;
  for (; survey->cells && count < most; count++) {
    double best = count ? 2.25 * survey->step * survey->step : HUGE_VAL, p[3];
    int64_t chosen = -1;
    for (int64_t i = 0; i < cell_count(survey); i++) {
      if (survey->cells[i] != PAGS_CELL_ROOM)
        continue;
      double nearest = HUGE_VAL;
      middle_of(survey, i, p);
      const double to_middle = pags_distance_squared3(p, survey->middle);
      for (int j = 0; j < count; j++)
        nearest = fmin(nearest, pags_distance_squared3(p, places[j]));
      if (count ? nearest > best : to_middle < best) { /* the first is the one nearest to the middle */
        best = count ? nearest : to_middle;
        chosen = i;
      }
    }
    if (chosen < 0)
      return count;
    middle_of(survey, chosen, places[count]);
  }
  return count;
}
