/* SPDX-License-Identifier: Apache-2.0 */
/* Figures and curves of a run. A curve has at most POINTS points. When it is full, every other point is removed and the
 * edition changes, so that pages fetch the whole curve again. */
#include "cli/view/run_status.h"

#include <math.h>
#include "base/file.h"
#include "port/port.h"

enum { POINTS = 1024, HELD = 256, WORST = 6, SAID = 160 };

typedef enum column { STEP, LOSS, PSNR, GAUSSIANS, RATE, MEMORY, COLUMNS } column;

typedef struct held_out {
  int64_t step;
  double psnr;
} held_out;

struct pags_run_status {
  pthread_mutex_t lock;
  double points[POINTS][COLUMNS]; /* NaN: unknown */
  int64_t edition;
  int count, held_count;
  int64_t every; /* steps between points; 0: no step yet */
  held_out held[HELD];
  pags_train_progress now;
  pags_run_status_share share;
  uint64_t memory; /* resident memory at the last point, bytes */
  int64_t views;
  double *psnr_of; /* per view, at its last training step; NaN: never */
  double *held_of; /* per held-out view, at the last evaluation */
  bool checkpoint, stop;
  char said[SAID];
};

/* ---- Curves ---- */

/* Keeps every other of `count` items; returns their number. */
static int halve(void *items, size_t size, int count) {
  char *const bytes = items;
  for (size_t i = 0; i < (size_t)count / 2; i++)
    memcpy(bytes + i * size, bytes + (2 * i + 1) * size, size);
  return count / 2;
}

static void add_point(pags_run_status *status, const double point[COLUMNS]) {
  if (status->count == POINTS) {
    status->count = halve(status->points, sizeof status->points[0], POINTS);
    status->every *= 2;
    status->edition++;
  }
  memcpy(status->points[status->count++], point, COLUMNS * sizeof *point);
}

static void add_held_out(pags_run_status *status, int64_t step, double psnr) {
  if (status->held_count == HELD)
    status->held_count = halve(status->held, sizeof status->held[0], HELD);
  status->held[status->held_count++] = (held_out){step, psnr};
}

static pags_result read_line(pags_run_status *status, const pags_json *json) {
  const pags_json_value *root = pags_json_root(json);
  double step, gaussians, loss, psnr;
  PAGS_TRY(pags_json_number(json, root, "step", &step));
  PAGS_TRY(pags_json_number(json, root, "gaussians", &gaussians));
  if (pags_json_member(root, "held_out_psnr")) {
    PAGS_TRY(pags_json_number_or(json, root, "held_out_psnr", (double)NAN, &psnr));
    add_held_out(status, (int64_t)step, psnr);
  } else if (pags_json_member(root, "loss")) {
    PAGS_TRY(pags_json_number(json, root, "loss", &loss));
    PAGS_TRY(pags_json_number_or(json, root, "psnr", (double)NAN, &psnr));
    add_point(status, (double[COLUMNS]){step, loss, psnr, gaussians, (double)NAN, (double)NAN});
  }
  return PAGS_OK;
}

/* Reads an earlier log up to the first invalid line. */
static void read_log(pags_run_status *status, const char *path) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  if (!pags_file_exists(path) || pags_file_read(path, &bytes, &size) != PAGS_OK)
    return;
  const char *at = (const char *)bytes, *const end = at + size;
  bool valid = true;
  while (at < end && valid) {
    const char *line = at, *stop = memchr(at, '\n', (size_t)(end - at));
    PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
    at = stop ? stop + 1 : end;
    valid =
        pags_json_parse_text(path, line, (size_t)(at - line), &json) == PAGS_OK && read_line(status, json) == PAGS_OK;
  }
}

/* ---- Updates by the trainer ---- */

/* At the first step: removes points of steps that are repeated, and continues with the spacing of the earlier log. */
static void begin(pags_run_status *status, const pags_train_progress *progress) {
  while (status->count > 0 && status->points[status->count - 1][STEP] >= (double)progress->step)
    status->count--;
  while (status->held_count > 0 && status->held[status->held_count - 1].step >= progress->step)
    status->held_count--;
  const double apart =
      status->count > 1 ? status->points[status->count - 1][STEP] - status->points[status->count - 2][STEP] : 1;
  status->every = apart > 1 ? (int64_t)apart : 1;
}

void pags_run_status_update(pags_run_status *status, const pags_train_progress *progress, pags_run_status_share share) {
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&status->lock);
  if (status->every == 0)
    begin(status, progress);
  const bool measured = progress->held_out_count > 0 && progress->held_out_step == progress->step;
  status->now = *progress;
  status->now.held_out = NULL; /* belongs to the run */
  status->now.moment = NULL;
  status->share = share;
  if (progress->seen.view >= 0 && progress->seen.view < status->views)
    status->psnr_of[progress->seen.view] = progress->seen.psnr;
  if (measured) {
    for (int i = 0; i < progress->held_out_count; i++)
      status->held_of[progress->held_out[i].view] = progress->held_out[i].psnr;
    add_held_out(status, progress->step, progress->held_out_psnr);
  }
  if (progress->step % status->every == 0 || progress->step == progress->iterations) {
    status->memory = pags_port_resident_memory();
    add_point(status, (double[COLUMNS]){(double)progress->step, progress->loss, progress->psnr,
                                        (double)progress->gaussians, progress->it_per_second, (double)status->memory});
  }
}

void pags_run_status_notify(pags_run_status *status, const char *text) {
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&status->lock);
  snprintf(status->said, sizeof status->said, "%s", text);
}

bool pags_run_status_wants_checkpoint(pags_run_status *status) {
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&status->lock);
  const bool wanted = status->checkpoint;
  status->checkpoint = false;
  return wanted;
}

bool pags_run_status_wants_stop(pags_run_status *status) {
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&status->lock);
  return status->stop;
}

/* ---- Answers to pages ---- */

/* The views with the lowest PSNR, lowest first. */
static void put_worst(const pags_run_status *status, pags_json_writer *json) {
  double above = -HUGE_VAL;
  int64_t last = -1;
  pags_json_begin_array(json, "worst");
  for (int k = 0; k < WORST; k++) {
    int64_t worst = -1;
    double least = HUGE_VAL;
    for (int64_t i = 0; i < status->views; i++) {
      const double psnr = isnan(status->held_of[i]) ? status->psnr_of[i] : status->held_of[i];
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

pags_result pags_run_status_answer(pags_run_status *status, const pags_view_request *request, pags_view_message *out) {
  pags_json_writer json = {0};
  PAGS_AUTO(pags_mutex_unlock) pthread_mutex_t *held = pags_mutex_lock(&status->lock);
  status->checkpoint = status->checkpoint || request->kind == PAGS_VIEW_CHECKPOINT;
  status->stop = status->stop || request->kind == PAGS_VIEW_STOP;
  const pags_train_progress *now = &status->now;
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
  pags_json_put_unsigned(&json, "memory", status->memory);
  pags_json_put_number(&json, "share", status->share.taken);
  pags_json_put_number(&json, "mostShare", status->share.most);
  pags_json_put_integer(&json, "pictures", status->share.pictures);
  pags_json_put_bool(&json, "stopping", status->stop);
  pags_json_put_bool(&json, "saving", status->checkpoint);
  pags_json_put_string(&json, "said", status->said);
  put_worst(status, &json);
  if (request->kind == PAGS_VIEW_RUN) {
    const bool known = request->edition == status->edition && request->from <= status->count;
    const int from = known ? (int)request->from : 0;
    pags_json_put_integer(&json, "edition", status->edition);
    pags_json_put_integer(&json, "from", from);
    pags_json_begin_array(&json, "points");
    for (int i = from; i < status->count; i++)
      pags_json_put_numbers(&json, NULL, status->points[i], COLUMNS);
    pags_json_end_array(&json);
    pags_json_begin_array(&json, "heldOut");
    for (int i = 0; i < status->held_count; i++)
      pags_json_put_numbers(&json, NULL, (double[]){(double)status->held[i].step, status->held[i].psnr}, 2);
    pags_json_end_array(&json);
  }
  return pags_view_message_of(&json, out);
}

/* ---- Start and end ---- */

pags_result pags_run_status_create(int64_t views, const char *log, pags_run_status **out) {
  PAGS_AUTO(pags_run_status_destroy_auto) pags_run_status *status = calloc(1, sizeof *status);
  *out = NULL;
  PAGS_CHECK_MEMORY(status, NULL);
  pthread_mutex_init(&status->lock, NULL);
  status->views = views;
  status->psnr_of = malloc(((size_t)views + 1) * sizeof *status->psnr_of);
  status->held_of = malloc(((size_t)views + 1) * sizeof *status->held_of);
  PAGS_CHECK_MEMORY(status->psnr_of && status->held_of, "%lld views", (long long)views);
  for (int64_t i = 0; i < views; i++)
    status->psnr_of[i] = status->held_of[i] = (double)NAN;
  if (log)
    read_log(status, log);
  *out = pags_take(&status);
  return PAGS_OK;
}

void pags_run_status_destroy(pags_run_status *status) {
  if (!status)
    return;
  pthread_mutex_destroy(&status->lock);
  free(status->psnr_of);
  free(status->held_of);
  free(status);
}
