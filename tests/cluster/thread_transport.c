/* SPDX-License-Identifier: Apache-2.0 */
/* A transport whose ranks are threads of one process. Every message is copied when it is sent. The receiver identifies
 * a message by its sender and by the number of the transfer.
 *
 * With a rate limit, a message arrives when both ends have been busy with it for bytes / rate seconds. Each end handles
 * one message at a time per direction, as a full-duplex network card does. The data is copied earlier, so calls wait
 * until the time of arrival.
 */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/memory.h"
#include "cluster/backend.h"
#include "cluster/thread_ranks.h"
#include "port/port.h"

typedef struct message {
  struct message *next;
  int from;
  int64_t number, bytes;
  double arrives_ms;
  char data[];
} message;

/* One rank as the others see it. The hub's lock guards all fields. */
typedef struct seat {
  message *inbox;
  double sends_until_ms, receives_until_ms;
  int64_t done;
  bool ends_early, left;
} seat;

typedef struct hub {
  pthread_mutex_t lock;
  pthread_cond_t changed;
  int present; /* the last rank to leave frees the hub */
  double bytes_a_ms, watchdog;
  pags_result failure; /* the failure of a rank that gave up */
  char failed[1024];   /* its message; "": no rank gave up */
  seat *seats;
} hub;

typedef struct threads_transport {
  pags_transport base;
  hub *hub;
  int64_t number; /* number of the next transfer */
  bool broken;
} threads_transport;

/* A transfer that is under way. */
typedef struct moving {
  int64_t number;
  double sent_ms; /* time at which the last part of this rank is sent */
} moving;

static pags_result fail_parted(threads_transport *self) {
  hub *shared = self->hub;
  pthread_mutex_lock(&shared->lock);
  const pags_result result = shared->failed[0] ? pags_fail(shared->failure, "%s", shared->failed)
                                               : pags_fail(PAGS_ERROR_IO, "the ranks have parted after a failure");
  pthread_mutex_unlock(&shared->lock);
  return result;
}

static pags_result begin(pags_transport *transport, const pags_part *parts, moving *state) {
  threads_transport *self = (threads_transport *)transport;
  hub *shared = self->hub;
  if (self->broken)
    return fail_parted(self);
  const int ranks = transport->ranks;
  message **messages = calloc((size_t)ranks, sizeof *messages);
  bool memory = messages != NULL;
  for (int rank = 0; memory && rank < ranks; rank++) {
    const int64_t bytes = parts[rank].send_bytes;
    if (!bytes)
      continue;
    messages[rank] = malloc(sizeof **messages + (size_t)bytes);
    memory = messages[rank] != NULL;
    if (memory)
      memcpy(messages[rank]->data, parts[rank].send, (size_t)bytes);
  }
  if (!memory) {
    for (int rank = 0; messages && rank < ranks; rank++)
      free(messages[rank]);
    free(messages);
    return pags_out_of_memory("messages to %d ranks", ranks);
  }
  state->number = self->number++;
  pthread_mutex_lock(&shared->lock);
  const double now = pags_clock_ms();
  seat *own = &shared->seats[transport->rank];
  state->sent_ms = now;
  for (int rank = 0; rank < ranks; rank++) {
    if (!messages[rank])
      continue;
    seat *other = &shared->seats[rank];
    message *sent = messages[rank];
    sent->from = transport->rank;
    sent->number = state->number;
    sent->bytes = parts[rank].send_bytes;
    sent->arrives_ms = now;
    if (shared->bytes_a_ms > 0) {
      double begins = own->sends_until_ms > other->receives_until_ms ? own->sends_until_ms : other->receives_until_ms;
      begins = begins > now ? begins : now;
      sent->arrives_ms = begins + (double)sent->bytes / shared->bytes_a_ms;
      own->sends_until_ms = other->receives_until_ms = state->sent_ms = sent->arrives_ms;
    }
    sent->next = other->inbox;
    other->inbox = sent;
  }
  pthread_cond_broadcast(&shared->changed);
  pthread_mutex_unlock(&shared->lock);
  free(messages);
  return PAGS_OK;
}

/* Takes the message out of this rank's inbox. Returns NULL if it isn't there. The caller holds the lock. */
static message *take(seat *own, int from, int64_t number) {
  for (message **at = &own->inbox; *at; at = &(*at)->next)
    if ((*at)->from == from && (*at)->number == number) {
      message *found = *at;
      *at = found->next;
      return found;
    }
  return NULL;
}

/* Waits until the clock reaches `until_ms`. The caller holds the lock. */
static void wait_until(hub *shared, double until_ms) {
  for (double left = until_ms - pags_clock_ms(); left > 0; left = until_ms - pags_clock_ms())
    pags_port_condition_wait(&shared->changed, &shared->lock, left * 1e-3);
}

static pags_result receive(threads_transport *self, int from, int64_t number, const pags_part *part) {
  hub *shared = self->hub;
  seat *own = &shared->seats[self->base.rank];
  const double give_up_ms = pags_clock_ms() + shared->watchdog * 1e3;
  message *found;
  while (!(found = take(own, from, number))) {
    if (shared->failed[0])
      return pags_fail(shared->failure, "%s", shared->failed);
    if (shared->seats[from].left)
      return pags_fail(PAGS_ERROR_IO, "rank %d of %d has ended before its work was done", from, self->base.ranks);
    const double left = give_up_ms - pags_clock_ms();
    if (left <= 0)
      return pags_fail(PAGS_ERROR_IO, "rank %d of %d has been silent for %g s", from, self->base.ranks,
                       shared->watchdog);
    pags_port_condition_wait(&shared->changed, &shared->lock, left * 1e-3);
  }
  wait_until(shared, found->arrives_ms);
  const int64_t bytes = found->bytes;
  if (bytes == part->receive_bytes)
    memcpy(part->receive, found->data, (size_t)bytes);
  free(found);
  return bytes == part->receive_bytes ? PAGS_OK
                                      : pags_fail(PAGS_ERROR_IO, "rank %d of %d sent %lld bytes; expected %lld", from,
                                                  self->base.ranks, (long long)bytes, (long long)part->receive_bytes);
}

static pags_result move(pags_transport *transport, const pags_part *parts) {
  threads_transport *self = (threads_transport *)transport;
  moving state = {0};
  PAGS_TRY(begin(transport, parts, &state));
  pags_result result = PAGS_OK;
  pthread_mutex_lock(&self->hub->lock);
  for (int rank = 0; result == PAGS_OK && rank < transport->ranks; rank++)
    if (parts[rank].receive_bytes)
      result = receive(self, rank, state.number, &parts[rank]);
  if (result == PAGS_OK)
    wait_until(self->hub, state.sent_ms);
  self->broken = result != PAGS_OK;
  pthread_mutex_unlock(&self->hub->lock);
  return result;
}

static void tell(pags_transport *transport, int64_t done, bool ends_early) {
  hub *shared = ((threads_transport *)transport)->hub;
  pthread_mutex_lock(&shared->lock);
  shared->seats[transport->rank].done = done;
  shared->seats[transport->rank].ends_early = ends_early;
  pthread_mutex_unlock(&shared->lock);
}

static void hear(const pags_transport *transport, int64_t *done, bool *ends_early) {
  hub *shared = ((const threads_transport *)transport)->hub;
  pthread_mutex_lock(&shared->lock);
  for (int rank = 0; rank < transport->ranks; rank++) {
    *done += shared->seats[rank].done;
    *ends_early |= shared->seats[rank].ends_early || shared->seats[rank].left;
  }
  pthread_mutex_unlock(&shared->lock);
}

static void give_up(pags_transport *transport, pags_result result, const char *why) {
  threads_transport *self = (threads_transport *)transport;
  hub *shared = self->hub;
  pthread_mutex_lock(&shared->lock);
  if (!self->broken && !shared->failed[0]) {
    shared->failure = result;
    snprintf(shared->failed, sizeof shared->failed, "%s", why);
  }
  self->broken = true;
  pthread_cond_broadcast(&shared->changed);
  pthread_mutex_unlock(&shared->lock);
}

static bool speaks(const pags_transport *transport) {
  return transport->rank == 0;
}

static void destroy_hub(hub *shared, int ranks) {
  for (int rank = 0; shared->seats && rank < ranks; rank++)
    for (message *next, *at = shared->seats[rank].inbox; at; at = next) {
      next = at->next;
      free(at);
    }
  free(shared->seats);
  pthread_cond_destroy(&shared->changed);
  pthread_mutex_destroy(&shared->lock);
  free(shared);
}

static void destroy(pags_transport *transport, bool failed) {
  (void)failed;
  hub *shared = ((threads_transport *)transport)->hub;
  pthread_mutex_lock(&shared->lock);
  shared->seats[transport->rank].left = true;
  const bool last = --shared->present == 0;
  pthread_cond_broadcast(&shared->changed);
  pthread_mutex_unlock(&shared->lock);
  if (last)
    destroy_hub(shared, transport->ranks);
  free(transport);
}

pags_result pags_transport_create_threads(int ranks, double bytes_a_second, double watchdog,
                                          pags_transport **transports) {
  static const pags_backend backend = {move, tell, hear, give_up, speaks, destroy};
  assert(ranks >= 1 && ranks <= PAGS_RANKS_MOST && bytes_a_second >= 0 && watchdog > 0);
  for (int rank = 0; rank < ranks; rank++)
    transports[rank] = NULL;
  hub *shared = calloc(1, sizeof *shared);
  if (!shared || pthread_mutex_init(&shared->lock, NULL) != 0) {
    free(shared);
    return pags_out_of_memory("%d ranks", ranks);
  }
  if (!pags_port_condition_create(&shared->changed)) {
    pthread_mutex_destroy(&shared->lock);
    free(shared);
    return pags_out_of_memory("%d ranks", ranks);
  }
  shared->bytes_a_ms = bytes_a_second * 1e-3;
  shared->watchdog = watchdog;
  shared->seats = calloc((size_t)ranks, sizeof *shared->seats);
  bool memory = shared->seats != NULL;
  for (int rank = 0; memory && rank < ranks; rank++) {
    threads_transport *self = calloc(1, sizeof *self);
    memory = self != NULL;
    if (memory) {
      *self = (threads_transport){.base = {.backend = &backend, .rank = rank, .ranks = ranks}, .hub = shared};
      transports[rank] = &self->base;
      shared->present++;
    }
  }
  if (memory)
    return PAGS_OK;
  for (int rank = 0; rank < ranks; rank++) {
    free(transports[rank]);
    transports[rank] = NULL;
  }
  destroy_hub(shared, ranks);
  return pags_out_of_memory("%d ranks", ranks);
}
