/* SPDX-License-Identifier: Apache-2.0 */
/* Shares the results of a step between ranks; see stages.h. */
#include "train/stages.h"

#include "cluster/shares.h"

pags_result pags_shared_step_results(pags_trainer *t, pags_step_view *views, int count) {
  PAGS_AUTOFREE pags_view_result *all = calloc((size_t)t->shared.ranks, sizeof *all);
  PAGS_CHECK_MEMORY(all, "the losses of %d photographs", count);
  PAGS_TRY(pags_share_all(t->shared.transport, &views[t->shared.rank].result, sizeof *all, all));
  for (int i = 0; i < count; i++)
    views[i].result = all[i];
  return PAGS_OK;
}

/* ---- Poses ---- */

/* The photographs' poses in the order of the photographs. That of an object comes from one rank alone, and poses of
 * different objects have nothing to do with each other. */
static pags_result share_poses(pags_trainer *t) {
  pags_step_rest *const r = &t->rest;
  const int64_t size = sizeof *r->poses, room = t->state.schedule.batch * t->state.model_count;
  PAGS_AUTOFREE int64_t *bytes = calloc((size_t)t->shared.ranks, sizeof *bytes);
  PAGS_AUTOFREE void *all = NULL;
  int64_t count = 0;
  PAGS_CHECK_MEMORY(bytes, "the poses of a step");
  PAGS_TRY(pags_share_parts(t->shared.transport, r->poses, r->pose_count * size, &all, bytes));
  for (int k = 0; k < t->shared.ranks; k++)
    count += bytes[k] / size;
  if (count > room)
    return pags_fail(PAGS_ERROR_LIMIT, "%lld poses in a step of at most %lld", (long long)count, (long long)room);
  if (count > 0)
    memcpy(r->poses, all, (size_t)(count * size));
  r->pose_count = count;
  return PAGS_OK;
}

/* Adds up the gradients by the camera of each photograph over the Gaussians of all ranks. */
static pags_result share_cameras(pags_trainer *t) {
  pags_step_rest *const r = &t->rest;
  const int ranks = t->shared.ranks;
  PAGS_AUTOFREE pags_exact_sum *mine = calloc((size_t)r->count * (size_t)(ranks + 1), sizeof *mine);
  if (!mine)
    return pags_transport_give_up(t->shared.transport,
                                  pags_out_of_memory("the cameras of %lld photographs", (long long)r->count));
  for (int64_t i = 0; i < r->count; i++)
    mine[i] = r->photographs[i].by_world;
  pags_exact_sum *const all = mine + r->count;
  PAGS_TRY(pags_share_all(t->shared.transport, mine, r->count * (int64_t)sizeof *mine, all));
  for (int64_t i = 0; i < r->count; i++)
    for (int k = 0; k < ranks; k++)
      if (k != t->shared.rank)
        pags_exact_sum_join(&r->photographs[i].by_world, all + k * r->count + i);
  return PAGS_OK;
}

/* ---- Updates that were left out ---- */

pags_result pags_shared_step_nonfinite(pags_trainer *t) {
  pags_nonfinite *const n = &t->state.nonfinite;
  const pags_left_out mine = {n->count - t->shared_nonfinite, n->first};
  PAGS_AUTOFREE pags_left_out *all = calloc((size_t)t->shared.ranks, sizeof *all);
  PAGS_CHECK_MEMORY(all, "skipped updates of a step");
  PAGS_TRY(pags_share_all(t->shared.transport, &mine, sizeof mine, all));
  for (int r = 0; r < t->shared.ranks; r++)
    if (r != t->shared.rank && all[r].count > 0)
      pags_nonfinite_note(n, all[r].count, &all[r].first);
  return PAGS_OK;
}

pags_result pags_shared_step_rest(pags_trainer *t) {
  PAGS_TRY(pags_shared_step_nonfinite(t));
  if (t->state.cameras.count > 0)
    PAGS_TRY(share_cameras(t));
  return share_poses(t);
}
