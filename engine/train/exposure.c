/* Exposure of photographs. */
#include "train/exposure.h"

#include <math.h>
#include <stdlib.h>

static const double final_share = 0.1; /* of the rate, at the schedule's end; log-linear */

static int64_t camera_of(const pags_dataset *dataset, int64_t view) {
  int sensor = pags_dataset_view(dataset, view)->sensor;
  return sensor < 0 ? 0 : 1 + (int64_t)sensor;
}

pags_result pags_exposures_create(pags_exposures *exposures, const pags_dataset *dataset) {
  *exposures = (pags_exposures){.count = pags_dataset_view_count(dataset), .sensors = 1};
  for (int64_t i = 0; i < exposures->count; i++) {
    int64_t camera = camera_of(dataset, i);
    exposures->sensors = camera < exposures->sensors ? exposures->sensors : camera + 1;
  }
  exposures->items = calloc((size_t)(exposures->count + exposures->sensors), sizeof(pags_exposure));
  if (!exposures->items)
    return pags_fail(PAGS_ERROR_MEMORY, "no memory for exposures of %lld views", (long long)exposures->count);
  for (int64_t i = 0; i < exposures->count; i++)
    for (int c = 0; c < 3; c++)
      exposures->items[i].value[c] = 1.0;
  return PAGS_OK;
}

void pags_exposures_destroy(pags_exposures *exposures) {
  free(exposures->items);
  *exposures = (pags_exposures){0};
}

void pags_exposures_value(const pags_exposures *exposures, const pags_dataset *dataset, int64_t view, double value[6]) {
  const pags_exposure *camera = exposures->items + exposures->count + camera_of(dataset, view);
  for (int k = 0; k < 6; k++)
    value[k] = exposures->items[view].value[k] + camera->value[k];
}

typedef struct exposure_job {
  const double *value;
  const pags_picture *picture;
  float *const *planes;
  double (*rows)[6]; /* sums of each row */
} exposure_job;

enum { ROW_GRAIN = 32 };

static void apply_rows(void *context, int64_t begin, int64_t end, int worker) {
  const exposure_job *job = context;
  const int64_t stride = job->picture->stride;
  (void)worker;
  for (int c = 0; c < 3; c++) {
    const float gain = (float)job->value[c], offset = (float)job->value[3 + c];
    const float *from = job->picture->rgb[c];
    float *to = job->planes[c];
    for (int64_t i = begin * stride; i < end * stride; i++)
      to[i] = gain * from[i] + offset;
  }
}

pags_result pags_exposure_apply(const double value[6], const pags_picture *picture, pags_tasks *tasks, float *const out[3]) {
  exposure_job job = {.value = value, .picture = picture, .planes = out};
  return pags_parallel_for(tasks, picture->height, ROW_GRAIN, apply_rows, &job) ? PAGS_OK
                                                                              : pags_fail(PAGS_CANCELLED, "cancelled");
}

enum { CHAINS = 16 }; /* partial sums side by side, so that the compiler may use vectors */

/* Sums of g x and of g over a row, and g times the gain. The padding's gradient is zero. */
static void row_backward(const float *x, float *g, int width, float gain, double *gx, double *sum) {
  float a[CHAINS] = {0.0f}, b[CHAINS] = {0.0f};
  for (int i = 0; i < width; i += CHAINS)
    for (int k = 0; k < CHAINS; k++) {
      a[k] += g[i + k] * x[i + k];
      b[k] += g[i + k];
      g[i + k] *= gain;
    }
  *gx = *sum = 0.0;
  for (int k = 0; k < CHAINS; k++) {
    *gx += (double)a[k];
    *sum += (double)b[k];
  }
}

static void backward_rows(void *context, int64_t begin, int64_t end, int worker) {
  const exposure_job *job = context;
  const pags_picture *p = job->picture;
  (void)worker;
  for (int64_t y = begin; y < end; y++)
    for (int c = 0; c < 3; c++)
      row_backward(p->rgb[c] + y * p->stride, job->planes[c] + y * p->stride, p->stride,
                   (float)job->value[c], &job->rows[y][c], &job->rows[y][3 + c]);
}

pags_result pags_exposure_backward(const double value[6], const pags_picture *picture, pags_tasks *tasks,
                                   float *const gradient[3], double out[6]) {
  pags_arena *arena = pags_tasks_arena(tasks, 0);
  const pags_arena_mark mark = pags_arena_save(arena);
  exposure_job job = {.value = value, .picture = picture, .planes = gradient};
  job.rows = pags_arena_alloc(arena, (size_t)picture->height, sizeof *job.rows);
  pags_result result = job.rows ? PAGS_OK : pags_fail(PAGS_ERROR_MEMORY, "no memory for %d rows", picture->height);
  if (result == PAGS_OK && !pags_parallel_for(tasks, picture->height, ROW_GRAIN, backward_rows, &job))
    result = pags_fail(PAGS_CANCELLED, "cancelled");
  for (int k = 0; k < 6; k++)
    out[k] = 0.0;
  for (int y = 0; result == PAGS_OK && y < picture->height; y++)
    for (int k = 0; k < 6; k++)
      out[k] += job.rows[y][k];
  pags_arena_release(arena, mark);
  return result;
}

/* The cameras' parts take back what the mean has moved by. */
static void hold_means(pags_exposures *exposures, const pags_dataset *dataset) {
  double mean[6] = {0.0}, value[6];
  int64_t training = 0;
  for (int64_t i = 0; i < exposures->count; i++) {
    if (pags_dataset_view(dataset, i)->test)
      continue;
    training++;
    pags_exposures_value(exposures, dataset, i, value);
    for (int k = 0; k < 6; k++)
      mean[k] += value[k];
  }
  for (int64_t i = exposures->count; i < exposures->count + exposures->sensors; i++)
    for (int k = 0; k < 6; k++)
      exposures->items[i].value[k] -= mean[k] / (double)(training > 0 ? training : 1) - (k < 3 ? 1.0 : 0.0);
}

static int move(pags_exposure *e, const double gradient[6], const pags_train_config *config, double rate) {
  double direction[6];
  if (!pags_moments_step(&e->moments, gradient, config, direction))
    return 0;
  for (int k = 0; k < 6; k++)
    e->value[k] -= rate * direction[k];
  return 1;
}

int pags_exposures_update(pags_exposures *exposures, const pags_dataset *dataset, int64_t view, const double gradient[6],
                           const pags_schedule *schedule, int64_t step) {
  const pags_train_config *c = &schedule->config;
  double t = fmin((double)step / (double)schedule->length, 1.0), rate = c->exposure_rate * pow(final_share, t);
  int moved = move(&exposures->items[view], gradient, c, rate) &&
              move(&exposures->items[exposures->count + camera_of(dataset, view)], gradient, c, rate);
  hold_means(exposures, dataset);
  return moved;
}
