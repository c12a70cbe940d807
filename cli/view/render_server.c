/* SPDX-License-Identifier: Apache-2.0 */
/* The rendering thread and the sessions of pages. */
#include "cli/view/render_server.h"

#include <math.h>
#include "base/clock.h"
#include "port/port.h"

enum {
  STILL_MS = 150,    /* from the last look to the sharp picture */
  REFRESH_MS = 1000, /* on demand: between two sharp pictures of the same look, since the scene changes */
  REPLIES = 8,       /* maximum queue per page; further replies are dropped */
  SHARP_PERCENT = 92,
  LEAST_PERCENT = 35,
  MOST_PERCENT = 80
};

/* Target time from sending a picture to its acknowledgement; a slower connection gets lower JPEG quality. */
static const double line_ms = 80;

typedef struct session {
  bool taken, has_look;
  uint64_t id; /* counts the sessions of this slot, so that a new page never gets the picture of the one before */
  pags_view_look look;
  bool fresh; /* the look hasn't been rendered */
  bool sharp; /* its sharp picture has been rendered */
  double looked_ms, drawn_ms;
  bool in_flight;
  int64_t sent_serial;
  double sent_ms;
  int percent;
  pags_deadline_controller controller;
  bool picks;
  pags_view_request pick;
  pags_view_message picture; /* bytes NULL: none */
  pags_view_message replies[REPLIES];
  int reply_count;
} session;

struct pags_render_server {
  pags_render_server_settings settings;
  pthread_t thread;
  pthread_mutex_t lock;
  pthread_cond_t changed;
  bool quit;
  int drawing; /* session whose sharp picture is being rendered; -1: none */
  int count, last;
  session sessions[];
};

/* ---- Sessions ---- */

static void clear_session(session *s) {
  const uint64_t id = s->id;
  free(s->picture.bytes);
  for (int i = 0; i < s->reply_count; i++)
    free(s->replies[i].bytes);
  memset(s, 0, sizeof *s);
  s->id = id + 1;
}

int pags_render_server_open_session(pags_render_server *server) {
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock);
  for (int i = 0; i < server->count; i++) {
    session *s = &server->sessions[i];
    if (s->taken)
      continue;
    clear_session(s);
    s->taken = true;
    s->controller = pags_renderer_controller(server->settings.renderer);
    s->percent = MOST_PERCENT;
    return i;
  }
  return -1;
}

void pags_render_server_close_session(pags_render_server *server, int number) {
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock);
  if (server->drawing == number)
    pags_tasks_cancel(server->settings.tasks);
  clear_session(&server->sessions[number]);
  pthread_cond_signal(&server->changed);
}

/* Queues a reply and takes it over; drops it if the page doesn't read. */
static void reply(session *s, pags_view_message *message) {
  if (s->reply_count < REPLIES)
    s->replies[s->reply_count++] = *message;
  else
    free(message->bytes);
  *message = (pags_view_message){0};
}

void pags_render_server_request(pags_render_server *server, int number, const pags_view_request *request) {
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock);
  session *s = &server->sessions[number];
  if (request->kind == PAGS_VIEW_LOOK) {
    s->look = request->look;
    s->has_look = s->fresh = true;
    s->sharp = false;
    s->looked_ms = pags_clock_ms();
    if (server->drawing == number)
      pags_tasks_cancel(server->settings.tasks);
  } else if (request->kind == PAGS_VIEW_PICK) {
    s->picks = true;
    s->pick = *request;
  } else if (s->in_flight && !s->picture.bytes && request->serial == s->sent_serial) {
    /* Allow the next picture and adapt the JPEG quality to the connection. */
    const double took = pags_clock_ms() - s->sent_ms;
    s->in_flight = false;
    if (took > line_ms)
      s->percent = s->percent - 10 > LEAST_PERCENT ? s->percent - 10 : LEAST_PERCENT;
    else if (took < line_ms / 2)
      s->percent = s->percent + 5 < MOST_PERCENT ? s->percent + 5 : MOST_PERCENT;
  }
  pthread_cond_signal(&server->changed);
}

void pags_render_server_reply(pags_render_server *server, int number, pags_view_message *message) {
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock);
  reply(&server->sessions[number], message);
}

void pags_render_server_refuse(pags_render_server *server, int number, const char *text) {
  pags_view_message message;
  if (pags_renderer_error_message(text, 0, &message) == PAGS_OK)
    pags_render_server_reply(server, number, &message);
}

bool pags_render_server_next_message(pags_render_server *server, int number, pags_view_message *out) {
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock);
  session *s = &server->sessions[number];
  if (s->reply_count) {
    *out = s->replies[0];
    memmove(s->replies, s->replies + 1, (size_t)--s->reply_count * sizeof *s->replies);
    return true;
  }
  if (!s->picture.bytes)
    return false;
  *out = s->picture;
  s->picture = (pags_view_message){0};
  s->sent_ms = pags_clock_ms();
  return true;
}

/* ---- The thread ---- */

/* Milliseconds until the session is due; 0: now; negative: waits for its page. */
static double due_in(const pags_render_server *server, const session *s, double now) {
  if (!s->taken || !s->has_look)
    return -1;
  if (s->picks)
    return 0;
  if (s->in_flight || (!s->fresh && s->sharp && !server->settings.on_demand))
    return -1;
  if (!s->fresh && s->sharp)
    return fmax(s->drawn_ms + REFRESH_MS - now, 0);
  const double still = s->looked_ms + STILL_MS - now;
  return s->fresh || still < 0 ? 0 : still;
}

/* Returns the next session that is due after the last one served; -1: none, then *wait is the seconds until one is. */
static int next_session(const pags_render_server *server, double *wait) {
  const double now = pags_clock_ms();
  *wait = 3600;
  for (int k = 1; k <= server->count; k++) {
    const int number = (server->last + k) % server->count;
    const double due = due_in(server, &server->sessions[number], now);
    if (due == 0)
      return number;
    if (due > 0 && due * 1e-3 < *wait)
      *wait = due * 1e-3;
  }
  return -1;
}

static void serve_pick(pags_render_server *server, int number) {
  session *s = &server->sessions[number];
  const pags_view_look look = s->look;
  const uint64_t id = s->id;
  const pags_view_request pick = s->pick;
  pags_view_message message;
  s->picks = false;
  pthread_mutex_unlock(&server->lock);
  pags_result result = pags_renderer_pick(server->settings.renderer, &look, pick.x, pick.y, pick.serial, &message);
  if (result != PAGS_OK)
    result = pags_renderer_error_message(pags_error_message(), pick.serial, &message);
  pthread_mutex_lock(&server->lock);
  if (result == PAGS_OK && s->id == id)
    reply(s, &message);
  else if (result == PAGS_OK)
    free(message.bytes);
}

static void serve_picture(pags_render_server *server, int number) {
  session *s = &server->sessions[number];
  const pags_view_look look = s->look;
  const uint64_t id = s->id;
  const bool photograph = look.channel == PAGS_VIEW_PHOTOGRAPH || look.channel == PAGS_VIEW_DIFFERENCE;
  const bool sharp = !s->fresh || photograph; /* photographs always are */
  const int step = s->controller.step;        /* a look that requires full quality ignores it */
  const pags_renderer_quality quality = {.step = sharp || look.full || !look.early_z ? 0 : step,
                                         .sharp = sharp,
                                         .percent = sharp ? SHARP_PERCENT : s->percent};
  pags_view_message message = {0};
  s->fresh = false;
  server->drawing = sharp ? number : -1;
  pags_tasks_reset(server->settings.tasks);
  pthread_mutex_unlock(&server->lock);
  const double begun = pags_clock_ms();
  pags_result result = pags_renderer_draw(server->settings.renderer, &look, &quality, &message);
  const double took = pags_clock_ms() - begun;
  const bool refused = result != PAGS_OK && result != PAGS_CANCELLED;
  if (refused)
    result = pags_renderer_error_message(pags_error_message(), look.serial, &message);
  pthread_mutex_lock(&server->lock);
  server->drawing = -1;
  if (s->id != id || result != PAGS_OK) {
    free(message.bytes);
    return;
  }
  s->sharp = (sharp || refused) && !s->fresh;
  s->drawn_ms = pags_clock_ms();
  if (refused) {
    reply(s, &message);
    return;
  }
  if (!sharp && quality.step == step)
    pags_deadline_controller_tell(&s->controller, took);
  s->picture = message;
  s->sent_serial = look.serial;
  s->in_flight = true;
}

/* Serves the next session that is due; releases the lock meanwhile. Returns false if none is due; then *wait is the
 * seconds until one is. */
static bool serve_next(pags_render_server *server, double *wait) {
  const int number = next_session(server, wait);
  if (number < 0)
    return false;
  if (server->sessions[number].picks) {
    serve_pick(server, number);
  } else {
    server->last = number;
    serve_picture(server, number);
  }
  pthread_mutex_unlock(&server->lock);
  server->settings.wake(server->settings.user);
  pthread_mutex_lock(&server->lock);
  return true;
}

static void *draw_loop(void *user) {
  pags_render_server *server = user;
  double wait;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock);
  while (!server->quit)
    if (!serve_next(server, &wait))
      pags_port_condition_wait(&server->changed, &server->lock, wait);
  return NULL;
}

bool pags_render_server_is_due(pags_render_server *server) {
  double wait;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock);
  return next_session(server, &wait) >= 0;
}

void pags_render_server_draw_next(pags_render_server *server) {
  double wait;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock);
  serve_next(server, &wait);
}

static bool is_empty(const pags_render_server *server) {
  for (int i = 0; i < server->count; i++)
    if (server->sessions[i].taken)
      return false;
  return true;
}

void pags_render_server_wait_empty(pags_render_server *server, double seconds) {
  const double until = pags_clock_ms() + 1e3 * seconds;
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&server->lock);
  for (double left = seconds; left > 0 && !is_empty(server); left = 1e-3 * (until - pags_clock_ms()))
    pags_port_condition_wait(&server->changed, &server->lock, left);
}

/* ---- Start and end ---- */

pags_result pags_render_server_create(const pags_render_server_settings *settings, pags_render_server **out) {
  pags_render_server *server = calloc(1, sizeof *server + (size_t)settings->sessions * sizeof *server->sessions);
  *out = NULL;
  PAGS_CHECK_MEMORY(server, NULL);
  server->settings = *settings;
  server->count = settings->sessions;
  server->drawing = -1;
  pthread_mutex_init(&server->lock, NULL);
  if (!pags_port_condition_create(&server->changed) ||
      (!settings->on_demand && pthread_create(&server->thread, NULL, draw_loop, server))) {
    pthread_mutex_destroy(&server->lock);
    free(server);
    return pags_fail(PAGS_ERROR_MEMORY, "can't start the rendering thread");
  }
  *out = server;
  return PAGS_OK;
}

void pags_render_server_stop(pags_render_server *server) {
  if (!server)
    return;
  pthread_mutex_lock(&server->lock);
  server->quit = true;
  pags_tasks_cancel(server->settings.tasks);
  pthread_cond_signal(&server->changed);
  pthread_mutex_unlock(&server->lock);
  if (!server->settings.on_demand)
    pthread_join(server->thread, NULL);
  pags_tasks_reset(server->settings.tasks);
}

void pags_render_server_destroy(pags_render_server *server) {
  if (!server)
    return;
  for (int i = 0; i < server->count; i++)
    clear_session(&server->sessions[i]);
  pthread_cond_destroy(&server->changed);
  pthread_mutex_destroy(&server->lock);
  free(server);
}
