/* SPDX-License-Identifier: Apache-2.0 */
/* Who may come in: the checks of what a browser says in its request before anything else is done with it. Only text is
 * looked at, so that the checks can be tested and fuzzed without a network. */
#ifndef PAGS_CLI_VIEW_GATE_H
#define PAGS_CLI_VIEW_GATE_H

#include <pags/base.h>
#include <stdbool.h>
#include <stddef.h>

enum {
  PAGS_GATE_TOKEN_BYTES = 24, /* 192 random bits */
  PAGS_GATE_TOKEN = 2 * PAGS_GATE_TOKEN_BYTES,
  PAGS_GATE_HOSTS = 8,
  PAGS_GATE_NAME = 128
};

typedef struct pags_gate {
  char token[PAGS_GATE_TOKEN + 1];             /* hexadecimal digits */
  char hosts[PAGS_GATE_HOSTS][PAGS_GATE_NAME]; /* "name:port" that a request may name as its host */
  int host_count;
  char cookie[32]; /* name of the cookie that holds the token; of its own for each port */
} pags_gate;

/* Makes the token of random bytes, allows the bound address, and for loopback localhost as well, and names the cookie;
 * `given` is a comma-separated list of further hosts, NAME or NAME:PORT, NULL: none. PAGS_ERROR_ARGUMENT for a host
 * that is empty or too long, or too many of them. */
pags_result pags_gate_make(pags_gate *gate, const unsigned char random[PAGS_GATE_TOKEN_BYTES], const char *bound,
                           int port, const char *given);

/* Whether an address is one of this machine alone. */
bool pags_gate_is_loopback(const char *address);

/* Whether a request's Host is one of ours: a page of another name that is made to lead here (DNS rebinding) isn't. */
bool pags_gate_host(const pags_gate *gate, const char *host);

/* Whether a WebSocket's Origin is a page of ours: http:// or https:// and one of the hosts. */
bool pags_gate_origin(const pags_gate *gate, const char *origin);

/* Whether a text is the token; takes the same time wherever they differ. */
bool pags_gate_token(const pags_gate *gate, const char *text, size_t size);

/* Whether a Cookie header holds the token under the cookie's name. */
bool pags_gate_cookie(const pags_gate *gate, const char *header);

#endif
