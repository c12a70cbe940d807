/* SPDX-License-Identifier: Apache-2.0 */
/* Tests arrays of Gaussians: memory, gathering, Morton order, and rows that can't be drawn. */
#include <pags/gaussians.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>

#include "base/rng.h"
#include "scene/morton.h"

static void fill(pags_gaussians *g, uint64_t seed) {
  for (int p = 0; p < pags_plane_count(g->sh_degree); p++)
    for (int64_t i = 0; i < g->count; i++)
      pags_plane(g, p)[i] = (float)(pags_rng_uniform(seed, (uint64_t)p, (uint64_t)i) * 4 - 2);
}

static void planes_are_zero_and_aligned(void **state) {
  (void)state;
  for (int degree = 0; degree <= 3; degree++) {
    pags_gaussians g;
    assert_int_equal(pags_gaussians_create(&g, 21, degree), PAGS_OK);
    assert_int_equal(g.count, 21);
    assert_int_equal(g.stride, 32);
    for (int p = 0; p < pags_plane_count(degree); p++) {
      assert_int_equal((uintptr_t)pags_plane(&g, p) % 64, 0);
      for (int64_t i = 0; i < g.stride; i++)
        assert_true(pags_plane(&g, p)[i] == 0);
    }
    pags_gaussians_destroy(&g);
    assert_null(g.data);
  }
}

static void empty_and_too_large_arrays(void **state) {
  (void)state;
  pags_gaussians g;
  assert_int_equal(pags_gaussians_create(&g, 0, 3), PAGS_OK);
  assert_null(g.data);
  assert_int_equal(pags_gaussians_morton_order(&g, NULL), PAGS_OK);
  assert_int_equal(pags_gaussians_find_bad(&g, NULL), 0);
  pags_gaussians_destroy(&g);
  assert_int_equal(pags_gaussians_create(&g, INT64_C(1) << 31, 0), PAGS_ERROR_LIMIT);
  assert_null(g.data);
}

static void growing_keeps_everything(void **state) {
  (void)state;
  pags_gaussians g, copy;
  assert_int_equal(pags_gaussians_create(&g, 40, 1), PAGS_OK);
  assert_int_equal(pags_gaussians_add_s_sem(&g), PAGS_OK);
  assert_int_equal(pags_gaussians_add_object_id(&g), PAGS_OK);
  assert_int_equal(pags_gaussians_add_fourier(&g, 0), PAGS_OK);
  fill(&g, 1);
  g.s_sem[39] = 0.5f;
  g.fourier[11 * g.stride + 39] = 3;
  g.fourier[39] = 4;
  g.object_id[39] = 12;
  assert_int_equal(pags_gaussians_create(&copy, 40, 1), PAGS_OK);
  fill(&copy, 1);
  assert_int_equal(pags_gaussians_reserve(&g, 1000), PAGS_OK);
  assert_int_equal(g.stride, 1008);
  assert_int_equal(g.count, 40);
  for (int p = 0; p < pags_plane_count(1); p++) {
    assert_memory_equal(pags_plane(&g, p), pags_plane(&copy, p), 40 * sizeof(float));
    for (int64_t i = 40; i < g.stride; i++)
      assert_true(pags_plane(&g, p)[i] == 0);
  }
  assert_true(g.s_sem[39] == 0.5f && g.s_sem[40] == 0);
  assert_true(g.fourier[11 * g.stride + 39] == 3 && g.fourier[39] == 4 && g.fourier[40] == 0);
  assert_true(g.object_id[39] == 12 && g.object_id[0] == -1 && g.object_id[1007] == -1);
  const float *before = g.data;
  assert_int_equal(pags_gaussians_reserve(&g, 500), PAGS_OK);
  assert_ptr_equal(g.data, before);
  pags_gaussians_destroy(&g);
  pags_gaussians_destroy(&copy);
}

/* The series of all coefficients against sums term by term; coefficients without one keep their value. */
static void series_of_every_coefficient(void **state) {
  (void)state;
  enum { ROWS = 5 };
  pags_gaussians g, grown;
  assert_int_equal(pags_gaussians_create(&g, ROWS, 2), PAGS_OK);
  assert_int_equal(pags_gaussians_add_fourier(&g, 1), PAGS_OK);
  assert_int_equal(pags_fourier_planes(&g), 48);
  fill(&g, 4);
  for (int p = 0; p < 48; p++)
    for (int i = 0; i < ROWS; i++)
      g.fourier[p * g.stride + i] = 0.1F * (float)(p % 7) - 0.05F * (float)i;
  assert_int_equal(pags_gaussians_create_like(&grown, ROWS, &g), PAGS_OK);
  pags_gaussians_gather(&g, (int64_t[]){4, 3, 2, 1, 0}, ROWS, &grown);
  assert_int_equal(pags_gaussians_reserve(&grown, 100), PAGS_OK);
  assert_int_equal(grown.fourier_degree, 1);
  float *const sh = calloc(27 * (size_t)grown.stride, sizeof *sh);
  double basis[5];
  assert_non_null(sh);
  pags_fourier_basis(0.2, basis);
  pags_fourier_colour(&grown, basis, 1, 4, sh);
  for (int c = 0; c < 9; c++)
    for (int channel = 0; channel < 3; channel++)
      for (int i = 0; i < ROWS; i++) {
        const int row = ROWS - 1 - i; /* of g */
        const double a = 6.283185307179586 * 0.2, wave[4] = {sin(a), cos(a), sin(2 * a), cos(2 * a)};
        double sum = (double)pags_plane(&g, PAGS_SH + 3 * c + channel)[row];
        for (int k = 0; k < 4 && c < 4; k++)
          sum += wave[k] * (double)g.fourier[(12 * c + 3 * k + channel) * g.stride + row];
        assert_float_equal(sh[(3 * c + channel) * grown.stride + i], i >= 1 && i < 4 ? (float)sum : 0, 1e-6);
      }
  free(sh);
  pags_gaussians_destroy(&g);
  pags_gaussians_destroy(&grown);
}

/* A coefficient that is 0 but changes over time counts for the degree of its row. */
static void a_series_counts_for_the_degree(void **state) {
  (void)state;
  pags_gaussians g;
  assert_int_equal(pags_gaussians_create(&g, 2, 3), PAGS_OK);
  assert_int_equal(pags_gaussians_add_fourier(&g, 2), PAGS_OK);
  assert_int_equal(pags_gaussians_row_degree(&g, 1), 0);
  g.fourier[(12 * 2 + 11) * g.stride + 1] = 1e-20F; /* the last term of blue of a coefficient of degree 1 */
  assert_int_equal(pags_gaussians_row_degree(&g, 1), 1);
  g.fourier[(12 * 8) * g.stride + 1] = 1;
  assert_int_equal(pags_gaussians_row_degree(&g, 1), 2);
  assert_int_equal(pags_gaussians_row_degree(&g, 0), 0);
  pags_gaussians_destroy(&g);
}

static void gathering_takes_whole_rows(void **state) {
  (void)state;
  pags_gaussians g, out;
  int64_t index[] = {3, 0, 3};
  assert_int_equal(pags_gaussians_create(&g, 4, 3), PAGS_OK);
  assert_int_equal(pags_gaussians_add_object_id(&g), PAGS_OK);
  fill(&g, 2);
  g.object_id[3] = 9;
  assert_int_equal(pags_gaussians_create_like(&out, 3, &g), PAGS_OK);
  assert_non_null(out.object_id);
  assert_null(out.s_sem);
  pags_gaussians_gather(&g, index, 3, &out);
  for (int p = 0; p < PAGS_MAX_PLANES; p++)
    for (int i = 0; i < 3; i++)
      assert_true(pags_plane(&out, p)[i] == pags_plane(&g, p)[index[i]]);
  assert_int_equal(out.object_id[0], 9);
  assert_int_equal(out.object_id[1], -1);
  pags_gaussians_destroy(&g);
  pags_gaussians_destroy(&out);
}

/* The Morton code of row i, computed bit by bit. */
static uint64_t plain_code(const pags_gaussians *g, int64_t i, const double lo[3], double extent) {
  uint64_t code = 0;
  for (int k = 0; k < 3; k++) {
    double cell = floor((pags_plane(g, k)[i] - lo[k]) * (2097152.0 / extent));
    uint64_t whole = cell > 2097151 ? 2097151 : (uint64_t)cell;
    for (int bit = 0; bit < 21; bit++)
      code |= (whole >> bit & 1) << (3 * bit + k);
  }
  return code;
}

static void morton_order_follows_the_codes(void **state) {
  (void)state;
  enum { N = 40000 }; /* several blocks */
  pags_gaussians g;
  static int64_t index[N], on_pool[N];
  assert_int_equal(pags_gaussians_create(&g, N, 0), PAGS_OK);
  fill(&g, 3);
  /* Two equal rows, for ties, and two corners that fix the bounding cube. */
  for (int k = 0; k < 3; k++) {
    pags_plane(&g, k)[100] = pags_plane(&g, k)[4000];
    pags_plane(&g, k)[7] = -2;
    pags_plane(&g, k)[8] = 2;
  }
  pags_plane(&g, 0)[50] = NAN;
  pags_plane(&g, 2)[20] = INFINITY;
  assert_int_equal(pags_gaussians_morton_order(&g, index), PAGS_OK);
  double lo[3] = {-2, -2, -2};
  assert_int_equal(index[N - 2], 20);
  assert_int_equal(index[N - 1], 50);
  for (int i = 0; i + 3 < N; i++) {
    uint64_t here = plain_code(&g, index[i], lo, 4), next = plain_code(&g, index[i + 1], lo, 4);
    assert_true(here < next || (here == next && index[i] < index[i + 1]));
  }
  for (int threads = 1; threads <= 4; threads += 3) {
    pags_tasks *tasks = pags_tasks_create(threads);
    assert_non_null(tasks);
    assert_int_equal(pags_morton_order(&g, tasks, on_pool), PAGS_OK);
    assert_memory_equal(index, on_pool, sizeof index);
    pags_tasks_destroy(tasks);
  }
  pags_gaussians_destroy(&g);
}

static void equal_places_keep_their_order(void **state) {
  (void)state;
  pags_gaussians g;
  int64_t index[50];
  assert_int_equal(pags_gaussians_create(&g, 50, 0), PAGS_OK);
  assert_int_equal(pags_gaussians_morton_order(&g, index), PAGS_OK);
  for (int i = 0; i < 50; i++)
    assert_int_equal(index[i], i);
  pags_gaussians_destroy(&g);
}

static void bad_rows_are_found(void **state) {
  (void)state;
  enum { N = 700 };
  pags_gaussians g;
  int64_t index[N];
  assert_int_equal(pags_gaussians_create(&g, N, 3), PAGS_OK);
  fill(&g, 4);
  pags_plane(&g, PAGS_SH + 47)[699] = NAN;
  pags_plane(&g, PAGS_MEAN)[0] = -INFINITY;
  for (int k = 0; k < 4; k++)
    pags_plane(&g, PAGS_ROTATION + k)[256] = k ? 0.0f : -0.0f;
  assert_int_equal(pags_gaussians_find_bad(&g, NULL), 3);
  assert_int_equal(pags_gaussians_find_bad(&g, index), 3);
  assert_int_equal(index[0], 1);
  assert_int_equal(index[254], 255);
  assert_int_equal(index[255], 257);
  assert_int_equal(index[N - 4], 698);
  pags_gaussians_destroy(&g);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(planes_are_zero_and_aligned),
      cmocka_unit_test(empty_and_too_large_arrays),
      cmocka_unit_test(growing_keeps_everything),
      cmocka_unit_test(series_of_every_coefficient),
      cmocka_unit_test(a_series_counts_for_the_degree),
      cmocka_unit_test(gathering_takes_whole_rows),
      cmocka_unit_test(morton_order_follows_the_codes),
      cmocka_unit_test(equal_places_keep_their_order),
      cmocka_unit_test(bad_rows_are_found),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
