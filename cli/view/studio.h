/* SPDX-License-Identifier: Apache-2.0 */
/* Draws for all pages in turn, on a thread of its own or when somebody says so. A page holds a seat; what it looks at
 * last is drawn, never what it looked at before that. While looks come, pictures are drawn within the budget, at most
 * one of them not yet acknowledged by its page; when none has come for a moment, a sharp one follows, which a new look
 * of that page cancels. All functions may be called from any thread. */
#ifndef PAGS_CLI_VIEW_STUDIO_H
#define PAGS_CLI_VIEW_STUDIO_H

#include "cli/view/drawer.h"

typedef struct pags_studio pags_studio;

typedef struct pags_studio_settings {
  pags_drawer *drawer; /* used, as `tasks` are, by who draws; both must outlive the studio */
  pags_tasks *tasks;
  int seats;
  bool by_hand;             /* without a thread: pags_studio_draw_next draws a scene that changes, see REFRESH_MS */
  void (*wake)(void *user); /* called when there is something to take */
  void *user;
} pags_studio_settings;

pags_result pags_studio_create(const pags_studio_settings *settings, pags_studio **out);

/* by_hand: whether a page waits for a picture or for what it picked. */
bool pags_studio_is_due(pags_studio *studio);
/* by_hand: draws one picture, or picks, for the next page that waits; nothing if none does. */
void pags_studio_draw_next(pags_studio *studio);

/* by_hand: waits until all have left, or for so many seconds. */
void pags_studio_wait_empty(pags_studio *studio, double seconds);

/* Ends the thread, after which nothing wakes anybody; a picture being drawn is cancelled. Seats may still be left. NULL
 * is allowed. */
void pags_studio_stop(pags_studio *studio);
void pags_studio_destroy(pags_studio *studio); /* of a studio that was stopped; NULL is allowed */

/* Takes a seat; -1 if all are taken. */
int pags_studio_enter(pags_studio *studio);
void pags_studio_leave(pags_studio *studio, int seat);

/* Says what the page of a seat asks for. */
void pags_studio_ask(pags_studio *studio, int seat, const pags_view_request *request);

/* Gives a message to the page of a seat, which is dropped where the page doesn't read; takes over message->bytes. */
void pags_studio_reply(pags_studio *studio, int seat, pags_view_message *message);

/* Says that a message of the page couldn't be read: it is told so. */
void pags_studio_refuse(pags_studio *studio, int seat, const char *text);

/* Takes the next message for the page of a seat; false if there is none. The caller frees out->bytes. */
bool pags_studio_take(pags_studio *studio, int seat, pags_view_message *out);

#endif
