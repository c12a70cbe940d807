/* SPDX-License-Identifier: Apache-2.0 */
/* The members of a cluster from the bytes that are kept of them; see kept.h. */
#include "frame/kept.h"

#include <assert.h>

enum { MOST_MEMBERS = 256 };

/* Opacities are multiplied by this where only the places of splats are wanted, so that those are found of all that are
 * drawn with the factors of their own view, which may be gone. Places don't depend on it. */
static const float large_factor = 1e4f;

struct kept_room {
  _Alignas(64) pags_splat splats[MOST_MEMBERS];
  uint32_t keys[MOST_MEMBERS];
  pags_tile_box boxes[MOST_MEMBERS];
  float factors[MOST_MEMBERS];
  int64_t slot_start[MOST_MEMBERS];
};

pags_result pags_frame_kept_reserve(pags_frame *frame, kept_room **out) {
  *out = NULL;
  if (!frame->kept)
    return PAGS_OK;
  *out = pags_frame_alloc(frame, pags_tasks_workers(frame->tasks), sizeof **out, "splats of a cluster");
  return *out ? PAGS_OK : PAGS_ERROR_MEMORY;
}

static void place(const pags_frame *f, const view_cluster *c, kept_room *room) {
  const pags_gaussians *const g = f->parts[c->part].gaussians;
  for (int k = 0; k < MOST_MEMBERS; k++)
    room->factors[k] = large_factor;
  f->kernels->project(f->projections + c->part, g->data + c->first, g->stride, room->factors, c->count, room->splats,
                      room->keys, false, room->boxes, NULL);
}

frame_members pags_frame_members(const pags_frame *frame, const view_cluster *c, kept_room *rooms, int worker) {
  if (!frame->kept)
    return (frame_members){frame->keys + c->base, frame->splats + c->base, frame->slot_start + c->base};
  kept_room *const room = rooms + worker;
  int64_t slot = frame->cluster_slots[c - frame->clusters];
  assert(c->count <= MOST_MEMBERS);
  if (frame->scans)
    place(frame, c, room);
  for (int k = 0; k < c->count; k++) {
    const uint8_t kept = frame->kept[c->base + k];
    room->keys[k] = kept & KEPT_DRAWN ? 0 : UINT32_MAX;
    room->splats[k].tiles = kept & KEPT_DRAWN ? 1 : 0;
    room->splats[k].clamped = kept & KEPT_CLAMPED;
    room->slot_start[k] = slot;
    slot += room->splats[k].tiles;
  }
  return (frame_members){room->keys, room->splats, room->slot_start};
}
