/* SPDX-License-Identifier: Apache-2.0 */
/* Splats that one frame projects and another draws; see shared_splats.h. */
#include "frame/shared_splats.h"

#include <assert.h>
#include <string.h>

#include "frame/members.h"

enum { MEMBERS = 256 }; /* a worker's block of splats */

/* Both kinds of splats begin with the same floats, x to slope. */
enum { SENT_FLOATS = 11 };
static_assert(offsetof(pags_sent_splat, slope) == offsetof(pags_splat, slope) &&
                  offsetof(pags_splat, slope) == sizeof(float[SENT_FLOATS - 1]),
              "a sent splat begins as a splat does");

/* ---- Owners ---- */

pags_result pags_frame_project(pags_frame *frame, pags_frame *lender, const pags_part *parts, int part_count,
                               const pags_camera *camera, const pags_frame_options *options, pags_touch_fn *touch,
                               void *user, int64_t *count) {
  assert(options->keep_for_backward && lender != frame);
  PAGS_TRY(pags_frame_begin(frame, parts, part_count, camera, options));
  PAGS_TRY(pags_stage_cull(frame, false));
  frame->touch = touch, frame->touch_user = user;
  PAGS_TRY(pags_stage_touch(frame));
  /* The splats lie in the lender's memory, since they go with the next view. */
  pags_arena *const own = frame->arena;
  lender->rendered = false;
  pags_arena_reset(lender->arena);
  frame->arena = lender->arena;
  pags_result result =
      pags_frame_alloc(frame, &frame->extents, frame->dense_count, sizeof *frame->extents, "extents of splats");
  if (result == PAGS_OK)
    result = pags_stage_project(frame);
  if (result == PAGS_OK)
    result = pags_frame_place_slots(frame);
  frame->arena = own;
  PAGS_TRY(result);
  *count = frame->slot_start[frame->dense_count];
  return PAGS_OK;
}

typedef struct taking {
  const pags_frame *frame;
  pags_sent_splat *out;
  uint8_t *flags;
} taking;

static void take(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const taking *const t = context;
  const pags_frame *const f = t->frame;
  for (int64_t i = begin; i < end; i++) {
    t->flags[i] = 0;
    if (f->slot_start[i] == f->slot_start[i + 1])
      continue;
    const pags_splat *const s = f->splats + i;
    pags_sent_splat *const to = t->out + f->slot_start[i];
    memcpy(to, s, sizeof(float[SENT_FLOATS]));
    to->id = s->id;
    memcpy(to->extent, f->extents[i], sizeof to->extent);
    t->flags[i] = (uint8_t)(MEMBER_DRAWN | f->splats[i].clamped);
  }
}

pags_result pags_frame_take_splats(pags_frame *frame, pags_sent_splat *out) {
  assert(!frame->member_flags);
  uint8_t *flags;
  PAGS_TRY(pags_frame_alloc(frame, &flags, frame->dense_count, 1, "flags of splats"));
  int64_t *slots;
  PAGS_TRY(pags_frame_alloc(frame, &slots, frame->cluster_count + 1, sizeof *slots, "slots of clusters"));
  PAGS_TRY(pags_frame_for(frame, frame->dense_count, MEMBERS, take, &(taking){frame, out, flags}));
  for (int64_t c = 0; c < frame->cluster_count; c++)
    slots[c] = frame->slot_start[frame->clusters[c].base];
  slots[frame->cluster_count] = frame->slot_start[frame->dense_count];
  frame->member_flags = flags;
  frame->cluster_slots = slots;
  frame->splats = NULL;
  frame->keys = NULL;
  frame->boxes = NULL;
  frame->extents = NULL;
  frame->slot_start = NULL;
  return PAGS_OK;
}

int64_t pags_frame_splats_before(const pags_frame *frame, int part) {
  int64_t c = 0;
  while (c < frame->cluster_count && frame->clusters[c].part < part)
    c++;
  return frame->cluster_slots[c];
}

pags_result pags_frame_return_sums(pags_frame *frame, int first_part, const pags_splat_sums *sums,
                                   pags_receive_fn *receive, void *user, int64_t *bad_rows) {
  return pags_stage_project_backward(frame, first_part, sums->sum, receive, user, bad_rows);
}

pags_result pags_frame_return_scores(pags_frame *frame, const pags_splat_scores *scores, pags_score_fn *receive,
                                     void *user) {
  return pags_stage_receive_scores(frame, NULL, scores, receive, user);
}

/* ---- The frame that draws ---- */

typedef struct arrival {
  pags_frame *frame;
  const pags_sent_splat *splats;
  pags_alpha_cut cut;
  int64_t count;
} arrival;

/* Block function: takes over the splats of one block, finds their tiles, and fills up the last vector. */
static void arrive(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const arrival *const a = context;
  pags_frame *const f = a->frame;
  for (int64_t i = begin; i < end; i++) {
    if (i >= a->count) {
      f->keys[i] = UINT32_MAX;
      continue;
    }
    const pags_sent_splat *const s = a->splats + i;
    f->splats[i] = (pags_splat){.cut = a->cut.cut, .floor = a->cut.floor, .id = s->id};
    memcpy(f->splats + i, s, sizeof(float[SENT_FLOATS]));
    memcpy(f->keys + i, &s->z, sizeof *f->keys);
    memcpy(f->boxes[i].extent, s->extent, sizeof s->extent);
  }
  pags_frame_box_members(f, begin, (int)(end - begin));
}

pags_result pags_frame_draw_splats(pags_frame *frame, const pags_sent_splat *splats, int64_t count, float alpha_min,
                                   const pags_camera *camera, const pags_frame_options *options, pags_picture *out) {
  assert(options->keep_for_backward);
  PAGS_TRY(pags_frame_begin(frame, NULL, 0, camera, options));
  pags_frame_prepare_sky(frame);
  PAGS_TRY(pags_frame_reserve_planes(frame));
  frame->ids_ascend = false; /* the splats of one owner follow those of another */
  frame->cluster_count = 0;
  frame->dense_count = (count + PAGS_LANES - 1) / PAGS_LANES * PAGS_LANES;
  PAGS_TRY(pags_frame_reserve_splats(frame));
  arrival a = {frame, splats, pags_frame_alpha_cut(alpha_min), count};
  PAGS_TRY(pags_frame_for(frame, frame->dense_count, MEMBERS, arrive, &a));
  PAGS_TRY(pags_frame_draw_projected(frame));
  pags_frame_show(frame, out);
  return PAGS_OK;
}

/* The sums over the slots of each splat, or its scores. */
typedef struct departure {
  const pags_frame *frame;
  const float *slots;
  pags_splat_sums *sums;
  pags_splat_scores *scores;
} departure;

static int64_t arrived(const pags_frame *f) {
  int64_t count = f->dense_count;
  while (count > 0 && f->keys[count - 1] == UINT32_MAX)
    count--;
  return count;
}

static void add_slots(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const departure *const d = context;
  for (int64_t i = begin; i < end; i++) {
    const float *slot = d->slots + d->frame->slot_start[i] * PAGS_SLOT_FLOATS;
    pags_splat_sums sums = {{0.0f}};
    if (d->frame->splats[i].tiles > 0)
      memcpy(sums.sum, slot, sizeof sums.sum);
    for (uint32_t k = 1; k < d->frame->splats[i].tiles; k++)
      for (int f = 0; f < PAGS_SPLAT_SUMS; f++)
        sums.sum[f] += slot[k * PAGS_SLOT_FLOATS + (uint32_t)f];
    d->sums[i] = sums;
  }
}

static void add_scores(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const departure *const d = context;
  for (int64_t i = begin; i < end; i++)
    d->scores[i] = pags_frame_add_scores(d->frame, d->slots, i);
}

pags_result pags_frame_splat_sums(pags_frame *frame, const pags_picture_gradient *gradient, pags_splat_sums *out) {
  static_assert((int)PAGS_SPLAT_SUMS == (int)PAGS_SLOT_FLOATS, "a splat's sums are those of its slots");
  float *slots;
  PAGS_TRY(pags_stage_raster_backward(frame, gradient, &slots));
  departure d = {.frame = frame, .slots = slots, .sums = out};
  return pags_frame_for(frame, arrived(frame), MEMBERS, add_slots, &d);
}

pags_result pags_frame_splat_scores(pags_frame *frame, const pags_score_planes *planes, pags_splat_scores *out) {
  float *slots;
  PAGS_TRY(pags_stage_score(frame, planes, &slots));
  departure d = {.frame = frame, .slots = slots, .scores = out};
  return pags_frame_for(frame, arrived(frame), MEMBERS, add_scores, &d);
}
