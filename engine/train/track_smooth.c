/* SPDX-License-Identifier: Apache-2.0 */
/* Removes the jitter of labelled tracks. An object on wheels or on foot moves with little jerk, so a labelled track
 * is the true one plus an independent error at each time step. The smoothed track x minimises
 *
 *     sum over keyframes |x_k - label_k|^2 + lambda * sum over four neighbouring keyframes |third divided difference|^2
 *
 * (Whittaker 1923), with times in median spacings; constant acceleration costs nothing. The strength of smoothing is
 * estimated from the labels themselves: one lambda for all positions of a data set and one for all rotations, those
 * with the least score of generalised cross-validation (Craven and Wahba 1979),
 *
 *     N * sum |label - x|^2 / (N - trace)^2,
 *
 * where trace is that of the matrix that maps labels to x, and the sums are over all tracks. So labels without jitter
 * stay as they are. Rotations are smoothed as rotation vectors relative to the first keyframe, which is exact for
 * rotations about one axis, such as the yaw of an object on a road. Only trained keyframes are used. */
#include <math.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "maths/maths.h"
#include "train/track_poses.h"

enum { WINDOW = 4, CHANNELS = 6, LEAST_KEYFRAMES = 8, STRENGTHS = 23 };
enum { ROTATION, TRANSLATION, KINDS };   /* channels 0-2 are the rotation, 3-5 the translation */
static const double least_lambda = 1e-4; /* hardly smooths; each further strength is half a decade more */
static const double longest_gap = 4.0;   /* median spacings; a longer gap splits the track in two runs */

/* A run: consecutive trained keyframes of an object without a long gap. */
typedef struct run {
  pags_object *object;
  int64_t *keyframes; /* indices of the run's keyframes in the object */
  int64_t count;
  double spacing; /* median spacing of the object's trained keyframes, seconds */
  double (*label)[CHANNELS];
  double (*smooth)[CHANNELS];
  double (*band)[WINDOW]; /* lower band of the matrix A: band[i][j] = A[i][i - j]; then of its Cholesky factor */
} run;

/* Sums over runs for generalised cross-validation. */
typedef struct scores {
  double labels;                 /* N, the number of labels per channel */
  double freedom[STRENGTHS];     /* N - trace, per strength */
  double rest[STRENGTHS][KINDS]; /* sum |label - x|^2, per strength and kind */
} scores;

static double strength(int i) {
  return least_lambda * pags_pow(10.0, 0.5 * i);
}

/* ---- Solving one run ---- */

/* Builds the matrix A = 1 + lambda D' D of a run and replaces it by its Cholesky factor. A is at least the identity,
 * so the factorisation never fails. */
static void factor(run *r, double lambda) {
  /* Build A. The rows of D are the third divided differences, times 3! to be derivatives. */
  for (int64_t i = 0; i < r->count; i++)
    for (int j = 0; j < WINDOW; j++)
      r->band[i][j] = j == 0;
  for (int64_t first = 0; first + WINDOW <= r->count; first++) {
    double d[WINDOW];
    for (int i = 0; i < WINDOW; i++) {
      d[i] = 6.0;
      for (int j = 0; j < WINDOW; j++)
        if (j != i)
          d[i] *= r->spacing / (r->object->keyframes[r->keyframes[first + i]].time -
                                r->object->keyframes[r->keyframes[first + j]].time);
    }
    for (int i = 0; i < WINDOW; i++)
      for (int j = 0; j <= i; j++)
        r->band[first + i][i - j] += lambda * d[i] * d[j];
  }

  for (int64_t i = 0; i < r->count; i++)
    for (int j = i < WINDOW - 1 ? (int)i : WINDOW - 1; j >= 0; j--) {
      double sum = r->band[i][j];
      for (int k = j + 1; k < WINDOW && k <= i; k++)
        sum -= r->band[i][k] * r->band[i - j][k - j];
      r->band[i][j] = j == 0 ? sqrt(sum) : sum / r->band[i - j][0];
    }
}

/* Solves A x' = x for channels [begin, end), by forward and backward substitution; x' replaces x. */
static void solve(const run *r, double (*x)[CHANNELS], int begin, int end) {
  for (int c = begin; c < end; c++) {
    for (int64_t i = 0; i < r->count; i++) {
      for (int j = 1; j < WINDOW && j <= i; j++)
        x[i][c] -= r->band[i][j] * x[i - j][c];
      x[i][c] /= r->band[i][0];
    }
    for (int64_t i = r->count - 1; i >= 0; i--) {
      for (int j = 1; j < WINDOW && i + j < r->count; j++)
        x[i][c] -= r->band[i + j][j] * x[i + j][c];
      x[i][c] /= r->band[i][0];
    }
  }
}

/* ---- Choosing the strength ---- */

static void score_run(run *r, scores *s) {
  s->labels += (double)r->count;
  for (int i = 0; i < STRENGTHS; i++) {
    factor(r, strength(i));

    /* The trace of the inverse of A, column by column. */
    double trace = 0.0;
    for (int64_t k = 0; k < r->count; k++) {
      for (int64_t j = 0; j < r->count; j++)
        r->smooth[j][0] = j == k;
      solve(r, r->smooth, 0, 1);
      trace += r->smooth[k][0];
    }
    s->freedom[i] += (double)r->count - trace;

    memcpy(r->smooth, r->label, (size_t)r->count * sizeof *r->smooth);
    solve(r, r->smooth, 0, CHANNELS);
    for (int64_t k = 0; k < r->count; k++)
      for (int c = 0; c < CHANNELS; c++) {
        const double rest = r->label[k][c] - r->smooth[k][c];
        s->rest[i][c / 3] += rest * rest;
      }
  }
}

/* ---- Labels and increments ---- */

/* Computes the rotation vector of `m` relative to the run's first keyframe. `out` receives, among the
 * equivalent vectors, which differ by whole turns, the one nearest to `before`, the vector of the keyframe before. */
static void rotation_from(const double first[12], const double m[12], const double before[3], double out[3]) {
  double back[12], relative[12], least[3], best = INFINITY;
  pags_rigid_inverse(first, back);
  pags_rigid_multiply(back, m, relative);
  pags_increment_rotation(relative, least);
  const double angle = pags_length3(least), turn = angle > 1e-12 ? 6.283185307179586 / angle : 0.0;
  for (int n = -2; n <= 2; n++) { /* the same rotation, n whole turns further */
    double v[3];
    pags_scale3(1.0 + n * turn, least, v);
    const double apart = pags_distance_squared3(v, before);
    if (apart < best) {
      best = apart;
      pags_copy3(v, out);
    }
  }
}

static void smooth_run(run *r, const int best[KINDS]) {
  memcpy(r->smooth, r->label, (size_t)r->count * sizeof *r->smooth);
  for (int kind = 0; kind < KINDS; kind++) {
    factor(r, strength(best[kind]));
    solve(r, r->smooth, 3 * kind, 3 * kind + 3);
  }

  /* Compute each keyframe's increment from the label to the smoothed pose. */
  double first[12], place[3], zero[3] = {0.0, 0.0, 0.0};
  memcpy(first, r->object->keyframes[r->keyframes[0]].world_from_object, sizeof first);
  pags_pose_position(first, place);
  for (int64_t i = 0; i < r->count; i++) {
    pags_keyframe *keyframe = &r->object->keyframes[r->keyframes[i]];
    double turn[12], pose[12], back[12], increment[12], position[3];
    pags_increment_matrix(r->smooth[i], zero, turn);
    pags_rigid_multiply(first, turn, pose);
    pags_add3(place, r->smooth[i] + 3, position);
    pags_pose_place(pose, position);
    pags_rigid_inverse(keyframe->world_from_object, back);
    pags_rigid_multiply(back, pose, increment);
    pags_increment_rotation(increment, keyframe->rotation);
    pags_pose_position(increment, keyframe->translation);
  }
}

/* ---- All tracks ---- */

/* All runs of a data set and the arrays they point into. */
typedef struct run_list {
  run *items;
  int64_t count;
  int64_t *keyframes;
  double (*label)[CHANNELS], (*smooth)[CHANNELS], (*band)[WINDOW];
  int64_t used; /* keyframes taken from the arrays */
} run_list;

static void destroy(run_list *list) {
  free(list->items);
  free(list->keyframes);
  free(list->label);
  free(list->smooth);
  free(list->band);
}

static void list_runs(run_list *list, pags_object *o) {
  int64_t *keyframes = list->keyframes + list->used, count = 0;
  for (int64_t k = 0; k < o->keyframe_count; k++)
    if (o->keyframes[k].trained)
      keyframes[count++] = k;
  if (count < LEAST_KEYFRAMES)
    return;

  /* The median spacing of the keyframes' times; `smooth` serves as scratch. */
  double *const apart = list->smooth[list->used];
  for (int64_t i = 1; i < count; i++)
    apart[i - 1] = o->keyframes[keyframes[i]].time - o->keyframes[keyframes[i - 1]].time;
  pags_sort_doubles(apart, count - 1);
  const double spacing = apart[(count - 1) / 2];

  for (int64_t begin = 0, i = 1; i <= count; i++) {
    if (i < count && o->keyframes[keyframes[i]].time - o->keyframes[keyframes[i - 1]].time <= longest_gap * spacing)
      continue;
    int64_t at = list->used + begin;
    if (i - begin >= LEAST_KEYFRAMES)
      list->items[list->count++] =
          (run){o, keyframes + begin, i - begin, spacing, list->label + at, list->smooth + at, list->band + at};
    begin = i;
  }
  list->used += count;
}

pags_result pags_tracks_smooth(pags_track_poses *tracks) {
  size_t keyframes = 1;
  for (int64_t i = 0; i < tracks->count; i++)
    keyframes += (size_t)tracks->objects[i].keyframe_count;
  PAGS_AUTO(destroy)
  run_list list = {.items = malloc(keyframes / LEAST_KEYFRAMES * sizeof(run) + sizeof(run)),
                   .keyframes = malloc(keyframes * sizeof *list.keyframes),
                   .label = malloc(keyframes * sizeof *list.label),
                   .smooth = malloc(keyframes * sizeof *list.smooth),
                   .band = malloc(keyframes * sizeof *list.band)};
  PAGS_CHECK_MEMORY(list.items && list.keyframes && list.label && list.smooth && list.band, "tracks of %zu keyframes",
                    keyframes);
  for (int64_t i = 0; i < tracks->count; i++)
    if (tracks->objects[i].moving)
      list_runs(&list, &tracks->objects[i]);

  /* Score all strengths over all runs, then smooth with the best. */
  scores s = {0};
  for (run *r = list.items; r < list.items + list.count; r++) {
    const double *first = r->object->keyframes[r->keyframes[0]].world_from_object;
    const double *before = (const double[3]){0.0, 0.0, 0.0};
    for (int64_t i = 0; i < r->count; before = r->label[i++]) {
      const double *m = r->object->keyframes[r->keyframes[i]].world_from_object;
      rotation_from(first, m, before, r->label[i]);
      for (int k = 0; k < 3; k++)
        r->label[i][3 + k] = m[4 * k + 3] - first[4 * k + 3];
    }
    score_run(r, &s);
  }
  int best[KINDS] = {0};
  for (int kind = 0; kind < KINDS; kind++) {
    double least = INFINITY;
    for (int i = 0; i < STRENGTHS; i++) {
      const double score = s.labels * s.rest[i][kind] / (s.freedom[i] * s.freedom[i]);
      best[kind] = score < least ? i : best[kind];
      least = score < least ? score : least;
    }
  }
  for (int64_t i = 0; i < list.count; i++)
    smooth_run(&list.items[i], best);
  if (list.count > 0)
    pags_log_message(PAGS_LOG_INFO, "labels of moving objects jitter by about %.3f m and %.2f degrees: smoothed",
                     sqrt(s.rest[best[TRANSLATION]][TRANSLATION] / s.freedom[best[TRANSLATION]]),
                     sqrt(s.rest[best[ROTATION]][ROTATION] / s.freedom[best[ROTATION]]) * 57.29577951308232);
  return PAGS_OK;
}
