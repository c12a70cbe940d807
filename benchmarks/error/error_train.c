/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench error, approximations of training: Adam that updates only the clusters in view, and pruning scores
 * measured at half the size.
 *
 * Adam runs on the largest model, with gradients of pictures of the unchanged scene, so that three optimisers get the
 * same gradients: the engine's, the engine's kernels over every row at every step, and dense Adam in double on a
 * sample of the rows. */
#include "benchmarks/error/error.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/sort.h"
#include "reference/reference_adam.h"
#include "train/adam.h"

enum { STEPS = 24, FIRST_STEP = 15000, CLUSTER = 64, SAMPLE_ROWS = 1 << 15, SCORE_VIEWS = 12 };

/* Returns view i of `wanted` evenly spread ones, shifted by i so that the cameras of a rig take turns. */
static const pags_camera *view_at(const pags_bench_view *v, int64_t i, int64_t wanted) {
  const int64_t count = v->all_count > 0 ? v->all_count : v->camera_count;
  const pags_camera *const cameras = v->all_count > 0 ? v->all : v->cameras;
  return cameras + (count <= wanted ? i % count : (i * count / wanted + i) % count);
}

/* Makes a plane large enough for every picture: constant `value` if it is 0 or more, else pseudo-random numbers of
 * the size of a loss gradient. It is used for all three channels. */
static float *make_plane(const pags_bench_view *v, int value) {
  const int64_t count = v->all_count > 0 ? v->all_count : v->camera_count;
  const pags_camera *const cameras = v->all_count > 0 ? v->all : v->cameras;
  int64_t most = 0;
  for (int64_t i = 0; i < count; i++) {
    const int64_t size = (int64_t)((cameras[i].width + 15) / 16 * 16) * ((cameras[i].height + 15) / 16 * 16);
    most = size > most ? size : most;
  }
  float *const plane = malloc((size_t)most * sizeof *plane);
  for (int64_t i = 0; plane && i < most; i++)
    plane[i] = value >= 0 ? (float)value : ((float)((uint32_t)i * 2654435761u >> 8 & 1023) - 511.5f) * 1e-9f;
  return plane;
}

/* ---- Adam for the clusters in view ---- */

typedef struct adam_bench {
  const pags_bench_view *view;
  int part; /* index of the part with the most Gaussians */
  int planes;
  int64_t rows, clusters, stride;
  float *gradient, *zeros; /* gradient: plane p at gradient + p * stride; zeros: the planes of one cluster */
  uint8_t *seen;           /* per cluster: 1 if it is in this step's picture */
  pags_schedule schedule;
  pags_gaussians own[2]; /* [0]: updated only when in view; [1]: every row at every step */
  pags_clusters bounds[2];
  pags_adam adam[2];
  reference_adam exact;
  double *exact_gradient;
  int64_t every; /* one cluster of every `every` ones is in the sample */
  double ms[2], updated;
} adam_bench;

static void take_gradient(void *user, const pags_cluster_gradient *g, int worker) {
  adam_bench *const a = user;
  (void)worker;
  if (g->part != a->part)
    return;
  a->seen[g->cluster] = 1;
  for (int p = 0; p < a->planes; p++)
    memcpy(a->gradient + p * a->stride + g->first, g->data + (int64_t)p * g->stride, (size_t)g->count * sizeof(float));
}

static void step_engine(adam_bench *a, int which, int64_t step) {
  const double begin = error_clock_ms();
  pags_adam_begin(&a->adam[which], step);
  for (int64_t c = 0; c < a->clusters; c++) {
    if (which == 0 && !a->seen[c])
      continue;
    pags_adam_touch(&a->adam[which], &a->own[which], c, step);
    const float *const gradient = a->seen[c] ? a->gradient + c * CLUSTER : a->zeros;
    pags_adam_update(&a->adam[which], &a->own[which], &a->bounds[which], c, gradient, a->seen[c] ? a->stride : CLUSTER,
                     a->planes, NULL);
  }
  a->ms[which] += error_clock_ms() - begin;
}

/* Returns the model's row of row i of the sample; -1 beyond the last Gaussian. */
static int64_t sampled_row(const adam_bench *a, int64_t i) {
  const int64_t row = i / CLUSTER * a->every * CLUSTER + i % CLUSTER;
  return row < a->rows ? row : -1;
}

static void step_exact(adam_bench *a, int64_t step) {
  static const int first[] = {PAGS_MEAN, PAGS_SCALE, PAGS_ROTATION, PAGS_OPACITY, PAGS_SH, PAGS_SH + 3};
  double groups[PAGS_RATE_GROUPS], rate[PAGS_MAX_PLANES];
  pags_schedule_rates(&a->schedule, step, groups);
  for (int g = 0; g < 6; g++)
    for (int p = first[g]; p < a->planes; p++)
      rate[p] = groups[g];
  for (int64_t i = 0; i < a->exact.count; i++) {
    const int64_t row = sampled_row(a, i);
    for (int p = 0; p < a->planes; p++)
      a->exact_gradient[i * a->planes + p] =
          row >= 0 && a->seen[row / CLUSTER] ? (double)a->gradient[p * a->stride + row] : 0;
  }
  reference_adam_step(&a->exact, a->exact_gradient, rate);
}

static pags_result create_adam(adam_bench *a) {
  const pags_gaussians *const from = a->view->parts[a->part].gaussians;
  pags_train_config config = pags_train_config_default();
  config.color.sh_degree = from->sh_degree;
  config.picture.cluster_size = CLUSTER;
  /* extent 20 m, which scales the learning rate of positions; 100 views */
  a->schedule = pags_schedule_make(&config, 20, 100);
  a->planes = pags_plane_count(from->sh_degree);
  a->rows = from->count;
  a->clusters = (a->rows + CLUSTER - 1) / CLUSTER;
  a->stride = a->clusters * CLUSTER;
  for (int k = 0; k < 2; k++) {
    PAGS_TRY(pags_gaussians_create(&a->own[k], from->count, from->sh_degree));
    for (int p = 0; p < a->planes; p++)
      memcpy(pags_plane(&a->own[k], p), pags_plane(from, p), (size_t)from->count * sizeof(float));
    PAGS_TRY(pags_clusters_create(&a->bounds[k], from->count, CLUSTER));
    PAGS_TRY(pags_adam_create(&a->adam[k], &a->schedule, &a->own[k], FIRST_STEP, FIRST_STEP + STEPS));
  }
  a->gradient = calloc((size_t)(a->stride * a->planes), sizeof *a->gradient);
  a->zeros = calloc((size_t)CLUSTER * PAGS_MAX_PLANES, sizeof *a->zeros);
  a->seen = malloc((size_t)a->clusters);
  a->every = (a->stride + SAMPLE_ROWS - 1) / SAMPLE_ROWS;
  const int64_t sample = (a->clusters + a->every - 1) / a->every * CLUSTER;
  double *const value = calloc((size_t)(sample * a->planes), sizeof *value);
  a->exact_gradient = malloc((size_t)(sample * a->planes) * sizeof *a->exact_gradient);
  if (!a->gradient || !a->zeros || !a->seen || !value || !a->exact_gradient) {
    free(value);
    return pags_out_of_memory("Adam");
  }
  a->exact = reference_adam_create(a->planes);
  for (int64_t i = 0; i < sample; i++)
    for (int p = 0; p < a->planes && sampled_row(a, i) >= 0; p++)
      value[i * a->planes + p] = (double)pags_plane(from, p)[sampled_row(a, i)];
  reference_adam_append(&a->exact, value, sample);
  a->exact.step = FIRST_STEP;
  free(value);
  return PAGS_OK;
}

static pags_result run_adam(adam_bench *a, pags_frame *frame, const float *plane) {
  for (int64_t step = 0; step < STEPS; step++) {
    PAGS_TRY(error_go_on(a->view, 0.9 + 0.07 * (double)step / STEPS, "Adam"));

    /* Compute the gradients of this step's view. */
    const pags_bench_view *const v = a->view;
    pags_frame_options options = v->options;
    pags_picture picture;
    options.keep_for_backward = 1;
    options.exp_degree = 5;
    memset(a->seen, 0, (size_t)a->clusters);
    PAGS_TRY(
        pags_frame_render(frame, v->parts, v->part_count, view_at(v, step, STEPS), &options, NULL, NULL, &picture));
    const pags_picture_gradient gradient = {.rgb = {plane, plane, plane}};
    PAGS_TRY(pags_frame_backward(frame, &gradient, take_gradient, a, NULL));

    for (int turn = 0; turn < 2; turn++)
      step_engine(a, (int)(step + turn) % 2, FIRST_STEP + step + 1);
    step_exact(a, FIRST_STEP + step + 1);
    for (int64_t c = 0; c < a->clusters; c++)
      a->updated += a->seen[c] ? CLUSTER : 0;
  }
  for (int k = 0; k < 2; k++)
    pags_adam_flush(&a->adam[k], &a->own[k], FIRST_STEP + STEPS, a->view->tasks);
  return PAGS_OK;
}

/* Adds the differences between two optimisers' parameters, `got` against `other` (NULL: the double-precision Adam),
 * each divided by the root mean square distance that the parameter's plane moved over the sample. */
static void compare_adam(const adam_bench *a, const pags_gaussians *got, const pags_gaussians *other, error_sum *sum) {
  const pags_gaussians *const from = a->view->parts[a->part].gaussians;
  for (int p = 0; p < a->planes; p++) {
    double square = 0, moved = 0;
    for (int64_t i = 0; i < a->exact.count; i++) {
      const int64_t row = sampled_row(a, i);
      const double way = row < 0 ? 0 : a->exact.value[i * a->planes + p] - (double)pags_plane(from, p)[row];
      square += way * way;
      moved += way != 0;
    }
    for (int64_t i = 0; i < a->exact.count && moved > 0; i++) {
      const int64_t row = sampled_row(a, i);
      if (row < 0)
        continue;
      const double want = other ? (double)pags_plane(other, p)[row] : a->exact.value[i * a->planes + p];
      error_sum_add(sum, ((double)pags_plane(got, p)[row] - want) / sqrt(square / moved));
    }
  }
}

static void add_adam_rows(const adam_bench *a, error_table *table) {
  error_sum against_dense = {0}, against_double = {0};
  compare_adam(a, &a->own[0], &a->own[1], &against_dense);
  compare_adam(a, &a->own[0], NULL, &against_double);
  error_row *row = error_table_add(table, "Adam, paid when seen", "same kernels, every row", "way gone");
  error_sum_put(&against_dense, 1, row);
  row->gain = a->ms[1] / a->ms[0];
  row->gain_of = "update";
  row->counts[0] = (error_count){"rows a step", (double)a->rows, a->updated / STEPS};
  row = error_table_add(table, "Adam in float", "dense Adam, double", "way gone");
  error_sum_put(&against_double, 1, row);
}

static void destroy_adam(adam_bench *a) {
  for (int k = 0; k < 2; k++) {
    pags_adam_destroy(&a->adam[k]);
    pags_gaussians_destroy(&a->own[k]);
    pags_clusters_destroy(&a->bounds[k]);
  }
  reference_adam_destroy(&a->exact);
  free(a->gradient);
  free(a->zeros);
  free(a->seen);
  free(a->exact_gradient);
}

static pags_result add_adam(const pags_bench_view *view, pags_frame *frame, error_table *table) {
  adam_bench a = {.view = view};
  for (int p = 1; p < view->part_count; p++)
    a.part = view->parts[p].gaussians->count > view->parts[a.part].gaussians->count ? p : a.part;
  if (view->part_count == 0 || view->parts[a.part].clusters->size != CLUSTER)
    return PAGS_OK;
  float *const plane = make_plane(view, -1);
  pags_result result = plane ? create_adam(&a) : pags_out_of_memory("a gradient");
  if (result == PAGS_OK)
    result = run_adam(&a, frame, plane);
  if (result == PAGS_OK)
    add_adam_rows(&a, table);
  destroy_adam(&a);
  free(plane);
  return result;
}

/* ---- Scores at half the size ---- */

typedef struct ranked {
  double score;
  int64_t row;
} ranked;

typedef struct score_bench {
  int64_t first[PAGS_BENCH_ERROR_PARTS]; /* index of each part's first Gaussian */
  int64_t rows;
  double *score[2], ms[2]; /* [0]: at full size, [1]: at half size */
  double *target;
  const float *ones, *zeros;
} score_bench;

static void take_scores(void *user, const pags_cluster_score *c, int worker) {
  const score_bench *const s = user;
  (void)worker;
  for (int i = 0; i < c->count; i++)
    s->target[s->first[c->part] + c->first + i] += c->squared[i];
}

static pags_result score_view(score_bench *s, const pags_bench_view *v, pags_frame *frame, int64_t i, int half) {
  const pags_camera camera = pags_camera_downscale(view_at(v, i, SCORE_VIEWS), half ? 2 : 1);
  pags_frame_options options = v->options;
  pags_picture picture;
  options.keep_for_backward = 1;
  options.exp_degree = 5;
  s->target = s->score[half];
  const double begin = error_clock_ms();
  PAGS_TRY(pags_frame_render(frame, v->parts, v->part_count, &camera, &options, NULL, NULL, &picture));
  const pags_score_planes planes = {.counted = s->ones, .critical = s->zeros};
  PAGS_TRY(pags_frame_scores(frame, &planes, take_scores, s));
  s->ms[half] += error_clock_ms() - begin;
  return PAGS_OK;
}

static int lower_score(const void *a, const void *b) {
  const ranked *x = a, *y = b;
  if (x->score != y->score)
    return x->score < y->score ? -1 : 1;
  return (x->row > y->row) - (x->row < y->row);
}

/* Replaces the scores of the rows that some view saw by their percentile ranks; rows that no view saw keep their
 * score. Returns how many were ranked. */
static int64_t rank_scores(score_bench *s, ranked *list, int half) {
  int64_t count = 0;
  for (int64_t i = 0; i < s->rows; i++)
    if (s->score[0][i] >= 0)
      list[count++] = (ranked){s->score[half][i], i};
  pags_sort(list, count, sizeof *list, lower_score);
  for (int64_t i = 0; i < count; i++)
    s->score[half][list[i].row] = 100.0 * (double)i / (double)count;
  return count;
}

static pags_result compare_scores(score_bench *s, error_table *table) {
  ranked *const list = malloc((size_t)(s->rows > 0 ? s->rows : 1) * sizeof *list);
  error_sum sum = {0};
  int64_t chosen = 0, others = 0;
  if (!list)
    return pags_out_of_memory("ranking %lld Gaussians", (long long)s->rows);
  for (int64_t i = 0; i < s->rows; i++)
    if (s->score[0][i] == 0 && s->score[1][i] == 0)
      s->score[0][i] = -1; /* no view saw it: left out, since it ranks lowest at both sizes */
  rank_scores(s, list, 1);
  rank_scores(s, list, 0);
  free(list);
  for (int64_t i = 0; i < s->rows; i++) {
    if (s->score[0][i] < 0)
      continue;
    error_sum_add(&sum, s->score[0][i] - s->score[1][i]);
    chosen += s->score[0][i] < 60;
    others += s->score[0][i] < 60 && s->score[1][i] >= 60;
  }
  error_row *const row = error_table_add(table, "S_grad at half size", "at full size", "percentile");
  error_sum_put(&sum, 1, row);
  row->gain = s->ms[0] / s->ms[1];
  row->gain_of = "scoring";
  row->counts[0] = (error_count){"60 % lowest, all -> the same", (double)chosen, (double)(chosen - others)};
  return PAGS_OK;
}

static pags_result add_scores(const pags_bench_view *view, pags_frame *frame, error_table *table) {
  score_bench s = {.rows = 0};
  pags_result result = PAGS_OK;
  for (int p = 0; p < view->part_count; p++) {
    s.first[p] = s.rows;
    s.rows += view->parts[p].gaussians->count;
  }
  float *const ones = make_plane(view, 1), *const zeros = make_plane(view, 0);
  s.ones = ones, s.zeros = zeros;
  s.score[0] = calloc(2 * (size_t)(s.rows > 0 ? s.rows : 1), sizeof(double));
  s.score[1] = s.score[0] ? s.score[0] + s.rows : NULL;
  if (!ones || !zeros || !s.score[0])
    result = pags_out_of_memory("scores");
  for (int64_t i = 0; i < SCORE_VIEWS && result == PAGS_OK; i++) {
    result = error_go_on(view, 0.97 + 0.03 * (double)i / SCORE_VIEWS, "scores");
    for (int turn = 0; turn < 2 && result == PAGS_OK; turn++)
      result = score_view(&s, view, frame, i, (int)(i + turn) % 2);
  }
  if (result == PAGS_OK)
    result = compare_scores(&s, table);
  free(s.score[0]);
  free(ones);
  free(zeros);
  return result;
}

pags_result error_rows_of_training(const pags_bench_view *view, error_table *table) {
  pags_frame *frame;
  PAGS_TRY(pags_frame_create(view->tasks, &frame));
  pags_result result = add_adam(view, frame, table);
  if (result == PAGS_OK)
    result = add_scores(view, frame, table);
  pags_frame_destroy(frame);
  return result;
}
