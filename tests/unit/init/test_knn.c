/* SPDX-License-Identifier: Apache-2.0 */
/* The nearest-neighbour search gives the bits of a search over all pairs. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/rng.h"
#include "init/from_points.h"

static void all_pairs(const float *xyz, int64_t count, float *out) {
  for (int64_t i = 0; i < count; i++) {
    float best[3] = {FLT_MAX, FLT_MAX, FLT_MAX};
    for (int64_t j = 0; j < count; j++) {
      if (i == j)
        continue;
      const float x = xyz[3 * i] - xyz[3 * j], y = xyz[3 * i + 1] - xyz[3 * j + 1], z = xyz[3 * i + 2] - xyz[3 * j + 2];
      const float d = x * x + y * y + z * z;
      if (d < best[0])
        best[2] = best[1], best[1] = best[0], best[0] = d;
      else if (d < best[1])
        best[2] = best[1], best[1] = d;
      else if (d < best[2])
        best[2] = d;
    }
    out[i] = count > 3    ? (best[0] + best[1] + best[2]) / 3.0f
             : count == 3 ? (best[0] + best[1]) / 2.0f
             : count == 2 ? best[0]
                          : 0.0f;
  }
}

enum { UNIFORM, OUTLIERS, DUPLICATES, PLANE, LINE, SAME, KINDS };

static float *make_points(int kind, int64_t count) {
  float *xyz = calloc((size_t)(3 * count + 1), sizeof *xyz);
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 3; k++) {
      float v = (float)(pags_rng_uniform(3, (uint64_t)k, (uint64_t)i) * 10.0 - 5.0);
      if (kind == OUTLIERS) /* a dense cluster, and a few points a million times as far away */
        v *= i % 50 == 0 ? 1e5f : 0.1f;
      if (kind == DUPLICATES)
        v = floorf(v);
      if ((kind == PLANE && k == 1) || (kind == LINE && k > 0) || kind == SAME)
        v = 2.5f;
      xyz[3 * i + k] = v;
    }
  return xyz;
}

static void check(int kind, int64_t count, int threads) {
  float *xyz = make_points(kind, count), *expected = calloc((size_t)count + 1, sizeof *expected);
  float *out = calloc((size_t)count + 1, sizeof *out);
  pags_tasks *tasks = pags_tasks_create(threads);
  all_pairs(xyz, count, expected);
  out[count] = -1.0f;
  assert_int_equal(pags_knn_mean_squared(xyz, count, tasks, out), PAGS_OK);
  assert_memory_equal(out, expected, (size_t)count * sizeof *out);
  assert_true(out[count] == -1.0f);
  pags_tasks_destroy(tasks);
  free(xyz);
  free(expected);
  free(out);
}

static void test_few_points(void **state) {
  (void)state;
  for (int kind = 0; kind < KINDS; kind++)
    for (int64_t count = 0; count < 40; count++)
      check(kind, count, 1);
}

static void test_many_points(void **state) {
  (void)state;
  for (int kind = 0; kind < KINDS; kind++) {
    check(kind, 4000, 1);
    check(kind, 2500, 3);
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_few_points),
      cmocka_unit_test(test_many_points),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
