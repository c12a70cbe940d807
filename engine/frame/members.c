/* SPDX-License-Identifier: Apache-2.0 */
/* The members of a cluster, from their splats or from their flags; see members.h. */
#include "frame/members.h"

#include <assert.h>

/* Opacity factor for finding positions alone: with it, every splat is drawn that was drawn with the factors of its own
 * view, which may be gone. Positions don't depend on it. */
static const float large_factor = 1e4f;

struct member_scratch {
  _Alignas(64) pags_splat splats[MOST_MEMBERS];
  uint32_t keys[MOST_MEMBERS];
  pags_tile_box boxes[MOST_MEMBERS];
  float factors[MOST_MEMBERS];
  int64_t slot_start[MOST_MEMBERS];
};

pags_result pags_frame_reserve_members(pags_frame *frame, member_scratch **out) {
  *out = NULL;
  if (!frame->member_flags)
    return PAGS_OK;
  return pags_frame_alloc(frame, out, pags_tasks_workers(frame->tasks), sizeof **out, "splats of a cluster");
}

frame_members pags_frame_members(const pags_frame *frame, const view_cluster *c, member_scratch *workers, int worker) {
  if (!frame->member_flags)
    return (frame_members){frame->keys + c->base, frame->splats + c->base, frame->slot_start + c->base};
  member_scratch *const scratch = workers + worker;
  int64_t slot = frame->cluster_slots[c - frame->clusters];
  assert(c->count <= MOST_MEMBERS);
  if (frame->scans) {
    const pags_gaussians *const g = frame->parts[c->part].gaussians;
    for (int k = 0; k < MOST_MEMBERS; k++)
      scratch->factors[k] = large_factor;
    const pags_projection view = frame_projection(frame, c);
    frame->kernels->project(&view, g->data + c->first, g->stride, scratch->factors, c->count, scratch->splats,
                            scratch->keys, false, scratch->boxes, NULL);
  }
  for (int k = 0; k < c->count; k++) {
    const uint8_t flags = frame->member_flags[c->base + k];
    scratch->keys[k] = flags & MEMBER_DRAWN ? 0 : UINT32_MAX;
    scratch->splats[k].tiles = flags & MEMBER_DRAWN ? 1 : 0;
    scratch->splats[k].clamped = flags & MEMBER_CLAMPED;
    scratch->slot_start[k] = slot;
    slot += scratch->splats[k].tiles;
  }
  return (frame_members){scratch->keys, scratch->splats, scratch->slot_start};
}
