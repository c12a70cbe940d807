/* SPDX-License-Identifier: Apache-2.0 */
/* Collective calls: each is a set of parts, one to and one from every rank, that the backend moves. A
 * broadcast and a gather go straight between the root and every other rank; what they carry is small compared with what
 * is exchanged. */
#include "cluster/transport.h"

#include <assert.h>
#include <stdio.h>

#include "base/memory.h"
#include "cluster/backend.h"

int pags_transport_rank(const pags_transport *transport) {
  return transport ? transport->rank : 0;
}

int pags_transport_ranks(const pags_transport *transport) {
  return transport ? transport->ranks : 1;
}

pags_transport_counters pags_transport_counted(const pags_transport *transport) {
  return transport ? transport->counters : (pags_transport_counters){0};
}

static pags_result create_parts(pags_transport *transport, pags_part **parts) {
  const int ranks = pags_transport_ranks(transport);
  *parts = calloc((size_t)ranks, sizeof **parts);
  return *parts ? PAGS_OK : pags_transport_give_up(transport, pags_out_of_memory("a message to %d ranks", ranks));
}

/* Copies this rank's part to itself and moves the others. */
static pags_result move(pags_transport *transport, pags_part *parts) {
  pags_part *const own = &parts[pags_transport_rank(transport)];
  assert(own->send_bytes == own->receive_bytes);
  if (own->send_bytes)
    memmove(own->receive, own->send, (size_t)own->send_bytes);
  own->send_bytes = own->receive_bytes = 0;
  if (!transport)
    return PAGS_OK;
  for (int rank = 0; rank < transport->ranks; rank++) {
    transport->counters.bytes_sent += parts[rank].send_bytes;
    transport->counters.bytes_received += parts[rank].receive_bytes;
  }
  return pags_transport_give_up(transport, transport->backend->move(transport, parts));
}

/* ---- Collective calls ---- */

pags_result pags_transport_exchange(pags_transport *transport, const void *send, const int64_t *send_bytes,
                                    void *receive, const int64_t *receive_bytes) {
  PAGS_AUTOFREE pags_part *parts = NULL;
  PAGS_TRY(create_parts(transport, &parts));
  const char *from = send;
  char *to = receive;
  for (int rank = 0; rank < pags_transport_ranks(transport); rank++) {
    assert(send_bytes[rank] >= 0 && receive_bytes[rank] >= 0);
    parts[rank] = (pags_part){from, to, send_bytes[rank], receive_bytes[rank]};
    if (send_bytes[rank])
      from += send_bytes[rank];
    if (receive_bytes[rank])
      to += receive_bytes[rank];
  }
  return move(transport, parts);
}

pags_result pags_transport_broadcast(pags_transport *transport, int root, void *data, int64_t bytes) {
  const int ranks = pags_transport_ranks(transport);
  assert(bytes >= 0 && root >= 0 && root < ranks);
  PAGS_AUTOFREE pags_part *parts = NULL;
  PAGS_TRY(create_parts(transport, &parts));
  if (pags_transport_rank(transport) != root)
    parts[root] = (pags_part){.receive = data, .receive_bytes = bytes};
  else
    for (int rank = 0; rank < ranks; rank++)
      if (rank != root)
        parts[rank] = (pags_part){.send = data, .send_bytes = bytes};
  return move(transport, parts);
}

pags_result pags_transport_gather(pags_transport *transport, int root, const void *send, int64_t bytes, void *receive,
                                  const int64_t *receive_bytes) {
  const int ranks = pags_transport_ranks(transport);
  assert(bytes >= 0 && root >= 0 && root < ranks);
  PAGS_AUTOFREE pags_part *parts = NULL;
  PAGS_TRY(create_parts(transport, &parts));
  char *to = receive;
  for (int rank = 0; rank < ranks && pags_transport_rank(transport) == root; rank++) {
    parts[rank] = (pags_part){.receive = to, .receive_bytes = receive_bytes[rank]};
    if (receive_bytes[rank])
      to += receive_bytes[rank];
  }
  parts[root].send = send;
  parts[root].send_bytes = bytes;
  return move(transport, parts);
}

typedef struct ending {
  int result;
  char message[1020];
} ending;

/* How all ranks end, given how each does. */
static ending choose_ending(const ending *endings, int ranks, const char *agreed_before) {
  ending agreed = {0};
  bool alike = true;
  for (int rank = 1; rank < ranks; rank++)
    alike &= endings[rank].result == endings[0].result && !strcmp(endings[rank].message, endings[0].message);
  for (int rank = ranks - 1; rank >= 0; rank--) {
    const ending *other = &endings[rank];
    if (other->result == PAGS_OK ||
        (other->result == PAGS_CANCELLED && agreed.result != PAGS_OK && agreed.result != PAGS_CANCELLED))
      continue;
    const bool plain = alike || other->result == PAGS_CANCELLED || !strcmp(other->message, agreed_before);
    char prefix[32] = "";
    if (!plain)
      snprintf(prefix, sizeof prefix, "rank %d: ", rank);
    agreed.result = other->result;
    if (snprintf(agreed.message, sizeof agreed.message, "%s%s", prefix, other->message) < 0)
      agreed.message[0] = '\0';
  }
  return agreed;
}

pags_result pags_transport_agree(pags_transport *transport, pags_result mine) {
  if (!transport)
    return mine;
  const bool leads = transport->rank == 0;
  const size_t room = leads ? (size_t)transport->ranks : 1;
  ending own = {.result = (int)mine}, agreed = {0};
  if (mine != PAGS_OK)
    snprintf(own.message, sizeof own.message, "%s", pags_error_message());
  PAGS_AUTOFREE ending *endings = calloc(room, sizeof *endings);
  PAGS_AUTOFREE int64_t *bytes = calloc(room, sizeof *bytes);
  if (!endings || !bytes)
    return pags_transport_give_up(transport, pags_out_of_memory("the endings of %d ranks", transport->ranks));
  for (size_t rank = 0; rank < room; rank++)
    bytes[rank] = sizeof own;
  PAGS_TRY(pags_transport_gather(transport, 0, &own, sizeof own, endings, bytes));
  if (leads)
    agreed = choose_ending(endings, transport->ranks, transport->failure);
  PAGS_TRY(pags_transport_broadcast(transport, 0, &agreed, sizeof agreed));
  if (agreed.result == PAGS_OK)
    return PAGS_OK;
  snprintf(transport->failure, sizeof transport->failure, "%s", agreed.message);
  return pags_fail((pags_result)agreed.result, "%s", agreed.message);
}

pags_result pags_transport_give_up(pags_transport *transport, pags_result mine) {
  char message[1024];
  if (!transport || mine == PAGS_OK || (transport->failure[0] && !strcmp(pags_error_message(), transport->failure)))
    return mine;
  if (snprintf(message, sizeof message, "rank %d: %s", transport->rank, pags_error_message()) > 0)
    transport->backend->give_up(transport, mine, message);
  return mine;
}

/* ---- News, beginning and end ---- */

void pags_transport_tell(pags_transport *transport, int64_t done, bool ends_early) {
  if (transport)
    transport->backend->tell(transport, done, ends_early);
}

void pags_transport_hear(const pags_transport *transport, int64_t *done, bool *ends_early) {
  *done = 0;
  *ends_early = false;
  if (transport)
    transport->backend->hear(transport, done, ends_early);
}

bool pags_transport_speaks(const pags_transport *transport) {
  return !transport || transport->backend->speaks(transport);
}

double pags_transport_watchdog(void) {
  enum { DEFAULT_SECONDS = 60 };
  const char *text = getenv("PAGS_WATCHDOG");
  const double seconds = text ? strtod(text, NULL) : 0;
  return seconds > 0 ? seconds : DEFAULT_SECONDS;
}

void pags_transport_destroy(pags_transport *transport, bool failed) {
  if (transport)
    transport->backend->destroy(transport, failed);
}
