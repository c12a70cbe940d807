/* SPDX-License-Identifier: Apache-2.0 */
/* Finds poses of a car that leap, labels of objects that lie aside, and tracks that go from one object to another
 * (motion.h).
 *
 * The neighbours distinguish a fault from motion: a value is compared with the median of what the poses around it
 * predict. The median stays right as long as most of them are, so that one wrong pose, or two in a row, don't make
 * their neighbours suspicious. */
#include "dataset/driving/motion.h"

#include <math.h>
#include <string.h>

#include "base/sort.h"
#include "base/vec3.h"
#include "maths/maths.h"

static const double degrees = 57.29577951308232;

/* ---- The motion of a car ---- */

enum { AROUND = 3, MOST_LOOKED = 512 }; /* AROUND: steps on either side that a step is compared with */

/* Few values, which are sorted by insertion. */
static double median(double *values, int count) {
  for (int i = 1; i < count; i++)
    for (int j = i; j > 0 && values[j - 1] > values[j]; j--) {
      const double keep = values[j];
      values[j] = values[j - 1];
      values[j - 1] = keep;
    }
  return count ? 0.5 * (values[(count - 1) / 2] + values[count / 2]) : 0;
}

/* The angle in degrees between two rotations, to some thousandths: the trace of the rotation from one to the other is
 * 1 + 2 cos(angle). */
static double angle_between(const double a[12], const double b[12]) {
  double trace = 0;
  for (int row = 0; row < 12; row += 4)
    trace += pags_dot3(a + row, b + row);
  return degrees * pags_acos(fmax(-1, fmin(1, 0.5 * (trace - 1))));
}

/* Poses with their times at equal distances in memory, as arrays or as members of keyframes. */
typedef struct sequence {
  const double *poses, *times;
  size_t pose_stride, time_stride; /* in doubles */
  int64_t count;
} sequence;

static const double *pose_at(const sequence *s, int64_t i) {
  return s->poses + (size_t)i * s->pose_stride;
}

static double step_time(const sequence *s, int64_t i) {
  return s->times[(size_t)(i + 1) * s->time_stride] - s->times[(size_t)i * s->time_stride];
}

/* How far the step from pose `at` to the next differs from the steps around it, in metres. */
static double step_error(const sequence *s, int64_t at) {
  double square = 0;
  for (int axis = 3; axis < 12; axis += 4) {
    double speeds[2 * AROUND];
    int n = 0;
    for (int64_t i = at - AROUND; i <= at + AROUND; i++)
      if (i >= 0 && i + 1 < s->count && i != at)
        speeds[n++] = (pose_at(s, i + 1)[axis] - pose_at(s, i)[axis]) / step_time(s, i);
    const double step = pose_at(s, at + 1)[axis] - pose_at(s, at)[axis];
    const double off = n >= 2 ? step - step_time(s, at) * median(speeds, n) : 0;
    square += off * off;
  }
  return sqrt(square);
}

/* No car, and nothing else on a street, gains 30 m/s in a second; positions are known to 0.8 m. */
static bool is_leap(double metres, double dt) {
  return metres > 0.8 + 30 * dt * dt;
}

static double step_length(const sequence *s, int64_t at) {
  return pags_pose_distance(pose_at(s, at + 1), pose_at(s, at));
}

/* Whether the step leads nowhere while those around it lead on. */
static bool is_repeat(const sequence *s, int64_t at) {
  double sum = 0;
  int n = 0;
  if (step_length(s, at) > 1e-6)
    return false;
  for (int64_t i = at - AROUND; i <= at + AROUND; i++)
    if (i >= 0 && i + 1 < s->count && i != at) {
      sum += step_length(s, i);
      n++;
    }
  return n > 1 && sum > 0.3 * n;
}

/* How far the angle of the step from a pose to the next differs from those around it, in degrees. */
static double turn_error(const sequence *s, int64_t at) {
  double angles[2 * AROUND];
  int n = 0;
  for (int64_t i = at - AROUND; i <= at + AROUND; i++)
    if (i >= 0 && i + 1 < s->count && i != at)
      angles[n++] = angle_between(pose_at(s, i), pose_at(s, i + 1));
  return n >= 2 ? fabs(angle_between(pose_at(s, at), pose_at(s, at + 1)) - median(angles, n)) : 0;
}

/* The median of an error over at most MOST_LOOKED steps spread over the sequence. */
static double usual_error(const sequence *s, double (*error)(const sequence *s, int64_t at)) {
  double errors[MOST_LOOKED];
  int64_t n = 0;
  for (int64_t i = 0; i + 1 < s->count; i += 1 + s->count / MOST_LOOKED)
    errors[n++] = error(s, i);
  pags_sort_doubles(errors, n);
  return n ? errors[n / 2] : 0;
}

pags_leaps pags_find_leaps(const double (*poses)[12], const double *times, int64_t count) {
  const sequence s = {poses ? *poses : NULL, times, 12, 1, count};
  const double usual = usual_error(&s, step_error), usual_turn = usual_error(&s, turn_error);
  pags_leaps leaps = {0};
  for (int64_t i = 0; i + 1 < count; i++) {
    const double dt = step_time(&s, i), off = step_error(&s, i), turn_off = turn_error(&s, i);
    const double angle = angle_between(poses[i], poses[i + 1]);
    const bool leaps_far = is_leap(off, dt) || off > fmax(0.3 + 12 * dt * dt, 10 * usual);
    const bool turns_far = angle > 4 + 90 * dt || turn_off > fmax(2 + 30 * dt, 10 * usual_turn);
    if (is_repeat(&s, i) && leaps.repeats++ == 0)
      leaps.first_repeat = i;
    if (!(dt > 0) || (!leaps_far && !turns_far) || leaps.count++ > 0)
      continue;
    leaps.first = i;
    leaps.metres = off;
    leaps.degrees = angle;
    leaps.seconds = dt;
  }
  return leaps;
}

pags_track_leap pags_track_find_leap(const pags_object *object) {
  const size_t stride = sizeof(pags_keyframe) / sizeof(double);
  const sequence s = {object->keyframes->world_from_object, &object->keyframes->time, stride, stride,
                      object->keyframe_count};
  for (int64_t i = 0; i + 1 < s.count; i++) {
    const double dt = step_time(&s, i), off = step_error(&s, i);
    if (dt > 0 && is_leap(off, dt))
      return (pags_track_leap){i, off, dt};
  }
  return (pags_track_leap){0};
}

/* ---- Labels that are turned by half a turn ---- */

/* Whether no object of this category turns that far from one label to the next. Walkers may turn on the spot. */
static bool is_flip(const pags_object *object, const pags_keyframe *a, const pags_keyframe *b) {
  const double angle = angle_between(a->world_from_object, b->world_from_object);
  const double fastest = object->category == PAGS_CATEGORY_PEDESTRIAN ? 500 : 200; /* degrees a second */
  return angle > 135 && angle > fastest * (b->time - a->time);
}

/* The labels fall into two groups, which face opposite ways. The smaller one is turned; of two equal ones that which
 * faces against the way that the object goes. */
static void turn_flips(const pags_object *object, uint8_t *mended) {
  int64_t flips = 0, turned = 0;
  bool side = false;
  double along = 0; /* way along the front of the first group minus that of the second */
  for (int64_t i = 0; i < object->keyframe_count; i++) {
    const double *m = object->keyframes[i].world_from_object, *next = m;
    if (i > 0 && is_flip(object, &object->keyframes[i - 1], &object->keyframes[i]))
      side = !side, flips++;
    turned += side;
    if (i + 1 < object->keyframe_count)
      next = object->keyframes[i + 1].world_from_object;
    for (int k = 0; k < 3; k++)
      along += (side ? -1 : 1) * m[4 * k] * (next[4 * k + 3] - m[4 * k + 3]);
    mended[i] = (uint8_t)((mended[i] & PAGS_MENDED_MOVED) | (side ? PAGS_MENDED_TURNED : 0));
  }
  const bool swap = 2 * turned > object->keyframe_count || (2 * turned == object->keyframe_count && along < 0);
  for (int64_t i = 0; i < object->keyframe_count && flips; i++) {
    if (swap)
      mended[i] ^= PAGS_MENDED_TURNED;
    double *m = object->keyframes[i].world_from_object;
    for (int row = 0; row < 12 && mended[i] & PAGS_MENDED_TURNED; row += 4) {
      m[row] = -m[row];
      m[row + 1] = -m[row + 1];
    }
  }
}

/* ---- Labels that lie aside ---- */

enum { LEAST_KEYFRAMES = 5, NEAR = 2 }; /* NEAR: labels on either side that predict the one between them */

/* Collects the nearest good labels before (step -1) or behind (step 1) a label; returns their number. */
static int near_labels(const pags_object *object, const uint8_t *mended, int64_t at, int step, double longest,
                       int64_t out[NEAR]) {
  int n = 0;
  for (int64_t i = at + step; i >= 0 && i < object->keyframe_count && n < NEAR; i += step)
    if (!(mended[i] & PAGS_MENDED_MOVED) && fabs(object->keyframes[i].time - object->keyframes[at].time) <= longest)
      out[n++] = i;
  return n;
}

/* Predicts the place of a label from those around it: the median over all pairs of one before and one behind, or, at
 * an end, over the pairs of the first three. Returns 0 without such pairs, 1 between labels, 2 at an end. */
static int predict(const pags_object *object, const uint8_t *mended, int64_t at, double longest, double place[3]) {
  int64_t before[NEAR], behind[NEAR], pairs[2 * NEAR][2];
  const int a = near_labels(object, mended, at, -1, longest, before);
  const int b = near_labels(object, mended, at, 1, longest, behind);
  int n = 0;
  for (int i = 0; i < a; i++)
    for (int j = 0; j < b; j++)
      pairs[n][0] = before[i], pairs[n++][1] = behind[j];
  if (n == 0 && a + b == NEAR)
    pairs[n][0] = a ? before[1] : behind[0], pairs[n++][1] = a ? before[0] : behind[1];
  for (int k = 0; k < 3 && n; k++) {
    double values[2 * NEAR];
    for (int i = 0; i < n; i++) {
      const pags_keyframe *from = &object->keyframes[pairs[i][0]], *to = &object->keyframes[pairs[i][1]];
      const double share = (object->keyframes[at].time - from->time) / (to->time - from->time);
      const double p = from->world_from_object[4 * k + 3], q = to->world_from_object[4 * k + 3];
      values[i] = p + share * (q - p);
    }
    place[k] = median(values, n);
  }
  return n == 0 ? 0 : a && b ? 1 : 2;
}

/* Distance of a label from its prediction, in units of what motion and noise explain; `place` is the prediction. */
static double place_error(const pags_object *object, const uint8_t *mended, int64_t at, double spacing,
                          double place[3]) {
  double labelled[3];
  pags_pose_position(object->keyframes[at].world_from_object, labelled);
  const int kind = predict(object, mended, at, 4.5 * spacing, place);
  const double off = kind ? pags_distance3(labelled, place) : 0;
  /* 0.7 m of noise; 6 m/s^2 over two spacings on either side, over three spacings at an end */
  return off / ((kind == 2 ? 1.4 : 1.0) * (0.7 + 12 * spacing * spacing));
}

/* Turns a label as the one before it if that and the one behind agree and it differs. */
static bool mend_turn(const pags_object *object, int64_t at) {
  if (at == 0 || at + 1 == object->keyframe_count)
    return false;
  double *m = object->keyframes[at].world_from_object;
  const pags_keyframe *a = &object->keyframes[at - 1], *b = &object->keyframes[at + 1];
  const double apart = angle_between(a->world_from_object, b->world_from_object);
  const double off = fmin(angle_between(a->world_from_object, m), angle_between(b->world_from_object, m));
  if (off < 30 || off < 3 * apart ||
      off < 200 * fmax(b->time - object->keyframes[at].time, object->keyframes[at].time - a->time))
    return false;
  for (int row = 0; row < 12; row += 4)
    memcpy(m + row, a->world_from_object + row, 3 * sizeof *m);
  return true;
}

void pags_track_mend(const pags_object *object, uint8_t *mended) {
  double spacing = INFINITY, place[3];
  int64_t moved = 0;
  turn_flips(object, mended);
  for (int64_t i = 0; i < object->keyframe_count; i++) {
    spacing = i ? fmin(spacing, object->keyframes[i].time - object->keyframes[i - 1].time) : spacing;
    moved += (mended[i] & PAGS_MENDED_MOVED) != 0;
  }

  /* Move the label that is farthest off first, since a wrong label makes its neighbours' predictions worse; at most a
   * quarter of them, for a track of which more is wrong has no neighbours to trust. */
  for (; object->keyframe_count >= LEAST_KEYFRAMES && 4 * moved < object->keyframe_count; moved++) {
    double worst = 1;
    int64_t at = -1;
    for (int64_t i = 0; i < object->keyframe_count; i++) {
      const double error = mended[i] & PAGS_MENDED_MOVED ? 0 : place_error(object, mended, i, spacing, place);
      if (error > worst) {
        worst = error;
        at = i;
      }
    }
    int64_t off = 0; /* if most labels are off by more than a quarter of the worst, jitter explains it */
    for (int64_t i = 0; i < object->keyframe_count; i++)
      off += 4 * place_error(object, mended, i, spacing, place) > worst;
    if (at < 0 || 2 * off > object->keyframe_count)
      break;
    mended[at] |= PAGS_MENDED_MOVED;
  }
  /* A moved label gets the place that those which weren't moved predict. */
  for (int64_t i = 0; i < object->keyframe_count; i++)
    if (mended[i] & PAGS_MENDED_MOVED && predict(object, mended, i, 4.5 * spacing, place))
      pags_pose_place(object->keyframes[i].world_from_object, place);
  for (int64_t i = 0; i < object->keyframe_count && object->keyframe_count >= LEAST_KEYFRAMES; i++)
    if (mend_turn(object, i))
      mended[i] |= PAGS_MENDED_TURNED;
}

/* ---- Tracks that go from one thing to another ---- */

/* Labels of a thing of its own, at least; steps next to a gap that tell the speed there; most pieces of a track. */
enum { LEAST_PART = 3, SIDE = 3, MOST_PARTS = 32 };

/* Velocity along an axis at a label, from at most SIDE steps to labels of the same part before (direction -1) or behind
 * (1) it: the median. NaN without such steps. */
static double side_speed(const pags_object *object, const int *part, int64_t at, int direction, int axis) {
  double speeds[SIDE];
  int n = 0;
  int64_t from = at;
  for (int64_t i = at + direction; i >= 0 && i < object->keyframe_count && n < SIDE; i += direction) {
    if (part[i] != part[at])
      continue;
    const pags_keyframe *a = &object->keyframes[from], *b = &object->keyframes[i];
    speeds[n++] = (b->world_from_object[axis] - a->world_from_object[axis]) / (b->time - a->time);
    from = i;
  }
  return n ? median(speeds, n) : (double)NAN;
}

/* How far label `b` is from where the labels before `a` lead or, if that is less, `a` from where those behind `b` come
 * from: in metres. */
static double gap_error(const pags_object *object, const int *part, int64_t a, int64_t b) {
  const double dt = object->keyframes[b].time - object->keyframes[a].time;
  double before = 0, behind = 0;
  for (int axis = 3; axis < 12; axis += 4) {
    const double step = object->keyframes[b].world_from_object[axis] - object->keyframes[a].world_from_object[axis];
    const double ahead = step - dt * side_speed(object, part, a, -1, axis);
    const double back = step - dt * side_speed(object, part, b, 1, axis);
    before += ahead * ahead;
    behind += back * back;
  }
  const double error = sqrt(fmin(before, behind)); /* fmin ignores a side without steps */
  return isfinite(error) ? error : 0;
}

/* Joins a piece to an earlier part that it continues from, except for the piece just before it: a track that comes back
 * after a leap. Its labels must be within a metre and 2 m/s of where that part leads. */
static void join(const pags_object *object, int *part, int64_t begin, double usual) {
  int best = -1;
  double least = 1;
  for (int64_t a = begin - 1, last[MOST_PARTS] = {0}; a >= 0; a--) {
    if (part[a] == part[begin - 1] || last[part[a]]++)
      continue;
    const double dt = object->keyframes[begin].time - object->keyframes[a].time;
    const double error = gap_error(object, part, a, begin) / (1 + 2 * dt + 5 * usual);
    if (error < least) {
      least = error;
      best = part[a];
    }
  }
  for (int64_t i = begin, piece = part[begin]; best >= 0 && i < object->keyframe_count && part[i] == piece; i++)
    part[i] = best;
}

/* Numbers the parts anew: the one with most labels becomes 0, as do those of few labels or between its own, which lie
 * aside as long as these are at most a quarter. Returns the number of parts. */
static int number_parts(const pags_object *object, int *part, uint8_t *mended, int pieces) {
  int64_t sizes[MOST_PARTS] = {0}, aside = 0, first = -1, last = -1;
  int names[MOST_PARTS], main_part = 0, parts = 1;
  for (int64_t i = 0; i < object->keyframe_count; i++)
    sizes[part[i]]++;
  for (int p = 1; p < pieces; p++)
    main_part = sizes[p] > sizes[main_part] ? p : main_part;
  for (int64_t i = 0; i < object->keyframe_count; i++)
    if (part[i] == main_part) {
      first = first < 0 ? i : first;
      last = i;
    }
  for (int p = 0; p < pieces; p++)
    names[p] = -1;
  names[main_part] = 0;
  for (int64_t i = 0; i < object->keyframe_count; i++) {
    const int p = part[i];
    const bool few = sizes[p] < LEAST_PART || (i > first && i < last && 4 * sizes[p] <= object->keyframe_count);
    if (names[p] < 0)
      names[p] = few ? 0 : parts++;
    if (p != main_part && names[p] == 0) {
      mended[i] = PAGS_MENDED_MOVED;
      aside++;
    }
    part[i] = names[p];
  }
  if (4 * aside > object->keyframe_count)
    memset(mended, PAGS_MENDED_NOT, (size_t)object->keyframe_count);
  return parts;
}

int pags_track_split(const pags_object *object, int *part, uint8_t *mended, double *errors) {
  const int64_t count = object->keyframe_count;
  memset(part, 0, (size_t)count * sizeof *part);
  memset(mended, PAGS_MENDED_NOT, (size_t)count);
  if (count < 2 * LEAST_PART)
    return 1;
  for (int64_t i = 0; i + 1 < count; i++)
    errors[i] = gap_error(object, part, i, i + 1);
  memcpy(errors + count, errors, (size_t)(count - 1) * sizeof *errors);
  pags_sort_doubles(errors + count, count - 1);
  const double usual = errors[count + (count - 1) / 2];
  /* Cut the track where it leaps: by more than a metre of noise, 24 m/s^2, and five times the error of half of the
   * steps, which is that of the labels. */
  int pieces = 1;
  for (int64_t i = 0; i + 1 < count; i++) {
    const double dt = object->keyframes[i + 1].time - object->keyframes[i].time;
    pieces += errors[i] > 1 + 12 * dt * dt + 5 * usual;
    part[i + 1] = pieces - 1;
  }
  if (pieces > MOST_PARTS || 4 * (pieces - 1) > count) { /* a track that leaps all the time follows nothing */
    memset(part, 0, (size_t)count * sizeof *part);
    return 1;
  }
  for (int64_t i = 1; i < count; i++)
    if (part[i] != part[i - 1])
      join(object, part, i, usual);
  return number_parts(object, part, mended, pieces);
}
