/* SPDX-License-Identifier: Apache-2.0 */
/* A thread that draws for all pages in turn. A page holds a seat; what it looks at last is drawn, never what it looked
 * at before that. While looks come, pictures are drawn within the budget, at most one of them not yet acknowledged by
 * its page; when none has come for a moment, a sharp one follows, which a new look of that page cancels. All functions
 * may be called from any thread. */
#ifndef PAGS_CLI_VIEW_STUDIO_H
#define PAGS_CLI_VIEW_STUDIO_H

#include "cli/view/drawer.h"

typedef struct pags_studio pags_studio;

/* Starts the thread, which uses `drawer` and `tasks`, both of which must outlive the studio. `wake` is called by it
 * when there is something to take. */
pags_result pags_studio_create(pags_drawer *drawer, pags_tasks *tasks, int seats, void (*wake)(void *user), void *user,
                               pags_studio **out);

/* Ends the thread, after which nothing wakes anybody; a picture being drawn is cancelled. Seats may still be left. NULL
 * is allowed. */
void pags_studio_stop(pags_studio *studio);
void pags_studio_destroy(pags_studio *studio); /* of a studio that was stopped; NULL is allowed */

/* Takes a seat; -1 if all are taken. */
int pags_studio_enter(pags_studio *studio);
void pags_studio_leave(pags_studio *studio, int seat);

/* Says what the page of a seat asks for. */
void pags_studio_ask(pags_studio *studio, int seat, const pags_view_request *request);

/* Says that a message of the page couldn't be read: it is told so. */
void pags_studio_refuse(pags_studio *studio, int seat, const char *text);

/* Takes the next message for the page of a seat; false if there is none. The caller frees out->bytes. */
bool pags_studio_take(pags_studio *studio, int seat, pags_view_message *out);

#endif
