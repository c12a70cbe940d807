/* SPDX-License-Identifier: Apache-2.0 */
/* Access checks on the headers of a browser's request, made before anything else. They work on text only, so that they
 * can be tested and fuzzed without a network. */
#ifndef PAGS_CLI_VIEW_ACCESS_H
#define PAGS_CLI_VIEW_ACCESS_H

#include <pags/base.h>
#include <stdbool.h>
#include <stddef.h>

enum {
  PAGS_ACCESS_TOKEN_BYTES = 24, /* 192 random bits */
  PAGS_ACCESS_TOKEN = 2 * PAGS_ACCESS_TOKEN_BYTES,
  PAGS_ACCESS_HOSTS = 8,
  PAGS_ACCESS_NAME = 128
};

typedef struct pags_access {
  char token[PAGS_ACCESS_TOKEN + 1];               /* hexadecimal digits */
  char hosts[PAGS_ACCESS_HOSTS][PAGS_ACCESS_NAME]; /* accepted values of the Host header, "name:port" */
  int host_count;
  char cookie[32]; /* name of the cookie that holds the token; differs for each port */
} pags_access;

/* Makes the token from random bytes, sets the cookie's name, and accepts the bound address as host (for loopback also
 * localhost). `given`: comma-separated list of further hosts, NAME or NAME:PORT; NULL: none. PAGS_ERROR_ARGUMENT if a
 * host is empty or too long, or if there are too many. */
pags_result pags_access_create(pags_access *access, const unsigned char random[PAGS_ACCESS_TOKEN_BYTES],
                               const char *bound, int port, const char *given);

/* Whether the Host header names an accepted host. This stops DNS rebinding: another site's name that resolves to this
 * machine is refused. */
bool pags_access_allows_host(const pags_access *access, const char *host);

/* Whether the Origin header of a WebSocket is http:// or https:// and an accepted host. */
bool pags_access_allows_origin(const pags_access *access, const char *origin);

/* Whether a text is the token, in constant time. */
bool pags_access_is_token(const pags_access *access, const char *text, size_t size);

/* Whether the Cookie header contains the token. */
bool pags_access_allows_cookie(const pags_access *access, const char *header);

#endif
