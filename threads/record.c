/* SPDX-License-Identifier: Apache-2.0 */
/* Events and blocks in arrays that grow by doubling. Growing takes time that belongs to no event: the clock is read
 * again afterwards. */
#include "threads/record.h"

#include <stdlib.h>

#include "port/port.h"

static bool grow(void **array, int64_t *capacity, int64_t count, size_t size) {
  if (count < *capacity)
    return true;
  const int64_t more = *capacity > 0 ? 2 * *capacity : 4096;
  void *const larger = realloc(*array, (size_t)more * size);
  if (!larger)
    return false;
  *array = larger;
  *capacity = more;
  return true;
}

void pags_record_destroy(pags_record *record) {
  free(record->events);
  free(record->block_ns);
  *record = (pags_record){0};
}

/* Adds an event under the names that are set. */
static void add_event(pags_record *r, pags_event event) {
  void *events = r->events;
  event.phase = r->phase;
  event.stage = r->stage;
  event.begins = r->begins;
  r->lost |= !grow(&events, &r->capacity, r->count, sizeof *r->events);
  r->events = events;
  if (!r->lost)
    r->events[r->count++] = event;
  r->begins = false;
  r->last = pags_port_clock_ns();
}

void pags_record_end(pags_record *r, pags_event_kind kind) {
  const int64_t ns = pags_port_clock_ns() - r->last;
  if (ns > 0)
    add_event(r, (pags_event){.kind = kind, .ns = ns});
}

void pags_record_block(pags_record *r) {
  const int64_t now = pags_port_clock_ns();
  void *blocks = r->block_ns;
  r->lost |= !grow(&blocks, &r->block_capacity, r->blocks, sizeof *r->block_ns);
  r->block_ns = blocks;
  if (!r->lost)
    r->block_ns[r->blocks++] = now - r->last;
  r->last = now;
}

void pags_record_loop(pags_record *r, int64_t begin, int64_t blocks) {
  add_event(
      r,
      (pags_event){
          .kind = PAGS_EVENT_LOOP, .ns = pags_port_clock_ns() - begin, .first = r->blocks - blocks, .count = blocks});
}
