/* SPDX-License-Identifier: Apache-2.0 */
#include "cluster/transport_checks.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "port/port.h"

static _Thread_local char wrong[2048];

static bool fail(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(wrong, sizeof wrong, format, arguments);
  va_end(arguments);
  return false;
}

#define EXPECT(condition)                                                                  \
  do {                                                                                     \
    if (!(condition))                                                                      \
      return fail("%s:%d: %s (%s)", __FILE__, __LINE__, #condition, pags_error_message()); \
  } while (0)

/* Returns the number of bytes that rank a sends to rank b in a round. A third of the parts are empty. */
static int64_t size_of(int round, int a, int b) {
  const double u = pags_rng_uniform(7, (uint64_t)round, (uint64_t)(a * 64 + b));
  return u < 0.33 ? 0 : (int64_t)(u * u * u * 200000);
}

static char byte_of(int round, int a, int b, int64_t i) {
  return (char)(uint8_t)(round * 31 + a * 17 + b * 5 + (i & 0xffff) * 3 + (i >> 20));
}

/* The buffers of one rank in an exchange. */
typedef struct buffers {
  int64_t send_bytes[64], receive_bytes[64];
  char *send, *receive;
} buffers;

static bool fill(const pags_transport *transport, int round, buffers *out) {
  const int rank = pags_transport_rank(transport), ranks = pags_transport_ranks(transport);
  int64_t sent = 0, received = 0;
  for (int other = 0; other < ranks; other++) {
    sent += out->send_bytes[other] = size_of(round, rank, other);
    received += out->receive_bytes[other] = size_of(round, other, rank);
  }
  out->send = malloc((size_t)sent + 1);
  out->receive = malloc((size_t)received + 1);
  EXPECT(out->send && out->receive);
  memset(out->receive, 0x5a, (size_t)received + 1);
  char *at = out->send;
  for (int other = 0; other < ranks; other++)
    for (int64_t i = 0; i < out->send_bytes[other]; i++)
      *at++ = byte_of(round, rank, other, i);
  return true;
}

static bool check(const pags_transport *transport, int round, buffers *in) {
  const char *at = in->receive;
  for (int other = 0; other < pags_transport_ranks(transport); other++)
    for (int64_t i = 0; i < in->receive_bytes[other]; i++)
      EXPECT(*at++ == byte_of(round, other, pags_transport_rank(transport), i));
  EXPECT(*at == 0x5a);
  free(in->send);
  free(in->receive);
  return true;
}

static bool exchanges(pags_transport *transport) {
  enum { ROUNDS = 18 };
  const pags_transport_counters before = pags_transport_counted(transport);
  int64_t sent = 0;
  for (int round = 0; round < ROUNDS; round++) {
    buffers b;
    if (!fill(transport, round, &b))
      return false;
    EXPECT(pags_transport_exchange(transport, b.send, b.send_bytes, b.receive, b.receive_bytes) == PAGS_OK);
    for (int other = 0; other < pags_transport_ranks(transport); other++)
      sent += other != pags_transport_rank(transport) ? b.send_bytes[other] : 0;
    if (!check(transport, round, &b))
      return false;
  }
  EXPECT(pags_transport_counted(transport).bytes_sent - before.bytes_sent == sent);
  return true;
}

static bool from_and_to_root(pags_transport *transport) {
  const int rank = pags_transport_rank(transport), ranks = pags_transport_ranks(transport);
  for (int root = 0; root < ranks; root++) {
    int data[1000];
    for (int i = 0; i < 1000; i++)
      data[i] = rank == root ? root * 5000 + i : -1;
    EXPECT(pags_transport_broadcast(transport, root, data, sizeof data) == PAGS_OK);
    for (int i = 0; i < 1000; i++)
      EXPECT(data[i] == root * 5000 + i);
    EXPECT(pags_transport_broadcast(transport, root, NULL, 0) == PAGS_OK);

    /* rank r sends r integers */
    int64_t bytes[64];
    int own[64], all[64 * 64];
    for (int other = 0; other < ranks; other++)
      bytes[other] = other * (int64_t)sizeof *own;
    for (int i = 0; i < rank; i++)
      own[i] = rank * 100 + i;
    const bool at_root = rank == root;
    EXPECT(pags_transport_gather(transport, root, own, bytes[rank], at_root ? all : NULL, at_root ? bytes : NULL) ==
           PAGS_OK);
    for (int other = 0, k = 0; at_root && other < ranks; other++)
      for (int i = 0; i < other; i++)
        EXPECT(all[k++] == other * 100 + i);
  }
  return true;
}

static bool agreements(pags_transport *transport) {
  const int rank = pags_transport_rank(transport), ranks = pags_transport_ranks(transport);
  EXPECT(pags_transport_agree(transport, PAGS_OK) == PAGS_OK);
  const int last = ranks - 1;
  pags_result mine = rank == last ? pags_fail(PAGS_ERROR_FORMAT, "the last one's file is damaged") : PAGS_OK;
  EXPECT(pags_transport_agree(transport, mine) == PAGS_ERROR_FORMAT);
  char expected[80];
  snprintf(expected, sizeof expected, "rank %d: the last one's file is damaged", last);
  EXPECT(strcmp(pags_error_message(), ranks > 1 ? expected : "the last one's file is damaged") == 0);
  EXPECT(pags_transport_agree(transport, pags_fail(PAGS_ERROR_IO, "no such file")) == PAGS_ERROR_IO);
  EXPECT(strcmp(pags_error_message(), "no such file") == 0); /* all ranks fail alike: no rank is named */
  if (ranks < 2)
    return true;
  /* a failure precedes a cancellation, and the lowest rank's failure precedes the others' */
  mine = rank == 0 ? pags_fail(PAGS_CANCELLED, "stopped") : pags_fail(PAGS_ERROR_IO, "disk %d", rank);
  EXPECT(pags_transport_agree(transport, mine) == PAGS_ERROR_IO);
  EXPECT(strcmp(pags_error_message(), "rank 1: disk 1") == 0);
  /* the second time, the rank is still named once */
  EXPECT(pags_transport_agree(transport, PAGS_ERROR_IO) == PAGS_ERROR_IO);
  EXPECT(strcmp(pags_error_message(), "rank 1: disk 1") == 0);
  mine = rank == 1 ? pags_fail(PAGS_CANCELLED, "stopped") : PAGS_OK;
  EXPECT(pags_transport_agree(transport, mine) == PAGS_CANCELLED);
  EXPECT(strcmp(pags_error_message(), "stopped") == 0); /* a cancellation names no rank */
  return true;
}

static bool news(pags_transport *transport) {
  const int ranks = pags_transport_ranks(transport);
  int64_t done = -1;
  bool ends_early = true;
  pags_transport_hear(transport, &done, &ends_early);
  EXPECT(done == 0 && !ends_early);
  EXPECT(pags_transport_agree(transport, PAGS_OK) == PAGS_OK); /* no rank tells before all have heard */
  pags_transport_tell(transport, 10 + pags_transport_rank(transport), pags_transport_rank(transport) == ranks - 1);
  const int64_t expected = transport ? 10 * ranks + ranks * (ranks - 1) / 2 : 0;
  const int64_t give_up_ns = pags_port_clock_ns() + 5 * INT64_C(1000000000);
  do
    pags_transport_hear(transport, &done, &ends_early);
  while ((done != expected || ends_early != (transport != NULL)) && pags_port_clock_ns() < give_up_ns);
  EXPECT(done == expected && ends_early == (transport != NULL));
  return true;
}

static bool large_part(pags_transport *transport, int64_t bytes) {
  const int rank = pags_transport_rank(transport), last = pags_transport_ranks(transport) - 1;
  int64_t send_bytes[64] = {0}, receive_bytes[64] = {0};
  char *const data = malloc((size_t)bytes);
  EXPECT(data);
  for (int64_t i = 0; i < bytes; i++)
    data[i] = rank == 0 ? byte_of(1, 0, last, i) : 0;
  send_bytes[last] = rank == 0 ? bytes : 0;
  receive_bytes[0] = rank == last ? bytes : 0;
  EXPECT(pags_transport_exchange(transport, data, send_bytes, data, receive_bytes) == PAGS_OK);
  for (int64_t i = 0; rank == last && i < bytes; i++)
    EXPECT(data[i] == byte_of(1, 0, last, i));
  free(data);
  return true;
}

const char *transport_checks(pags_transport *transport, int64_t large) {
  wrong[0] = '\0';
  const bool right = exchanges(transport) && from_and_to_root(transport) && agreements(transport) &&
                     (large == 0 || large_part(transport, large)) && news(transport);
  if (right)
    wrong[0] = '\0';
  return wrong;
}
