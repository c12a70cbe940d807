/* SPDX-License-Identifier: Apache-2.0 */
/* What every kernel test needs, after dav1d's checkasm: a main that runs each case on each table of kernels this
 * machine has (whatever PAGS_CPU says), reproducible random numbers, buffers that catch stray reads and writes,
 * float comparison and a benchmark of the very calls that were tested.
 *
 *   test_x [NAME...] [--cpu NAME] [--seed N] [--bench]     NAME: part of a case's name */
#ifndef PAGS_TESTS_CHECK_H
#define PAGS_TESTS_CHECK_H

#include "simd/kernels.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Fused builds round differently from ISA to ISA; the others must agree to the bit. */
#if defined(PAGS_FUSED)
enum { CHECK_EXACT = 0 };
#else
enum { CHECK_EXACT = 1 };
#endif

typedef struct check_case {
  const char *name;
  void (*run)(const pags_kernels *kernels);
} check_case;

/* Runs the cases: for each table, once with all buffers ending at a guard page and once with all beginning at one.
 * The return value is main's. */
int check_main(int argc, char **argv, const check_case *cases, int count);

/* Counts and prints a failure. The first few of a case are shown. */
#define CHECK_FAIL(...) check_fail(__FILE__, __LINE__, __VA_ARGS__)
#define CHECK(condition)            \
  do {                              \
    if (!(condition))               \
      CHECK_FAIL("%s", #condition); \
  } while (0)
void check_fail(const char *file, int line, const char *format, ...) __attribute__((format(printf, 3, 4)));
/* One line about the case, after its name and the table's; printed for one of the two placements. */
void check_note(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* ---- Random numbers: the same in every case whatever ran before it ---- */

uint32_t check_u32(void);
int check_below(int n); /* 0 .. n - 1 */
float check_uniform(float lo, float hi);
float check_normal(void);

/* ---- Buffers ---- */

/* `size` bytes between pages that can't be touched; the rest of the first and last page is filled and looked at on
 * release. Filled with 0xA5 bytes (floats: about -2.9e-16). Every buffer of a case is released after it. */
void *check_buffer(size_t size);
/* From here on `buffer` can't be written. */
void check_freeze(const void *buffer);
/* Looks at the filling of all buffers and releases them; for cases with many rounds. */
void check_release(void);

#define CHECK_NEW(type, count) ((type *)check_buffer((size_t)(count) * sizeof(type)))

/* ---- Comparison ---- */

typedef struct check_tolerance {
  int ulp;
  double relative, absolute; /* passes within ulp, or within relative |want| + absolute */
  double flips;              /* share of values that may be off, by flip_size at most: where a threshold decides */
  double flip_size;
} check_tolerance;

/* Distance in representable floats, 0 and -0 being the same; INT64_MAX where one is NaN. */
int64_t check_ulps(float a, float b);
bool check_close(float got, float want, const check_tolerance *tolerance);
bool check_same_bits(const float *got, const float *want, int64_t count); /* any NaN is the same as any other */
/* Compares with the tolerance; on builds that must agree to the bit, for that. */
#define CHECK_FLOATS(what, got, want, count, ...) \
  check_floats(__FILE__, __LINE__, what, got, want, count, &(check_tolerance){__VA_ARGS__}, CHECK_EXACT)
/* With the tolerance on every build: against an oracle. */
#define CHECK_NEAR(what, got, want, count, ...) \
  check_floats(__FILE__, __LINE__, what, got, want, count, &(check_tolerance){__VA_ARGS__}, 0)
/* To the bit on every build: the same kernels asked in two ways. */
#define CHECK_SAME(what, got, want, count) \
  check_floats(__FILE__, __LINE__, what, got, want, count, &(check_tolerance){.ulp = 0}, 1)
void check_floats(const char *file, int line, const char *what, const float *got, const float *want, int64_t count,
                  const check_tolerance *tolerance, bool exact);

/* ---- Benchmark ---- */

typedef struct check_timer {
  int64_t repeats, left;
  int batches;
  double began, best; /* s */
} check_timer;

/* CHECK_BENCH("raster", pairs, "pair") kernels->raster(&in, &out); runs the call only under --bench and prints ns
 * per item. */
#define CHECK_BENCH(what, items, unit) \
  for (check_timer timer = {.repeats = 0}; check_timed(&timer, what, (double)(items), unit);)
bool check_timed(check_timer *timer, const char *what, double items, const char *unit);

#endif
