/* SPDX-License-Identifier: Apache-2.0 */
#include "check.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "pages.h"

enum { FILLING = 0xA5, SHOWN_FAILURES = 5, MAX_BUFFERS = 256 };

typedef struct buffer {
  unsigned char *pages; /* the first accessible page */
  size_t length;        /* length of the accessible pages in bytes */
  unsigned char *data;
  size_t size;
} buffer;

static struct {
  const char *case_name, *table;
  char where[128]; /* message formatted in advance, as the signal handler must not format */
  uint64_t seed, rng;
  int case_failures;
  bool at_end, bench;
  buffer buffers[MAX_BUFFERS];
  int buffer_count;
} state;

/* ---- Failures ---- */

void check_fail(const char *file, int line, const char *format, ...) {
  if (++state.case_failures > SHOWN_FAILURES)
    return;
  const char *const name = strrchr(file, '/');
  printf("%s:%d: %s: ", name ? name + 1 : file, line, state.where);
  va_list args;
  va_start(args, format);
  vprintf(format, args);
  va_end(args);
  putchar('\n');
}

void check_note(const char *format, ...) {
  if (!state.at_end)
    return;
  printf("  %s %s: ", state.case_name, state.table);
  va_list args;
  va_start(args, format);
  vprintf(format, args);
  va_end(args);
  putchar('\n');
}

/* ---- Random numbers: SplitMix64 (Steele et al. 2014) ---- */

uint32_t check_u32(void) {
  uint64_t x = state.rng += UINT64_C(0x9E3779B97F4A7C15);
  x = (x ^ x >> 30) * UINT64_C(0xBF58476D1CE4E5B9);
  x = (x ^ x >> 27) * UINT64_C(0x94D049BB133111EB);
  return (uint32_t)(x >> 32);
}

int check_below(int n) {
  return (int)((uint64_t)check_u32() * (uint64_t)n >> 32);
}

float check_uniform(float lo, float hi) {
  return lo + (hi - lo) * ((float)(check_u32() >> 8) * 0x1p-24f);
}

float check_normal(void) {
  const double radius = sqrt(-2.0 * log((check_u32() + 1.0) * 0x1p-32));
  return (float)(radius * cos(6.283185307179586 * check_u32() * 0x1p-32));
}

/* ---- Buffers ---- */

void *check_buffer(size_t size) {
  const size_t page = pages_size();
  /* The block is always larger than `size`, so that an empty buffer has an address too. */
  const size_t length = (size / page + 1) * page;
  if (state.buffer_count == MAX_BUFFERS) {
    fprintf(stderr, "more than %d buffers in a case\n", MAX_BUFFERS);
    exit(2);
  }
  unsigned char *const all = pages_make(length + 2 * page);
  if (!all || !pages_allow(all, page, PAGES_SHUT) || !pages_allow(all + page + length, page, PAGES_SHUT)) {
    perror("check_buffer");
    exit(2);
  }
  buffer *const b = &state.buffers[state.buffer_count++];
  *b = (buffer){.pages = all + page, .length = length, .size = size};
  memset(b->pages, FILLING, length);
  b->data = state.at_end ? b->pages + length - size : b->pages;
  return b->data;
}

void check_freeze(const void *data) {
  for (int i = 0; i < state.buffer_count; i++)
    if (state.buffers[i].data == data && !pages_allow(state.buffers[i].pages, state.buffers[i].length, PAGES_READ))
      perror("check_freeze");
}

void check_release(void) {
  const size_t page = pages_size();
  while (state.buffer_count > 0) {
    const buffer *const b = &state.buffers[--state.buffer_count];
    for (size_t i = 0; i < b->length; i++) {
      unsigned char *const at = b->pages + i;
      if ((at < b->data || at >= b->data + b->size) && *at != FILLING) {
        CHECK_FAIL("stray write %td bytes from the start of a buffer of %zu", at - b->data, b->size);
        break;
      }
    }
    pages_free(b->pages - page, b->length + 2 * page);
  }
}

/* ---- Comparison ---- */

static int64_t float_order(float x) {
  int32_t bits;
  memcpy(&bits, &x, sizeof bits);
  return bits < 0 ? -(int64_t)(bits & 0x7FFFFFFF) : bits;
}

int64_t check_ulps(float a, float b) {
  if (isnan(a) || isnan(b))
    return INT64_MAX;
  return llabs(float_order(a) - float_order(b));
}

bool check_close(float got, float want, const check_tolerance *t) {
  if (isnan(got) || isnan(want))
    return isnan(got) && isnan(want);
  if (check_ulps(got, want) <= t->ulp)
    return true;
  return fabs((double)got - (double)want) <= t->relative * fabs((double)want) + t->absolute && isfinite(want);
}

bool check_same_bits(const float *got, const float *want, int64_t count) {
  for (int64_t i = 0; i < count; i++)
    if (memcmp(got + i, want + i, sizeof *got) && !(isnan(got[i]) && isnan(want[i])))
      return false;
  return true;
}

void check_floats(const char *file, int line, const char *what, const float *got, const float *want, int64_t count,
                  const check_tolerance *tolerance, bool exact) {
  int64_t flips = 0;
  for (int64_t i = 0; i < count; i++) {
    if (exact ? check_same_bits(got + i, want + i, 1) : check_close(got[i], want[i], tolerance))
      continue;
    if (!exact && fabs((double)got[i] - (double)want[i]) <= tolerance->flip_size) {
      flips++;
      continue;
    }
    check_fail(file, line, "%s[%lld]: %.9g, should be %.9g%s", what, (long long)i, (double)got[i], (double)want[i],
               exact ? " to the bit" : "");
  }
  if ((double)flips > tolerance->flips * (double)count)
    check_fail(file, line, "%s: %lld of %lld values on the other side of a threshold", what, (long long)flips,
               (long long)count);
}

/* ---- Benchmark ---- */

static double seconds(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Measures batches of at least 2 ms. The fastest of 20 counts, since other work on the machine only adds time. */
bool check_timed(check_timer *t, const char *what, double items, const char *unit) {
  if (!state.bench || !state.at_end)
    return false;
  if (t->repeats == 0) {
    *t = (check_timer){.repeats = 1, .left = 1, .best = INFINITY, .began = seconds()};
  } else if (t->left == 0) {
    const double spent = seconds() - t->began;
    if (spent < 2e-3)
      t->repeats *= 2;
    else
      t->best = fmin(t->best, spent / (double)t->repeats), t->batches++;
    if (t->batches == 20) {
      printf("%-32s %-8s %10.4f ns/%s\n", what, state.table, 1e9 * t->best / items, unit);
      return false;
    }
    t->left = t->repeats;
    t->began = seconds();
  }
  t->left--;
  return true;
}

/* ---- Running the cases ---- */

typedef struct arguments {
  const char *filters[16];
  int filter_count;
  const char *cpu;
} arguments;

static bool parse(arguments *a, int argc, char **argv) {
  for (int i = 1; i < argc; i++) {
    if (strcmp(argv[i], "--bench") == 0)
      state.bench = true;
    else if (strcmp(argv[i], "--seed") == 0 && i + 1 < argc)
      state.seed = strtoull(argv[++i], NULL, 0);
    else if (strcmp(argv[i], "--cpu") == 0 && i + 1 < argc)
      a->cpu = argv[++i];
    else if (argv[i][0] != '-' && a->filter_count < 16)
      a->filters[a->filter_count++] = argv[i];
    else
      return false;
  }
  return true;
}

static bool wanted(const arguments *a, const char *name) {
  for (int i = 0; i < a->filter_count; i++)
    if (strstr(name, a->filters[i]))
      return true;
  return a->filter_count == 0;
}

/* The seed is made from the case's name, so that neither filters nor the order of the cases change its random
 * numbers. */
static int run_case(const check_case *c, const pags_kernels *table, bool at_end) {
  state.case_name = c->name;
  state.table = table->name;
  state.at_end = at_end;
  state.case_failures = 0;
  state.rng = state.seed;
  for (const char *p = c->name; *p; p++)
    state.rng = (state.rng ^ (unsigned char)*p) * UINT64_C(0x100000001B3);
  snprintf(state.where, sizeof state.where, "%s on %s, buffers %s (--seed %llu)", c->name, table->name,
           at_end ? "ending at a guard page" : "beginning at a guard page", (unsigned long long)state.seed);
  c->run(table);
  check_release();
  if (state.case_failures > SHOWN_FAILURES)
    printf("... %d failures in %s\n", state.case_failures, state.where);
  return state.case_failures;
}

int check_main(int argc, char **argv, const check_case *cases, int count) {
  static const char *const names[] = {"scalar", "avx2", "avx512", "neon"};
  arguments a = {.filter_count = 0};
  state.seed = 1;
  if (!parse(&a, argc, argv)) {
    fprintf(stderr, "usage: %s [NAME...] [--cpu NAME] [--seed N] [--bench]\n", argv[0]);
    return 2;
  }
  setvbuf(stdout, NULL, _IOLBF, 0);
  pages_on_crash(state.where);
  int runs = 0, failures = 0;
  for (size_t t = 0; t < sizeof names / sizeof *names; t++) {
    const pags_kernels *const table = pags_kernels_named(names[t]);
    if (!table || (a.cpu && strcmp(a.cpu, names[t]) != 0))
      continue;
    for (int i = 0; i < count; i++)
      for (int at_end = 1; at_end >= 0 && wanted(&a, cases[i].name); at_end--, runs++)
        failures += run_case(cases + i, table, at_end);
  }
  printf("%d runs, %d failures (seed %llu)\n", runs, failures, (unsigned long long)state.seed);
  return failures || !runs;
}
