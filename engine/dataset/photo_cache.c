/* SPDX-License-Identifier: Apache-2.0 */
/* A cache of decoded photographs within a size limit in bytes (`budget`), which decodes the announced views ahead on
 * the thread pool.
 *
 * There is one slot per view. Bytes are booked before they are allocated: a decode books the most that it can hold at
 * once, and when its result is collected, all bytes except those of the finished photograph are given back. Only the
 * owner's thread books bytes; a job writes nothing but the result in its own slot and then sets `done`.
 *
 * When room is needed, the photograph that is wanted latest is evicted first (a view outside of the announced order
 * counts as never wanted); among equals the least recently used one. A background decode may evict only photographs
 * that are wanted later than its own. */
#include "dataset/internal.h"

#include <assert.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/text.h"
#include "dataset/owners.h"

typedef enum slot_state { EMPTY, DECODING, READY } slot_state;

typedef struct slot {
  slot_state state;
  int shrink;
  uint64_t booked;   /* bytes */
  uint64_t last_use; /* value of cache->gets when the view was last asked for */
  int64_t wanted_at; /* position in the announced order; INT64_MAX: not announced */
  struct pags_photo_cache *cache;
  pags_job job;
  /* Written by the job; the owner's thread reads them after `done` is set or after pags_job_wait. */
  atomic_bool done;
  pags_result result;
  char *message; /* error message of a failed decode */
  pags_photo_data data;
} slot;

struct pags_photo_cache {
  const pags_dataset *dataset;
  pags_tasks *tasks;
  uint64_t budget, used, peak, gets, decoded;
  int64_t count, decoding; /* number of slots; number of background decodes */
  slot *slots;
  int64_t current; /* view that get returned last, -1: none; its planes are never evicted */
  int64_t *order;  /* the announced views in the order in which they are wanted */
  int64_t order_count, order_next;
  int order_shrink;
  atomic_bool closing; /* the cache is being destroyed: jobs that have not started skip the decode */
};

/* ---- Decoding jobs and booking ---- */

static void run_job(void *context) {
  slot *s = context;
  struct pags_photo_cache *cache = s->cache;
  if (atomic_load(&cache->closing))
    s->result = PAGS_CANCELLED;
  else
    s->result = pags_photo_decode(cache->dataset, s - cache->slots, s->shrink, &s->data);
  if (s->result != PAGS_OK && s->result != PAGS_CANCELLED)
    s->message = pags_text_format("%s", pags_error_message());
  atomic_store(&s->done, true);
}

static void book(pags_photo_cache *cache, slot *s, uint64_t bytes) {
  cache->used += bytes - s->booked;
  s->booked = bytes;
  if (cache->used > cache->peak)
    cache->peak = cache->used;
}

static void drop(pags_photo_cache *cache, slot *s) {
  assert(s->state != DECODING);
  pags_photo_data_destroy(&s->data);
  free(s->message);
  s->message = NULL;
  s->state = EMPTY;
  book(cache, s, 0);
}

/* Ends a decode: marks the slot as ready and books only the bytes of the photograph. A failed decode keeps its error
 * in the slot, which the next get of the view returns. */
static void settle(pags_photo_cache *cache, slot *s) {
  const pags_photo_data *data = &s->data;
  const uint64_t planes = (uint64_t)(3 + data->has_mask + data->has_labels);
  s->state = READY;
  book(cache, s, s->result == PAGS_OK ? (uint64_t)data->stride * (uint64_t)data->height * planes + 64 : 0);
}

/* Waits for the background decode of a slot and settles the slot. */
static void harvest(pags_photo_cache *cache, slot *s) {
  pags_job_wait(cache->tasks, &s->job);
  cache->decoding--;
  cache->decoded++;
  settle(cache, s);
}

/* ---- Eviction and decoding ahead ---- */

/* Evicts photographs that are wanted later than `position` (-1: any) until `bytes` more fit into the size limit;
 * returns false if they can't be made to fit. */
static bool make_room(pags_photo_cache *cache, uint64_t bytes, int64_t position) {
  while (!(bytes <= cache->budget && cache->used <= cache->budget - bytes)) {
    slot *victim = NULL;
    for (int64_t i = 0; i < cache->count; i++) {
      slot *s = &cache->slots[i];
      if (s->state != READY || s->booked == 0 || i == cache->current || s->wanted_at <= position)
        continue;
      if (!victim || s->wanted_at > victim->wanted_at ||
          (s->wanted_at == victim->wanted_at && s->last_use < victim->last_use))
        victim = s;
    }
    if (!victim)
      return false;
    drop(cache, victim);
  }
  return true;
}

static void start(slot *s, int shrink, uint64_t bytes) {
  book(s->cache, s, bytes);
  s->state = DECODING;
  s->shrink = shrink;
  s->result = PAGS_OK;
  atomic_store(&s->done, false);
}

/* Settles finished background decodes, then starts new ones in the announced order until the next one doesn't fit
 * into the size limit or two decodes per worker are running. */
static void pump(pags_photo_cache *cache) {
  int64_t limit = 2 * (int64_t)pags_tasks_workers(cache->tasks);
  for (int64_t i = 0; i < cache->count && cache->decoding > 0; i++)
    if (cache->slots[i].state == DECODING && atomic_load(&cache->slots[i].done))
      harvest(cache, &cache->slots[i]);
  for (int64_t i = cache->order_next; i < cache->order_count && cache->decoding < limit; i++) {
    slot *s = &cache->slots[cache->order[i]];
    bool other_size = s->state == READY && s->shrink != cache->order_shrink;
    if (s->wanted_at != i || s->state == DECODING || (s->state == READY && !other_size))
      continue;
    if (cache->order[i] == cache->current)
      continue; /* the caller still uses it at another size; its next get decodes it */
    uint64_t kept, decoding;
    pags_photo_bytes(cache->dataset, cache->order[i], cache->order_shrink, &kept, &decoding);
    if (other_size)
      drop(cache, s);
    if (!make_room(cache, decoding, i))
      return;
    start(s, cache->order_shrink, decoding);
    cache->decoding++;
    pags_job_submit(cache->tasks, &s->job);
  }
}

/* ---- Creation and destruction ---- */

pags_result pags_photo_cache_create(const pags_dataset *dataset, pags_tasks *tasks, uint64_t budget,
                                    pags_photo_cache **out) {
  assert(dataset && tasks && out);
  *out = NULL;
  PAGS_AUTO(pags_photo_cache_destroy_auto) pags_photo_cache *cache = calloc(1, sizeof *cache);
  PAGS_CHECK_MEMORY(cache, "%s", dataset->path);
  cache->dataset = dataset;
  cache->tasks = tasks;
  cache->budget = budget;
  cache->current = -1;
  atomic_init(&cache->closing, false);
  cache->slots = calloc((size_t)dataset->count, sizeof *cache->slots);
  cache->order = calloc((size_t)dataset->count, sizeof *cache->order);
  PAGS_CHECK_MEMORY(cache->slots && cache->order, "%s", dataset->path);
  cache->count = dataset->count;
  for (int64_t i = 0; i < cache->count; i++) {
    slot *s = &cache->slots[i];
    s->cache = cache;
    s->wanted_at = INT64_MAX;
    s->job = (pags_job){.run = run_job, .context = s};
    atomic_init(&s->done, false);
  }
  *out = pags_take(&cache);
  return PAGS_OK;
}

void pags_photo_cache_destroy(pags_photo_cache *cache) {
  if (!cache)
    return;
  atomic_store(&cache->closing, true);
  for (int64_t i = 0; i < cache->count; i++) {
    if (cache->slots[i].state == DECODING)
      harvest(cache, &cache->slots[i]);
    drop(cache, &cache->slots[i]);
  }
  free(cache->slots);
  free(cache->order);
  free(cache);
}

/* ---- Getting photographs and announcing views ---- */

/* Decodes a view on the caller's thread for a get. */
static void decode_now(pags_photo_cache *cache, int64_t view, int shrink) {
  slot *s = &cache->slots[view];
  uint64_t kept, decoding;
  pags_photo_bytes(cache->dataset, view, shrink, &kept, &decoding);
  /* A get may evict everything but the current view; if that isn't enough, background decodes are waited for one by
   * one, which frees the memory they hold beyond their photographs. */
  for (int64_t i = 0; !make_room(cache, decoding, -1) && i < cache->count; i++)
    if (cache->slots[i].state == DECODING)
      harvest(cache, &cache->slots[i]);
  start(s, shrink, decoding);
  pump(cache); /* background decodes run while this thread decodes */
  run_job(s);
  cache->decoded++;
  settle(cache, s);
}

pags_result pags_photo_cache_get(pags_photo_cache *cache, int64_t view, int shrink, pags_photo *out) {
  assert(view >= 0 && view < cache->count && shrink >= 1);
  slot *s = &cache->slots[view];
  cache->current = -1;
  if (s->state == DECODING)
    harvest(cache, s);
  if (s->state == READY && s->shrink != shrink)
    drop(cache, s);
  /* The announced order is done up to and including this view. Views before it that were never asked for count as
   * unannounced from now on. */
  const int64_t position = s->wanted_at;
  if (position != INT64_MAX && shrink == cache->order_shrink) {
    for (int64_t i = cache->order_next; i <= position; i++)
      cache->slots[cache->order[i]].wanted_at = INT64_MAX;
    cache->order_next = position + 1;
  }
  s->last_use = ++cache->gets;
  cache->current = view;
  if (s->state == EMPTY)
    decode_now(cache, view, shrink);
  else
    pump(cache);
  if (s->result != PAGS_OK) {
    cache->current = -1;

    /* Return the error of the decode, which may have happened in the background. */
    pags_result result =
        s->message ? pags_fail(s->result, "%s", s->message) : pags_out_of_memory("%s", cache->dataset->path);
    drop(cache, s); /* the next get decodes anew */
    return result;
  }
  size_t plane = (size_t)s->data.stride * (size_t)s->data.height;
  *out = (pags_photo){.width = s->data.width,
                      .height = s->data.height,
                      .stride = s->data.stride,
                      .rgb = s->data.planes,
                      .mask = s->data.has_mask ? s->data.planes + 3 * plane : NULL,
                      .labels = s->data.has_labels ? s->data.planes + (s->data.has_mask ? 4 : 3) * plane : NULL};
  return PAGS_OK;
}

void pags_photo_cache_prefetch(pags_photo_cache *cache, const int64_t *views, int64_t count, int shrink) {
  for (int64_t i = 0; i < cache->order_count; i++)
    cache->slots[cache->order[i]].wanted_at = INT64_MAX;
  cache->order_count = 0;
  cache->order_next = 0;
  cache->order_shrink = shrink;
  for (int64_t i = 0; i < count; i++) {
    assert(views[i] >= 0 && views[i] < cache->count);
    slot *s = &cache->slots[views[i]];
    if (s->wanted_at != INT64_MAX)
      continue; /* a view that occurs twice keeps its first position */
    s->wanted_at = cache->order_count;
    cache->order[cache->order_count++] = views[i];
  }
  pump(cache);
}

void pags_photo_cache_figures(const pags_photo_cache *cache, uint64_t *used, uint64_t *peak, uint64_t *decoded) {
  *used = cache->used;
  *peak = cache->peak;
  *decoded = cache->decoded;
}
