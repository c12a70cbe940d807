/* The state of a run: rows that move together through parameters, moments and statistics. */
#include "train/state.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

static pags_result reserve_density(pags_density *density, int64_t capacity) {
  if (capacity <= density->capacity)
    return PAGS_OK;
  float *gradient = calloc((size_t)capacity, sizeof(float));
  int32_t *seen = calloc((size_t)capacity, sizeof(int32_t));
  if (!gradient || !seen) {
    free(gradient);
    free(seen);
    return pags_fail(PAGS_ERROR_MEMORY, "no memory for statistics of %lld Gaussians", (long long)capacity);
  }
  if (density->capacity > 0) {
    memcpy(gradient, density->gradient, (size_t)density->capacity * sizeof(float));
    memcpy(seen, density->seen, (size_t)density->capacity * sizeof(int32_t));
  }
  free(density->gradient);
  free(density->seen);
  *density = (pags_density){.capacity = capacity, .gradient = gradient, .seen = seen};
  return PAGS_OK;
}

static pags_result reserve(pags_train_state *state, int64_t capacity) {
  PAGS_TRY(pags_gaussians_reserve(&state->gaussians, capacity));
  PAGS_TRY(pags_adam_reserve(&state->adam, capacity));
  return reserve_density(&state->density, state->gaussians.stride);
}

static pags_result make_clusters(pags_train_state *state, pags_tasks *tasks) {
  pags_clusters_destroy(&state->clusters);
  PAGS_TRY(pags_clusters_create(&state->clusters, state->gaussians.count, state->schedule.config.cluster_size));
  pags_adam_bound_all(&state->adam, &state->gaussians, &state->clusters, tasks);
  return PAGS_OK;
}

pags_result pags_state_create(pags_train_state *state, const pags_schedule *schedule, int64_t stop, pags_gaussians *g) {
  *state =
      (pags_train_state){.schedule = *schedule, .stop = stop, .cap = schedule->config.max_gaussians, .gaussians = *g};
  *g = (pags_gaussians){0};
  pags_result result = pags_adam_create(&state->adam, &state->schedule, &state->gaussians, 0, stop);
  if (result == PAGS_OK)
    result = reserve_density(&state->density, state->gaussians.stride);
  if (result == PAGS_OK)
    result = make_clusters(state, NULL);
  if (result != PAGS_OK)
    pags_state_destroy(state);
  return result;
}

void pags_state_destroy(pags_train_state *state) {
  pags_gaussians_destroy(&state->gaussians);
  pags_adam_destroy(&state->adam);
  pags_clusters_destroy(&state->clusters);
  free(state->density.gradient);
  free(state->density.seen);
  *state = (pags_train_state){0};
}

void pags_state_settle(pags_train_state *state, pags_tasks *tasks) {
  pags_adam_settle(&state->adam, &state->gaussians, state->step, tasks);
}

void pags_state_clear_density(pags_train_state *state) {
  memset(state->density.gradient, 0, (size_t)state->density.capacity * sizeof(float));
  memset(state->density.seen, 0, (size_t)state->density.capacity * sizeof(int32_t));
}

/* One column of 4-byte values after another: all that a row consists of. */
typedef struct column {
  void *data;
  int moment; /* 1: fresh rows start at zero */
} column;

enum { MAX_COLUMNS = 3 * PAGS_MAX_PLANES + 4 };

static int list_columns(pags_train_state *state, column columns[MAX_COLUMNS]) {
  int n = 0, planes = pags_plane_count(state->gaussians.sh_degree);
  for (int p = 0; p < planes; p++) {
    columns[n++] = (column){pags_plane(&state->gaussians, p), 0};
    columns[n++] = (column){pags_plane(&state->adam.first, p), 1};
    columns[n++] = (column){pags_plane(&state->adam.second, p), 1};
  }
  columns[n++] = (column){state->density.gradient, 0};
  columns[n++] = (column){state->density.seen, 0};
  if (state->gaussians.s_sem)
    columns[n++] = (column){state->gaussians.s_sem, 0};
  if (state->gaussians.object_id)
    columns[n++] = (column){state->gaussians.object_id, 0};
  return n;
}

typedef struct gather_job {
  column columns[MAX_COLUMNS];
  const int64_t *source;
  int64_t count, fresh, old_count;
  uint32_t *scratch; /* count per worker */
} gather_job;

static void gather_columns(void *context, int64_t begin, int64_t end, int worker) {
  gather_job *job = context;
  uint32_t *scratch = job->scratch + worker * job->count;
  for (int64_t c = begin; c < end; c++) {
    uint32_t *data = job->columns[c].data;
    int64_t copied = job->columns[c].moment ? job->fresh : job->count;
    for (int64_t i = 0; i < copied; i++)
      scratch[i] = data[job->source[i]];
    memcpy(data, scratch, (size_t)copied * sizeof(uint32_t));
    int64_t written = job->old_count > job->count ? job->old_count : job->count;
    memset(data + copied, 0, (size_t)(written - copied) * sizeof(uint32_t));
  }
}

pags_result pags_state_gather(pags_train_state *state, const int64_t *source, int64_t count, int64_t fresh,
                              pags_tasks *tasks) {
  assert(fresh <= count);
  if (count >
      state->gaussians.stride) /* half as much again, so that growth by shares copies each row a few times only */
    PAGS_TRY(reserve(state, count + count / 2));
  int workers = pags_tasks_workers(tasks);
  gather_job *job = malloc(sizeof *job);
  uint32_t *scratch = malloc((size_t)workers * (size_t)(count > 0 ? count : 1) * sizeof(uint32_t));
  if (!job || !scratch) {
    free(job);
    free(scratch);
    return pags_fail(PAGS_ERROR_MEMORY, "no memory to reorder %lld Gaussians", (long long)count);
  }
  int n = list_columns(state, job->columns);
  job->source = source;
  job->count = count;
  job->fresh = fresh;
  job->old_count = state->gaussians.count;
  job->scratch = scratch;
  bool done = pags_parallel_for(tasks, n, 1, gather_columns, job);
  free(scratch);
  free(job);
  state->gaussians.count = count;
  if (!done) /* some columns moved, some not: nothing may be saved from here on */
    return pags_fail(PAGS_CANCELLED, "cancelled while Gaussians were reordered");
  return pags_adam_regroup(&state->adam, count, state->step);
}

pags_result pags_state_sort(pags_train_state *state, pags_tasks *tasks) {
  int64_t count = state->gaussians.count;
  int64_t *order = malloc((size_t)(count > 0 ? count : 1) * sizeof(int64_t));
  if (!order)
    return pags_fail(PAGS_ERROR_MEMORY, "no memory to sort %lld Gaussians", (long long)count);
  pags_result result = pags_gaussians_morton_order(&state->gaussians, order);
  if (result == PAGS_OK)
    result = pags_state_gather(state, order, count, count, tasks);
  free(order);
  return result == PAGS_OK ? make_clusters(state, tasks) : result;
}
