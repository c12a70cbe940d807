/* SPDX-License-Identifier: Apache-2.0 */
/* A model in training: creation, and reordering, adding and removing of its rows, which move together through
 * parameters, moments and statistics. */
#include "train/model.h"

#include <assert.h>
#include <math.h>

#include "base/memory.h"
#include "cluster/order.h"
#include "cluster/shares.h"
#include "scene/morton.h"
#include "threads/record.h"

/* ---- Creation and memory ---- */

/* Returns `column`, of `rows` values, with room for `capacity`, the new ones zero; NULL if out of memory. */
static void *extend(void *column, int64_t rows, int64_t capacity) {
  rows = column ? rows : 0;
  uint32_t *const longer = realloc(column, (size_t)capacity * sizeof *longer);
  if (longer)
    memset(longer + rows, 0, (size_t)(capacity - rows) * sizeof *longer);
  return longer;
}

static pags_result reserve_density(const pags_train_model *model, pags_density *density) {
  const pags_train_priority *const priority = &model->schedule.config.priority;
  const bool with_squared = priority->prunes > 0 && priority->score == PAGS_SCORE_PAPER;
  const int64_t rows = density->capacity, capacity = model->gaussians.stride;
  if (capacity <= rows)
    return PAGS_OK;
  float *const gradient = extend(density->gradient, rows, capacity);
  density->gradient = gradient ? gradient : density->gradient;
  int32_t *const seen = extend(density->seen, rows, capacity);
  density->seen = seen ? seen : density->seen;
  float *const squared = with_squared ? extend(density->squared, rows, capacity) : NULL;
  density->squared = squared ? squared : density->squared;
  PAGS_CHECK_MEMORY(gradient && seen && (squared || !with_squared), "statistics of %lld Gaussians",
                    (long long)capacity);
  density->capacity = capacity;
  return PAGS_OK;
}

static pags_result reserve(pags_train_model *model, int64_t capacity) {
  PAGS_TRY(pags_gaussians_reserve(&model->gaussians, capacity));
  PAGS_TRY(pags_adam_reserve(&model->adam, capacity));
  return reserve_density(model, &model->density);
}

static pags_result make_clusters(pags_train_model *model, pags_tasks *tasks) {
  pags_clusters_destroy(&model->clusters);
  PAGS_TRY(pags_clusters_create(&model->clusters, model->gaussians.count, model->schedule.config.picture.cluster_size));
  pags_adam_bound_all(&model->adam, &model->gaussians, &model->clusters, tasks);
  return PAGS_OK;
}

pags_result pags_model_create(pags_train_model *model, const pags_schedule *schedule, int64_t stop, pags_gaussians *g) {
  *model = (pags_train_model){.object = -1,
                              .schedule = *schedule,
                              .cap = schedule->config.size_limit.max_gaussians,
                              .fourier_gain = NAN,
                              .gaussians = *g,
                              .total = g->count};
  *g = (pags_gaussians){0};
  pags_result result = pags_adam_create(&model->adam, &model->schedule, &model->gaussians, 0, stop);
  if (result == PAGS_OK)
    result = reserve_density(model, &model->density);
  if (result == PAGS_OK)
    result = make_clusters(model, NULL);
  if (result != PAGS_OK)
    pags_model_destroy(model);
  return result;
}

static void destroy_density(pags_density *density) {
  free(density->gradient);
  free(density->seen);
  free(density->squared);
  *density = (pags_density){0};
}

void pags_model_destroy(pags_train_model *model) {
  pags_gaussians_destroy(&model->gaussians);
  pags_adam_destroy(&model->adam);
  pags_clusters_destroy(&model->clusters);
  destroy_density(&model->density);
  *model = (pags_train_model){0};
}

void pags_model_clear_density(pags_train_model *model) {
  memset(model->density.gradient, 0, (size_t)model->density.capacity * sizeof(float));
  memset(model->density.seen, 0, (size_t)model->density.capacity * sizeof(int32_t));
}

/* ---- Reordering rows ---- */

/* One array of 4-byte values with one value per row: a plane of parameters or moments, or a statistic. */
typedef struct column {
  void *data;
  bool moment; /* an optimiser moment, of which fresh rows start at zero */
} column;

enum { MAX_COLUMNS = 3 * PAGS_MAX_PLANES + 3 * PAGS_MAX_FOURIER + 5 };

/* Those of the Gaussians alone. */
static int list_parameters(pags_gaussians *g, column columns[MAX_COLUMNS]) {
  int n = 0;
  for (int p = 0; p < pags_all_planes(g); p++)
    columns[n++] = (column){pags_any_plane(g, p), false};
  if (g->s_sem)
    columns[n++] = (column){g->s_sem, false};
  if (g->object_id)
    columns[n++] = (column){g->object_id, false};
  return n;
}

static int list_columns(pags_train_model *model, column columns[MAX_COLUMNS]) {
  int n = list_parameters(&model->gaussians, columns);
  for (int p = 0; p < pags_all_planes(&model->gaussians); p++) {
    columns[n++] = (column){pags_any_plane(&model->adam.first, p), true};
    columns[n++] = (column){pags_any_plane(&model->adam.second, p), true};
  }
  columns[n++] = (column){model->density.gradient, false};
  columns[n++] = (column){model->density.seen, false};
  if (model->density.squared)
    columns[n++] = (column){model->density.squared, false};
  return n;
}

void pags_model_copy_rows(pags_train_model *from, int64_t first, int64_t count, pags_train_model *to, int64_t at) {
  column read[MAX_COLUMNS], written[MAX_COLUMNS];
  const int n = list_columns(from, read), m = list_columns(to, written);
  assert(count == 0 || m == n);
  for (int c = 0; c < n && c < m && count > 0; c++)
    memcpy((uint32_t *)written[c].data + at, (const uint32_t *)read[c].data + first, (size_t)count * sizeof(uint32_t));
}

/* A few columns at a time, one for each worker, are gathered into scratch memory and copied back, both in blocks of
 * GATHERED rows of a column. */
enum { GATHERED = 1 << 14 };

typedef struct gather_job {
  column columns[MAX_COLUMNS];
  const int64_t *source;
  int64_t count, fresh, old_count;
  int64_t blocks;    /* of a column: those of its longest state */
  int first;         /* column */
  uint32_t *scratch; /* `count` values per column at a time */
} gather_job;

/* The rows of a block that are copied. */
static int64_t copied_end(const gather_job *job, const column *c, int64_t row) {
  const int64_t copied = c->moment ? job->fresh : job->count;
  return row + GATHERED < copied ? row + GATHERED : copied;
}

static void gather_blocks(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const gather_job *const job = context;
  for (int64_t b = begin; b < end; b++) {
    const column *const c = job->columns + job->first + b / job->blocks;
    const uint32_t *const data = c->data;
    uint32_t *const scratch = job->scratch + b / job->blocks * job->count;
    const int64_t row = b % job->blocks * GATHERED, last = copied_end(job, c, row);
    for (int64_t i = row; i < last; i++)
      scratch[i] = data[job->source[i]];
  }
}

/* Copies back, and sets to zero what is fresh or no longer a row. */
static void store_blocks(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const gather_job *const job = context;
  for (int64_t b = begin; b < end; b++) {
    const column *const c = job->columns + job->first + b / job->blocks;
    uint32_t *const data = c->data;
    const uint32_t *const scratch = job->scratch + b / job->blocks * job->count;
    const int64_t row = b % job->blocks * GATHERED, last = copied_end(job, c, row);
    const int64_t written = job->old_count > job->count ? job->old_count : job->count;
    const int64_t clear = last > row ? last : row, all = row + GATHERED < written ? row + GATHERED : written;
    if (last > row)
      memcpy(data + row, scratch + row, (size_t)(last - row) * sizeof *data);
    if (all > clear)
      memset(data + clear, 0, (size_t)(all - clear) * sizeof *data);
  }
}

pags_result pags_model_gather(pags_train_model *model, const int64_t *source, int64_t count, int64_t fresh,
                              pags_tasks *tasks) {
  assert(fresh <= count);
  if (count > model->gaussians.stride) /* with half as much room again, so that rows are copied a few times only while
                                          the model grows step by step */
    PAGS_TRY(reserve(model, count + count / 2));
  const int workers = pags_tasks_workers(tasks);
  const int64_t old_count = model->gaussians.count, longest = count > old_count ? count : old_count;
  PAGS_AUTOFREE gather_job *job = malloc(sizeof *job);
  PAGS_AUTOFREE uint32_t *scratch = malloc((size_t)workers * (size_t)(count > 0 ? count : 1) * sizeof *scratch);
  PAGS_CHECK_MEMORY(job && scratch, "%lld Gaussians", (long long)count);
  *job = (gather_job){.source = source,
                      .count = count,
                      .fresh = fresh,
                      .old_count = old_count,
                      .blocks = (longest + GATHERED - 1) / GATHERED,
                      .scratch = scratch};
  const int n = list_columns(model, job->columns);
  bool done = true;
  for (; done && job->first < n; job->first += workers) {
    const int64_t some = n - job->first < workers ? n - job->first : workers;
    done = pags_parallel_for(tasks, some * job->blocks, 1, gather_blocks, job) &&
           pags_parallel_for(tasks, some * job->blocks, 1, store_blocks, job);
  }
  model->gaussians.count = model->total = count;
  model->first_row = 0;
  if (!done) /* some columns have been reordered, some not: this state must not be saved */
    return pags_fail(PAGS_CANCELLED, "cancelled while Gaussians were reordered");
  return pags_adam_regroup(&model->adam, count, model->step);
}

pags_result pags_model_collect(pags_train_model *model) {
  pags_transport *const transport = pags_model_transport(model);
  const int ranks = pags_transport_ranks(transport), rank = pags_transport_rank(transport);
  const int64_t own_bytes = model->gaussians.count * (int64_t)sizeof(uint32_t);
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians all = {0};
  column own[MAX_COLUMNS], whole[MAX_COLUMNS];
  pags_adam_destroy(&model->adam);
  pags_clusters_destroy(&model->clusters);
  destroy_density(&model->density);
  PAGS_AUTOFREE int64_t *bytes = malloc((size_t)ranks * sizeof *bytes);
  pags_result mine = bytes ? PAGS_OK : pags_out_of_memory("a message of %d ranks", ranks);
  if (mine == PAGS_OK && rank == 0)
    mine = pags_gaussians_create_like(&all, model->total, &model->gaussians);
  PAGS_TRY(pags_transport_agree(transport, mine));
  PAGS_TRY(pags_share_all(transport, &own_bytes, sizeof own_bytes, bytes));
  const int n = list_parameters(&model->gaussians, own);
  if (rank == 0)
    list_parameters(&all, whole);
  for (int c = 0; c < n; c++)
    PAGS_TRY(pags_transport_gather(transport, 0, own[c].data, own_bytes, rank == 0 ? whole[c].data : NULL, bytes));
  const pags_gaussians given_up = model->gaussians;
  model->gaussians = all;
  all = given_up;
  return PAGS_OK;
}

/* The moves' values of one column on their way: those that this rank sends, by the rank that gets them, and those that
 * it gets, by the rank that sends them, each in the order of the moves. */
typedef struct relocation {
  int64_t *sent, *received; /* per rank */
  int64_t *from, *to;       /* own rows in the order in which they are sent and received */
  int64_t all_sent, all_received;
} relocation;

static void list_moves(const pags_row_move *moves, int64_t count, int rank, int ranks, relocation *r) {
  for (int other = 0; other < ranks; other++) {
    const int64_t sent = r->all_sent, received = r->all_received;
    for (int64_t i = 0; i < count; i++) {
      if (moves[i].from_rank == rank && moves[i].to_rank == other)
        r->from[r->all_sent++] = moves[i].from;
      if (moves[i].to_rank == rank && moves[i].from_rank == other)
        r->to[r->all_received++] = moves[i].to;
    }
    r->sent[other] = r->all_sent - sent;
    r->received[other] = r->all_received - received;
  }
}

pags_result pags_model_relocate(pags_train_model *model, const pags_row_move *moves, int64_t count) {
  pags_transport *const transport = pags_model_transport(model);
  const int ranks = pags_transport_ranks(transport);
  PAGS_AUTOFREE int64_t *lists = malloc(2 * ((size_t)ranks + (size_t)count) * sizeof *lists);
  PAGS_AUTOFREE uint32_t *out = malloc((2 * (size_t)count + 1) * sizeof *out);
  const pags_result mine = lists && out ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)count);
  PAGS_TRY(pags_transport_agree(transport, mine));
  uint32_t *const in = out + count;
  relocation r = {lists, lists + ranks, lists + 2 * ranks, lists + 2 * ranks + count, 0, 0};
  list_moves(moves, count, pags_transport_rank(transport), ranks, &r);
  column columns[MAX_COLUMNS];
  const int n = list_columns(model, columns);
  for (int c = 0; c < n; c++) {
    uint32_t *const data = columns[c].data;
    for (int64_t i = 0; i < r.all_sent; i++) {
      if (columns[c].moment)
        data[r.from[i]] = 0;
      out[i] = data[r.from[i]];
    }
    PAGS_TRY(pags_share_items(transport, out, r.sent, in, r.received, sizeof *in));
    for (int64_t i = 0; i < r.all_received; i++)
      data[r.to[i]] = in[i];
  }
  return PAGS_OK;
}

/* ---- Sorting over ranks ---- */

static pags_result make_keys(const pags_train_model *model, const uint32_t *numbers, pags_key *keys) {
  const pags_gaussians *const g = &model->gaussians;
  pags_transport *const transport = model->sharing->transport;
  const int ranks = pags_transport_ranks(transport);
  pags_morton_cube own = pags_morton_bounds(g);
  PAGS_AUTOFREE pags_morton_cube *all = malloc((size_t)ranks * sizeof *all);
  const pags_result mine = keys && all ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)g->count);
  PAGS_TRY(pags_transport_agree(transport, mine));
  PAGS_TRY(pags_share_all(transport, &own, sizeof own, all));
  for (int r = 0; r < ranks; r++)
    for (int k = 0; k < 3; k++) {
      own.lo[k] = fmin(own.lo[k], all[r].lo[k]);
      own.hi[k] = fmax(own.hi[k], all[r].hi[k]);
    }
  if (pags_morton_is_wide(&own)) {
    int64_t counts[PAGS_MORTON_COUNTS] = {0};
    pags_morton_count(g, counts);
    PAGS_TRY(pags_share_sum(transport, counts, PAGS_MORTON_COUNTS));
    pags_morton_tighten(counts, &own);
  }
  for (int64_t i = 0; i < g->count; i++)
    keys[i] = (pags_key){pags_morton_code(g, i, &own), numbers[i]};
  return PAGS_OK;
}

/* Moves all columns to their places in the order. */
static pags_result take_places(pags_train_model *model, const pags_spread_order *order) {
  pags_transport *const transport = model->sharing->transport;
  const int64_t old = model->gaussians.count, count = order->count, written = old > count ? old : count;
  PAGS_AUTOFREE uint32_t *placed = malloc((size_t)(count + 1) * sizeof *placed);
  pags_result mine = placed ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)count);
  if (mine == PAGS_OK && count > model->gaussians.stride)
    mine = reserve(model, count + count / 2);
  PAGS_TRY(pags_transport_agree(transport, mine));
  column columns[MAX_COLUMNS];
  const int n = list_columns(model, columns);
  for (int c = 0; c < n; c++) {
    uint32_t *const data = columns[c].data;
    PAGS_TRY(pags_order_move(transport, order, data, placed, false));
    memcpy(data, placed, (size_t)count * sizeof *data);
    memset(data + count, 0, (size_t)(written - count) * sizeof *data);
  }
  model->gaussians.count = count;
  return PAGS_OK;
}

static pags_result sort_shared(pags_train_model *model, const uint32_t *numbers) {
  pags_sharing *const s = model->sharing;
  const int ranks = pags_transport_ranks(s->transport);
  PAGS_AUTOFREE pags_key *keys = malloc((size_t)(model->gaussians.count + 1) * sizeof *keys);
  PAGS_AUTO(pags_order_destroy) pags_spread_order order = {0};
  int64_t total = model->gaussians.count;
  PAGS_TRY(pags_share_sum(s->transport, &total, 1));
  s->rows[model->index] = total;
  pags_shares_cut(s->rows, s->models, model->schedule.config.picture.cluster_size, ranks, s->begin);
  PAGS_TRY(make_keys(model, numbers, keys));
  PAGS_TRY(
      pags_order_create(s->transport, keys, model->gaussians.count, s->begin + model->index * (ranks + 1), &order));
  PAGS_TRY(take_places(model, &order));
  model->first_row = order.first;
  model->total = total;
  return pags_adam_regroup(&model->adam, model->gaussians.count, model->step);
}

pags_result pags_model_sort(pags_train_model *model, const uint32_t *numbers, pags_tasks *tasks) {
  pags_tasks_mark(tasks, NULL, "order");
  if (model->sharing) {
    PAGS_TRY(sort_shared(model, numbers));
    return make_clusters(model, tasks);
  }
  const int64_t count = model->gaussians.count;
  PAGS_AUTOFREE int64_t *order = malloc((size_t)(count > 0 ? count : 1) * sizeof *order);
  PAGS_CHECK_MEMORY(order, "%lld Gaussians", (long long)count);
  PAGS_TRY(pags_morton_order(&model->gaussians, tasks, order));
  pags_tasks_mark(tasks, NULL, "gather");
  PAGS_TRY(pags_model_gather(model, order, count, count, tasks));
  return make_clusters(model, tasks);
}

/* ---- Fourier terms and rows that aren't finite ---- */

void pags_model_update(pags_train_model *m, pags_nonfinite *nonfinite, int64_t cluster, const float *gradient,
                       int64_t stride, int planes) {
  pags_nonfinite_row first = {0};
  const int left_out =
      pags_adam_update(&m->adam, &m->gaussians, &m->clusters, cluster, gradient, stride, planes, &first);
  first.object = m->object;
  first.row += m->first_row;
  if (left_out)
    pags_nonfinite_note(nonfinite, left_out, &first);
}

pags_result pags_model_add_fourier(pags_train_model *model, int degree) {
  PAGS_TRY(reserve(model, 1)); /* without room for a row there would be no columns, of which all ranks have the same */
  PAGS_TRY(pags_gaussians_add_fourier(&model->gaussians, degree));
  PAGS_TRY(pags_gaussians_add_fourier(&model->adam.first, degree));
  return pags_gaussians_add_fourier(&model->adam.second, degree);
}

bool pags_model_is_finite_row(const pags_gaussians *g, int64_t row) {
  for (int p = 0; p < pags_all_planes(g); p++)
    if (!isfinite(pags_any_plane(g, p)[row]))
      return false;
  return true;
}

pags_result pags_model_drop_spoiled(pags_train_model *model, int64_t *dropped) {
  pags_gaussians *g = &model->gaussians, kept = {0};
  int64_t count = 0;
  PAGS_AUTOFREE int64_t *index = malloc((size_t)(g->count > 0 ? g->count : 1) * sizeof *index);
  PAGS_CHECK_MEMORY(index, "the scene");
  for (int64_t row = 0; row < g->count; row++)
    if (pags_model_is_finite_row(g, row))
      index[count++] = row;
  if (count == g->count)
    return PAGS_OK;
  PAGS_CHECK_MEMORY(pags_gaussians_create_like(&kept, count, g) == PAGS_OK, "the scene");
  *dropped += g->count - count;
  pags_gaussians_gather(g, index, count, &kept);
  pags_gaussians_destroy(g);
  *g = kept;
  model->total = count;
  return PAGS_OK;
}
