/* SPDX-License-Identifier: Apache-2.0 */
/* The figures and curves of a run. A curve has at most POINTS points: when it is full, every other one goes, and pages
 * are told by another edition to fetch it anew. */
#include "cli/view/board.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include "base/file.h"
#include "base/memory.h"
#include "port/port.h"

enum { POINTS = 1024, HELD = 256, WORST = 6, SAID = 160 };

typedef enum column { STEP, LOSS, PSNR, GAUSSIANS, RATE, MEMORY, COLUMNS } column;

typedef struct held_out {
  int64_t step;
  double psnr;
} held_out;

struct pags_board {
  pthread_mutex_t lock;
  double points[POINTS][COLUMNS]; /* NaN: not known */
  int64_t edition;
  int count, held_count;
  int64_t every; /* steps between points; 0: no step yet */
  held_out held[HELD];
  pags_train_progress now;
  pags_board_share share;
  uint64_t memory; /* resident, bytes, at the last point */
  int64_t views;
  double *psnr_of; /* per view, as it was seen last; NaN: never */
  double *held_of; /* the same of held-out views */
  bool checkpoint, stop;
  char said[SAID];
};

/* ---- Curves ---- */

static void add_point(pags_board *self, const double point[COLUMNS]) {
  if (self->count == POINTS) {
    for (int i = 0; i < POINTS / 2; i++)
      memcpy(self->points[i], self->points[2 * i + 1], sizeof self->points[i]);
    self->count = POINTS / 2;
    self->every *= 2;
    self->edition++;
  }
  memcpy(self->points[self->count++], point, COLUMNS * sizeof *point);
}

static void add_held_out(pags_board *self, int64_t step, double psnr) {
  if (self->held_count == HELD) {
    for (int i = 0; i < HELD / 2; i++)
      self->held[i] = self->held[2 * i + 1];
    self->held_count = HELD / 2;
  }
  self->held[self->held_count++] = (held_out){step, psnr};
}

/* Takes a line of an earlier log. */
static pags_result read_line(pags_board *self, const pags_json *json) {
  const pags_json_value *root = pags_json_root(json);
  double step, gaussians, loss, psnr;
  PAGS_TRY(pags_json_number(json, root, "step", &step));
  PAGS_TRY(pags_json_number(json, root, "gaussians", &gaussians));
  if (pags_json_member(root, "held_out_psnr")) {
    PAGS_TRY(pags_json_number_or(json, root, "held_out_psnr", (double)NAN, &psnr));
    add_held_out(self, (int64_t)step, psnr);
  } else if (pags_json_member(root, "loss")) {
    PAGS_TRY(pags_json_number(json, root, "loss", &loss));
    PAGS_TRY(pags_json_number_or(json, root, "psnr", (double)NAN, &psnr));
    const double point[COLUMNS] = {step, loss, psnr, gaussians, (double)NAN, (double)NAN};
    add_point(self, point);
  }
  return PAGS_OK;
}

/* Takes the lines of an earlier log up to the first that is none. */
static void read_log(pags_board *self, const char *path) {
  uint8_t *bytes;
  size_t size;
  if (!pags_file_exists(path) || pags_file_read(path, &bytes, &size) != PAGS_OK)
    return;
  const char *at = (const char *)bytes, *const end = at + size;
  pags_result result = PAGS_OK;
  while (at < end && result == PAGS_OK) {
    const char *line = at, *stop = memchr(at, '\n', (size_t)(end - at));
    pags_json *json;
    at = stop ? stop + 1 : end;
    result = pags_json_parse_text(path, line, (size_t)(at - line), &json);
    if (result != PAGS_OK)
      break;
    result = read_line(self, json);
    pags_json_destroy(json);
  }
  free(bytes);
}

/* ---- What the trainer says ---- */

/* At the first step: takes away what the earlier log says of steps that are done again, and spaces the points as it
 * did. */
static void begin(pags_board *self, const pags_train_progress *progress) {
  while (self->count > 0 && self->points[self->count - 1][STEP] >= (double)progress->step)
    self->count--;
  while (self->held_count > 0 && self->held[self->held_count - 1].step >= progress->step)
    self->held_count--;
  const double apart = self->count > 1 ? self->points[self->count - 1][STEP] - self->points[self->count - 2][STEP] : 1;
  self->every = apart > 1 ? (int64_t)apart : 1;
}

void pags_board_tell(pags_board *self, const pags_train_progress *progress, pags_board_share share) {
  pthread_mutex_lock(&self->lock);
  if (self->every == 0)
    begin(self, progress);
  const bool measured = progress->held_out_count > 0 && progress->held_out_step == progress->step;
  self->now = *progress;
  self->now.held_out = NULL; /* belongs to the run */
  self->now.moment = NULL;
  self->share = share;
  if (progress->seen.view >= 0 && progress->seen.view < self->views)
    self->psnr_of[progress->seen.view] = progress->seen.psnr;
  for (int i = 0; measured && i < progress->held_out_count; i++)
    self->held_of[progress->held_out[i].view] = progress->held_out[i].psnr;
  if (measured)
    add_held_out(self, progress->step, progress->held_out_psnr);
  if (progress->step % self->every == 0 || progress->step == progress->iterations) {
    self->memory = pags_port_resident_memory();
    const double point[COLUMNS] = {(double)progress->step,      progress->loss,          progress->psnr,
                                   (double)progress->gaussians, progress->it_per_second, (double)self->memory};
    add_point(self, point);
  }
  pthread_mutex_unlock(&self->lock);
}

void pags_board_say(pags_board *self, const char *text) {
  pthread_mutex_lock(&self->lock);
  snprintf(self->said, sizeof self->said, "%s", text);
  pthread_mutex_unlock(&self->lock);
}

bool pags_board_wants_checkpoint(pags_board *self) {
  pthread_mutex_lock(&self->lock);
  const bool wanted = self->checkpoint;
  self->checkpoint = false;
  pthread_mutex_unlock(&self->lock);
  return wanted;
}

bool pags_board_wants_stop(pags_board *self) {
  pthread_mutex_lock(&self->lock);
  const bool wanted = self->stop;
  pthread_mutex_unlock(&self->lock);
  return wanted;
}

/* ---- What pages are told ---- */

/* The views that are shown worst, worst first. */
static void put_worst(const pags_board *self, pags_json_writer *json) {
  double above = -HUGE_VAL;
  int64_t last = -1;
  pags_json_begin_array(json, "worst");
  for (int k = 0; k < WORST; k++) {
    int64_t worst = -1;
    double least = HUGE_VAL;
    for (int64_t i = 0; i < self->views; i++) {
      const double psnr = isnan(self->held_of[i]) ? self->psnr_of[i] : self->held_of[i];
      if (psnr < least && (psnr > above || (psnr == above && i > last))) {
        least = psnr;
        worst = i;
      }
    }
    if (worst < 0)
      break;
    pags_json_begin_object(json, NULL);
    pags_json_put_integer(json, "view", worst);
    pags_json_put_number(json, "psnr", least);
    pags_json_end_object(json);
    above = least;
    last = worst;
  }
  pags_json_end_array(json);
}

static void put_curves(const pags_board *self, pags_json_writer *json, const pags_view_request *request) {
  const bool known = request->edition == self->edition && request->from <= self->count;
  const int from = known ? (int)request->from : 0;
  pags_json_put_integer(json, "edition", self->edition);
  pags_json_put_integer(json, "from", from);
  pags_json_begin_array(json, "points");
  for (int i = from; i < self->count; i++)
    pags_json_put_numbers(json, NULL, self->points[i], COLUMNS);
  pags_json_end_array(json);
  pags_json_begin_array(json, "heldOut");
  for (int i = 0; i < self->held_count; i++) {
    const double pair[2] = {(double)self->held[i].step, self->held[i].psnr};
    pags_json_put_numbers(json, NULL, pair, 2);
  }
  pags_json_end_array(json);
}

pags_result pags_board_answer(pags_board *self, const pags_view_request *request, pags_view_message *out) {
  pags_json_writer json;
  pags_json_writer_init(&json, 0);
  pthread_mutex_lock(&self->lock);
  self->checkpoint = self->checkpoint || request->kind == PAGS_VIEW_CHECKPOINT;
  self->stop = self->stop || request->kind == PAGS_VIEW_STOP;
  const pags_train_progress *now = &self->now;
  pags_json_begin_object(&json, NULL);
  pags_json_put_string(&json, "type", "run");
  pags_json_put_integer(&json, "serial", request->serial);
  pags_json_put_integer(&json, "step", now->step);
  pags_json_put_integer(&json, "steps", now->iterations);
  pags_json_put_integer(&json, "gaussians", now->gaussians);
  pags_json_put_number(&json, "loss", now->loss);
  pags_json_put_number(&json, "psnr", now->psnr);
  pags_json_put_number(&json, "rate", now->it_per_second);
  pags_json_put_number(&json, "seconds", now->seconds);
  pags_json_put_number(&json, "left", now->eta_seconds);
  pags_json_put_integer(&json, "shrink", now->level);
  pags_json_put_integer(&json, "badRows", now->bad_rows);
  pags_json_put_unsigned(&json, "memory", self->memory);
  pags_json_put_number(&json, "share", self->share.taken);
  pags_json_put_number(&json, "mostShare", self->share.most);
  pags_json_put_integer(&json, "pictures", self->share.pictures);
  pags_json_put_bool(&json, "stopping", self->stop);
  pags_json_put_bool(&json, "saving", self->checkpoint);
  pags_json_put_string(&json, "said", self->said);
  put_worst(self, &json);
  if (request->kind == PAGS_VIEW_RUN)
    put_curves(self, &json, request);
  pags_json_end_object(&json);
  pthread_mutex_unlock(&self->lock);
  const pags_result result = pags_json_writer_finish(&json);
  if (result == PAGS_OK)
    *out = (pags_view_message){.bytes = (unsigned char *)json.data, .size = json.size};
  else
    pags_json_writer_destroy(&json);
  return result;
}

/* ---- Start and end ---- */

pags_result pags_board_create(int64_t views, const char *log, pags_board **out) {
  pags_board *self = calloc(1, sizeof *self);
  *out = NULL;
  if (!self)
    return pags_out_of_memory(NULL);
  self->views = views;
  self->psnr_of = malloc(((size_t)views + 1) * sizeof *self->psnr_of);
  self->held_of = malloc(((size_t)views + 1) * sizeof *self->held_of);
  pthread_mutex_init(&self->lock, NULL);
  if (!self->psnr_of || !self->held_of) {
    pags_board_destroy(self);
    return pags_out_of_memory("%lld views", (long long)views);
  }
  for (int64_t i = 0; i < views; i++)
    self->psnr_of[i] = self->held_of[i] = (double)NAN;
  if (log)
    read_log(self, log);
  *out = self;
  return PAGS_OK;
}

void pags_board_destroy(pags_board *self) {
  if (!self)
    return;
  pthread_mutex_destroy(&self->lock);
  free(self->psnr_of);
  free(self->held_of);
  free(self);
}
