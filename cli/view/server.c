/* SPDX-License-Identifier: Apache-2.0 */
/* The server: what it lets in (gate.h), what it hands out, and the messages of pages, which studio.h answers. */
#include "cli/view/server.h"

#include "cli/view/files.h"
#include "cli/view/gate.h"

#include <libwebsockets.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

enum {
  CONNECTIONS = 900,   /* at once: idle ones are many before they keep others out; they cost 8 kB each */
  HEADER_BYTES = 4096, /* of all headers of a request */
  HEADER_SECONDS = 5,  /* for a request's headers to come */
  IDLE_SECONDS = 10,   /* that a connection may stay open without a request */
  PING_SECONDS = 15,   /* between signs of life of a page */
  DEAD_SECONDS = 40,   /* without one */
  TICK_MS = 200,       /* between looks at whether to stop */
  CHUNK = 32768,       /* bytes of a file written at once */
  BAD_MESSAGES = 20    /* of a page that is then disconnected */
};

struct pags_server {
  pags_server_settings settings;
  pags_gate gate;
  pags_studio *studio;
  struct lws_context *context;
  struct lws_vhost *host;
  lws_sorted_usec_list_t tick;
  const volatile int *stop;
  _Atomic(const char *) description; /* NULL: not yet */
  _Atomic(const char *) goodbye;     /* NULL: not yet */
  char url[256];
  int port;
};

/* What is kept of a connection; zeros at first. */
typedef struct connection {
  const unsigned char *body; /* of an HTTP answer, what is left of it */
  size_t left;
  int seat; /* 1 + seat of a page; 0: none */
  int bad;  /* messages that couldn't be read */
  size_t size;
  char message[PAGS_VIEW_MESSAGE]; /* what has come of a message */
} connection;

/* ---- HTTP ---- */

static const char *const policy =
    "default-src 'self'; img-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'";

/* Copies a header; false if it is missing, too long or given more than once in parts. */
static bool header(struct lws *wsi, enum lws_token_indexes which, char *out, int size) {
  const int length = lws_hdr_total_length(wsi, which);
  return length > 0 && length < size && lws_hdr_copy(wsi, out, size, which) == length;
}

static bool comes_by_our_name(const pags_server *self, struct lws *wsi) {
  char host[PAGS_GATE_NAME];
  return header(wsi, WSI_TOKEN_HOST, host, sizeof host) && pags_gate_host(&self->gate, host);
}

static bool has_cookie(const pags_server *self, struct lws *wsi) {
  char cookie[2048];
  return header(wsi, WSI_TOKEN_HTTP_COOKIE, cookie, sizeof cookie) && pags_gate_cookie(&self->gate, cookie);
}

static bool has_token_in_address(const pags_server *self, struct lws *wsi) {
  char value[PAGS_GATE_TOKEN + 8];
  const char *at = lws_get_urlarg_by_name(wsi, "token=", value, sizeof value);
  return at && pags_gate_token(&self->gate, at, strlen(at));
}

/* Sends headers and begins to send the body. Returns 0, or 1 to close the connection. */
static int answer(const pags_server *self, struct lws *wsi, connection *c, unsigned status, const char *type,
                  const void *body, size_t size, bool set_cookie) {
  unsigned char buffer[LWS_PRE + 2048], *const start = buffer + LWS_PRE,
                                               *at = start, *const end = buffer + sizeof buffer;
  static const char *const extra[][2] = {{"content-security-policy:", NULL},
                                         {"x-content-type-options:", "nosniff"},
                                         {"referrer-policy:", "no-referrer"},
                                         {"cross-origin-resource-policy:", "same-origin"},
                                         {"cache-control:", "no-store"}};
  if (lws_add_http_common_headers(wsi, status, type, size, &at, end))
    return 1;
  for (size_t i = 0; i < sizeof extra / sizeof extra[0]; i++) {
    const char *value = extra[i][1] ? extra[i][1] : policy;
    if (lws_add_http_header_by_name(wsi, (const unsigned char *)extra[i][0], (const unsigned char *)value,
                                    (int)strlen(value), &at, end))
      return 1;
  }
  if (set_cookie) {
    char cookie[PAGS_GATE_TOKEN + 96];
    snprintf(cookie, sizeof cookie, "%s=%s; HttpOnly; SameSite=Strict; Path=/", self->gate.cookie, self->gate.token);
    if (lws_add_http_header_by_name(wsi, (const unsigned char *)"set-cookie:", (const unsigned char *)cookie,
                                    (int)strlen(cookie), &at, end))
      return 1;
  }
  if (lws_finalize_write_http_header(wsi, start, &at, end))
    return 1;
  c->body = body;
  c->left = size;
  lws_callback_on_writable(wsi);
  return 0;
}

static int refuse(const pags_server *self, struct lws *wsi, connection *c, unsigned status, const char *text) {
  return answer(self, wsi, c, status, "text/plain; charset=utf-8", text, strlen(text), false);
}

static int serve(const pags_server *self, struct lws *wsi, connection *c) {
  char path[64];
  if (!comes_by_our_name(self, wsi))
    return refuse(self, wsi, c, HTTP_STATUS_FORBIDDEN,
                  "This server doesn't go by that name. Open the address that pags printed, or start it with "
                  "--host NAME.\n");
  if (lws_hdr_total_length(wsi, WSI_TOKEN_GET_URI) <= 0)
    return refuse(self, wsi, c, HTTP_STATUS_METHOD_NOT_ALLOWED, "Only GET is served.\n");
  if (!header(wsi, WSI_TOKEN_GET_URI, path, sizeof path))
    return refuse(self, wsi, c, HTTP_STATUS_NOT_FOUND, "There is no such page.\n");
  const bool by_token = has_token_in_address(self, wsi);
  if (!by_token && !has_cookie(self, wsi))
    return refuse(self, wsi, c, HTTP_STATUS_FORBIDDEN,
                  "The token is missing or wrong. Open the whole address that pags printed, with its ?token=.\n");
  const char *description = atomic_load(&self->description);
  if (!strcmp(path, "/scene.json") && !description)
    return refuse(self, wsi, c, HTTP_STATUS_SERVICE_UNAVAILABLE, "The run begins: its first step isn't done yet.\n");
  if (!strcmp(path, "/scene.json"))
    return answer(self, wsi, c, HTTP_STATUS_OK, "application/json", description, strlen(description), false);
  const char *name = !strcmp(path, "/") ? "index.html" : path + 1;
  for (const pags_view_file *file = pags_view_files; file->name; file++)
    if (!strcmp(file->name, name))
      return answer(self, wsi, c, HTTP_STATUS_OK, file->type, file->bytes, file->size, by_token);
  return refuse(self, wsi, c, HTTP_STATUS_NOT_FOUND, "There is no such page.\n");
}

/* Writes the next piece of the body. Returns 0, or -1 to close the connection. */
static int go_on(struct lws *wsi, connection *c) {
  unsigned char buffer[LWS_PRE + CHUNK];
  const size_t size = c->left < CHUNK ? c->left : CHUNK;
  const bool last = size == c->left;
  if (!c->body)
    return 0;
  memcpy(buffer + LWS_PRE, c->body, size);
  if (lws_write(wsi, buffer + LWS_PRE, size, last ? LWS_WRITE_HTTP_FINAL : LWS_WRITE_HTTP) < (int)size)
    return -1;
  c->body += size;
  c->left -= size;
  if (!last) {
    lws_callback_on_writable(wsi);
    return 0;
  }
  c->body = NULL;
  return lws_http_transaction_completed(wsi) ? -1 : 0;
}

/* ---- WebSocket ---- */

/* Whether a page may open a WebSocket: it must be one of ours. */
static bool may_connect(const pags_server *self, struct lws *wsi) {
  char origin[PAGS_GATE_NAME + 16];
  return comes_by_our_name(self, wsi) && header(wsi, WSI_TOKEN_ORIGIN, origin, sizeof origin) &&
         pags_gate_origin(&self->gate, origin) && has_cookie(self, wsi);
}

static int enter(const pags_server *self, struct lws *wsi, connection *c) {
  const char *full = self->settings.board ? "as many pages are open as a run allows: 8"
                                          : "as many pages are open as pags view --clients allows";
  c->seat = 1 + pags_studio_enter(self->studio);
  if (c->seat)
    return 0;
  lws_close_reason(wsi, LWS_CLOSE_STATUS_PROTOCOL_ERR, (unsigned char *)(uintptr_t)full, strlen(full));
  return -1;
}

/* Does what a page asks for: of a run at once, the rest is drawn. */
static void obey(const pags_server *self, struct lws *wsi, const connection *c, const pags_view_request *request) {
  static const char alone[] = "this is a finished scene, not a run";
  pags_view_message reply = {0};
  const int seat = c->seat - 1;
  if (request->kind < PAGS_VIEW_RUN) {
    pags_studio_ask(self->studio, seat, request);
    return;
  }
  const pags_result result = self->settings.board ? pags_board_answer(self->settings.board, request, &reply)
                                                  : pags_fail(PAGS_ERROR_ARGUMENT, "%s", alone);
  if (result == PAGS_OK)
    pags_studio_reply(self->studio, seat, &reply);
  else
    pags_studio_refuse(self->studio, seat, pags_error_message());
  lws_callback_on_writable(wsi);
}

/* Takes a piece of a message, and the message when it is whole. Returns -1 to close the connection. */
static int receive(const pags_server *self, struct lws *wsi, connection *c, const void *data, size_t size) {
  if (!c->seat || lws_frame_is_binary(wsi) || size > sizeof c->message - c->size) {
    lws_close_reason(wsi, c->seat ? LWS_CLOSE_STATUS_MESSAGE_TOO_LARGE : LWS_CLOSE_STATUS_PROTOCOL_ERR, NULL, 0);
    return -1;
  }
  memcpy(c->message + c->size, data, size);
  c->size += size;
  if (lws_remaining_packet_payload(wsi) || !lws_is_final_fragment(wsi))
    return 0;
  pags_view_request request;
  const pags_result result = pags_view_request_parse(c->message, c->size, &request);
  c->size = 0;
  if (result == PAGS_OK) {
    obey(self, wsi, c, &request);
    return 0;
  }
  pags_studio_refuse(self->studio, c->seat - 1, pags_error_message());
  lws_callback_on_writable(wsi);
  if (++c->bad < BAD_MESSAGES)
    return 0;
  lws_close_reason(wsi, LWS_CLOSE_STATUS_POLICY_VIOLATION, NULL, 0);
  return -1;
}

static int send_next(const pags_server *self, struct lws *wsi, connection *c) {
  pags_view_message message;
  const char *goodbye = atomic_load(&self->goodbye);
  if (goodbye) {
    lws_close_reason(wsi, LWS_CLOSE_STATUS_GOINGAWAY, (unsigned char *)(uintptr_t)goodbye, strlen(goodbye));
    return -1;
  }
  if (!c->seat || lws_partial_buffered(wsi) || !pags_studio_take(self->studio, c->seat - 1, &message))
    return 0;
  unsigned char *padded = malloc(LWS_PRE + message.size);
  int written = -1;
  if (padded) {
    memcpy(padded + LWS_PRE, message.bytes, message.size);
    written = lws_write(wsi, padded + LWS_PRE, message.size, message.binary ? LWS_WRITE_BINARY : LWS_WRITE_TEXT);
  }
  free(padded);
  free(message.bytes);
  if (written < 0)
    return -1;
  lws_callback_on_writable(wsi); /* for what else there is */
  return 0;
}

/* ---- Events ---- */

static int on_event(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *data, size_t size) {
  connection *c = user;
  struct lws_context *context = wsi ? lws_get_context(wsi) : NULL;
  pags_server *self = context ? lws_context_user(context) : NULL;
  switch (reason) {
    case LWS_CALLBACK_HTTP: return serve(self, wsi, c);
    case LWS_CALLBACK_HTTP_BODY: /* of a method that was refused */ return -1;
    case LWS_CALLBACK_HTTP_WRITEABLE: return go_on(wsi, c);
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION: return may_connect(self, wsi) ? 0 : -1;
    case LWS_CALLBACK_ESTABLISHED: memset(c, 0, sizeof *c); return enter(self, wsi, c);
    case LWS_CALLBACK_RECEIVE: return receive(self, wsi, c, data, size);
    case LWS_CALLBACK_SERVER_WRITEABLE: return send_next(self, wsi, c);
    case LWS_CALLBACK_CLOSED:
      if (c && c->seat)
        pags_studio_leave(self->studio, c->seat - 1);
      if (c)
        c->seat = 0;
      return 0;
    case LWS_CALLBACK_EVENT_WAIT_CANCELLED: /* the studio has something to send */
      if (self && self->host)
        lws_callback_on_writable_all_protocol_vhost(self->host, lws_vhost_name_to_protocol(self->host, "pags"));
      return 0;
    default: return lws_callback_http_dummy(wsi, reason, user, data, size);
  }
}

static const struct lws_protocols protocols[] = {{"pags", on_event, sizeof(connection), 4096, 0, NULL, 0},
                                                 {NULL, NULL, 0, 0, 0, NULL, 0}};

void pags_server_wake(pags_server *self) {
  lws_cancel_service(self->context);
}

static void wake(void *user) {
  pags_server_wake(user);
}

static void on_tick(lws_sorted_usec_list_t *list) {
  pags_server *self = lws_container_of(list, pags_server, tick);
  lws_sul_schedule(self->context, 0, &self->tick, on_tick, TICK_MS * LWS_US_PER_MS);
}

/* ---- Start and end ---- */

static pags_result open_port(pags_server *self) {
  static const lws_retry_bo_t alive = {.secs_since_valid_ping = PING_SECONDS, .secs_since_valid_hangup = DEAD_SECONDS};
  const pags_server_settings *settings = &self->settings;
  struct lws_context_creation_info info = {0};
  lws_set_log_level(0, NULL);
  info.options = LWS_SERVER_OPTION_EXPLICIT_VHOSTS | LWS_SERVER_OPTION_FAIL_UPON_UNABLE_TO_BIND;
  if (!strchr(settings->bind, ':'))
    info.options |= LWS_SERVER_OPTION_DISABLE_IPV6;
  info.fd_limit_per_thread = CONNECTIONS;
  info.max_http_header_data = HEADER_BYTES;
  info.max_http_header_pool = CONNECTIONS;
  info.timeout_secs = HEADER_SECONDS;
  info.timeout_secs_ah_idle = HEADER_SECONDS;
  info.user = self;
  self->context = lws_create_context(&info);
  if (!self->context)
    return pags_fail(PAGS_ERROR_MEMORY, "can't start the server");
  info.port = settings->port;
  info.iface = settings->bind;
  info.protocols = protocols;
  info.keepalive_timeout = IDLE_SECONDS;
  info.retry_and_idle_policy = &alive;
  info.vhost_name = "pags";
  self->host = lws_create_vhost(self->context, &info);
  self->port = self->host ? lws_get_vhost_listen_port(self->host) : 0;
  if (self->port <= 0)
    return pags_fail(PAGS_ERROR_IO,
                     "%s:%d: can't listen there: the port is taken, or the address isn't one of this machine; "
                     "--port 0 takes a free port",
                     settings->bind, settings->port);
  return PAGS_OK;
}

pags_result pags_server_create(const pags_server_settings *settings, pags_server **out) {
  unsigned char random[PAGS_GATE_TOKEN_BYTES];
  pags_server *self = calloc(1, sizeof *self);
  *out = self;
  if (!self)
    return pags_out_of_memory(NULL);
  self->settings = *settings;
  atomic_init(&self->description, settings->description);
  atomic_init(&self->goodbye, NULL);
  PAGS_TRY(open_port(self));
  if (lws_get_random(self->context, random, sizeof random) != sizeof random)
    return pags_fail(PAGS_ERROR_IO, "the system provides no random numbers for the token");
  PAGS_TRY(pags_gate_make(&self->gate, random, settings->bind, self->port, settings->hosts));
  snprintf(self->url, sizeof self->url, "http://%s/?token=%s", self->gate.hosts[0], self->gate.token);
  return pags_studio_create(&(pags_studio_settings){.drawer = settings->drawer,
                                                    .tasks = settings->tasks,
                                                    .seats = settings->clients,
                                                    .by_hand = settings->board != NULL,
                                                    .wake = wake,
                                                    .user = self},
                            &self->studio);
}

void pags_server_destroy(pags_server *self) {
  if (!self)
    return;
  pags_studio_stop(self->studio);
  if (self->context)
    lws_context_destroy(self->context); /* its pages leave their seats */
  pags_studio_destroy(self->studio);
  free(self);
}

const char *pags_server_url(const pags_server *self) {
  return self->url;
}

int pags_server_port(const pags_server *self) {
  return self->port;
}

pags_studio *pags_server_studio(const pags_server *self) {
  return self->studio;
}

void pags_server_describe(pags_server *self, const char *description) {
  atomic_store(&self->description, description);
}

void pags_server_say_goodbye(pags_server *self, const char *text) {
  atomic_store(&self->goodbye, text);
  pags_server_wake(self);
}

pags_result pags_server_run(pags_server *self, const volatile int *stop) {
  lws_sul_schedule(self->context, 0, &self->tick, on_tick, TICK_MS * LWS_US_PER_MS);
  while (!*stop)
    if (lws_service(self->context, 0) < 0)
      return *stop ? PAGS_OK : pags_fail(PAGS_ERROR_IO, "the server failed while it waited for connections");
  lws_sul_cancel(&self->tick);
  return PAGS_OK;
}
