/* SPDX-License-Identifier: Apache-2.0 */
/* Chooses palettes. In one dimension by dynamic programming over a histogram (Wang and Song 2011, "Ckmeans.1d.dp", with
 * the divide-and-conquer search of monotone minima); in several by binary splitting along principal axes (Orchard and
 * Bouman 1991). Nothing is random and nothing depends on threads. */
#include "exporters/format/palette.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* ---- One dimension ---- */

enum { BINS = 8192 };

pags_result pags_codebook_create(pags_codebook *book, double lo, double hi) {
  *book = (pags_codebook){.lo = lo, .hi = hi};
  book->weight = calloc(2 * BINS, sizeof *book->weight);
  PAGS_CHECK_MEMORY(book->weight, "a codebook");
  book->sum = book->weight + BINS;
  return PAGS_OK;
}

void pags_codebook_destroy(pags_codebook *book) {
  free(book->weight);
  *book = (pags_codebook){0};
}

void pags_codebook_add(pags_codebook *book, double value, double weight) {
  const double at = book->hi > book->lo ? (value - book->lo) / (book->hi - book->lo) * BINS : 0;
  const int bin = (int)fmin(fmax(at, 0), BINS - 1);
  book->weight[bin] += weight;
  book->sum[bin] += weight * (value - book->lo);
}

/* The tables of the search: sums of weights and values before each bin, the least costs of the bins before each with
 * one value less, and the first bin of the last value. */
typedef struct search {
  double weight[BINS + 1], sum[BINS + 1], before[BINS + 1], cost[BINS + 1];
  int16_t from[PAGS_CODEBOOK][BINS + 1];
} search;

/* What bins [a, b) add to the costs as one value: the squares of their spread but for a term that is the same for any
 * choice. */
static double gain(const search *s, int a, int b) {
  const double w = s->weight[b] - s->weight[a], v = s->sum[b] - s->sum[a];
  return w > 0 ? -v * v / w : 0;
}

/* Finds the last value's first bin for the ends [lo, hi], which lies in [first, last]. */
static void search_ends(search *s, int level, int lo, int hi, int first, int last) {
  if (lo > hi)
    return;
  const int end = (lo + hi) / 2;
  int best = first;
  double least = HUGE_VAL;
  for (int at = first; at <= last && at <= end; at++) {
    const double cost = s->before[at] + gain(s, at, end);
    if (cost < least) {
      least = cost;
      best = at;
    }
  }
  s->cost[end] = least;
  s->from[level][end] = (int16_t)best;
  search_ends(s, level, lo, end - 1, first, best);
  search_ends(s, level, end + 1, hi, best, last);
}

pags_result pags_codebook_choose(pags_codebook *book) {
  PAGS_AUTOFREE search *s = calloc(1, sizeof *s);
  PAGS_CHECK_MEMORY(s, "a codebook");
  for (int i = 0; i < BINS; i++) {
    s->weight[i + 1] = s->weight[i] + book->weight[i];
    s->sum[i + 1] = s->sum[i] + book->sum[i];
  }
  for (int end = 0; end <= BINS; end++)
    s->cost[end] = gain(s, 0, end);
  for (int level = 1; level < PAGS_CODEBOOK; level++) {
    memcpy(s->before, s->cost, sizeof s->before);
    search_ends(s, level, 0, BINS, 0, BINS);
  }
  for (int level = PAGS_CODEBOOK - 1, end = BINS; level >= 0; level--) {
    const int from = level ? s->from[level][end] : 0;
    const double weight = s->weight[end] - s->weight[from];
    /* An unused value repeats the next one, so that the values ascend. */
    const double next = level < PAGS_CODEBOOK - 1 ? (double)book->values[level + 1] : book->hi;
    book->values[level] = (float)(weight > 0 ? book->lo + (s->sum[end] - s->sum[from]) / weight : next);
    end = from;
  }
  return PAGS_OK;
}

uint8_t pags_codebook_index(const pags_codebook *book, double value) {
  int lo = 0, hi = PAGS_CODEBOOK - 1;
  while (lo < hi) {
    const int middle = (lo + hi) / 2;
    if (value > ((double)book->values[middle] + (double)book->values[middle + 1]) / 2)
      lo = middle + 1;
    else
      hi = middle;
  }
  return (uint8_t)lo;
}

/* ---- Several dimensions ---- */

enum { WIDEST = 64, TURNS = 6 };

/* A leaf: rows order[begin] to order[end - 1]. */
typedef struct leaf {
  int64_t begin, end;
  double error; /* sum of the squares of the distances from the mean */
} leaf;

typedef struct splitter {
  const float *rows;
  int width;
  int32_t *order;
  leaf *leaves;
  int64_t count;
  int32_t *heap; /* leaves by error, largest first; of equal ones that with the lower number */
} splitter;

static void find_mean(const splitter *s, const leaf *l, double mean[WIDEST]) {
  memset(mean, 0, WIDEST * sizeof *mean);
  for (int64_t i = l->begin; i < l->end; i++)
    for (int k = 0; k < s->width; k++)
      mean[k] += (double)s->rows[(int64_t)s->order[i] * s->width + k];
  for (int k = 0; k < s->width; k++)
    mean[k] /= (double)(l->end - l->begin);
}

/* Computes the error of a leaf; `spread`, which may be NULL, receives that along each dimension. */
static double find_error(const splitter *s, const leaf *l, const double mean[WIDEST], double *spread) {
  double sums[WIDEST] = {0}, error = 0;
  for (int64_t i = l->begin; i < l->end; i++)
    for (int k = 0; k < s->width; k++) {
      const double d = (double)s->rows[(int64_t)s->order[i] * s->width + k] - mean[k];
      sums[k] += d * d;
    }
  for (int k = 0; k < s->width; k++) {
    error += sums[k];
    if (spread)
      spread[k] = sums[k];
  }
  return error;
}

static double project(const splitter *s, int64_t i, const double mean[WIDEST], const double axis[WIDEST]) {
  const float *row = s->rows + (int64_t)s->order[i] * s->width;
  double sum = 0;
  for (int k = 0; k < s->width; k++)
    sum += ((double)row[k] - mean[k]) * axis[k];
  return sum;
}

/* Finds the axis of the largest spread by power iteration, from the dimension with the largest. A part of the rows of
 * large leaves suffices. */
static void find_axis(const splitter *s, const leaf *l, const double mean[WIDEST], double axis[WIDEST]) {
  double spread[WIDEST];
  int widest = 0;
  find_error(s, l, mean, spread);
  for (int k = 1; k < s->width; k++)
    widest = spread[k] > spread[widest] ? k : widest;
  memset(axis, 0, WIDEST * sizeof *axis);
  axis[widest] = 1;
  const int64_t step = 1 + (l->end - l->begin) / 16384;
  for (int turn = 0; turn < TURNS; turn++) {
    double next[WIDEST] = {0}, length = 0;
    for (int64_t i = l->begin; i < l->end; i += step) {
      const double p = project(s, i, mean, axis);
      for (int k = 0; k < s->width; k++)
        next[k] += p * ((double)s->rows[(int64_t)s->order[i] * s->width + k] - mean[k]);
    }
    for (int k = 0; k < s->width; k++)
      length += next[k] * next[k];
    if (!(length > 0))
      return;
    for (int k = 0; k < s->width; k++)
      axis[k] = next[k] / sqrt(length);
  }
}

static bool comes_before(const splitter *s, int32_t a, int32_t b) {
  const double x = s->leaves[a].error, y = s->leaves[b].error;
  return x > y || (!(x < y) && a < b);
}

static void swap(int32_t *items, int64_t a, int64_t b) {
  const int32_t moved = items[a];
  items[a] = items[b];
  items[b] = moved;
}

/* Puts the heap's entry `at` where it belongs among those below it. */
static void sink(splitter *s, int64_t at) {
  for (;;) {
    int64_t best = at;
    for (int64_t child = 2 * at + 1; child <= 2 * at + 2 && child < s->count; child++)
      if (comes_before(s, s->heap[child], s->heap[best]))
        best = child;
    if (best == at)
      return;
    swap(s->heap, at, best);
    at = best;
  }
}

/* Cuts the leaf with the largest error in two; returns false if no leaf has any. */
static bool split(splitter *s) {
  leaf *l = &s->leaves[s->heap[0]], *added = &s->leaves[s->count];
  double mean[WIDEST], axis[WIDEST];
  if (!(l->error > 0))
    return false;
  find_mean(s, l, mean);
  find_axis(s, l, mean, axis);
  int64_t middle = l->begin, last = l->end;
  while (middle < last)
    if (project(s, middle, mean, axis) > 0)
      middle++;
    else
      swap(s->order, middle, --last);
  if (middle == l->begin || middle == l->end) { /* what spread there is is rounding */
    l->error = 0;
    sink(s, 0);
    return true;
  }
  *added = (leaf){.begin = middle, .end = l->end};
  l->end = middle;
  leaf *const halves[2] = {l, added};
  for (int k = 0; k < 2; k++) {
    find_mean(s, halves[k], mean);
    halves[k]->error = find_error(s, halves[k], mean, NULL);
  }
  s->heap[s->count] = (int32_t)s->count;
  s->count++;
  sink(s, 0);
  for (int64_t at = s->count - 1; at > 0 && comes_before(s, s->heap[at], s->heap[(at - 1) / 2]); at = (at - 1) / 2)
    swap(s->heap, at, (at - 1) / 2); /* the new entry rises to its place */
  return true;
}

pags_result pags_palette_make(const float *rows, int64_t count, int width, int64_t most, float *entries,
                              int32_t *labels, int64_t *found) {
  PAGS_AUTOFREE int32_t *order = malloc((size_t)count * sizeof *order);
  PAGS_AUTOFREE leaf *leaves = calloc((size_t)most + 1, sizeof *leaves);
  PAGS_AUTOFREE int32_t *heap = calloc((size_t)most + 1, sizeof *heap);
  PAGS_CHECK_MEMORY(order && leaves && heap, "a palette");
  splitter s = {.rows = rows, .width = width, .order = order, .leaves = leaves, .count = 1, .heap = heap};
  double mean[WIDEST];
  for (int64_t i = 0; i < count; i++)
    order[i] = (int32_t)i;
  leaves[0] = (leaf){.end = count, .error = HUGE_VAL};
  while (s.count < most && split(&s))
    continue;
  for (int64_t i = 0; i < s.count; i++) {
    find_mean(&s, &leaves[i], mean);
    for (int k = 0; k < width; k++)
      entries[i * width + k] = (float)mean[k];
    for (int64_t r = leaves[i].begin; r < leaves[i].end; r++)
      labels[order[r]] = (int32_t)i;
  }
  *found = s.count;
  return PAGS_OK;
}
