/* SPDX-License-Identifier: Apache-2.0 */
/* pags_pick: finds the Gaussian by which a ray has lost a given fraction of its light. Rejects clusters by their
 * boxes, then tests Gaussian by Gaussian.
 *
 * A ray meets a Gaussian at the point where the Gaussian's density along the ray is largest, if alpha is at
 * least the part's a (1/255, or alpha_min) there. Then the Gaussian's mean is within sqrt(2 ln(opacity / a)) sigma of
 * this point. So a cluster's box, widened by that many of its largest sigma, holds every point where the ray meets a
 * member: a ray that misses the widened box meets no member, and one that enters it meets none before. Clusters are
 * visited in the order of their entry points. As soon as the Gaussians met before the next cluster's entry have blocked
 * enough, the remaining clusters can't change the result. */
#include <pags/pick.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "frame/stages.h"
#include "maths/maths.h"
#include "scene/packed_rows.h"

enum { RUN = 64 }; /* clusters that one entry of pags_clusters.runs bounds */

static const double most_alpha = 0.99; /* as in the rasteriser */
static const char picking_among[] = "picking among %lld";

/* The least alpha of a part before its cut (pags_gaussians.alpha_min). */
static double least_alpha(const pags_part *part) {
  return part->gaussians->alpha_min > 0 ? (double)part->gaussians->alpha_min : 1.0 / 255;
}

typedef struct entry { /* where the ray enters a cluster's widened box */
  double t;
  int64_t cluster;
  int part;
} entry;

typedef struct meeting { /* a Gaussian that the ray meets, at ray parameter t with this alpha */
  double t, alpha;
  int64_t row;
  int32_t id;
  int part;
} meeting;

typedef struct picking {
  const pags_part *parts;
  const pags_pick_options *options;
  double origin[3], direction[3]; /* the ray in the frame of part `part` */
  entry *entries;
  meeting *meetings;
  int64_t entry_count, entry_capacity, meeting_count, meeting_capacity;
  int part;
} picking;

pags_pick_options pags_pick_options_default(void) {
  return (pags_pick_options){.farthest = HUGE_VAL, .blocked = 0.5};
}

/* ---- Clusters that the ray enters ---- */

/* The ray parameter at which the ray enters the box of cluster or run i, widened by `reach` sigmas; -1 where it
 * misses the box between options.nearest and options.farthest. A small margin covers the rounding of the float
 * bounds. */
static double enter(const picking *self, const pags_clusters *clusters, int64_t i, double reach) {
  double begin = self->options->nearest, end = self->options->farthest,
         pad = reach * (double)clusters->sigma[i] * 1.0001 + 1e-9;
  for (int k = 0; k < 3; k++) {
    double lo = (double)clusters->lo[k][i] - pad - self->origin[k],
           hi = (double)clusters->hi[k][i] + pad - self->origin[k];
    double d = self->direction[k];
    if (d == 0) {
      if (lo > 0 || hi < 0)
        return -1;
      continue;
    }
    double a = lo / d, b = hi / d;
    begin = fmax(begin, fmin(a, b));
    end = fmin(end, fmax(a, b));
  }
  return begin <= end ? begin : -1;
}

/* Appends to `entries` the clusters of the current part whose widened boxes the ray enters. */
static pags_result find_entries(picking *self) {
  const pags_part *part = &self->parts[self->part];
  const pags_clusters *clusters = part->clusters;
  const double most = (part->opacity_factor ? (double)part->opacity_factor_most : 1) / least_alpha(part);
  if (!(most > 1)) /* no Gaussian of the part can have its least alpha */
    return PAGS_OK;
  const double reach = sqrt(2 * pags_log(most)); /* the largest distance from a mean, in sigmas, at which one can */
  for (int64_t i = 0; i < clusters->count; i++) {
    if (clusters->runs && i % RUN == 0 && enter(self, clusters->runs, i / RUN, reach) < 0) {
      i += RUN - 1;
      continue;
    }
    double t = enter(self, clusters, i, reach);
    if (t < 0)
      continue;
    PAGS_CHECK_MEMORY(pags_grow(&self->entries, self->entry_count + 1, &self->entry_capacity, sizeof *self->entries),
                      picking_among, (long long)self->entry_count);
    self->entries[self->entry_count++] = (entry){t, i, self->part};
  }
  return PAGS_OK;
}

static int compare_entries(const void *left, const void *right) {
  const entry *a = left, *b = right;
  return a->t != b->t         ? (a->t < b->t ? -1 : 1)
         : a->part != b->part ? (a->part < b->part ? -1 : 1)
                              : (a->cluster > b->cluster) - (a->cluster < b->cluster);
}

/* Makes `part` the current part and transforms the ray into its frame. */
static void enter_part(picking *self, int part, const double origin[3], const double direction[3]) {
  double model_from_world[12];
  self->part = part;
  pags_affine_inverse(self->parts[part].world_from_model, model_from_world);
  const double *m = model_from_world;
  for (int k = 0; k < 3; k++) {
    self->origin[k] = m[4 * k + 3];
    self->direction[k] = 0;
    for (int j = 0; j < 3; j++) {
      self->origin[k] += m[4 * k + j] * (origin[j] - self->options->origin[j]);
      self->direction[k] += m[4 * k + j] * direction[j];
    }
  }
}

/* ---- Gaussians that the ray meets ---- */

/* Alpha of row i of `planes` (`stride` floats each) where the ray meets it, and *t, the ray parameter there. `factor`
 * scales the opacity. Returns 0 where the ray doesn't meet it: alpha below the part's least, or *t out of range. */
static double meet(const picking *self, const float *planes, int64_t stride, int64_t i, double factor, double *t) {
  const float *p = planes + i;
  const double q[4] = {(double)p[PAGS_ROTATION * stride], (double)p[(PAGS_ROTATION + 1) * stride],
                       (double)p[(PAGS_ROTATION + 2) * stride], (double)p[(PAGS_ROTATION + 3) * stride]};
  double r[9], away[3], unit_away[3], unit_along[3], dot = 0, along = 0, off = 0;
  pags_rotation_from_quaternion(q, r);
  for (int k = 0; k < 3; k++)
    away[k] = self->origin[k] - (double)p[(PAGS_MEAN + k) * stride];
  for (int k = 0; k < 3; k++) { /* to the Gaussian's own axes, the columns of r, in units of its sigmas */
    double inverse = pags_exp(-(double)p[(PAGS_SCALE + k) * stride]);
    unit_away[k] = (r[k] * away[0] + r[3 + k] * away[1] + r[6 + k] * away[2]) * inverse;
    unit_along[k] =
        (r[k] * self->direction[0] + r[3 + k] * self->direction[1] + r[6 + k] * self->direction[2]) * inverse;
    dot += unit_away[k] * unit_along[k];
    along += unit_along[k] * unit_along[k];
  }
  *t = -dot / along;
  for (int k = 0; k < 3; k++) {
    double d = unit_away[k] + *t * unit_along[k];
    off += d * d;
  }
  double alpha = factor / (1 + pags_exp(-(double)p[PAGS_OPACITY * stride])) * pags_exp(-0.5 * off);
  const pags_part *part = &self->parts[self->part];
  const double least = least_alpha(part);
  const bool met = *t >= self->options->nearest && *t <= self->options->farthest && alpha >= least; /* false for NaN */
  if (part->gaussians->alpha_min > 0)
    alpha = (alpha - least) / (1 - least);
  return !met ? 0 : alpha < most_alpha ? alpha : most_alpha;
}

static int compare_meetings(const void *left, const void *right) {
  const meeting *a = left, *b = right;
  return a->t != b->t     ? (a->t < b->t ? -1 : 1)
         : a->id != b->id ? (a->id < b->id ? -1 : 1)
                          : (a->part > b->part) - (a->part < b->part);
}

/* Sorts the meetings and returns the one by which at least options.blocked of the ray is blocked, of those at t <
 * `end`; NULL where these block less. *blocked: the fraction that is blocked with it. */
static const meeting *settle(picking *self, double end, double *blocked) {
  double left = 1;
  pags_sort(self->meetings, self->meeting_count, sizeof *self->meetings, compare_meetings);
  for (int64_t i = 0; i < self->meeting_count && self->meetings[i].t < end; i++) {
    left *= 1 - self->meetings[i].alpha;
    if (1 - left >= self->options->blocked) {
      *blocked = 1 - left;
      return &self->meetings[i];
    }
  }
  return NULL;
}

/* Visits the clusters in the order in which the ray enters them and collects the Gaussians that it meets, until
 * enough is blocked. The meetings are only sorted and summed again when their number has grown by half, so that the
 * total cost of these checks stays proportional to the number of meetings. */
static pags_result walk(picking *self, const double origin[3], const double direction[3], const meeting **found,
                        double *blocked) {
  int64_t looked = 0;
  pags_sort(self->entries, self->entry_count, sizeof *self->entries, compare_entries);
  for (int64_t i = 0; i < self->entry_count; i++) {
    if (self->meeting_count > looked + looked / 2) {
      looked = self->meeting_count;
      *found = settle(self, self->entries[i].t, blocked);
      if (*found)
        return PAGS_OK;
    }
    if (self->entries[i].part != self->part)
      enter_part(self, self->entries[i].part, origin, direction);

    /* Collects the cluster's members that the ray meets. */
    const pags_part *part = &self->parts[self->entries[i].part];
    float unpacked[PAGS_PACKED_GEOMETRY_PLANES * PAGS_PACKED_ROWS];
    int64_t first = self->entries[i].cluster * part->clusters->size, end = first + part->clusters->size;
    end = end < part->gaussians->count ? end : part->gaussians->count;
    if (part->packed)
      pags_packed_geometry(part->packed, self->entries[i].cluster, unpacked);
    for (int64_t row = first; row < end; row++) {
      double t, factor = part->opacity_factor ? (double)part->opacity_factor[row] : 1;
      double alpha = part->packed ? meet(self, unpacked, PAGS_PACKED_ROWS, row - first, factor, &t)
                                  : meet(self, part->gaussians->data, part->gaussians->stride, row, factor, &t);
      if (alpha <= 0)
        continue;
      PAGS_CHECK_MEMORY(
          pags_grow(&self->meetings, self->meeting_count + 1, &self->meeting_capacity, sizeof *self->meetings),
          picking_among, (long long)self->meeting_count);
      self->meetings[self->meeting_count++] = (meeting){t, alpha, row, part_id(part, row), self->entries[i].part};
    }
  }
  *found = settle(self, HUGE_VAL, blocked);
  return PAGS_OK;
}

/* ---- Picking ---- */

static void release(picking *self) {
  free(self->entries);
  free(self->meetings);
}

pags_result pags_pick(const pags_part *parts, int part_count, const double origin[3], const double direction[3],
                      const pags_pick_options *options, pags_picked *out) {
  const pags_pick_options fallback = pags_pick_options_default();
  PAGS_AUTO(release) picking self = {.parts = parts, .options = options ? options : &fallback, .part = -1};
  double length = 0, blocked = 0;
  *out = (pags_picked){.part = -1, .id = -1, .object = -1};
  for (int k = 0; k < 3; k++)
    length += direction[k] * direction[k] + 0 * origin[k];
  if (!(length > 0 && isfinite(length)))
    return pags_fail(PAGS_ERROR_ARGUMENT, "a ray: expected finite numbers and a direction of some length");
  for (int i = 0; i < part_count; i++) {
    enter_part(&self, i, origin, direction);
    PAGS_TRY(find_entries(&self));
  }
  const meeting *found = NULL;
  PAGS_TRY(walk(&self, origin, direction, &found, &blocked));
  if (!found)
    return PAGS_OK;
  const pags_gaussians *g = parts[found->part].gaussians;
  *out = (pags_picked){.part = found->part,
                       .row = found->row,
                       .id = found->id,
                       .depth = found->t,
                       .alpha = found->alpha,
                       .blocked = blocked,
                       .object = g->object_id && !parts[found->part].packed ? g->object_id[found->row] : -1};
  pags_along3(origin, found->t, direction, out->point);
  return PAGS_OK;
}

pags_result pags_composition_pick(const pags_composition *composition, const pags_part *parts, int part_count,
                                  const double origin[3], const double direction[3], const pags_pick_options *options,
                                  pags_picked *out) {
  const pags_scene *scene = pags_composition_scene(composition);
  pags_pick_options own = options ? *options : pags_pick_options_default();
  memcpy(own.origin, scene->origin, sizeof own.origin);
  PAGS_TRY(pags_pick(parts, part_count, origin, direction, &own, out));
  if (out->part < 0)
    return PAGS_OK;
  out->object = pags_composition_part_object(composition, &parts[out->part]);
  if (out->object >= 0) {
    const pags_scene_object *object = &scene->objects[out->object];
    out->class_name = object->record.class_name;
    out->object_id = object->record.id;
    out->critical = object->critical;
  }
  return PAGS_OK;
}
