/* SPDX-License-Identifier: Apache-2.0 */
/* Tests sparse depth from LiDAR for the depth loss: samples lie at the right pixels, and points that the camera
 * doesn't see are left out. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>

#include "train/driving_losses.h"
#include "unit/driving_stub.h"

static int count_wrong(const pags_dataset *d, int step, const pags_lidar_depth_sample *samples, int64_t count) {
  int wrong = 0;
  for (int64_t i = 0; i < count; i++) {
    double truth = stub_depth(d, step, (double)samples[i].x, (double)samples[i].y, 1 << STUB_WALKER);
    wrong += fabs((double)samples[i].depth - truth) > 0.02 * truth + 0.05;
  }
  return wrong;
}

static void samples_have_the_depth_of_their_pixel(void **state) {
  (void)state;
  pags_dataset *d = stub_open();
  pags_lidar_depth_sample *samples;
  int64_t count;
  assert_int_equal(pags_lidar_depth_samples(d, 3, 100000, &count, &samples), PAGS_OK);
  assert_true(count > 1500);
  assert_true(count_wrong(d, 3, samples, count) < 0.02 * (double)count);
  for (int64_t i = 0; i < count; i++)
    assert_true(samples[i].x >= 0 && samples[i].x < STUB_WIDTH && samples[i].y >= 0 && samples[i].y < STUB_HEIGHT);
  free(samples);
  stub_close(d);
}

static void samples_are_limited_and_evenly_spread(void **state) {
  (void)state;
  pags_dataset *d = stub_open();
  pags_lidar_depth_sample *all, *some;
  int64_t count, few;
  assert_int_equal(pags_lidar_depth_samples(d, 3, 100000, &count, &all), PAGS_OK);
  assert_int_equal(pags_lidar_depth_samples(d, 3, 100, &few, &some), PAGS_OK);
  assert_int_equal(few, 100);
  assert_float_equal(some[0].depth, all[0].depth, 0);
  assert_float_equal(some[50].depth, all[count / 2].depth, 0);
  free(all);
  free(some);
  stub_close(d);
}

static void none_without_a_sweep(void **state) {
  (void)state;
  pags_dataset *d = stub_open();
  pags_lidar_depth_sample *samples;
  int64_t count;
  assert_int_equal(pags_lidar_depth_samples(d, STUB_STEPS - 1, 100, &count, &samples), PAGS_OK);
  assert_int_equal(count, 0);
  assert_null(samples);
  stub_close(d);
}

static void held_out_views_have_depth_too(void **state) {
  (void)state;
  pags_dataset *d = stub_open();
  pags_lidar_depth_sample *samples;
  int64_t count;
  assert_int_equal(pags_lidar_depth_samples(d, STUB_HELD_OUT, 100, &count, &samples), PAGS_OK);
  assert_int_equal(count, 100);
  free(samples);
  stub_close(d);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(samples_have_the_depth_of_their_pixel),
      cmocka_unit_test(samples_are_limited_and_evenly_spread),
      cmocka_unit_test(none_without_a_sweep),
      cmocka_unit_test(held_out_views_have_depth_too),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
