/* SPDX-License-Identifier: Apache-2.0 */
/* The test driver of the kernel tests, after dav1d's checkasm: its main runs each case on each kernel table that
 * this machine can run (whatever PAGS_CPU is). It offers reproducible random numbers, buffers that catch stray reads
 * and writes, float comparison, and a benchmark of the tested calls.
 *
 *   test_x [NAME...] [--cpu NAME] [--seed N] [--bench]     NAME: part of a case's name */
#ifndef PAGS_TESTS_CHECK_H
#define PAGS_TESTS_CHECK_H

#include "simd/kernels.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Whether kernel tables must agree to the bit. Builds with fused multiply-add round differently on each ISA. */
#if defined(PAGS_FUSED)
enum { CHECK_EXACT = 0 };
#else
enum { CHECK_EXACT = 1 };
#endif

typedef struct check_case {
  const char *name;
  void (*run)(const pags_kernels *kernels);
} check_case;

/* Runs the cases on each table, once with every buffer ending at a guard page and once with every buffer beginning at
 * one. Returns main's exit code. */
int check_main(int argc, char **argv, const check_case *cases, int count);

/* Counts and prints a failure; only the first failures of a case are printed. */
#define CHECK_FAIL(...) check_fail(__FILE__, __LINE__, __VA_ARGS__)
#define CHECK(condition)            \
  do {                              \
    if (!(condition))               \
      CHECK_FAIL("%s", #condition); \
  } while (0)
void check_fail(const char *file, int line, const char *format, ...) __attribute__((format(printf, 3, 4)));
/* Prints one line about the case after its name and the table's; only for one of the two buffer placements. */
void check_note(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* ---- Random numbers, which don't depend on the cases that ran before ---- */

uint32_t check_u32(void);
int check_below(int n); /* 0 .. n - 1 */
float check_uniform(float lo, float hi);
float check_normal(void);

/* ---- Buffers ---- */

/* Allocates `size` bytes between guard pages, filled with 0xA5 bytes (floats: about -2.9e-16). The rest of the first
 * and last page is filled, too, and checked for stray writes on release. All buffers are released at the end of the
 * case. */
void *check_buffer(size_t size);
/* Makes `buffer` read-only. */
void check_freeze(const void *buffer);
/* Checks all buffers for stray writes and releases them; for cases with many rounds. */
void check_release(void);

#define CHECK_NEW(type, count) ((type *)check_buffer((size_t)(count) * sizeof(type)))

/* ---- Comparison ---- */

typedef struct check_tolerance {
  int ulp;
  double relative, absolute; /* passes within `ulp`, or within relative * |want| + absolute */
  /* Share of values that may be off by up to flip_size because rounding changed a decision. */
  double flips;
  double flip_size;
} check_tolerance;

/* Returns the distance in representable floats; 0 and -0 are equal; INT64_MAX if either is NaN. */
int64_t check_ulps(float a, float b);
bool check_close(float got, float want, const check_tolerance *tolerance);
bool check_same_bits(const float *got, const float *want, int64_t count); /* any two NaNs are equal */
/* Compares with the tolerance; where kernel tables must agree to the bit, compares bits. */
#define CHECK_FLOATS(what, got, want, count, ...) \
  check_floats(__FILE__, __LINE__, what, got, want, count, &(check_tolerance){__VA_ARGS__}, CHECK_EXACT)
/* Compares with the tolerance on every build: for results against an oracle. */
#define CHECK_NEAR(what, got, want, count, ...) \
  check_floats(__FILE__, __LINE__, what, got, want, count, &(check_tolerance){__VA_ARGS__}, 0)
/* Compares bits on every build: for the same kernel called in two ways. */
#define CHECK_SAME(what, got, want, count) \
  check_floats(__FILE__, __LINE__, what, got, want, count, &(check_tolerance){.ulp = 0}, 1)
void check_floats(const char *file, int line, const char *what, const float *got, const float *want, int64_t count,
                  const check_tolerance *tolerance, bool exact);

/* ---- Benchmark ---- */

typedef struct check_timer {
  int64_t repeats, left;
  int batches;
  double began, best; /* seconds */
} check_timer;

/* CHECK_BENCH("raster", pairs, "pair") kernels->raster(&in, &out); runs the call only under --bench and prints ns
 * per item. */
#define CHECK_BENCH(what, items, unit) \
  for (check_timer timer = {.repeats = 0}; check_timed(&timer, what, (double)(items), unit);)
bool check_timed(check_timer *timer, const char *what, double items, const char *unit);

#endif
