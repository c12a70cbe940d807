/* The jitter of labels. What rides on wheels or walks has little jerk, so that a labelled track is the true one plus an error of
 * its own at each time step. The smoothed track x minimises
 *   sum over knots |x_k - label_k|^2 + lambda * sum over four neighbouring knots |third divided difference|^2
 * (Whittaker 1923), times in median spacings; constant acceleration costs nothing. lambda = 10 000 takes about 70 % off
 * independent errors of a track of 31 knots, and leaves motions slower than about 30 time steps a cycle alone. Rotations are
 * smoothed as rotation vectors relative to the first knot, which is exact for rotations about one axis: the yaw of what
 * stands on a road. Trained knots only. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <pags/camera.h>

#include "train/tracks.h"

enum { WINDOW = 4, CHANNELS = 6, LEAST_KNOTS = 8 };
static const double lambda = 10000.0;
static const double longest_gap = 4.0; /* median spacings; a longer one parts the track */

/* A run of trained knots. */
typedef struct run {
  pags_object *object;
  int64_t *knots; /* indices in the object */
  int64_t count;
  double spacing;        /* s */
  double (*band)[WINDOW]; /* lower band of the matrix: band[i][j] = A[i][i - j]; then of its Cholesky factor */
  double (*right)[CHANNELS];
} run;

/* A = 1 + lambda D' D, D's rows being the third divided differences (times 3! to be derivatives). */
static void build_matrix(run *r) {
  for (int64_t i = 0; i < r->count; i++)
    for (int j = 0; j < WINDOW; j++)
      r->band[i][j] = j == 0;
  for (int64_t first = 0; first + WINDOW <= r->count; first++) {
    double d[WINDOW];
    for (int i = 0; i < WINDOW; i++) {
      d[i] = 6.0;
      for (int j = 0; j < WINDOW; j++)
        if (j != i)
          d[i] *= r->spacing / (r->object->knots[r->knots[first + i]].time - r->object->knots[r->knots[first + j]].time);
    }
    for (int i = 0; i < WINDOW; i++)
      for (int j = 0; j <= i; j++)
        r->band[first + i][i - j] += lambda * d[i] * d[j];
  }
}

/* Cholesky in place, then both substitutions. The matrix is at least the identity. */
static void solve(run *r) {
  for (int64_t i = 0; i < r->count; i++)
    for (int j = i < WINDOW - 1 ? (int)i : WINDOW - 1; j >= 0; j--) {
      double sum = r->band[i][j];
      for (int k = j + 1; k < WINDOW && k <= i; k++)
        sum -= r->band[i][k] * r->band[i - j][k - j];
      r->band[i][j] = j == 0 ? sqrt(sum) : sum / r->band[i - j][0];
    }
  for (int c = 0; c < CHANNELS; c++) {
    for (int64_t i = 0; i < r->count; i++) {
      for (int j = 1; j < WINDOW && j <= i; j++)
        r->right[i][c] -= r->band[i][j] * r->right[i - j][c];
      r->right[i][c] /= r->band[i][0];
    }
    for (int64_t i = r->count - 1; i >= 0; i--) {
      for (int j = 1; j < WINDOW && i + j < r->count; j++)
        r->right[i][c] -= r->band[i + j][j] * r->right[i + j][c];
      r->right[i][c] /= r->band[i][0];
    }
  }
}

/* Rotation vector of `m` relative to the run's first knot, continued from `before` without jumps of a turn. */
static void rotation_from(const double first[12], const double m[12], const double before[3], double out[3]) {
  double back[12], relative[12], q[4];
  pags_rigid_inverse(first, back);
  pags_rigid_multiply(back, m, relative);
  double r[9];
  for (int i = 0; i < 9; i++)
    r[i] = relative[i / 3 * 4 + i % 3];
  pags_quaternion_from_rotation(r, q);
  double sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), angle = 2.0 * atan2(sine, q[0]);
  double scale = sine > 1e-12 ? angle / sine : 2.0, best = INFINITY;
  double turn = sine > 1e-12 ? 6.283185307179586 / sine : 0.0;
  for (int n = -2; n <= 2; n++) { /* the same rotation, whole turns apart */
    double apart = 0.0, v[3];
    for (int i = 0; i < 3; i++) {
      v[i] = q[1 + i] * (scale + n * turn);
      apart += (v[i] - before[i]) * (v[i] - before[i]);
    }
    if (apart < best) {
      best = apart;
      memcpy(out, v, sizeof v);
    }
  }
}

static void fill_right(run *r) {
  const double *first = r->object->knots[r->knots[0]].world_from_object;
  double before[3] = {0.0, 0.0, 0.0};
  for (int64_t i = 0; i < r->count; i++) {
    const double *m = r->object->knots[r->knots[i]].world_from_object;
    rotation_from(first, m, before, r->right[i]);
    memcpy(before, r->right[i], sizeof before);
    for (int k = 0; k < 3; k++)
      r->right[i][3 + k] = m[4 * k + 3] - first[4 * k + 3];
  }
}

/* The increment from each label to the smoothed pose. */
static void take_increments(run *r) {
  double first[12], zero[3] = {0.0, 0.0, 0.0};
  memcpy(first, r->object->knots[r->knots[0]].world_from_object, sizeof first);
  for (int64_t i = 0; i < r->count; i++) {
    pags_knot *knot = &r->object->knots[r->knots[i]];
    double turn[12], pose[12], back[12], increment[12];
    pags_increment_matrix(r->right[i], zero, turn);
    pags_rigid_multiply(first, turn, pose);
    for (int k = 0; k < 3; k++)
      pose[4 * k + 3] = first[4 * k + 3] + r->right[i][3 + k];
    pags_rigid_inverse(knot->world_from_object, back);
    pags_rigid_multiply(back, pose, increment);
    rotation_from((const double[12]){1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, increment, zero, knot->rotation);
    for (int k = 0; k < 3; k++)
      knot->translation[k] = increment[4 * k + 3];
  }
}

static void smooth_run(run *r) {
  if (r->count < LEAST_KNOTS)
    return;
  build_matrix(r);
  fill_right(r);
  solve(r);
  take_increments(r);
}

static int by_size(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static double median_spacing(const pags_object *o, const int64_t *knots, int64_t count, double (*scratch)[CHANNELS]) {
  double *gaps = &scratch[0][0];
  for (int64_t i = 1; i < count; i++)
    gaps[i - 1] = o->knots[knots[i]].time - o->knots[knots[i - 1]].time;
  qsort(gaps, (size_t)(count - 1), sizeof *gaps, by_size);
  return gaps[(count - 1) / 2];
}

static pags_result smooth_object(pags_object *o) {
  size_t room = (size_t)(o->knot_count > 0 ? o->knot_count : 1);
  int64_t *knots = malloc(room * sizeof *knots), count = 0;
  double(*band)[WINDOW] = malloc(room * sizeof *band);
  double(*right)[CHANNELS] = malloc(room * sizeof *right);
  for (int64_t k = 0; knots && k < o->knot_count; k++)
    if (o->knots[k].trained)
      knots[count++] = k;
  pags_result result =
      knots && band && right ? PAGS_OK : pags_fail(PAGS_ERROR_MEMORY, "no memory to smooth a track of %zu knots", room);
  if (result == PAGS_OK && count >= LEAST_KNOTS) {
    double spacing = median_spacing(o, knots, count, right);
    for (int64_t begin = 0, i = 1; i <= count; i++) {
      if (i < count && o->knots[knots[i]].time - o->knots[knots[i - 1]].time <= longest_gap * spacing)
        continue;
      smooth_run(&(run){o, knots + begin, i - begin, spacing, band, right});
      begin = i;
    }
  }
  free(knots);
  free(band);
  free(right);
  return result;
}

pags_result pags_tracks_smooth(pags_tracks *tracks) {
  for (int64_t i = 0; i < tracks->count; i++)
    if (tracks->objects[i].moving)
      PAGS_TRY(smooth_object(&tracks->objects[i]));
  return PAGS_OK;
}
