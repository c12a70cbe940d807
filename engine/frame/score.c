/* SPDX-License-Identifier: Apache-2.0 */
/* Computes each Gaussian's importance for a picture: its visible weight, the part of it on critical pixels, and the
 * sensitivity score of Speedy-Splat (Hanson et al. 2025). Each tile writes partial sums to one slot per
 * (Gaussian, tile) pair; each cluster then adds up its members' slots, always in the same order. */
#include <assert.h>

#include "frame/members.h"

typedef struct score_context {
  pags_frame *frame;
  const pags_score_planes *planes;
  float *written;                /* the slots, where they are written */
  const float *slots;            /* and where they are read */
  const pags_splat_scores *sums; /* by slot_start, in place of slots that are still to be added up; or NULL */
  pags_score_fn *receive;
  void *user;
  double *scratch; /* per worker: PAGS_SCORE_SUMS arrays of MOST_MEMBERS */
  member_scratch *members;
} score_context;

/* Block function: writes the partial sums of the pairs in tiles [begin, end). */
static void tiles_score(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const score_context *const c = context;
  const pags_frame *const f = c->frame;
  for (int64_t tile = begin; tile < end; tile++) {
    const int64_t at = frame_tile_offset(f, tile);
    const pags_raster_score in = {.tile = frame_drawn_tile(f, tile, c->written),
                                  .counted = c->planes->counted + at,
                                  .critical = c->planes->critical + at,
                                  .overlap = c->planes->overlap};
    f->kernels->raster_score(&in);
  }
}

pags_splat_scores pags_frame_add_scores(const pags_frame *f, const float *slots, int64_t dense) {
  pags_splat_scores sum = {0.0, 0.0, 0.0};
  if (f->keys[dense] == UINT32_MAX)
    return sum;
  const float *slot = slots + f->slot_start[dense] * PAGS_SCORE_SUMS;
  for (uint32_t i = 0; i < f->splats[dense].tiles; i++, slot += PAGS_SCORE_SUMS) {
    sum.seen += (double)slot[PAGS_SCORE_SEEN];
    sum.critical += (double)slot[PAGS_SCORE_CRITICAL];
    sum.squared += (double)slot[PAGS_SCORE_SQUARED];
  }
  return sum;
}

/* Block function: sums the scores of the members of clusters [begin, end) and calls the receiver. */
static void clusters_score(void *context, int64_t begin, int64_t end, int worker) {
  const score_context *const c = context;
  double *const seen = c->scratch + (int64_t)worker * PAGS_SCORE_SUMS * MOST_MEMBERS;
  double *const critical = seen + MOST_MEMBERS, *const squared = critical + MOST_MEMBERS;
  for (int64_t i = begin; i < end; i++) {
    const view_cluster *const v = c->frame->clusters + i;
    const frame_members members = pags_frame_members(c->frame, v, c->members, worker);
    for (int k = 0; k < v->count; k++) {
      const bool drawn = members.keys[k] != UINT32_MAX && members.splats[k].tiles > 0;
      const pags_splat_scores sum = !c->sums ? pags_frame_add_scores(c->frame, c->slots, v->base + k)
                                    : drawn  ? c->sums[members.slot_start[k]]
                                             : (pags_splat_scores){0.0, 0.0, 0.0};
      seen[k] = sum.seen, critical[k] = sum.critical, squared[k] = sum.squared;
    }
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

pags_result pags_stage_score(pags_frame *frame, const pags_score_planes *planes, float **slots) {
  assert(frame->rendered && frame->options.keep_for_backward);
  assert(planes->counted && planes->critical);
  pags_tasks_mark(frame->tasks, NULL, "scores");
  score_context c = {.frame = frame, .planes = planes};
  PAGS_TRY(pags_frame_alloc(frame, &c.written, frame->stats.pairs_binned * PAGS_SCORE_SUMS, sizeof *c.written,
                            "score slots"));
  *slots = c.written;
  return pags_frame_for(frame, (int64_t)frame->tiles_x * frame->tiles_y, 1, tiles_score, &c);
}

pags_result pags_stage_receive_scores(pags_frame *frame, const float *slots, const pags_splat_scores *sums,
                                      pags_score_fn *receive, void *user) {
  const int workers = pags_tasks_workers(frame->tasks);
  score_context c = {.frame = frame, .slots = slots, .sums = sums, .receive = receive, .user = user};
  PAGS_TRY(pags_frame_alloc(frame, &c.scratch, (int64_t)workers * PAGS_SCORE_SUMS * MOST_MEMBERS, sizeof *c.scratch,
                            "scores"));
  PAGS_TRY(pags_frame_reserve_members(frame, &c.members));
  return pags_frame_for(frame, frame->cluster_count, 4, clusters_score, &c);
}

pags_result pags_frame_scores(pags_frame *frame, const pags_score_planes *planes, pags_score_fn *receive, void *user) {
  float *slots;
  PAGS_TRY(pags_stage_score(frame, planes, &slots));
  return pags_stage_receive_scores(frame, slots, NULL, receive, user);
}
