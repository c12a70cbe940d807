/* SPDX-License-Identifier: Apache-2.0 */
/* The server: access checks (access.h), embedded files, and the messages of pages, which render_server.h and
 * run_status.h answer. */
#include "cli/view/server.h"

#include "cli/view/access.h"

#include <libwebsockets.h>
#include <stdatomic.h>

enum {
  CONNECTIONS = 900,   /* maximum number: many idle connections are needed to block others; each costs 8 kB */
  HEADER_BYTES = 4096, /* maximum for all headers of a request */
  HEADER_SECONDS = 5,  /* time limit for the headers of a request */
  IDLE_SECONDS = 10,   /* time limit of a connection without requests */
  PING_SECONDS = 15,   /* between two pings */
  DEAD_SECONDS = 40,   /* time limit without an answer to pings */
  TICK_MS = 200,       /* between checks of `stop` */
  CHUNK = 32768,       /* bytes of a file written at once */
  BAD_MESSAGES = 20    /* invalid messages after which a page is disconnected */
};

struct pags_server {
  pags_server_settings settings;
  pags_access access;
  pags_render_server *render_server;
  struct lws_context *context;
  struct lws_vhost *host;
  lws_sorted_usec_list_t tick;
  _Atomic(const char *) description; /* NULL: not yet */
  _Atomic(const char *) goodbye;     /* NULL: not yet */
  char url[256];
  int port;
};

/* State of a connection, initially zeros. */
typedef struct connection {
  const unsigned char *body; /* unsent rest of an HTTP answer */
  size_t left;
  int session; /* 1 + session of a page; 0: none */
  int bad;     /* number of invalid messages */
  size_t size;
  char message[PAGS_VIEW_MESSAGE]; /* the part of a message received */
} connection;

/* ---- HTTP ---- */

/* Copies a header; false if it is missing, too long or given more than once in parts. */
static bool header(struct lws *wsi, enum lws_token_indexes which, char *out, int size) {
  const int length = lws_hdr_total_length(wsi, which);
  return length > 0 && length < size && lws_hdr_copy(wsi, out, size, which) == length;
}

static bool has_accepted_host(const pags_server *server, struct lws *wsi) {
  char host[PAGS_ACCESS_NAME];
  return header(wsi, WSI_TOKEN_HOST, host, sizeof host) && pags_access_allows_host(&server->access, host);
}

static bool has_cookie(const pags_server *server, struct lws *wsi) {
  char cookie[2048];
  return header(wsi, WSI_TOKEN_HTTP_COOKIE, cookie, sizeof cookie) &&
         pags_access_allows_cookie(&server->access, cookie);
}

/* Adds a header to an answer; false if it doesn't fit. */
static bool add_header(struct lws *wsi, const char *name, const char *value, unsigned char **at, unsigned char *end) {
  return !lws_add_http_header_by_name(wsi, (const unsigned char *)name, (const unsigned char *)value,
                                      (int)strlen(value), at, end);
}

/* Sends the headers and starts sending the body. Returns 0, or 1 to close the connection. */
static int answer(const pags_server *server, struct lws *wsi, connection *c, unsigned status, const char *type,
                  const void *body, size_t size, bool set_cookie) {
  static const char *const extra[][2] = {{"content-security-policy:",
                                          "default-src 'self'; img-src 'self' blob:; object-src 'none'; base-uri "
                                          "'none'; form-action 'none'; frame-ancestors 'none'"},
                                         {"x-content-type-options:", "nosniff"},
                                         {"referrer-policy:", "no-referrer"},
                                         {"cross-origin-resource-policy:", "same-origin"},
                                         {"cache-control:", "no-store"}};
  unsigned char buffer[LWS_PRE + 2048], *const start = buffer + LWS_PRE,
                                               *at = start, *const end = buffer + sizeof buffer;
  char cookie[PAGS_ACCESS_TOKEN + 96];
  if (lws_add_http_common_headers(wsi, status, type, size, &at, end))
    return 1;
  for (size_t i = 0; i < sizeof extra / sizeof extra[0]; i++)
    if (!add_header(wsi, extra[i][0], extra[i][1], &at, end))
      return 1;
  snprintf(cookie, sizeof cookie, "%s=%s; HttpOnly; SameSite=Strict; Path=/", server->access.cookie,
           server->access.token);
  if (set_cookie && !add_header(wsi, "set-cookie:", cookie, &at, end))
    return 1;
  if (lws_finalize_write_http_header(wsi, start, &at, end))
    return 1;
  c->body = body;
  c->left = size;
  lws_callback_on_writable(wsi);
  return 0;
}

static int refuse(const pags_server *server, struct lws *wsi, connection *c, unsigned status, const char *text) {
  return answer(server, wsi, c, status, "text/plain; charset=utf-8", text, strlen(text), false);
}

static int serve(const pags_server *server, struct lws *wsi, connection *c) {
  char path[64], token[PAGS_ACCESS_TOKEN + 8];
  if (!has_accepted_host(server, wsi))
    return refuse(server, wsi, c, HTTP_STATUS_FORBIDDEN,
                  "This host name isn't accepted. Open the address that pags printed, or start it with --host NAME.\n");
  if (lws_hdr_total_length(wsi, WSI_TOKEN_GET_URI) <= 0)
    return refuse(server, wsi, c, HTTP_STATUS_METHOD_NOT_ALLOWED, "Only GET is served.\n");
  if (!header(wsi, WSI_TOKEN_GET_URI, path, sizeof path))
    return refuse(server, wsi, c, HTTP_STATUS_NOT_FOUND, "There is no such page.\n");
  const char *given = lws_get_urlarg_by_name(wsi, "token=", token, sizeof token);
  const bool by_token = given && pags_access_is_token(&server->access, given, strlen(given));
  if (!by_token && !has_cookie(server, wsi))
    return refuse(server, wsi, c, HTTP_STATUS_FORBIDDEN,
                  "The token is missing or wrong. Open the whole address that pags printed, with its ?token=.\n");
  const char *description = atomic_load(&server->description);
  if (!strcmp(path, "/scene.json") && !description)
    return refuse(server, wsi, c, HTTP_STATUS_SERVICE_UNAVAILABLE,
                  "The run is starting: its first step isn't done yet.\n");
  if (!strcmp(path, "/scene.json"))
    return answer(server, wsi, c, HTTP_STATUS_OK, "application/json", description, strlen(description), false);
  const char *name = !strcmp(path, "/") ? "index.html" : path + 1;
  for (const pags_view_file *file = pags_view_files; file->name; file++)
    if (!strcmp(file->name, name))
      return answer(server, wsi, c, HTTP_STATUS_OK, file->type, file->bytes, file->size, by_token);
  return refuse(server, wsi, c, HTTP_STATUS_NOT_FOUND, "There is no such page.\n");
}

/* Writes the next piece of the body. Returns 0, or -1 to close the connection. */
static int send_body(struct lws *wsi, connection *c) {
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

/* Whether a page may open a WebSocket: host, origin and cookie must match. */
static bool may_connect(const pags_server *server, struct lws *wsi) {
  char origin[PAGS_ACCESS_NAME + 16];
  return has_accepted_host(server, wsi) && header(wsi, WSI_TOKEN_ORIGIN, origin, sizeof origin) &&
         pags_access_allows_origin(&server->access, origin) && has_cookie(server, wsi);
}

/* Tells a page why its WebSocket is closed; `text` may be NULL. Returns -1, which closes it. */
static int disconnect(struct lws *wsi, enum lws_close_status status, const char *text) {
  lws_close_reason(wsi, status, (unsigned char *)(uintptr_t)text, text ? strlen(text) : 0);
  return -1;
}

static int open_session(const pags_server *server, struct lws *wsi, connection *c) {
  const char *full = server->settings.run_status ? "a run allows at most 8 open pages"
                                                 : "the maximum number of open pages is reached (pags view --clients)";
  *c = (connection){.session = 1 + pags_render_server_open_session(server->render_server)};
  return c->session ? 0 : disconnect(wsi, LWS_CLOSE_STATUS_PROTOCOL_ERR, full);
}

/* Answers a request about a run. */
static pags_result answer_run(const pags_server *server, int session, const pags_view_request *request) {
  pags_view_message reply;
  if (!server->settings.run_status)
    return pags_fail(PAGS_ERROR_ARGUMENT, "this is a finished scene, not a run");
  PAGS_TRY(pags_run_status_answer(server->settings.run_status, request, &reply));
  pags_render_server_reply(server->render_server, session, &reply);
  return PAGS_OK;
}

/* Receives a fragment of a message and handles the message when it is complete. Returns -1 to close the connection. */
static int receive(const pags_server *server, struct lws *wsi, connection *c, const void *data, size_t size) {
  if (!c->session)
    return disconnect(wsi, LWS_CLOSE_STATUS_PROTOCOL_ERR, NULL);
  if (lws_frame_is_binary(wsi) || size > sizeof c->message - c->size)
    return disconnect(wsi, LWS_CLOSE_STATUS_MESSAGE_TOO_LARGE, NULL);
  memcpy(c->message + c->size, data, size);
  c->size += size;
  if (lws_remaining_packet_payload(wsi) || !lws_is_final_fragment(wsi))
    return 0;
  pags_view_request request;
  const int session = c->session - 1;
  pags_result result = pags_view_request_parse(c->message, c->size, &request);
  const bool bad = result != PAGS_OK;
  c->size = 0;
  if (!bad && request.kind < PAGS_VIEW_RUN) {
    pags_render_server_request(server->render_server, session, &request);
    return 0;
  }
  if (!bad)
    result = answer_run(server, session, &request);
  if (result != PAGS_OK)
    pags_render_server_refuse(server->render_server, session, pags_error_message());
  lws_callback_on_writable(wsi);
  c->bad += bad;
  return bad && c->bad >= BAD_MESSAGES ? disconnect(wsi, LWS_CLOSE_STATUS_POLICY_VIOLATION, NULL) : 0;
}

static int send_next(const pags_server *server, struct lws *wsi, connection *c) {
  pags_view_message message;
  const char *goodbye = atomic_load(&server->goodbye);
  if (goodbye)
    return disconnect(wsi, LWS_CLOSE_STATUS_GOINGAWAY, goodbye);
  if (!c->session || lws_partial_buffered(wsi) ||
      !pags_render_server_next_message(server->render_server, c->session - 1, &message))
    return 0;
  PAGS_AUTOFREE unsigned char *bytes = message.bytes, *padded = malloc(LWS_PRE + message.size);
  if (!padded)
    return -1;
  memcpy(padded + LWS_PRE, bytes, message.size);
  if (lws_write(wsi, padded + LWS_PRE, message.size, message.binary ? LWS_WRITE_BINARY : LWS_WRITE_TEXT) < 0)
    return -1;
  lws_callback_on_writable(wsi); /* for further messages */
  return 0;
}

/* ---- Events ---- */

static int on_event(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *data, size_t size) {
  connection *c = user;
  struct lws_context *context = wsi ? lws_get_context(wsi) : NULL;
  pags_server *server = context ? lws_context_user(context) : NULL;
  switch (reason) {
    case LWS_CALLBACK_HTTP: return serve(server, wsi, c);
    case LWS_CALLBACK_HTTP_BODY: /* of a method that was refused */ return -1;
    case LWS_CALLBACK_HTTP_WRITEABLE: return send_body(wsi, c);
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION: return may_connect(server, wsi) ? 0 : -1;
    case LWS_CALLBACK_ESTABLISHED: return open_session(server, wsi, c);
    case LWS_CALLBACK_RECEIVE: return receive(server, wsi, c, data, size);
    case LWS_CALLBACK_SERVER_WRITEABLE: return send_next(server, wsi, c);
    case LWS_CALLBACK_CLOSED:
      if (c && c->session)
        pags_render_server_close_session(server->render_server, c->session - 1);
      if (c)
        c->session = 0;
      return 0;
    case LWS_CALLBACK_EVENT_WAIT_CANCELLED: /* the render server has a message */
      if (server && server->host)
        lws_callback_on_writable_all_protocol_vhost(server->host, lws_vhost_name_to_protocol(server->host, "pags"));
      return 0;
    default: return lws_callback_http_dummy(wsi, reason, user, data, size);
  }
}

static const struct lws_protocols protocols[] = {{"pags", on_event, sizeof(connection), 4096, 0, NULL, 0},
                                                 {NULL, NULL, 0, 0, 0, NULL, 0}};

void pags_server_wake(pags_server *server) {
  lws_cancel_service(server->context);
}

static void wake(void *user) {
  pags_server_wake(user);
}

static void on_tick(lws_sorted_usec_list_t *list) {
  pags_server *server = lws_container_of(list, pags_server, tick);
  lws_sul_schedule(server->context, 0, &server->tick, on_tick, TICK_MS * LWS_US_PER_MS);
}

/* ---- Start and end ---- */

static pags_result open_port(pags_server *server) {
  static const lws_retry_bo_t alive = {.secs_since_valid_ping = PING_SECONDS, .secs_since_valid_hangup = DEAD_SECONDS};
  const pags_server_settings *settings = &server->settings;
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
  info.user = server;
  server->context = lws_create_context(&info);
  if (!server->context)
    return pags_fail(PAGS_ERROR_MEMORY, "can't start the server");
  info.port = settings->port;
  info.iface = settings->bind;
  info.protocols = protocols;
  info.keepalive_timeout = IDLE_SECONDS;
  info.retry_and_idle_policy = &alive;
  info.vhost_name = "pags";
  server->host = lws_create_vhost(server->context, &info);
  server->port = server->host ? lws_get_vhost_listen_port(server->host) : 0;
  if (server->port <= 0)
    return pags_fail(PAGS_ERROR_IO,
                     "%s:%d: can't listen there: the port is taken, or the address isn't one of this machine; --port 0 "
                     "takes a free port",
                     settings->bind, settings->port);
  return PAGS_OK;
}

pags_result pags_server_create(const pags_server_settings *settings, pags_server **out) {
  unsigned char random[PAGS_ACCESS_TOKEN_BYTES];
  pags_server *server = calloc(1, sizeof *server);
  *out = server;
  PAGS_CHECK_MEMORY(server, NULL);
  server->settings = *settings;
  atomic_init(&server->description, settings->description);
  atomic_init(&server->goodbye, NULL);
  PAGS_TRY(open_port(server));
  if (lws_get_random(server->context, random, sizeof random) != sizeof random)
    return pags_fail(PAGS_ERROR_IO, "the system provides no random numbers for the token");
  PAGS_TRY(pags_access_create(&server->access, random, settings->bind, server->port, settings->hosts));
  snprintf(server->url, sizeof server->url, "http://%s/?token=%s", server->access.hosts[0], server->access.token);
  return pags_render_server_create(&(pags_render_server_settings){.renderer = settings->renderer,
                                                                  .tasks = settings->tasks,
                                                                  .sessions = settings->clients,
                                                                  .on_demand = settings->run_status != NULL,
                                                                  .wake = wake,
                                                                  .user = server},
                                   &server->render_server);
}

void pags_server_destroy(pags_server *server) {
  if (!server)
    return;
  pags_render_server_stop(server->render_server);
  if (server->context)
    lws_context_destroy(server->context); /* closes the sessions of its pages */
  pags_render_server_destroy(server->render_server);
  free(server);
}

const char *pags_server_url(const pags_server *server) {
  return server->url;
}

int pags_server_port(const pags_server *server) {
  return server->port;
}

pags_render_server *pags_server_render_server(const pags_server *server) {
  return server->render_server;
}

void pags_server_describe(pags_server *server, const char *description) {
  atomic_store(&server->description, description);
}

void pags_server_say_goodbye(pags_server *server, const char *text) {
  atomic_store(&server->goodbye, text);
  pags_server_wake(server);
}

pags_result pags_server_run(pags_server *server, const volatile int *stop) {
  lws_sul_schedule(server->context, 0, &server->tick, on_tick, TICK_MS * LWS_US_PER_MS);
  while (!*stop)
    if (lws_service(server->context, 0) < 0)
      return *stop ? PAGS_OK : pags_fail(PAGS_ERROR_IO, "the server failed while it waited for connections");
  lws_sul_cancel(&server->tick);
  return PAGS_OK;
}
