/* SPDX-License-Identifier: Apache-2.0 */
/* The list of the background's chunks: appends them, and in the end decimates and crops them. */
#include "exporters/proxy/background.h"

#include <stdlib.h>
#include <string.h>

#include "base/parallel.h"

enum { LEAST_TRIANGLES = 8 }; /* a chunk that would get fewer by decimation is left out */

void pags_background_destroy(pags_background *background) {
  pags_depth_views_destroy(&background->depth_views);
  for (int64_t i = 0; i < background->chunk_count; i++)
    pags_proxy_mesh_destroy(&background->chunks[i].mesh);
  free(background->chunks);
  pags_cloud_destroy(&background->cloud);
  pags_columns_destroy(&background->columns);
  *background = (pags_background){0};
}

pags_result pags_background_add(pags_background *b, const char *class_name, pags_proxy_mesh *mesh) {
  PAGS_CHECK_MEMORY(pags_grow(&b->chunks, b->chunk_count + 1, &b->chunk_capacity, sizeof *b->chunks), "%lld chunks",
                    (long long)b->chunk_count + 1);
  int number = 0;
  for (int64_t i = 0; i < b->chunk_count; i++)
    number += !strcmp(b->chunks[i].class_name, class_name);
  b->chunks[b->chunk_count++] = (pags_chunk){.class_name = class_name, .number = number, .mesh = *mesh};
  *mesh = (pags_proxy_mesh){0};
  return PAGS_OK;
}

pags_result pags_background_add_solid(pags_background *b, const char *class_name, pags_proxy_mesh *mesh) {
  PAGS_TRY(pags_background_add(b, class_name, mesh));
  b->chunks[b->chunk_count - 1].solid = true;
  return PAGS_OK;
}

/* ---- Decimation ---- */

/* The ground has a limit of its own. Blocks come first, the rest gets what they leave of the limit. */
typedef enum kind { GROUND, BLOCK, REST, KINDS } kind;

typedef struct decimation {
  pags_background *background;
  double share[KINDS]; /* of its triangles that a chunk of this kind may keep */
} decimation;

static kind kind_of(const pags_chunk *chunk) {
  return !strncmp(chunk->class_name, "ground", 6) ? GROUND : chunk->solid || chunk->unseen_depth > 0 ? BLOCK : REST;
}

/* Decimates a chunk; one that would get too few triangles becomes empty and is left out in the end. */
static pags_result decimate_chunk(void *context, int64_t i, PAGS_UNUSED int worker) {
  const decimation *d = context;
  pags_proxy_mesh *mesh = &d->background->chunks[i].mesh, simple = {0};
  const double share = d->share[kind_of(&d->background->chunks[i])];
  if (share >= 1)
    return PAGS_OK;
  const int64_t budget = (int64_t)((double)mesh->triangle_count * share);
  const pags_result result =
      budget < LEAST_TRIANGLES ? PAGS_ERROR_LIMIT : pags_proxy_mesh_simplify(mesh, budget, &simple);
  pags_proxy_mesh_destroy(mesh);
  *mesh = simple;
  return result == PAGS_OK || result == PAGS_ERROR_LIMIT
             ? PAGS_OK
             : pags_fail(result, "a chunk of the background can't be decimated");
}

/* Decimates all chunks to `limit` triangles together, those of a kind each in proportion to its triangles. */
static pags_result decimate(const pags_proxy_maker *w, pags_background *b) {
  const double limit = (double)w->options->chunk_triangles;
  double total[KINDS] = {0};
  decimation d = {.background = b, .share = {1, 1, 1}};
  for (int64_t i = 0; i < b->chunk_count; i++)
    total[kind_of(&b->chunks[i])] += (double)b->chunks[i].mesh.triangle_count;
  if (total[BLOCK] + total[REST] <= limit)
    return PAGS_OK;
  d.share[BLOCK] = limit / total[BLOCK];
  d.share[REST] = (limit - fmin(limit, total[BLOCK])) / total[REST];
  return pags_parallel_try(w->tasks, b->chunk_count, decimate_chunk, &d, "interrupted");
}

/* ---- Finishing ---- */

/* Whether a point is within the box and the ball, those that there are. */
static bool is_within(const pags_proxy_options *options, const double p[3]) {
  for (int k = 0; k < 3 && options->box; k++)
    if (p[k] < options->box[k] || p[k] > options->box[3 + k])
      return false;
  return !options->ball || pags_distance_squared3(p, options->ball) <= options->ball[3] * options->ball[3];
}

pags_result pags_proxy_mesh_crop(const pags_proxy_options *options, pags_proxy_mesh *mesh) {
  const int64_t before = mesh->triangle_count;
  for (int64_t i = 0; i < before; i++) {
    double p[3];
    pags_proxy_mesh_middle(mesh, i, p);
    if (!is_within(options, p))
      mesh->triangles[3 * i] = UINT32_MAX;
  }
  pags_proxy_mesh_drop_marked(mesh);
  return mesh->triangle_count < before ? pags_proxy_mesh_compact(mesh) : PAGS_OK;
}

/* Leaves out a chunk of closed parts whose middle is outside. */
static void crop_solid(const pags_proxy_options *options, pags_proxy_mesh *mesh) {
  double lo[3], hi[3];
  pags_proxy_mesh_bounds(mesh, lo, hi);
  for (int k = 0; k < 3; k++)
    lo[k] = 0.5 * (lo[k] + hi[k]);
  if (!is_within(options, lo))
    pags_proxy_mesh_destroy(mesh);
}

pags_result pags_background_finish(const pags_proxy_maker *w, pags_background *b) {
  int64_t kept = 0;
  PAGS_TRY(decimate(w, b));
  for (int64_t i = 0; i < b->chunk_count; i++) {
    if (kind_of(&b->chunks[i]) != BLOCK) /* the surface that blocks are made of was cropped */
      PAGS_TRY(pags_proxy_mesh_crop(w->options, &b->chunks[i].mesh));
    else if (b->chunks[i].solid)
      crop_solid(w->options, &b->chunks[i].mesh);
    PAGS_TRY(pags_proxy_mesh_clean(&b->chunks[i].mesh));
  }
  for (int64_t i = 0; i < b->chunk_count; i++) { /* leave out the empty ones */
    pags_chunk chunk = b->chunks[i];
    if (!chunk.mesh.triangle_count)
      pags_proxy_mesh_destroy(&chunk.mesh);
    else
      b->chunks[kept++] = chunk;
  }
  b->chunk_count = kept;
  return PAGS_OK;
}
