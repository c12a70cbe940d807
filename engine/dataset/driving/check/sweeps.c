/* SPDX-License-Identifier: Apache-2.0 */
/* Looks at the sweep of the middle of a driving set: refuses values that can't be points in metres, and rows of another
 * number of columns, and states what the file looks like instead.
 *
 * The spread of the values tells the number of columns. Read with the right number, x, y, z, intensity, ... differ in
 * their standard deviations s_j; read with another, every column mixes all of them and has the standard deviation s of
 * all values. The gain mean_j log(s / s_j) is 0.6 and more for the first and about 0 for the second; multiples of the
 * right number have its gain, and divisors a part of it. */
#include "dataset/driving/check/checks.h"
#include "dataset/driving/reader.h"

#include "base/bytes.h"
#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "maths/maths.h"
#include "port/port.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Pieces of the file that are looked at, bytes of a piece (a multiple of 8), fewest and most columns looked for. */
enum { PIECES = 8, PIECE = 2048, FEWEST = 3, MOST = 16, FEW_VALUES = 512, FEW_POINTS = 200 };

/* Points below which another sweep is looked at, how many sweeps are, and bytes of sweeps of which rows are counted. */
enum { FEW_ROWS = 64, MOST_TRIED = 16, MOST_BYTES = 256 << 20 };

static const double farthest = PAGS_FARTHEST;
static const double nearest_median = 0.3; /* metres: half of the points are farther than this */
static const double small = 1e-6;         /* numbers nearer to zero, but for zero, are no coordinates */

typedef struct sample {
  uint8_t bytes[PIECES][PIECE];
  uint64_t at[PIECES]; /* offset of each piece in the file, a multiple of 8 */
  size_t size[PIECES]; /* bytes read */
  uint64_t file;       /* size of the file */
} sample;

static pags_result read_sample(const char *path, sample *out) {
  PAGS_TRY(pags_file_size(path, &out->file));
  PAGS_AUTO(pags_file_close) FILE *stream = pags_port_open(path, "rb");
  if (!stream)
    return pags_fail_errno(path, "can't be read");
  const uint64_t room = out->file > PIECE ? out->file - PIECE : 0;
  for (int i = 0; i < PIECES; i++) {
    out->at[i] = (uint64_t)i * PIECE < out->file ? room * (uint64_t)i / (PIECES - 1) / 8 * 8 : 0;
    out->size[i] = 0;
    if (out->file <= (uint64_t)PIECES * PIECE)
      out->at[i] = (uint64_t)i * PIECE; /* a small file is looked at as a whole */
    if (out->at[i] < out->file && pags_port_seek(stream, (int64_t)out->at[i], SEEK_SET))
      out->size[i] = fread(out->bytes[i], 1, PIECE, stream);
  }
  return PAGS_OK;
}

/* ---- Points ---- */

/* How the bytes are read as points. */
typedef struct reading {
  int columns, position[3];
  bool wide;      /* float64 */
  bool swapped;   /* big-endian */
  double unit;    /* metres of 1 */
  double from[3]; /* subtracted */
} reading;

/* What the points are like. */
typedef struct points_look {
  int64_t rows, points, wrong; /* points: finite ones but for zeros; wrong: those of them that no LiDAR gives */
  double median;               /* metres: of the distances of the points */
  double spread[3];            /* metres: standard deviations of x, y, z of the points */
  double first[3];             /* the first wrong one */
  int64_t first_row;
} points_look;

static double load(const reading *how, const uint8_t *at) {
  uint8_t turned[8];
  const int size = how->wide ? 8 : 4;
  for (int i = 0; how->swapped && i < size; i++)
    turned[i] = at[size - 1 - i];
  const uint8_t *from = how->swapped ? turned : at;
  return how->wide ? pags_load_f64(from) : (double)pags_load_f32(from);
}

static void look_at_points(const sample *s, const reading *how, points_look *out) {
  double distances[PIECES * PIECE / 12], sum[3] = {0}, squares[3] = {0};
  const uint64_t row = (uint64_t)how->columns * (how->wide ? 8 : 4);
  *out = (points_look){0};
  for (int i = 0; i < PIECES; i++)
    for (uint64_t at = (s->at[i] + row - 1) / row * row; at + row <= s->at[i] + s->size[i]; at += row) {
      const uint8_t *bytes = s->bytes[i] + (at - s->at[i]);
      double p[3];
      bool odd = false;
      out->rows++;
      for (int k = 0; k < 3; k++) {
        p[k] = (load(how, bytes + how->position[k] * (how->wide ? 8 : 4)) - how->from[k]) * how->unit;
        odd = odd || (p[k] != 0 && fabs(p[k]) < small);
      }
      const double square = pags_dot3(p, p);
      if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2]) || square == 0) /* a beam that met nothing */
        continue;
      distances[out->points++] = sqrt(square);
      for (int k = 0; k < 3; k++) {
        sum[k] += p[k];
        squares[k] += p[k] * p[k];
      }
      if (!odd && square <= farthest * farthest)
        continue;
      if (out->wrong++ == 0) {
        memcpy(out->first, p, sizeof p);
        out->first_row = (int64_t)(at / row);
      }
    }
  for (int k = 0; k < 3 && out->points; k++) {
    const double mean = sum[k] / (double)out->points;
    out->spread[k] = sqrt(fmax(squares[k] / (double)out->points - mean * mean, 0));
  }
  pags_sort_doubles(distances, out->points);
  out->median = out->points ? distances[out->points / 2] : 0;
}

static bool is_plausible(const points_look *look) {
  return 20 * look->wrong <= look->points && look->median >= nearest_median;
}

/* ---- What else the file may be ---- */

static bool fits(const sample *s, const reading *how) {
  points_look look;
  look_at_points(s, how, &look);
  return look.points > 0 && is_plausible(&look) && look.median >= 4 && look.median <= 60;
}

/* Reports what the points look like, if they aren't what the rules say. */
static const char *guess(const sample *s, const reading *declared, const pags_sweep *sweep) {
  reading how = *declared;
  how.wide = true;
  if (s->file % ((uint64_t)how.columns * 8) == 0 && fits(s, &how))
    return "; read as float64 they would be: write them as float32";
  how = *declared;
  how.swapped = true;
  if (fits(s, &how))
    return "; read as big-endian they would be: write them as little-endian";
  how = *declared;
  pags_pose_position(sweep->world_from_sweep, how.from);
  if (fits(s, &how))
    return "; they lie about the car's place in the world: if they are in the world's frame, put \"lidar_frame\": "
           "\"world\" into dataset.json";
  how = *declared;
  how.unit = 0.001;
  if (fits(s, &how))
    return "; taken as millimetres they would be: divide them by 1000";
  how.unit = 0.01;
  if (fits(s, &how))
    return "; taken as centimetres they would be: divide them by 100";
  return "";
}

/* ---- Columns ---- */

/* Whether a value of the sample is in a row, as declared, whose point is zero: a beam that met nothing says nothing of
 * the columns. */
static bool is_no_return(const sample *s, const reading *declared, int piece, size_t at) {
  const size_t row = 4 * (size_t)declared->columns, within = (size_t)((s->at[piece] + at) % row);
  if (within > at || at - within + row > s->size[piece])
    return false;
  const uint8_t *begin = s->bytes[piece] + (at - within);
  for (int k = 0; k < 3; k++)
    if (pags_load_f32(begin + 4 * declared->position[k]) != 0)
      return false;
  return true;
}

/* Returns the gain of reading the values in rows of this number of columns (see above); -1 if there are too few. */
static double gain_of(const sample *s, const reading *declared, int columns) {
  double sum[MOST] = {0}, square[MOST] = {0}, total = 0, squares = 0, gain = 0;
  int64_t counts[MOST] = {0}, all = 0;
  bool skipped[MOST] = {false};
  for (int i = 0; i < PIECES; i++) {
    int column = (int)(s->at[i] / 4 % (uint64_t)columns);
    for (size_t at = 0; at + 4 <= s->size[i]; at += 4, column = column + 1 == columns ? 0 : column + 1) {
      const double v = (double)pags_load_f32(s->bytes[i] + at);
      if (is_no_return(s, declared, i, at)) {
        skipped[column] = true;
        continue;
      }
      if (!(fabs(v) < 10 * farthest))
        continue;
      sum[column] += v;
      square[column] += v * v;
      counts[column]++;
    }
  }
  for (int j = 0; j < columns; j++) {
    total += sum[j];
    squares += square[j];
    all += counts[j];
  }
  if (all < FEW_VALUES)
    return -1;
  const double mean = total / (double)all, spread = sqrt(fmax(squares / (double)all - mean * mean, 0));
  if (!(spread > 0))
    return -1;
  for (int j = 0; j < columns; j++) {
    if (counts[j] == 0 && skipped[j])
      continue;
    const double m = counts[j] ? sum[j] / (double)counts[j] : 0;
    const double own = counts[j] ? sqrt(fmax(square[j] / (double)counts[j] - m * m, 0)) : 0;
    gain -= pags_log(own / spread + 1e-3) / columns;
  }
  return gain;
}

/* Returns the number of columns that the file has by its values; 0 if it is the declared one or can't be told. *alike:
 * whether the declared columns don't differ, and no others do. */
static int other_columns(const sample *s, const reading *how, bool *alike) {
  const int declared = how->columns;
  double gains[MOST + 1] = {0}, best = 0;
  for (int c = FEWEST; c <= MOST; c++) {
    gains[c] = gain_of(s, how, c);
    best = fmax(best, gains[c]);
  }
  *alike = declared <= MOST && best < 0.5 && gains[declared] > -0.5 && gains[declared] < 0.15;
  if (best < 0.5 || declared > MOST)
    return 0;
  int found = FEWEST;
  while (gains[found] < 0.95 * best)
    found++;
  /* The declared number is right if it is the smallest of those with the best gain, or no multiple of that one and
   * nearly as good. */
  const bool repeats = declared % found == 0 && declared > found;
  return gains[declared] >= 0.4 * best && !repeats ? 0 : found;
}

/* ---- The check ---- */

static pags_result check_rows(const pags_driving *driving, const char *path, const sample *s, const reading *how,
                              const pags_sweep *sweep) {
  const char *known = pags_sweep_format(path);
  points_look look;
  if (known)
    return pags_fail_at(path, "is %s; expected rows of %d little-endian float32 without a header", known, how->columns);
  look_at_points(s, how, &look);
  if (look.points > 0 && !driving->rules.lidar_world && !is_plausible(&look)) {
    const char *other = guess(s, how, sweep);
    if (look.wrong > 0)
      return pags_fail_at(path,
                          "%lld of %lld points looked at are farther than %g m or next to nothing, the first is row "
                          "%lld: %g %g %g; expected rows of %d float32, metres, about the car (kind %s)%s",
                          (long long)look.wrong, (long long)look.rows, farthest, (long long)look.first_row,
                          look.first[0], look.first[1], look.first[2], how->columns, driving->rules.kind, other);
    return pags_fail_at(path,
                        "half of the %lld points looked at are nearer than %g m; expected rows of %d float32, metres, "
                        "about the car (kind %s)%s",
                        (long long)look.points, nearest_median, how->columns, driving->rules.kind, other);
  }
  bool alike;
  const int columns = other_columns(s, how, &alike);
  if (columns > 0)
    return pags_fail_at(path,
                        "by its values it has %d floats a row, expected %d as kind %s has; name them in "
                        "'lidar_columns' of dataset.json",
                        columns, how->columns, driving->rules.kind);
  if (alike) {
    PAGS_WARN(
        "%s: its %d columns hold the same kind of values: it may not be rows of x, y, z, ...; expected a row of %d "
        "float32 a point",
        path, how->columns, how->columns);
    return PAGS_OK;
  }
  const double flattest = fmin(look.spread[0], look.spread[1]);
  if (look.points >= FEW_POINTS && look.spread[2] > 1.5 * flattest)
    PAGS_WARN(
        "%s: its points spread by %.1f m along z, but %.1f m along %s: their axes may be wrong; expected z to point up",
        path, look.spread[2], flattest, look.spread[0] < look.spread[1] ? "x" : "y");
  return PAGS_OK;
}

/* Looks at the form of the sweep of the middle or, where that has hardly any points, of the next one that has some. */
static pags_result check_form(const pags_driving *driving, sample *s) {
  reading how = {.columns = driving->rules.columns, .unit = 1};
  memcpy(how.position, driving->rules.position, sizeof how.position);
  const int64_t middle = driving->sweep_count / 2;
  for (int64_t i = 0; i < driving->sweep_count; i++) {
    const pags_sweep *sweep = &driving->sweeps[(middle + i) % driving->sweep_count];
    points_look look;
    PAGS_TRY(read_sample(sweep->path, s));
    look_at_points(s, &how, &look);
    if (look.points < FEW_ROWS && i + 1 < driving->sweep_count && i < MOST_TRIED)
      continue;
    return check_rows(driving, sweep->path, s, &how, sweep);
  }
  return PAGS_OK;
}

/* ---- Rows that are no points ---- */

static void warn_of_rows(const pags_driving *driving, const pags_sweep_rows *sum, int64_t looked,
                         const pags_tally *wanting, const pags_tally *empty) {
  const long long left_out = (long long)(sum->not_finite + sum->no_return + sum->far);
  if (left_out)
    PAGS_WARN(
        "%s/lidar: %lld of %lld rows in %lld sweeps are no points and left out: %lld not finite, %lld without a return "
        "(zero, or at one repeated place), %lld beyond %d m; the first such sweep is %s",
        driving->root, left_out, (long long)sum->all, (long long)looked, (long long)sum->not_finite,
        (long long)sum->no_return, (long long)sum->far, (int)PAGS_FARTHEST, wanting->first);
  if (empty->count)
    PAGS_WARN("%s/lidar: %lld of %lld sweeps have no points, the first is %s", driving->root, (long long)empty->count,
              (long long)looked, empty->first);
}

/* Counts the rows that are no points in all sweeps or, of a long recording, in every Nth, so that MOST_BYTES are read
 * at most. */
static pags_result count_rows(const pags_driving *driving) {
  pags_sweep_rows sum = {0};
  pags_tally wanting = {0}, empty = {0};
  int64_t looked = 0;
  uint64_t bytes = 0;
  for (int64_t i = 0; i < driving->sweep_count; i++) {
    uint64_t size;
    PAGS_TRY(pags_file_size(driving->sweeps[i].path, &size));
    bytes += size;
  }
  for (int64_t i = 0; i < driving->sweep_count; i += (int64_t)(bytes / MOST_BYTES) + 1, looked++) {
    const char *name = pags_path_name(driving->sweeps[i].path);
    pags_sweep_rows rows;
    int64_t count;
    PAGS_AUTOFREE float *xyz = NULL;
    PAGS_TRY(pags_sweep_read(driving, i, &count, &xyz, &rows));
    if (count == 0)
      pags_tally_add(&empty, "%s", name);
    if (count < rows.all)
      pags_tally_add(&wanting, "%s", name);
    sum.all += rows.all;
    sum.not_finite += rows.not_finite;
    sum.no_return += rows.no_return;
    sum.far += rows.far;
  }
  warn_of_rows(driving, &sum, looked, &wanting, &empty);
  return PAGS_OK;
}

pags_result pags_sweeps_check(pags_driving *driving, bool look) {
  PAGS_AUTOFREE sample *s = malloc(sizeof *s);
  PAGS_CHECK_MEMORY(s, "%s", driving->root);
  PAGS_TRY(check_form(driving, s));
  return look ? count_rows(driving) : PAGS_OK;
}
