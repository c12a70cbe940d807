/* SPDX-License-Identifier: Apache-2.0 */
/* Collective calls as transfers: each is a set of parts, one to and one from every rank, that the backend moves. A
 * broadcast and a gather go straight between the root and every other rank; what they carry is small compared with what
 * is exchanged. */
#include "cluster/transport.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
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

/* ---- Transfers ---- */

static void destroy_transfer(pags_transfer *transfer) {
  if (transfer)
    free(transfer->parts);
  free(transfer);
}

static pags_result create_transfer(pags_transport *transport, pags_transfer **out) {
  const int ranks = pags_transport_ranks(transport);
  pags_transfer *transfer = *out = calloc(1, sizeof *transfer);
  if (transfer)
    transfer->parts = calloc((size_t)ranks, sizeof *transfer->parts);
  if (!transfer || !transfer->parts) {
    destroy_transfer(transfer);
    *out = NULL;
    return pags_transport_give_up(transport, pags_out_of_memory("a message to %d ranks", ranks));
  }
  transfer->ranks = ranks;
  return PAGS_OK;
}

/* Copies this rank's part to itself and starts the others; frees the transfer if that fails. */
static pags_result begin_transfer(pags_transport *transport, pags_transfer **transfer) {
  struct pags_part *own = &(*transfer)->parts[pags_transport_rank(transport)];
  assert(own->send_bytes == own->receive_bytes);
  if (own->send_bytes)
    memmove(own->receive, own->send, (size_t)own->send_bytes);
  own->send_bytes = own->receive_bytes = 0;
  if (!transport)
    return PAGS_OK;
  for (int rank = 0; rank < transport->ranks; rank++) {
    transport->counters.bytes_sent += (*transfer)->parts[rank].send_bytes;
    transport->counters.bytes_received += (*transfer)->parts[rank].receive_bytes;
  }
  transport->counters.transfers++;
  const pags_result result = transport->backend->begin(transport, *transfer);
  if (result != PAGS_OK) {
    destroy_transfer(*transfer);
    *transfer = NULL;
  }
  return pags_transport_give_up(transport, result);
}

pags_result pags_transport_exchange_finish(pags_transport *transport, pags_transfer *transfer) {
  if (!transfer)
    return PAGS_OK;
  pags_result result = PAGS_OK;
  if (transport) {
    double since = pags_clock_ms();
    result = transport->backend->finish(transport, transfer);
    transport->counters.waited_ms += pags_clock_lap_ms(&since);
  }
  destroy_transfer(transfer);
  return result;
}

static pags_result run_transfer(pags_transport *transport, pags_transfer *transfer) {
  PAGS_TRY(begin_transfer(transport, &transfer));
  return pags_transport_exchange_finish(transport, transfer);
}

/* ---- Collective calls ---- */

pags_result pags_transport_exchange_begin(pags_transport *transport, const void *send, const int64_t *send_bytes,
                                          void *receive, const int64_t *receive_bytes, pags_transfer **transfer) {
  const int ranks = pags_transport_ranks(transport);
  PAGS_TRY(create_transfer(transport, transfer));
  const char *from = send;
  char *to = receive;
  for (int rank = 0; rank < ranks; rank++) {
    assert(send_bytes[rank] >= 0 && receive_bytes[rank] >= 0);
    (*transfer)->parts[rank] = (struct pags_part){from, to, send_bytes[rank], receive_bytes[rank]};
    if (send_bytes[rank])
      from += send_bytes[rank];
    if (receive_bytes[rank])
      to += receive_bytes[rank];
  }
  return begin_transfer(transport, transfer);
}

pags_result pags_transport_exchange(pags_transport *transport, const void *send, const int64_t *send_bytes,
                                    void *receive, const int64_t *receive_bytes) {
  pags_transfer *transfer;
  PAGS_TRY(pags_transport_exchange_begin(transport, send, send_bytes, receive, receive_bytes, &transfer));
  return pags_transport_exchange_finish(transport, transfer);
}

pags_result pags_transport_broadcast(pags_transport *transport, int root, void *data, int64_t bytes) {
  assert(bytes >= 0 && root >= 0 && root < pags_transport_ranks(transport));
  pags_transfer *transfer;
  PAGS_TRY(create_transfer(transport, &transfer));
  if (pags_transport_rank(transport) != root)
    transfer->parts[root] = (struct pags_part){.receive = data, .receive_bytes = bytes};
  else
    for (int rank = 0; rank < transfer->ranks; rank++)
      if (rank != root)
        transfer->parts[rank] = (struct pags_part){.send = data, .send_bytes = bytes};
  return run_transfer(transport, transfer);
}

pags_result pags_transport_gather(pags_transport *transport, int root, const void *send, int64_t bytes, void *receive,
                                  const int64_t *receive_bytes) {
  assert(bytes >= 0 && root >= 0 && root < pags_transport_ranks(transport));
  pags_transfer *transfer;
  PAGS_TRY(create_transfer(transport, &transfer));
  if (pags_transport_rank(transport) == root) {
    char *to = receive;
    for (int rank = 0; rank < transfer->ranks; rank++) {
      transfer->parts[rank] = (struct pags_part){.receive = to, .receive_bytes = receive_bytes[rank]};
      if (receive_bytes[rank])
        to += receive_bytes[rank];
    }
  }
  transfer->parts[root].send = send;
  transfer->parts[root].send_bytes = bytes;
  return run_transfer(transport, transfer);
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
    agreed.result = other->result;
    const bool plain = alike || other->result == PAGS_CANCELLED || !strcmp(other->message, agreed_before);
    char prefix[32] = "";
    if (!plain)
      snprintf(prefix, sizeof prefix, "rank %d: ", rank);
    if (snprintf(agreed.message, sizeof agreed.message, "%s%s", prefix, other->message) < 0)
      agreed.message[0] = '\0';
  }
  return agreed;
}

pags_result pags_transport_agree(pags_transport *transport, pags_result mine) {
  if (!transport)
    return mine;
  const int ranks = transport->ranks;
  ending own = {.result = (int)mine}, agreed = {0};
  if (mine != PAGS_OK)
    snprintf(own.message, sizeof own.message, "%s", pags_error_message());
  ending *endings = NULL;
  int64_t *bytes = NULL;
  bool memory = true;
  if (transport->rank == 0) {
    endings = calloc((size_t)ranks, sizeof *endings);
    bytes = calloc((size_t)ranks, sizeof *bytes);
    memory = endings && bytes;
    for (int rank = 0; memory && rank < ranks; rank++)
      bytes[rank] = sizeof own;
  }
  pags_result result = memory ? pags_transport_gather(transport, 0, &own, sizeof own, endings, bytes)
                              : pags_out_of_memory("the endings of %d ranks", ranks);
  if (result == PAGS_OK && transport->rank == 0)
    agreed = choose_ending(endings, ranks, transport->failure);
  free(endings);
  free(bytes);
  PAGS_TRY(pags_transport_give_up(transport, result));
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
