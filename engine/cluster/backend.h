/* SPDX-License-Identifier: Apache-2.0 */
/* What a transport is made of: functions that move parts, and what all kinds of transports count. */
#ifndef PAGS_CLUSTER_BACKEND_H
#define PAGS_CLUSTER_BACKEND_H

#include "cluster/transport.h"

/* One rank's side of one collective call: what goes to a rank and what comes from it. */
typedef struct pags_part {
  const char *send;
  char *receive;
  int64_t send_bytes, receive_bytes; /* 0: nothing; also of this rank itself, whose part is copied at once */
} pags_part;
typedef struct pags_backend {
  /* Moves a part to and one from each rank; returns once they are there. */
  pags_result (*move)(pags_transport *transport, const pags_part *parts);
  void (*tell)(pags_transport *transport, int64_t done, bool ends_early);
  void (*hear)(const pags_transport *transport, int64_t *done, bool *ends_early);
  void (*give_up)(pags_transport *transport, pags_result result, const char *message);
  bool (*speaks)(const pags_transport *transport);
  void (*destroy)(pags_transport *transport, bool failed);
} pags_backend;

/* The begin of every backend's own struct. */
struct pags_transport {
  const pags_backend *backend;
  int rank, ranks;
  char failure[1024]; /* the message of the last failure that the ranks have agreed on; names its rank */
  pags_transport_counters counters;
};

#endif
