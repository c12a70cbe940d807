/* SPDX-License-Identifier: Apache-2.0 */
/* The HTTP and WebSocket server of pags view and pags train --view, on libwebsockets: one thread serves every
 * connection, none of which it waits for. It hands out the page's files, which are part of the program, and the scene's
 * description, and nothing else: no name leads to a file of the machine. */
#ifndef PAGS_CLI_VIEW_SERVER_H
#define PAGS_CLI_VIEW_SERVER_H

#include "cli/view/board.h"
#include "cli/view/studio.h"

typedef struct pags_server_settings {
  pags_drawer *drawer;
  pags_tasks *tasks;
  const char *description; /* JSON text, served as scene.json; NULL: pags_server_describe brings it later */
  pags_board *board;       /* of a run, whose pictures are drawn by hand (studio.h); NULL: a finished scene */
  const char *bind;        /* address */
  int port;                /* 0: a free one */
  const char *hosts;       /* further names by which browsers come, separated by commas; NULL: none */
  int clients;             /* pages at once */
} pags_server_settings;

typedef struct pags_server pags_server;

/* Opens the port. PAGS_ERROR_IO with what would do if it can't be had. */
pags_result pags_server_create(const pags_server_settings *settings, pags_server **out);
void pags_server_destroy(pags_server *server); /* NULL is allowed */

/* The address to open in a browser, with the token; owned by the server. */
const char *pags_server_url(const pags_server *server);
int pags_server_port(const pags_server *server);

pags_studio *pags_server_studio(const pags_server *server);

/* Brings the description, once; the text must outlive the server. From any thread. */
void pags_server_describe(pags_server *server, const char *description);

/* Tells all pages why the server ends, and closes their lines; `text` is static. From any thread. */
void pags_server_say_goodbye(pags_server *server, const char *text);

/* Makes pags_server_run look at `stop` now. From any thread. */
void pags_server_wake(pags_server *server);

/* Serves until *stop is not 0. */
pags_result pags_server_run(pags_server *server, const volatile int *stop);

#endif
