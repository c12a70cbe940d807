/* SPDX-License-Identifier: Apache-2.0 */
/* Splats and their sums on their way between ranks; see shared_views.h. */
#include "train/shared_views.h"

#include <assert.h>

#include "base/memory.h"
#include "cluster/shares.h"

/* Makes room and keeps what is there. */
static pags_result reserve(pags_buffer *buffer, int64_t bytes) {
  if (buffer->data && bytes <= buffer->room)
    return PAGS_OK;
  const int64_t room = bytes + bytes / 2 + 64;
  void *const data = realloc(buffer->data, (size_t)room);
  PAGS_CHECK_MEMORY(data, "messages of %lld bytes", (long long)room);
  *buffer = (pags_buffer){data, room};
  return PAGS_OK;
}

pags_result pags_shared_views_create(pags_shared_views *shared, pags_transport *transport, pags_tasks *tasks) {
  const int ranks = pags_transport_ranks(transport);
  *shared = (pags_shared_views){.transport = transport, .rank = pags_transport_rank(transport), .ranks = ranks};
  shared->owners = calloc((size_t)ranks, sizeof(pags_frame *));
  shared->sent = calloc(4 * (size_t)ranks, sizeof *shared->sent);
  PAGS_CHECK_MEMORY(shared->owners && shared->sent, "views of %d ranks", ranks);
  shared->sent_before = shared->sent + ranks;
  shared->arrived = shared->sent + 2 * ranks;
  shared->arrived_before = shared->sent + 3 * ranks;
  for (int r = 0; r < ranks; r++)
    PAGS_TRY(pags_frame_create(tasks, shared->owners + r));
  return PAGS_OK;
}

void pags_shared_views_destroy(pags_shared_views *shared) {
  for (int r = 0; shared->owners && r < shared->ranks; r++)
    pags_frame_destroy(shared->owners[r]);
  free(shared->owners);
  free(shared->sent);
  free(shared->sending.data);
  free(shared->splats.data);
  free(shared->object_splats.data);
  free(shared->object_sums.data);
  free(shared->spread.data);
  *shared = (pags_shared_views){0};
}

/* ---- The way there ---- */

void pags_shared_views_begin(pags_shared_views *shared, int count) {
  shared->count = count;
  shared->bytes_there = shared->bytes_back = 0;
  memset(shared->sent, 0, 4 * (size_t)shared->ranks * sizeof *shared->sent);
}

pags_result pags_shared_views_project(pags_shared_views *shared, int view, pags_frame *lender, const pags_part *parts,
                                      int part_count, const pags_camera *camera, const pags_frame_options *options,
                                      pags_touch_fn *touch, void *user) {
  pags_frame *const frame = shared->owners[view];
  int64_t before = 0, count = 0;
  for (int k = 0; k < view; k++)
    before += shared->sent[k];
  PAGS_TRY(pags_frame_project(frame, lender, parts, part_count, camera, options, touch, user, &count));
  PAGS_TRY(reserve(&shared->sending, (before + count) * (int64_t)sizeof(pags_sent_splat)));
  PAGS_TRY(pags_frame_take_splats(frame, (pags_sent_splat *)shared->sending.data + before));
  shared->sent[view] = count;
  shared->sent_before[view] = pags_frame_splats_before(frame, 1);
  return PAGS_OK;
}

static int64_t total(const int64_t *counts, int ranks) {
  int64_t sum = 0;
  for (int r = 0; r < ranks; r++)
    sum += counts[r];
  return sum;
}

/* Tells each rank how many splats it gets. */
static pags_result exchange_counts(pags_shared_views *shared) {
  const int ranks = shared->ranks;
  PAGS_AUTOFREE int64_t *pairs = malloc(4 * (size_t)ranks * sizeof *pairs);
  PAGS_CHECK_MEMORY(pairs, "a message to %d ranks", ranks);
  for (int r = 0; r < ranks; r++) {
    pairs[2 * r] = shared->sent[r];
    pairs[2 * r + 1] = shared->sent_before[r];
  }
  PAGS_TRY(pags_share_each(shared->transport, pairs, pairs + 2 * ranks, 2 * (int64_t)sizeof *pairs));
  for (int r = 0; r < ranks; r++) {
    shared->arrived[r] = pairs[2 * (ranks + r)];
    shared->arrived_before[r] = pairs[2 * (ranks + r) + 1];
  }
  return PAGS_OK;
}

pags_result pags_shared_views_send(pags_shared_views *shared, pags_result mine) {
  PAGS_TRY(pags_transport_agree(shared->transport, mine));
  PAGS_TRY(exchange_counts(shared));
  mine = reserve(&shared->splats, total(shared->arrived, shared->ranks) * (int64_t)sizeof(pags_sent_splat));
  PAGS_TRY(pags_transport_agree(shared->transport, mine));
  const int64_t before = pags_transport_counted(shared->transport).bytes_received;
  PAGS_TRY(pags_share_items(shared->transport, shared->sending.data, shared->sent, shared->splats.data, shared->arrived,
                            sizeof(pags_sent_splat)));
  shared->bytes_there += pags_transport_counted(shared->transport).bytes_received - before;
  return PAGS_OK;
}

/* ---- Drawing ---- */

/* Whether this rank has a view of the round. */
static bool draws(const pags_shared_views *shared) {
  return shared->rank < shared->count;
}

/* Splats of the own view, or of its objects alone. */
static int64_t drawn_count(const pags_shared_views *shared, bool objects) {
  const int64_t all = total(shared->arrived, shared->ranks);
  return objects ? all - total(shared->arrived_before, shared->ranks) : all;
}

static pags_result pick_objects(pags_shared_views *shared) {
  PAGS_TRY(reserve(&shared->object_splats, drawn_count(shared, true) * (int64_t)sizeof(pags_sent_splat)));
  const pags_sent_splat *from = shared->splats.data;
  pags_sent_splat *to = shared->object_splats.data;
  for (int r = 0; r < shared->ranks; r++) {
    const int64_t before = shared->arrived_before[r], some = shared->arrived[r] - before;
    if (some > 0)
      memcpy(to, from + before, (size_t)some * sizeof *to);
    to += some;
    from += shared->arrived[r];
  }
  return PAGS_OK;
}

pags_result pags_shared_views_draw(pags_shared_views *shared, pags_frame *frame, bool objects, float alpha_min,
                                   const pags_camera *camera, const pags_frame_options *options, pags_picture *out) {
  if (objects)
    PAGS_TRY(pick_objects(shared));
  return pags_frame_draw_splats(frame, objects ? shared->object_splats.data : shared->splats.data,
                                drawn_count(shared, objects), alpha_min, camera, options, out);
}

pags_result pags_shared_views_sums(pags_shared_views *shared, pags_frame *frame, bool objects,
                                   const pags_picture_gradient *gradient) {
  static_assert(sizeof(pags_splat_sums) <= sizeof(pags_sent_splat), "sums take the room of their splats");
  return pags_frame_splat_sums(frame, gradient, objects ? shared->object_splats.data : shared->splats.data);
}

pags_result pags_shared_views_scores(pags_shared_views *shared, pags_frame *frame, const pags_score_planes *planes) {
  static_assert(sizeof(pags_splat_scores) <= sizeof(pags_sent_splat), "scores take the room of their splats");
  return pags_frame_splat_scores(frame, planes, shared->splats.data);
}

/* ---- The way back ---- */

/* Items of a view, of `size` bytes each, that come back to this rank; all of them, or those of objects. */
static int64_t returned_count(const pags_shared_views *shared, int view, bool objects) {
  return shared->sent[view] - (objects ? shared->sent_before[view] : 0);
}

/* Items of `size` bytes each; `drawn`: NULL: all views of the round. */
static pags_result give_back(pags_shared_views *shared, bool objects, const uint8_t *drawn, int64_t bytes) {
  pags_buffer *const own = objects ? &shared->object_splats : &shared->splats;
  pags_buffer *const returned = objects ? &shared->object_sums : &shared->sending;
  const int ranks = shared->ranks;
  PAGS_AUTOFREE int64_t *counts = calloc(2 * (size_t)ranks, sizeof *counts);
  pags_result mine = counts ? PAGS_OK : pags_out_of_memory("a message to %d ranks", ranks);
  const bool gives = draws(shared) && (!drawn || drawn[shared->rank]);
  for (int k = 0; counts && k < ranks; k++) {
    if (gives)
      counts[k] = shared->arrived[k] - (objects ? shared->arrived_before[k] : 0);
    if (k < shared->count && (!drawn || drawn[k]))
      counts[ranks + k] = returned_count(shared, k, objects);
  }
  if (counts)
    mine = reserve(returned, total(counts + ranks, ranks) * bytes);
  PAGS_TRY(pags_transport_agree(shared->transport, mine));
  const int64_t before = pags_transport_counted(shared->transport).bytes_sent;
  PAGS_TRY(pags_share_items(shared->transport, own->data, counts, returned->data, counts + ranks, bytes));
  shared->bytes_back += pags_transport_counted(shared->transport).bytes_sent - before;
  return PAGS_OK;
}

pags_result pags_shared_views_return_sums(pags_shared_views *shared, bool objects, const uint8_t *drawn) {
  return give_back(shared, objects, drawn, sizeof(pags_splat_sums));
}

pags_result pags_shared_views_return_scores(pags_shared_views *shared) {
  return give_back(shared, false, NULL, sizeof(pags_splat_scores));
}

pags_result pags_shared_views_backward(pags_shared_views *shared, int view, bool objects, const uint8_t *drawn,
                                       pags_receive_fn *receive, void *user) {
  const pags_splat_sums *sums = objects ? shared->object_sums.data : shared->sending.data;
  for (int k = 0; k < view; k++)
    sums += !drawn || drawn[k] ? returned_count(shared, k, objects) : 0;
  if (objects) { /* the frame finds them behind those of the background, which it doesn't read */
    const int64_t some = returned_count(shared, view, true);
    PAGS_TRY(reserve(&shared->spread, (shared->sent[view] + 1) * (int64_t)sizeof *sums));
    pags_splat_sums *const spread = shared->spread.data;
    if (some > 0)
      memcpy(spread + shared->sent_before[view], sums, (size_t)some * sizeof *sums);
    sums = spread;
  }
  return pags_frame_return_sums(shared->owners[view], objects ? 1 : 0, sums, receive, user, NULL);
}

pags_result pags_shared_views_receive_scores(pags_shared_views *shared, int view, pags_score_fn *receive, void *user) {
  const pags_splat_scores *scores = shared->sending.data;
  for (int k = 0; k < view; k++)
    scores += shared->sent[k];
  return pags_frame_return_scores(shared->owners[view], scores, receive, user);
}

void pags_shared_views_count(const pags_shared_views *shared, pags_train_traffic *sum) {
  sum->views += draws(shared);
  sum->splats += total(shared->arrived, shared->ranks);
  sum->bytes_there += shared->bytes_there;
  sum->bytes_back += shared->bytes_back;
}
