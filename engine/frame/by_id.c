/* SPDX-License-Identifier: Apache-2.0 */
/* The Gaussians of a composition, and the gradients of a picture by them, in the order of their ids: undoes the order
 * in which compose.c keeps them, for callers who know a Gaussian by its number in the scene's files. */
#include <pags/compose.h>

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "frame/stages.h"

/* ---- Gaussians ---- */

/* The highest SH degree of all parts, and the optional arrays that any part has. */
typedef struct shape {
  int sh_degree;
  int fourier_degree; /* -1: no colour changes */
  bool any, s_sem, object_id;
  float alpha_min; /* that of all parts; 0 if they differ */
} shape;

static void copy_part(const pags_part *part, pags_gaussians *out) {
  const pags_gaussians *g = part->gaussians;
  row_scratch geometry, colours;
  for (int64_t c = 0; c < part->clusters->count; c++) {
    const view_cluster cluster = {.cluster = c, .first = c * part->clusters->size};
    int64_t geometry_stride, colour_stride;
    const float *const places = pags_frame_geometry(part, &cluster, &geometry, &geometry_stride);
    const float *const shades = pags_frame_colours(part, &cluster, g->sh_degree, &colours, &colour_stride);
    const int64_t rest = part->gaussians->count - c * part->clusters->size;
    for (int64_t i = 0; i < part->clusters->size && i < rest; i++) {
      const int64_t row = cluster.first + i, id = part_id(part, row);
      for (int p = 0; p < PAGS_SH; p++)
        pags_plane(out, p)[id] = places[p * geometry_stride + i];
      for (int p = PAGS_SH; p < pags_plane_count(g->sh_degree); p++)
        pags_plane(out, p)[id] = shades[p * colour_stride + i];
      if (out->s_sem)
        out->s_sem[id] = g->s_sem ? g->s_sem[row] : part->packed ? pags_packed_s_sem(part->packed, row) : part->s_sem;
      for (int p = 0; p < pags_fourier_planes(g); p++)
        out->fourier[p * out->stride + id] = g->fourier[p * g->stride + row];
    }
  }
}

/* The parts of one object, -1 for the background, in its own frame. */
static pags_result object_parts(pags_composition *composition, int64_t object, const pags_part **parts, int *count) {
  const pags_placement placement = {.object = object, .world_from_object = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  return pags_compose_placed(composition, (double)NAN, &placement, 1, parts, count);
}

pags_result pags_composition_gaussians(pags_composition *composition, pags_gaussians *out) {
  const int64_t objects = pags_composition_scene(composition)->object_count;
  const pags_part *parts;
  int count;
  shape s = {.fourier_degree = -1};
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians all = {0};
  *out = (pags_gaussians){0};
  for (int64_t object = -1; object < objects; object++) {
    PAGS_TRY(object_parts(composition, object, &parts, &count));
    for (int p = 0; p < count; p++) {
      const pags_gaussians *g = parts[p].gaussians;
      s.sh_degree = g->sh_degree > s.sh_degree ? g->sh_degree : s.sh_degree;
      s.s_sem |= g->s_sem || (parts[p].packed && parts[p].packed->has_s_sem);
      s.object_id |= g->object_id != NULL;
      if (g->fourier && g->fourier_degree > s.fourier_degree)
        s.fourier_degree = g->fourier_degree;
      s.alpha_min = !s.any || s.alpha_min == g->alpha_min ? g->alpha_min : 0;
      s.any = true;
    }
  }
  PAGS_TRY(pags_gaussians_create(&all, pags_composition_gaussian_count(composition), s.sh_degree));
  all.alpha_min = s.alpha_min;
  if (s.s_sem)
    PAGS_TRY(pags_gaussians_add_s_sem(&all));
  if (s.fourier_degree >= 0)
    PAGS_TRY(pags_gaussians_add_fourier(&all, s.fourier_degree));
  if (s.object_id) {
    PAGS_TRY(pags_gaussians_add_object_id(&all));
    pags_composition_objects(composition, all.object_id);
  }
  for (int64_t object = -1; object < objects; object++) {
    PAGS_TRY(object_parts(composition, object, &parts, &count));
    for (int p = 0; p < count; p++)
      copy_part(&parts[p], &all);
  }
  *out = all;
  all = (pags_gaussians){0};
  return PAGS_OK;
}

/* ---- Gradients ---- */

typedef struct receiver {
  const pags_part *parts;
  pags_gaussians *out;
} receiver;

/* Clusters share no rows, so that several threads may write at once. */
static void receive(void *user, const pags_cluster_gradient *g, PAGS_UNUSED int worker) {
  const receiver *r = user;
  for (int i = 0; i < g->count; i++) {
    const int64_t id = part_id(&r->parts[g->part], g->first + i);
    for (int p = 0; p < g->planes; p++)
      pags_plane(r->out, p)[id] = g->data[(int64_t)p * g->stride + i];
  }
}

pags_result pags_frame_gradients(pags_frame *frame, const pags_picture_gradient *gradient, int64_t count,
                                 pags_gaussians *out, int64_t *bad_rows) {
  int degree = 0;
  for (int p = 0; p < frame->part_count; p++)
    degree = frame->parts[p].gaussians->sh_degree > degree ? frame->parts[p].gaussians->sh_degree : degree;
  *out = (pags_gaussians){0};
  for (int a = 0; a < frame->part_count; a++) /* they would write their gradients to the same rows */
    for (int b = 0; b < a; b++)
      if (frame->parts[a].clusters == frame->parts[b].clusters)
        return pags_fail(PAGS_ERROR_ARGUMENT,
                         "gradients: the same Gaussians were drawn twice: expected each part once");
  PAGS_TRY(pags_gaussians_create(out, count, degree));
  receiver r = {.parts = frame->parts, .out = out};
  const pags_result result = pags_frame_backward(frame, gradient, receive, &r, bad_rows);
  if (result != PAGS_OK)
    pags_gaussians_destroy(out);
  return result;
}
