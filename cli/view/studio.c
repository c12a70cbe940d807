/* SPDX-License-Identifier: Apache-2.0 */
/* The drawing thread and the seats of pages. */
#include "cli/view/studio.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include "base/clock.h"
#include "base/memory.h"
#include "port/port.h"

enum {
  STILL_MS = 150,    /* after the last look: time for the sharp picture */
  REFRESH_MS = 1000, /* by hand: between sharp pictures of a look that stays, since the scene changes */
  REPLIES = 8,       /* that wait for a page at most; it is told no more until it reads them */
  SHARP_PERCENT = 92,
  LEAST_PERCENT = 35,
  MOST_PERCENT = 80
};

/* The time that a picture should take from being sent to being acknowledged; a slower line gets fewer bytes. */
static const double line_ms = 80;

typedef struct seat {
  bool taken, has_look;
  uint64_t tenant; /* counts those who have sat here, so that no one gets what was drawn for another */
  pags_view_look look;
  bool fresh; /* the look hasn't been drawn */
  bool sharp; /* its sharp picture has been drawn */
  double looked_ms, drawn_ms;
  bool in_flight;
  int64_t sent_serial;
  double sent_ms;
  int percent;
  pags_deadline_controller controller;
  bool picks;
  double pick_x, pick_y;
  int64_t pick_serial;
  pags_view_message picture; /* bytes NULL: none */
  pags_view_message replies[REPLIES];
  int reply_count;
} seat;

struct pags_studio {
  pags_studio_settings settings;
  pthread_t thread;
  pthread_mutex_t lock;
  pthread_cond_t changed;
  bool quit;
  int drawing; /* seat whose sharp picture is being drawn; -1: none */
  int count, last;
  seat seats[];
};

/* ---- Seats ---- */

static void empty_seat(seat *s) {
  const uint64_t tenant = s->tenant;
  free(s->picture.bytes);
  for (int i = 0; i < s->reply_count; i++)
    free(s->replies[i].bytes);
  memset(s, 0, sizeof *s);
  s->tenant = tenant + 1;
}

int pags_studio_enter(pags_studio *self) {
  int found = -1;
  pthread_mutex_lock(&self->lock);
  for (int i = 0; i < self->count && found < 0; i++)
    if (!self->seats[i].taken)
      found = i;
  if (found >= 0) {
    empty_seat(&self->seats[found]);
    self->seats[found].taken = true;
    self->seats[found].controller = pags_drawer_controller(self->settings.drawer);
    self->seats[found].percent = MOST_PERCENT;
  }
  pthread_mutex_unlock(&self->lock);
  return found;
}

void pags_studio_leave(pags_studio *self, int number) {
  pthread_mutex_lock(&self->lock);
  if (self->drawing == number)
    pags_tasks_cancel(self->settings.tasks);
  empty_seat(&self->seats[number]);
  pthread_cond_signal(&self->changed);
  pthread_mutex_unlock(&self->lock);
}

/* Takes over a reply; drops it where the page doesn't read. */
static void reply(seat *s, pags_view_message *message) {
  if (s->reply_count < REPLIES)
    s->replies[s->reply_count++] = *message;
  else
    free(message->bytes);
  *message = (pags_view_message){0};
}

static void take_look(pags_studio *self, int number, const pags_view_look *look) {
  seat *s = &self->seats[number];
  s->look = *look;
  s->has_look = s->fresh = true;
  s->sharp = false;
  s->looked_ms = pags_clock_ms();
  if (self->drawing == number)
    pags_tasks_cancel(self->settings.tasks);
}

/* The page has its picture: the next may be drawn, of the quality that the line takes. */
static void acknowledge(seat *s, int64_t serial) {
  if (!s->in_flight || s->picture.bytes || serial != s->sent_serial)
    return;
  const double took = pags_clock_ms() - s->sent_ms;
  s->in_flight = false;
  if (took > line_ms)
    s->percent = s->percent - 10 > LEAST_PERCENT ? s->percent - 10 : LEAST_PERCENT;
  else if (took < line_ms / 2)
    s->percent = s->percent + 5 < MOST_PERCENT ? s->percent + 5 : MOST_PERCENT;
}

void pags_studio_ask(pags_studio *self, int number, const pags_view_request *request) {
  pthread_mutex_lock(&self->lock);
  seat *s = &self->seats[number];
  if (request->kind == PAGS_VIEW_LOOK) {
    take_look(self, number, &request->look);
  } else if (request->kind == PAGS_VIEW_GOT) {
    acknowledge(s, request->serial);
  } else {
    s->picks = true;
    s->pick_x = request->x;
    s->pick_y = request->y;
    s->pick_serial = request->serial;
  }
  pthread_cond_signal(&self->changed);
  pthread_mutex_unlock(&self->lock);
}

void pags_studio_reply(pags_studio *self, int number, pags_view_message *message) {
  pthread_mutex_lock(&self->lock);
  reply(&self->seats[number], message);
  pthread_mutex_unlock(&self->lock);
}

void pags_studio_refuse(pags_studio *self, int number, const char *text) {
  pags_view_message message;
  if (pags_drawer_refuse(text, 0, &message) == PAGS_OK)
    pags_studio_reply(self, number, &message);
}

bool pags_studio_take(pags_studio *self, int number, pags_view_message *out) {
  pthread_mutex_lock(&self->lock);
  seat *s = &self->seats[number];
  bool found = true;
  if (s->reply_count) {
    *out = s->replies[0];
    memmove(s->replies, s->replies + 1, (size_t)--s->reply_count * sizeof *s->replies);
  } else if (s->picture.bytes) {
    *out = s->picture;
    s->picture = (pags_view_message){0};
    s->sent_ms = pags_clock_ms();
  } else {
    found = false;
  }
  pthread_mutex_unlock(&self->lock);
  return found;
}

/* ---- The thread ---- */

/* A photograph has no coarse picture. */
static bool is_photograph(const seat *s) {
  return s->look.channel == PAGS_VIEW_PHOTOGRAPH || s->look.channel == PAGS_VIEW_DIFFERENCE;
}

/* Milliseconds until the seat is to be drawn, 0: now; negative: not before something comes from its page. */
static double due_in(const pags_studio *self, const seat *s, double now) {
  if (!s->taken || !s->has_look)
    return -1;
  if (s->picks)
    return 0;
  if (s->in_flight || (!s->fresh && s->sharp && !self->settings.by_hand))
    return -1;
  if (!s->fresh && s->sharp)
    return fmax(s->drawn_ms + REFRESH_MS - now, 0);
  const double still = s->looked_ms + STILL_MS - now;
  return s->fresh || still < 0 ? 0 : still;
}

/* The next seat that is due, after the one drawn last; -1: none, and *wait receives the seconds until one is. */
static int next_seat(const pags_studio *self, double *wait) {
  const double now = pags_clock_ms();
  *wait = 3600;
  for (int k = 1; k <= self->count; k++) {
    const int number = (self->last + k) % self->count;
    const double due = due_in(self, &self->seats[number], now);
    if (due == 0)
      return number;
    if (due > 0 && due * 1e-3 < *wait)
      *wait = due * 1e-3;
  }
  return -1;
}

static void serve_pick(pags_studio *self, int number) {
  seat *s = &self->seats[number];
  const pags_view_look look = s->look;
  const uint64_t tenant = s->tenant;
  const double x = s->pick_x, y = s->pick_y;
  const int64_t serial = s->pick_serial;
  pags_view_message message;
  s->picks = false;
  pthread_mutex_unlock(&self->lock);
  pags_result result = pags_drawer_pick(self->settings.drawer, &look, x, y, serial, &message);
  if (result != PAGS_OK)
    result = pags_drawer_refuse(pags_error_message(), serial, &message);
  pthread_mutex_lock(&self->lock);
  if (result == PAGS_OK && s->tenant == tenant)
    reply(s, &message);
  else if (result == PAGS_OK)
    free(message.bytes);
}

static void serve_picture(pags_studio *self, int number) {
  seat *s = &self->seats[number];
  const pags_view_look look = s->look;
  const uint64_t tenant = s->tenant;
  const bool sharp = !s->fresh || is_photograph(s);
  const pags_drawer_quality quality = {
      .step = sharp ? 0 : s->controller.step, .sharp = sharp, .percent = sharp ? SHARP_PERCENT : s->percent};
  pags_view_message message = {0};
  pags_drawer_facts facts;
  s->fresh = false;
  self->drawing = sharp ? number : -1;
  pags_tasks_reset(self->settings.tasks);
  pthread_mutex_unlock(&self->lock);
  pags_result result = pags_drawer_draw(self->settings.drawer, &look, &quality, &message, &facts);
  bool refused = false;
  if (result != PAGS_OK && result != PAGS_CANCELLED) {
    refused = true;
    result = pags_drawer_refuse(pags_error_message(), look.serial, &message);
  }
  pthread_mutex_lock(&self->lock);
  self->drawing = -1;
  if (s->tenant != tenant || result != PAGS_OK) {
    free(message.bytes);
    return;
  }
  if (refused) {
    reply(s, &message);
    s->sharp = !s->fresh;
    s->drawn_ms = pags_clock_ms();
    return;
  }
  if (!sharp && facts.step == quality.step) /* a look may ask for full quality, which says nothing of the step */
    pags_deadline_controller_tell(&s->controller, facts.ms);
  s->sharp = sharp && !s->fresh;
  s->drawn_ms = pags_clock_ms();
  s->picture = message;
  s->sent_serial = look.serial;
  s->in_flight = true;
}

/* Draws or picks for the next seat that is due, with the lock held, which it gives up meanwhile. Returns false if none
 * is; then *wait receives the seconds until one is. */
static bool serve_next(pags_studio *self, double *wait) {
  const int number = next_seat(self, wait);
  if (number < 0)
    return false;
  if (self->seats[number].picks)
    serve_pick(self, number);
  else {
    self->last = number;
    serve_picture(self, number);
  }
  pthread_mutex_unlock(&self->lock);
  self->settings.wake(self->settings.user);
  pthread_mutex_lock(&self->lock);
  return true;
}

static void *draw_loop(void *user) {
  pags_studio *self = user;
  double wait;
  pthread_mutex_lock(&self->lock);
  while (!self->quit)
    if (!serve_next(self, &wait))
      pags_port_condition_wait(&self->changed, &self->lock, wait);
  pthread_mutex_unlock(&self->lock);
  return NULL;
}

bool pags_studio_is_due(pags_studio *self) {
  double wait;
  pthread_mutex_lock(&self->lock);
  const bool due = next_seat(self, &wait) >= 0;
  pthread_mutex_unlock(&self->lock);
  return due;
}

void pags_studio_draw_next(pags_studio *self) {
  double wait;
  pthread_mutex_lock(&self->lock);
  serve_next(self, &wait);
  pthread_mutex_unlock(&self->lock);
}

static bool is_empty(const pags_studio *self) {
  for (int i = 0; i < self->count; i++)
    if (self->seats[i].taken)
      return false;
  return true;
}

void pags_studio_wait_empty(pags_studio *self, double seconds) {
  const double until = pags_clock_ms() + 1e3 * seconds;
  pthread_mutex_lock(&self->lock);
  for (double left = seconds; left > 0 && !is_empty(self); left = 1e-3 * (until - pags_clock_ms()))
    pags_port_condition_wait(&self->changed, &self->lock, left);
  pthread_mutex_unlock(&self->lock);
}

/* ---- Start and end ---- */

pags_result pags_studio_create(const pags_studio_settings *settings, pags_studio **out) {
  pags_studio *self = calloc(1, sizeof *self + (size_t)settings->seats * sizeof *self->seats);
  *out = NULL;
  if (!self)
    return pags_out_of_memory(NULL);
  self->settings = *settings;
  self->count = settings->seats;
  self->drawing = -1;
  pthread_mutex_init(&self->lock, NULL);
  if (!pags_port_condition_create(&self->changed) ||
      (!settings->by_hand && pthread_create(&self->thread, NULL, draw_loop, self))) {
    pthread_mutex_destroy(&self->lock);
    free(self);
    return pags_fail(PAGS_ERROR_MEMORY, "can't start the thread that draws");
  }
  *out = self;
  return PAGS_OK;
}

void pags_studio_stop(pags_studio *self) {
  if (!self)
    return;
  pthread_mutex_lock(&self->lock);
  self->quit = true;
  pags_tasks_cancel(self->settings.tasks);
  pthread_cond_signal(&self->changed);
  pthread_mutex_unlock(&self->lock);
  if (!self->settings.by_hand)
    pthread_join(self->thread, NULL);
  pags_tasks_reset(self->settings.tasks);
}

void pags_studio_destroy(pags_studio *self) {
  if (!self)
    return;
  for (int i = 0; i < self->count; i++)
    empty_seat(&self->seats[i]);
  pthread_cond_destroy(&self->changed);
  pthread_mutex_destroy(&self->lock);
  free(self);
}
