/* SPDX-License-Identifier: Apache-2.0 */
/* Draws for pages between the steps of a run, within a share of the time: of every training millisecond,
 * share / (1 - share) milliseconds become credit, at most CREDIT_MS; a picture is drawn while there is credit, and what
 * it took is taken away, so that one picture can make a debt, which the next steps pay first. */
#include "cli/view/watch.h"

#include "cli/draw/describe.h"
#include "cli/view/server.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include "base/clock.h"
#include "base/log.h"
#include "base/memory.h"

enum { CREDIT_MS = 100, CLIENTS = 8, BUDGET_MS = 40, GOODBYE_SECONDS = 3 };

struct pags_watch {
  pags_watch_settings settings;
  pags_tasks *tasks;
  pags_board *board;
  pags_drawer *drawer;
  pags_server *server;
  pags_json_writer description; /* written at the first step */
  bool described;
  pthread_t thread;
  bool running;
  volatile int stop;
  double credit_ms, returned_ms; /* when the last call of pags_watch_step returned; 0: none has */
  double taken_ms, trained_ms;
  int64_t pictures;
};

static void *serve(void *user) {
  pags_watch *self = user;
  if (pags_server_run(self->server, &self->stop) != PAGS_OK)
    pags_log_message(PAGS_LOG_WARNING, "--view: %s; the run continues without its page", pags_error_message());
  return NULL;
}

/* ---- Between two steps ---- */

static pags_result describe(pags_watch *self, pags_composition *composition) {
  pags_view_start start;
  PAGS_TRY(pags_view_start_find(pags_composition_scene(composition), &start));
  PAGS_TRY(pags_view_describe(composition, &start, self->settings.name, true, &self->description));
  pags_server_describe(self->server, self->description.data);
  return PAGS_OK;
}

/* Looks at the run as it stands: describes it at the first time, later draws for a page. */
static pags_result look(pags_watch *self, pags_train_moment *moment) {
  pags_composition *composition;
  PAGS_TRY(pags_train_moment_compose(moment, &composition));
  pags_result result = self->described ? pags_drawer_show(self->drawer, composition) : describe(self, composition);
  if (result == PAGS_OK && self->described) {
    pags_studio_draw_next(pags_server_studio(self->server));
    self->pictures++;
  }
  self->described = self->described || result == PAGS_OK;
  pags_train_moment_release(moment, composition);
  return result;
}

static void save(pags_watch *self, const pags_train_progress *progress) {
  char text[96];
  if (pags_train_moment_save(progress->moment) == PAGS_OK) {
    snprintf(text, sizeof text, "Checkpoint of step %lld written.", (long long)progress->step);
    pags_board_say(self->board, text);
  } else {
    pags_board_say(self->board, pags_error_message());
    pags_log_message(PAGS_LOG_WARNING, "--view: no checkpoint: %s", pags_error_message());
  }
}

bool pags_watch_step(pags_watch *self, const pags_train_progress *progress) {
  const double begun = pags_clock_ms(), share = self->settings.share;
  if (self->returned_ms > 0) {
    const double trained = begun - self->returned_ms;
    self->trained_ms += trained;
    self->credit_ms = share < 1 ? fmin(self->credit_ms + trained * share / (1 - share), CREDIT_MS) : CREDIT_MS;
  }
  const double all = self->taken_ms + self->trained_ms;
  pags_board_tell(self->board, progress, (pags_board_share){share, all > 0 ? self->taken_ms / all : 0, self->pictures});
  if (pags_board_wants_checkpoint(self->board))
    save(self, progress);
  const bool due = !self->described || (share > 0 && pags_studio_is_due(pags_server_studio(self->server)));
  if (due && self->credit_ms > 0 && look(self, progress->moment) != PAGS_OK)
    pags_board_say(self->board, pags_error_message());
  self->returned_ms = pags_clock_ms();
  self->taken_ms += self->returned_ms - begun;
  self->credit_ms -= self->returned_ms - begun;
  return !pags_board_wants_stop(self->board);
}

/* ---- Start and end ---- */

pags_result pags_watch_create(const pags_watch_settings *settings, pags_watch **out) {
  pags_watch *self = calloc(1, sizeof *self);
  *out = self;
  if (!self)
    return pags_out_of_memory(NULL);
  self->settings = *settings;
  self->credit_ms = CREDIT_MS;
  self->tasks = pags_tasks_create(settings->threads);
  if (!self->tasks)
    return pags_fail(PAGS_ERROR_MEMORY, "can't start %d threads", settings->threads);
  PAGS_TRY(pags_board_create(pags_dataset_view_count(settings->dataset), settings->log, &self->board));
  PAGS_TRY(pags_drawer_create(
      &(pags_drawer_settings){.tasks = self->tasks, .budget_ms = BUDGET_MS, .photographs = settings->dataset},
      &self->drawer));
  PAGS_TRY(pags_server_create(&(pags_server_settings){.drawer = self->drawer,
                                                      .tasks = self->tasks,
                                                      .board = self->board,
                                                      .bind = "127.0.0.1",
                                                      .port = settings->port,
                                                      .clients = CLIENTS},
                              &self->server));
  if (pthread_create(&self->thread, NULL, serve, self))
    return pags_fail(PAGS_ERROR_MEMORY, "can't start the thread of the server");
  self->running = true;
  return PAGS_OK;
}

const char *pags_watch_url(const pags_watch *self) {
  return pags_server_url(self->server);
}

void pags_watch_end(pags_watch *self, pags_result result, bool finished) {
  if (!self)
    return;
  if (self->running) {
    pags_server_say_goodbye(self->server, result != PAGS_OK ? "The run has failed; what it printed says why."
                                          : finished        ? "The run is done: its scene is written."
                                                            : "The run was stopped: checkpoint and scene are written.");
    pags_studio_wait_empty(pags_server_studio(self->server), GOODBYE_SECONDS);
    self->stop = 1;
    pags_server_wake(self->server);
    pthread_join(self->thread, NULL);
  }
  pags_server_destroy(self->server);
  pags_drawer_destroy(self->drawer);
  pags_board_destroy(self->board);
  pags_json_writer_destroy(&self->description);
  pags_tasks_destroy(self->tasks);
  free(self);
}
