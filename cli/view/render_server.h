/* SPDX-License-Identifier: Apache-2.0 */
/* Renders for all pages in turn, on its own thread or on demand. Each page has a session; only its latest request for a
 * view ("look") is rendered. While looks arrive, pictures are rendered within the time budget, with at most one picture
 * per session not yet acknowledged. After a short pause a sharp picture follows, which a new look cancels. All
 * functions may be called from any thread. */
#ifndef PAGS_CLI_VIEW_RENDER_SERVER_H
#define PAGS_CLI_VIEW_RENDER_SERVER_H

#include "cli/view/renderer.h"

typedef struct pags_render_server pags_render_server;

typedef struct pags_render_server_settings {
  pags_renderer *renderer; /* used, like `tasks`, by the rendering thread; both must outlive the server */
  pags_tasks *tasks;
  int sessions;
  bool on_demand; /* no thread: pags_render_server_draw_next renders, and repeats sharp pictures every REFRESH_MS, since
                     the scene changes */
  void (*wake)(void *user); /* called when a message is ready */
  void *user;
} pags_render_server_settings;

pags_result pags_render_server_create(const pags_render_server_settings *settings, pags_render_server **out);

/* on_demand: whether a page waits for a picture or a pick. */
bool pags_render_server_is_due(pags_render_server *server);
/* on_demand: serves one picture or pick to the next waiting page; does nothing if no page waits. */
void pags_render_server_draw_next(pags_render_server *server);

/* on_demand: waits until all sessions are closed, for at most `seconds`. */
void pags_render_server_wait_empty(pags_render_server *server, double seconds);

/* Ends the thread and cancels its picture; `wake` isn't called any more. Sessions may still be closed afterwards. NULL
 * is allowed. */
void pags_render_server_stop(pags_render_server *server);
void pags_render_server_destroy(pags_render_server *server); /* call pags_render_server_stop first; NULL is allowed */

/* Returns the number of a new session; -1 if all are in use. */
int pags_render_server_open_session(pags_render_server *server);
void pags_render_server_close_session(pags_render_server *server, int session);

/* Handles a request of a page: LOOK, PICK or GOT. */
void pags_render_server_request(pags_render_server *server, int session, const pags_view_request *request);

/* Queues a message for a page and takes over message->bytes; drops it if the page doesn't read its messages. */
void pags_render_server_reply(pags_render_server *server, int session, pags_view_message *message);

/* Queues an error message for a page whose request is invalid. */
void pags_render_server_refuse(pags_render_server *server, int session, const char *text);

/* Takes the next message of a page; false if the queue is empty. The caller frees out->bytes. */
bool pags_render_server_next_message(pags_render_server *server, int session, pags_view_message *out);

#endif
