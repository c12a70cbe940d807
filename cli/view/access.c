/* SPDX-License-Identifier: Apache-2.0 */
/* Checks of token, Host, Origin and cookie. */
#include "cli/view/access.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>
#include "base/text.h"

static pags_result allow(pags_access *access, const char *name, size_t length, int port) {
  if (!length || length > PAGS_ACCESS_NAME - 8)
    return pags_fail(PAGS_ERROR_ARGUMENT, "--host: expected names of 1 to %d letters, separated by commas, got '%.*s'",
                     PAGS_ACCESS_NAME - 8, (int)length, name);
  if (access->host_count == PAGS_ACCESS_HOSTS)
    return pags_fail(PAGS_ERROR_ARGUMENT, "--host: expected at most %d names", PAGS_ACCESS_HOSTS - 2);
  char *host = access->hosts[access->host_count++];
  const char *colon = memchr(name, ':', length);
  const bool bare = name[0] == '[' ? name[length - 1] == ']' : !colon;
  if (bare && port != 80 && port != 443)
    snprintf(host, PAGS_ACCESS_NAME, "%.*s:%d", (int)length, name, port);
  else
    snprintf(host, PAGS_ACCESS_NAME, "%.*s", (int)length, name);
  return PAGS_OK;
}

pags_result pags_access_create(pags_access *access, const unsigned char random[PAGS_ACCESS_TOKEN_BYTES],
                               const char *bound, int port, const char *given) {
  static const char digits[] = "0123456789abcdef";
  memset(access, 0, sizeof *access);
  for (int i = 0; i < PAGS_ACCESS_TOKEN_BYTES; i++) {
    access->token[2 * i] = digits[random[i] >> 4];
    access->token[2 * i + 1] = digits[random[i] & 15];
  }
  snprintf(access->cookie, sizeof access->cookie, "pags_%d", port);
  if (strchr(bound, ':')) { /* a URL has IPv6 addresses in brackets */
    char bracketed[PAGS_ACCESS_NAME];
    snprintf(bracketed, sizeof bracketed, "[%s]", bound);
    PAGS_TRY(allow(access, bracketed, strlen(bracketed), port));
  } else if (strcmp(bound, "0.0.0.0")) {
    PAGS_TRY(allow(access, bound, strlen(bound), port));
  }
  if (pags_text_starts(bound, "127.") || !strcmp(bound, "::1") || !strcmp(bound, "localhost"))
    PAGS_TRY(allow(access, "localhost", strlen("localhost"), port));
  for (const char *at = given; at;) {
    const char *comma = strchr(at, ',');
    const size_t length = comma ? (size_t)(comma - at) : strlen(at);
    /* A name without a port is accepted as is (behind a proxy) and with this port (direct requests). */
    PAGS_TRY(allow(access, at, length, port));
    if (!memchr(at, ':', length))
      PAGS_TRY(allow(access, at, length, 443));
    at = comma ? comma + 1 : NULL;
  }
  return PAGS_OK;
}

bool pags_access_allows_host(const pags_access *access, const char *host) {
  for (int i = 0; i < access->host_count; i++)
    if (!strcasecmp(host, access->hosts[i]))
      return true;
  return false;
}

bool pags_access_allows_origin(const pags_access *access, const char *origin) {
  const char *at = !strncmp(origin, "http://", 7) ? origin + 7 : !strncmp(origin, "https://", 8) ? origin + 8 : NULL;
  return at && pags_access_allows_host(access, at);
}

bool pags_access_is_token(const pags_access *access, const char *text, size_t size) {
  if (size != PAGS_ACCESS_TOKEN)
    return false;
  unsigned differ = 0;
  for (size_t i = 0; i < PAGS_ACCESS_TOKEN; i++)
    differ |= (unsigned)(unsigned char)(access->token[i] ^ text[i]);
  return !differ;
}

bool pags_access_allows_cookie(const pags_access *access, const char *header) {
  const size_t length = strlen(access->cookie);
  for (const char *at = header; at && *at;) {
    at += strspn(at, " ;");
    const size_t size = strcspn(at, ";");
    if (size > length && !strncmp(at, access->cookie, length) && at[length] == '=' &&
        pags_access_is_token(access, at + length + 1, size - length - 1))
      return true;
    at += size;
  }
  return false;
}
