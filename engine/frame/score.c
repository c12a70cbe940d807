/* SPDX-License-Identifier: Apache-2.0 */
/* Computes each Gaussian's importance for a picture: how much of it is seen, how much of that where critical pixels
 * are, and the sensitivity score of Speedy-Splat (Hanson et al. 2025). Each tile writes partial sums to one slot per
 * (Gaussian, tile) pair; each cluster then adds up its members' slots, always in the same order. */
#include <assert.h>

#include "frame/stages.h"

typedef struct score_context {
  pags_frame *frame;
  const pags_score_planes *planes;
  float *slots;
  pags_score_fn *receive;
  void *user;
  double *scratch; /* per worker: PAGS_SCORE_SUMS arrays of MOST_MEMBERS */
} score_context;

enum { MOST_MEMBERS = 256 };

/* Block function: writes the partial sums of the pairs in tiles [begin, end). */
static void tiles_score(void *context, int64_t begin, int64_t end, int worker) {
  const score_context *const c = context;
  const pags_frame *const f = c->frame;
  (void)worker;
  for (int64_t tile = begin; tile < end; tile++) {
    const int x0 = frame_tile_x(f, tile), y0 = frame_tile_y(f, tile);
    const int64_t start = f->tile_start[tile], at = frame_tile_offset(f, tile);
    pags_raster_score in = {.splats = f->splats,
                            .entries = f->entries + start,
                            .block_masks = f->block_masks + start,
                            .count = f->tile_start[tile + 1] - start,
                            .slot_start = f->slot_start,
                            .slots = c->slots,
                            .x0 = x0,
                            .y0 = y0,
                            .width = f->camera.width,
                            .height = f->camera.height,
                            .stride = f->stride,
                            .counted = c->planes->counted + at,
                            .critical = c->planes->critical + at,
                            .overlap = c->planes->overlap};
    for (int k = 0; k < 3; k++) {
      in.rgb[k] = frame_plane(f, PLANE_R + k) + at;
      in.rgb_gradient[k] = c->planes->rgb[k] ? c->planes->rgb[k] + at : NULL;
    }
    f->kernels->raster_score(&in);
  }
}

/* Sums the slots of the Gaussian at dense index `dense`; zeros where it isn't drawn. */
static void add_member(const score_context *c, int64_t dense, double *seen, double *critical, double *squared) {
  const pags_frame *const f = c->frame;
  *seen = *critical = *squared = 0.0;
  if (f->keys[dense] == UINT32_MAX)
    return;
  const float *slot = c->slots + f->slot_start[dense] * PAGS_SCORE_SUMS;
  for (uint32_t i = 0; i < f->splats[dense].tiles; i++, slot += PAGS_SCORE_SUMS) {
    *seen += (double)slot[PAGS_SCORE_SEEN];
    *critical += (double)slot[PAGS_SCORE_CRITICAL];
    *squared += (double)slot[PAGS_SCORE_SQUARED];
  }
}

/* Block function: sums the scores of the members of clusters [begin, end) and calls the receiver. */
static void clusters_score(void *context, int64_t begin, int64_t end, int worker) {
  const score_context *const c = context;
  double *const seen = c->scratch + (int64_t)worker * PAGS_SCORE_SUMS * MOST_MEMBERS;
  double *const critical = seen + MOST_MEMBERS, *const squared = critical + MOST_MEMBERS;
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const v = c->frame->clusters + i;
    for (int k = 0; k < v->count; k++)
      add_member(c, v->base + k, seen + k, critical + k, squared + k);
    const pags_cluster_score out = {.part = v->part,
                                    .cluster = v->cluster,
                                    .first = v->first,
                                    .count = v->count,
                                    .seen = seen,
                                    .critical = critical,
                                    .squared = squared};
    c->receive(c->user, &out, worker);
  }
}

pags_result pags_frame_scores(pags_frame *frame, const pags_score_planes *planes, pags_score_fn *receive, void *user) {
  assert(frame->rendered && frame->options.keep_for_backward && receive);
  assert(planes->counted && planes->critical && !(planes->rgb[0] && planes->overlap));
  pags_tasks_mark(frame->tasks, NULL, "scores");
  const int workers = pags_tasks_workers(frame->tasks);
  score_context c = {.frame = frame, .planes = planes, .receive = receive, .user = user};
  c.slots = pags_frame_alloc(frame, frame->stats.pairs_binned * PAGS_SCORE_SUMS, sizeof *c.slots, "score slots");
  c.scratch = pags_frame_alloc(frame, (int64_t)workers * PAGS_SCORE_SUMS * MOST_MEMBERS, sizeof *c.scratch, "scores");
  if (!c.slots || !c.scratch)
    return PAGS_ERROR_MEMORY;
  PAGS_TRY(pags_frame_for(frame, (int64_t)frame->tiles_x * frame->tiles_y, 1, tiles_score, &c));
  return pags_frame_for(frame, frame->cluster_count, 4, clusters_score, &c);
}
