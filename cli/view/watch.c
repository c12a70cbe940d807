/* SPDX-License-Identifier: Apache-2.0 */
/* Renders for pages between training steps, within a share of the time. Each training millisecond adds share / (1 -
 * share) milliseconds of credit, up to CREDIT_MS. A picture is rendered while the credit is positive, and its time is
 * subtracted; a negative credit is repaid by the next steps. */
#include "cli/view/watch.h"

#include "cli/draw/camera_paths.h"
#include "cli/view/server.h"

#include <math.h>
#include <pthread.h>
#include "base/clock.h"
#include "base/log.h"

enum { CREDIT_MS = 100, CLIENTS = 8, BUDGET_MS = 40, GOODBYE_SECONDS = 3 };

struct pags_watch {
  pags_watch_settings settings;
  pags_tasks *tasks;
  pags_run_status *run_status;
  pags_renderer *renderer;
  pags_server *server;
  pags_json_writer description; /* written at the first step */
  bool described;
  pthread_t thread;
  bool running;
  volatile int stop;
  double credit_ms, returned_ms; /* end of the last pags_watch_step; 0: no call yet */
  double taken_ms, trained_ms;
  int64_t pictures;
};

static void *serve(void *user) {
  pags_watch *watch = user;
  if (pags_server_run(watch->server, &watch->stop) != PAGS_OK)
    PAGS_WARN("--view: %s; the run continues without its page", pags_error_message());
  return NULL;
}

/* ---- Between two steps ---- */

/* Describes the scene on the first call; renders for a page on later calls. */
static pags_result look(pags_watch *watch, pags_composition *composition) {
  if (watch->described) {
    PAGS_TRY(pags_renderer_set_scene(watch->renderer, composition));
    pags_render_server_draw_next(pags_server_render_server(watch->server));
    watch->pictures++;
    return PAGS_OK;
  }
  pags_view_start start;
  PAGS_TRY(pags_view_start_find(pags_composition_scene(composition), &start));
  PAGS_TRY(pags_view_describe(composition, &start, watch->settings.name, true, &watch->description));
  pags_server_describe(watch->server, watch->description.data);
  watch->described = true;
  return PAGS_OK;
}

/* As `look`, of the scene as it is now. */
static pags_result look_now(pags_watch *watch, pags_train_moment *moment) {
  pags_composition *composition;
  PAGS_TRY(pags_train_moment_compose(moment, &composition));
  const pags_result result = look(watch, composition);
  pags_train_moment_release(moment, composition);
  return result;
}

static void save(pags_watch *watch, const pags_train_progress *progress) {
  char text[96];
  if (pags_train_moment_save(progress->moment) == PAGS_OK) {
    snprintf(text, sizeof text, "Checkpoint of step %lld written.", (long long)progress->step);
    pags_run_status_notify(watch->run_status, text);
  } else {
    pags_run_status_notify(watch->run_status, pags_error_message());
    PAGS_WARN("--view: no checkpoint: %s", pags_error_message());
  }
}

bool pags_watch_step(pags_watch *watch, const pags_train_progress *progress) {
  const double begun = pags_clock_ms(), share = watch->settings.share;
  if (watch->returned_ms > 0) {
    const double trained = begun - watch->returned_ms;
    watch->trained_ms += trained;
    watch->credit_ms = share < 1 ? fmin(watch->credit_ms + trained * share / (1 - share), CREDIT_MS) : CREDIT_MS;
  }
  const double all = watch->taken_ms + watch->trained_ms;
  pags_run_status_update(watch->run_status, progress,
                         (pags_run_status_share){share, all > 0 ? watch->taken_ms / all : 0, watch->pictures});
  if (pags_run_status_wants_checkpoint(watch->run_status))
    save(watch, progress);
  const bool due =
      !watch->described || (share > 0 && pags_render_server_is_due(pags_server_render_server(watch->server)));
  if (due && watch->credit_ms > 0 && look_now(watch, progress->moment) != PAGS_OK)
    pags_run_status_notify(watch->run_status, pags_error_message());
  watch->returned_ms = pags_clock_ms();
  watch->taken_ms += watch->returned_ms - begun;
  watch->credit_ms -= watch->returned_ms - begun;
  return !pags_run_status_wants_stop(watch->run_status);
}

/* ---- Start and end ---- */

pags_result pags_watch_create(const pags_watch_settings *settings, pags_watch **out) {
  pags_watch *watch = calloc(1, sizeof *watch);
  *out = watch;
  PAGS_CHECK_MEMORY(watch, NULL);
  watch->settings = *settings;
  watch->credit_ms = CREDIT_MS;
  watch->tasks = pags_tasks_create(settings->threads);
  if (!watch->tasks)
    return pags_fail(PAGS_ERROR_MEMORY, "can't start %d threads", settings->threads);
  PAGS_TRY(pags_run_status_create(pags_dataset_view_count(settings->dataset), settings->log, &watch->run_status));
  PAGS_TRY(pags_renderer_create(
      &(pags_renderer_settings){.tasks = watch->tasks, .budget_ms = BUDGET_MS, .photographs = settings->dataset},
      &watch->renderer));
  PAGS_TRY(pags_server_create(&(pags_server_settings){.renderer = watch->renderer,
                                                      .tasks = watch->tasks,
                                                      .run_status = watch->run_status,
                                                      .bind = "127.0.0.1",
                                                      .port = settings->port,
                                                      .clients = CLIENTS},
                              &watch->server));
  if (pthread_create(&watch->thread, NULL, serve, watch))
    return pags_fail(PAGS_ERROR_MEMORY, "can't start the thread of the server");
  watch->running = true;
  return PAGS_OK;
}

const char *pags_watch_url(const pags_watch *watch) {
  return pags_server_url(watch->server);
}

void pags_watch_end(pags_watch *watch, pags_result result, bool finished) {
  if (!watch)
    return;
  if (watch->running) {
    pags_server_say_goodbye(watch->server, result != PAGS_OK ? "The run has failed; see its messages."
                                           : finished        ? "The run is done: its scene is written."
                                                      : "The run was stopped: checkpoint and scene are written.");
    pags_render_server_wait_empty(pags_server_render_server(watch->server), GOODBYE_SECONDS);
    watch->stop = 1;
    pags_server_wake(watch->server);
    pthread_join(watch->thread, NULL);
  }
  pags_server_destroy(watch->server);
  pags_renderer_destroy(watch->renderer);
  pags_run_status_destroy(watch->run_status);
  pags_json_writer_destroy(&watch->description);
  pags_tasks_destroy(watch->tasks);
  free(watch);
}
