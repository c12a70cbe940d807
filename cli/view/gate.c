/* SPDX-License-Identifier: Apache-2.0 */
/* The checks of token, Host, Origin and cookie. */
#include "cli/view/gate.h"

#include <stdio.h>
#include <string.h>

static bool is_letter(char c, char lower) {
  return c == lower || (c >= 'A' && c <= 'Z' && c - 'A' + 'a' == lower);
}

/* Whether `text` is `name`, whatever the case of its letters. */
static bool same_name(const char *text, const char *name) {
  size_t i = 0;
  for (; name[i] && text[i]; i++) {
    const char lower = name[i] >= 'A' && name[i] <= 'Z' ? (char)(name[i] - 'A' + 'a') : name[i];
    if (!is_letter(text[i], lower))
      return false;
  }
  return !name[i] && !text[i];
}

static pags_result allow(pags_gate *gate, const char *name, size_t length, int port) {
  if (!length || length > PAGS_GATE_NAME - 8)
    return pags_fail(PAGS_ERROR_ARGUMENT, "--host: expected names of 1 to %d letters, separated by commas, got '%.*s'",
                     PAGS_GATE_NAME - 8, (int)length, name);
  if (gate->host_count == PAGS_GATE_HOSTS)
    return pags_fail(PAGS_ERROR_ARGUMENT, "--host: expected at most %d names", PAGS_GATE_HOSTS - 2);
  char *host = gate->hosts[gate->host_count++];
  const char *colon = memchr(name, ':', length);
  const bool bare = name[0] == '[' ? name[length - 1] == ']' : !colon;
  if (bare && port != 80 && port != 443)
    snprintf(host, PAGS_GATE_NAME, "%.*s:%d", (int)length, name, port);
  else
    snprintf(host, PAGS_GATE_NAME, "%.*s", (int)length, name);
  return PAGS_OK;
}

bool pags_gate_is_loopback(const char *address) {
  return !strncmp(address, "127.", 4) || !strcmp(address, "::1") || !strcmp(address, "localhost");
}

pags_result pags_gate_make(pags_gate *gate, const unsigned char random[PAGS_GATE_TOKEN_BYTES], const char *bound,
                           int port, const char *given) {
  static const char digits[] = "0123456789abcdef";
  memset(gate, 0, sizeof *gate);
  for (int i = 0; i < PAGS_GATE_TOKEN_BYTES; i++) {
    gate->token[2 * i] = digits[random[i] >> 4];
    gate->token[2 * i + 1] = digits[random[i] & 15];
  }
  snprintf(gate->cookie, sizeof gate->cookie, "pags_%d", port);
  if (strchr(bound, ':')) { /* IPv6, which an address of the web has in brackets */
    char bracketed[PAGS_GATE_NAME];
    snprintf(bracketed, sizeof bracketed, "[%s]", bound);
    PAGS_TRY(allow(gate, bracketed, strlen(bracketed), port));
  } else if (strcmp(bound, "0.0.0.0")) {
    PAGS_TRY(allow(gate, bound, strlen(bound), port));
  }
  if (pags_gate_is_loopback(bound))
    PAGS_TRY(allow(gate, "localhost", strlen("localhost"), port));
  for (const char *at = given; at;) {
    const char *comma = strchr(at, ',');
    const size_t length = comma ? (size_t)(comma - at) : strlen(at);
    /* A name without a port is meant as it stands behind a proxy, and with the port when it is asked directly. */
    PAGS_TRY(allow(gate, at, length, port));
    if (!memchr(at, ':', length))
      PAGS_TRY(allow(gate, at, length, 443));
    at = comma ? comma + 1 : NULL;
  }
  return PAGS_OK;
}

bool pags_gate_host(const pags_gate *gate, const char *host) {
  for (int i = 0; i < gate->host_count; i++)
    if (same_name(host, gate->hosts[i]))
      return true;
  return false;
}

bool pags_gate_origin(const pags_gate *gate, const char *origin) {
  const char *at = !strncmp(origin, "http://", 7) ? origin + 7 : !strncmp(origin, "https://", 8) ? origin + 8 : NULL;
  return at && pags_gate_host(gate, at);
}

bool pags_gate_token(const pags_gate *gate, const char *text, size_t size) {
  if (size != PAGS_GATE_TOKEN)
    return false;
  unsigned differ = 0;
  for (size_t i = 0; i < PAGS_GATE_TOKEN; i++)
    differ |= (unsigned)(unsigned char)(gate->token[i] ^ text[i]);
  return !differ;
}

bool pags_gate_cookie(const pags_gate *gate, const char *header) {
  const size_t length = strlen(gate->cookie);
  for (const char *at = header; at && *at;) {
    at += strspn(at, " ;");
    const size_t size = strcspn(at, ";");
    if (size > length && !strncmp(at, gate->cookie, length) && at[length] == '=' &&
        pags_gate_token(gate, at + length + 1, size - length - 1))
      return true;
    at += size;
  }
  return false;
}
