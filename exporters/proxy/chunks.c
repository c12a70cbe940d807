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

/* ---- Decimation ---- */

/* The ground has a limit of its own. Blocks come first, the rest gets what they leave of the limit. */
typedef enum kind { GROUND, BLOCK, REST, KINDS } kind;

typedef struct decimation {
  pags_background *background;
  double share[KINDS]; /* of its triangles that a chunk of this kind may keep */
} decimation;

static kind kind_of(const pags_chunk *chunk) {
  return !strcmp(chunk->class_name, "ground") ? GROUND : chunk->unseen_depth > 0 ? BLOCK : REST;
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

pags_result pags_proxy_mesh_crop(const pags_proxy_options *options, pags_proxy_mesh *mesh) {
  const int64_t before = mesh->triangle_count;
  for (int64_t i = 0; i < before; i++) {
    double p[3];
    bool within = true;
    pags_proxy_mesh_middle(mesh, i, p);
    for (int k = 0; k < 3 && options->box; k++)
      within = within && p[k] >= options->box[k] && p[k] <= options->box[3 + k];
    if (options->ball)
      within = within && pags_distance_squared3(p, options->ball) <= options->ball[3] * options->ball[3];
    if (!within)
      mesh->triangles[3 * i] = UINT32_MAX;
  }
  pags_proxy_mesh_drop_marked(mesh);
  return mesh->triangle_count < before ? pags_proxy_mesh_compact(mesh) : PAGS_OK;
}

pags_result pags_background_finish(const pags_proxy_maker *w, pags_background *b) {
  int64_t kept = 0;
  PAGS_TRY(decimate(w, b));
  for (int64_t i = 0; i < b->chunk_count; i++) {
    if (kind_of(&b->chunks[i]) != BLOCK) /* the surface that blocks are made of was cropped */
      PAGS_TRY(pags_proxy_mesh_crop(w->options, &b->chunks[i].mesh));
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
