/* SPDX-License-Identifier: Apache-2.0 */
/* HTTP and WebSocket server of pags view and pags train --view, on libwebsockets. One thread serves all connections
 * without blocking. It serves only the embedded files of the page and the description of the scene, never files of this
 * machine. */
#ifndef PAGS_CLI_VIEW_SERVER_H
#define PAGS_CLI_VIEW_SERVER_H

#include "cli/view/render_server.h"
#include "cli/view/run_status.h"

typedef struct pags_server_settings {
  pags_renderer *renderer;
  pags_tasks *tasks;
  const char *description; /* JSON text, served as scene.json; NULL: set later by pags_server_describe */
  pags_run_status
      *run_status;   /* status of a training run, which renders on demand (render_server.h); NULL: a finished scene */
  const char *bind;  /* address */
  int port;          /* 0: any free port */
  const char *hosts; /* further accepted host names, separated by commas; NULL: none */
  int clients;       /* maximum number of open pages */
} pags_server_settings;

typedef struct pags_server pags_server;

/* Opens the port. PAGS_ERROR_IO with the remedy if the port isn't available. After a failure, *out must be destroyed,
 * too. */
pags_result pags_server_create(const pags_server_settings *settings, pags_server **out);
void pags_server_destroy(pags_server *server); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_server, pags_server_destroy)

/* The address to open in a browser, with the token; owned by the server. */
const char *pags_server_url(const pags_server *server);
int pags_server_port(const pags_server *server);

pags_render_server *pags_server_render_server(const pags_server *server);

/* Sets the description, once; the text must outlive the server. From any thread. */
void pags_server_describe(pags_server *server, const char *description);

/* Closes all connections and tells the pages why; `text` must be static. From any thread. */
void pags_server_say_goodbye(pags_server *server, const char *text);

/* Makes pags_server_run check `stop` now. From any thread. */
void pags_server_wake(pags_server *server);

/* Serves until *stop is not 0. */
pags_result pags_server_run(pags_server *server, const volatile int *stop);

/* ---- The files of the page ---- */

/* Files of cli/view/page/ and cli/common/page/, embedded by cmake/embed.cmake. */
typedef struct pags_view_file {
  const char *name; /* NULL ends the list */
  const char *type; /* of HTTP's Content-Type */
  const unsigned char *bytes;
  size_t size;
} pags_view_file;

extern const pags_view_file pags_view_files[];

#endif
