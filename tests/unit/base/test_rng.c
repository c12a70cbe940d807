/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the random number generator: known values, moments and ranges. */
#include "base/rng.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>

/* Compares with the values that Random123 publishes for philox4x32 with 10 rounds. */
static void known_answers(void **state) {
  (void)state;
  static const struct {
    uint64_t seed, a, b;
    uint32_t out[4];
  } answers[] = {
      {0, 0, 0, {0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}},
      {UINT64_MAX, UINT64_MAX, UINT64_MAX, {0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}},
      {0x299f31d0a4093822, 0x85a308d3243f6a88, 0x0370734413198a2e, {0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}},
  };
  for (size_t i = 0; i < sizeof answers / sizeof *answers; i++) {
    uint32_t out[4];
    pags_rng_u32x4(answers[i].seed, answers[i].a, answers[i].b, out);
    assert_memory_equal(out, answers[i].out, sizeof out);
  }
}

static void moments_are_right(void **state) {
  (void)state;
  enum { N = 200000 };
  double mean = 0, square = 0, fourth = 0, cross = 0, uniform = 0, uniform_square = 0;
  for (uint64_t i = 0; i < N; i++) {
    double u = pags_rng_uniform(7, 1, i), z[2];
    pags_rng_normal2(7, 2, i, z);
    assert_true(u >= 0 && u < 1);
    uniform += u / N;
    uniform_square += u * u / N;
    mean += z[0] / N;
    square += z[0] * z[0] / N;
    fourth += pow(z[1], 4) / N;
    cross += z[0] * z[1] / N;
  }
  /* Tolerances are about five standard errors. */
  assert_true(fabs(uniform - 0.5) < 0.0033);
  assert_true(fabs(uniform_square - 1.0 / 3) < 0.0034);
  assert_true(fabs(mean) < 0.0112);
  assert_true(fabs(square - 1) < 0.016);
  assert_true(fabs(fourth - 3) < 0.11);
  assert_true(fabs(cross) < 0.0112);
}

static void below_stays_below_and_reaches_all(void **state) {
  (void)state;
  int seen[7] = {0};
  for (uint64_t i = 0; i < 7000; i++)
    ++seen[pags_rng_below(3, 0, i, 7)];
  for (int k = 0; k < 7; k++)
    assert_in_range(seen[k], 850, 1150);
  for (uint64_t i = 0; i < 1000; i++)
    assert_true(pags_rng_below(3, 1, i, UINT64_C(0xC000000000000001)) < UINT64_C(0xC000000000000001));
  /* Compares floor(x n / 2^64) with a product of 128 bits. */
  __extension__ typedef unsigned __int128 wide;
  for (uint64_t i = 0; i < 1000; i++) {
    uint32_t words[4];
    pags_rng_u32x4(3, 2, i, words);
    uint64_t n = UINT64_C(0x89ABCDEF01234567) >> i % 64 | 1, x = (uint64_t)words[0] << 32 | words[1];
    assert_true(pags_rng_below(3, 2, i, n) == (uint64_t)((wide)x * n >> 64));
  }
}

static void a_permutation_has_each_index_once(void **state) {
  (void)state;
  enum { N = 1000 };
  int64_t index[N], fixed = 0;
  char seen[N] = {0};
  pags_rng_permutation(1, 5, index, N);
  for (int i = 0; i < N; i++) {
    assert_in_range(index[i], 0, N - 1);
    assert_false(seen[index[i]]);
    seen[index[i]] = 1;
    fixed += index[i] == i;
  }
  assert_true(fixed < 10);
  pags_rng_permutation(1, 5, index, 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(known_answers),
      cmocka_unit_test(moments_are_right),
      cmocka_unit_test(below_stays_below_and_reaches_all),
      cmocka_unit_test(a_permutation_has_each_index_once),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
